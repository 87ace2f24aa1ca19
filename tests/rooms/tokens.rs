//! Rust text as words and signs, without comments, texts, characters and lifetimes. As much of the grammar as is needed
//! to tell a path from a sentence about one.

/// A word, `::`, or any other single sign, and the line it stands on.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Token {
    pub(crate) text: String,
    pub(crate) line: usize,
}

/// The tokens of `text`.
pub(crate) fn read(text: &str) -> Vec<Token> {
    let signs: Vec<char> = text.chars().collect();
    let at = |index: usize| signs.get(index).copied().unwrap_or('\0');
    let is_word = |c: char| c.is_alphanumeric() || c == '_';
    let mut tokens = Vec::new();
    let (mut index, mut line) = (0, 1);
    while index < signs.len() {
        let start = index;
        let mut token = false;
        match (at(index), at(index + 1)) {
            ('/', '/') => index = find(&signs, index, |i| at(i) == '\n'),
            ('/', '*') => index = end_of_block_comment(&signs, index),
            ('r', '"' | '#') if raw_text_hashes(&signs, index + 1).is_some() => {
                let hashes = raw_text_hashes(&signs, index + 1).unwrap_or(0);
                let closes = |i: usize| at(i) == '"' && (1..=hashes).all(|k| at(i + k) == '#');
                index = find(&signs, index + hashes + 2, closes) + 1 + hashes;
            }
            ('"', _) => {
                index += 1;
                while index < signs.len() && at(index) != '"' {
                    index += if at(index) == '\\' { 2 } else { 1 };
                }
                index += 1;
            }
            // `'\n'` and `'a'` are characters, all else is a lifetime, whose name is skipped.
            ('\'', '\\') => index = find(&signs, index + 3, |i| at(i) == '\'') + 1,
            ('\'', _) if at(index + 2) == '\'' => index += 3,
            ('\'', _) => index = find(&signs, index + 1, |i| !is_word(at(i))),
            (':', ':') => (index, token) = (index + 2, true),
            (c, _) if is_word(c) => {
                (index, token) = (find(&signs, index, |i| !is_word(at(i))), true);
            }
            (c, _) => (index, token) = (index + 1, !c.is_whitespace()),
        }
        let passed = &signs[start..index.min(signs.len())];
        if token {
            tokens.push(Token { text: passed.iter().collect(), line });
        }
        line += passed.iter().filter(|&&c| c == '\n').count();
    }
    tokens
}

/// The first index from `start` on where `found` holds, or the end.
fn find(signs: &[char], start: usize, found: impl Fn(usize) -> bool) -> usize {
    (start..signs.len()).find(|&index| found(index)).unwrap_or(signs.len())
}

/// The number of `#` before the quote that opens a raw text, if one opens at `index`.
fn raw_text_hashes(signs: &[char], index: usize) -> Option<usize> {
    let hashes = signs[index..].iter().take_while(|&&c| c == '#').count();
    (signs.get(index + hashes) == Some(&'"')).then_some(hashes)
}

/// Comments in comments count.
fn end_of_block_comment(signs: &[char], start: usize) -> usize {
    let (mut index, mut depth) = (start, 0);
    while index < signs.len() {
        match (signs[index], signs.get(index + 1)) {
            ('/', Some('*')) => (depth, index) = (depth + 1, index + 2),
            ('*', Some('/')) => (depth, index) = (depth - 1, index + 2),
            _ => index += 1,
        }
        if depth == 0 {
            break;
        }
    }
    index
}
