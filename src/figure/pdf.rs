//! One form for one page: the objects of a PDF in a fixed order.
//!
//! svg2pdf 0.13 keeps fonts and resources in hash maps, whose order changes from run to run, so the same page comes out
//! as different files. Nothing but that order differs. Here the entries of each resource dictionary are sorted by name
//! and the objects are numbered as they are first met on the way from the document's root, then written in that order.
//!
//! Reads what that library writes (one cross-reference table, one dictionary entry per line, no object streams) and
//! nothing else: on any other structure the answer is `None`.

/// How a dictionary refers to another object: its number, then this.
const REFERENCE: &[u8] = b" 0 R";

/// An object: its dictionary, and the rest (a stream, the closing word), which refers to nothing.
struct Object<'a> {
    dictionary: Vec<u8>,
    rest: &'a [u8],
}

/// The same document in its one form.
pub(super) fn in_fixed_order(pdf: &[u8]) -> Option<Vec<u8>> {
    let table = usize::try_from(number_after(pdf, b"startxref\n")?).ok()?;
    let offsets = offsets(pdf.get(table..)?)?;
    let first = *offsets.iter().min()?;
    let objects: Vec<Object> =
        offsets.iter().map(|&start| object(pdf, start, &offsets, table)).collect::<Option<_>>()?;
    let trailer = pdf.get(table..)?;
    let roots = [number_after(trailer, b"/Root ")?, number_after(trailer, b"/Info ")?];

    let order = order_of_first_mention(&objects, &roots)?;
    let mut new_numbers = vec![None; objects.len() + 1];
    for (new, &old) in (1_u64..).zip(&order) {
        *new_numbers.get_mut(old)? = Some(new);
    }
    let renumber = |old: u64| *new_numbers.get(usize::try_from(old).ok()?)?;

    let mut written = pdf.get(..first)?.to_vec();
    let mut new_offsets = Vec::with_capacity(order.len());
    for (new, &old) in (1..).zip(&order) {
        let object = objects.get(old.checked_sub(1)?)?;
        new_offsets.push(written.len());
        written.extend(format!("{new} 0 obj\n").bytes());
        written.extend(with_references(&object.dictionary, renumber)?);
        written.extend(object.rest);
    }
    let table = written.len();
    let size = order.len() + 1;
    written.extend(format!("xref\n0 {size}\n0000000000 65535 f\r\n").bytes());
    for offset in new_offsets {
        written.extend(format!("{offset:010} 00000 n\r\n").bytes());
    }
    let [root, info] = [renumber(roots[0])?, renumber(roots[1])?];
    let trailer = format!("<<\n  /Size {size}\n  /Root {root} 0 R\n  /Info {info} 0 R\n>>");
    written.extend(format!("trailer\n{trailer}\nstartxref\n{table}\n%%EOF").bytes());
    Some(written)
}

/// Where the objects 1, 2, … start, from the cross-reference table.
fn offsets(table: &[u8]) -> Option<Vec<usize>> {
    let header = table.strip_prefix(b"xref\n0 ")?;
    let count = usize::try_from(leading_number(header)?).ok()?;
    let entries = &header[header.iter().position(|&byte| byte == b'\n')? + 1..];
    let entries = entries.get(..count.checked_mul(20)?)?.chunks_exact(20).skip(1);
    entries
        .map(|entry| (entry[17] == b'n').then(|| usize::try_from(leading_number(entry)?).ok())?)
        .collect()
}

/// The object that starts at `start` and ends where the next one, or the table, starts.
fn object<'a>(pdf: &'a [u8], start: usize, offsets: &[usize], table: usize) -> Option<Object<'a>> {
    let end = offsets.iter().copied().filter(|&offset| offset > start).min().unwrap_or(table);
    let bytes = pdf.get(start..end)?;
    let bytes = &bytes[find(bytes, b" obj\n")? + 5..];
    let dictionary_end =
        find(bytes, b"stream\n").into_iter().chain(find(bytes, b"endobj")).min()?;
    let (dictionary, rest) = bytes.split_at(dictionary_end);
    Some(Object { dictionary: sorted_resources(dictionary), rest })
}

/// Sorts neighbouring lines that name a resource, like `/gs4 12 0 R`.
fn sorted_resources(dictionary: &[u8]) -> Vec<u8> {
    let mut lines: Vec<&[u8]> = dictionary.split_inclusive(|&byte| byte == b'\n').collect();
    for run in lines.chunk_by_mut(|one, two| resource(one).is_some() && resource(two).is_some()) {
        run.sort_by_key(|line| resource(line));
    }
    lines.concat()
}

/// Kind and number of the resource that a line names.
fn resource(line: &[u8]) -> Option<(&[u8], u64)> {
    let name = line.trim_ascii().strip_prefix(b"/")?;
    let digits = name.iter().position(u8::is_ascii_digit)?;
    let (kind, rest) = name.split_at(digits);
    let is_resource = kind.iter().all(u8::is_ascii_lowercase) && rest.ends_with(REFERENCE);
    is_resource.then(|| Some((kind, leading_number(rest)?)))?
}

/// The numbers of all objects that can be reached, in the order in which they are first mentioned.
fn order_of_first_mention(objects: &[Object], roots: &[u64]) -> Option<Vec<usize>> {
    let mut order = Vec::new();
    let mut is_known = vec![false; objects.len() + 1];
    let mut waiting: Vec<usize> =
        roots.iter().rev().map(|&root| usize::try_from(root).ok()).collect::<Option<_>>()?;
    while let Some(number) = waiting.pop() {
        if std::mem::replace(is_known.get_mut(number)?, true) {
            continue;
        }
        order.push(number);
        let mut mentioned = Vec::new();
        with_references(&objects.get(number.checked_sub(1)?)?.dictionary, |reference| {
            mentioned.push(usize::try_from(reference).ok()?);
            Some(reference)
        })?;
        waiting.extend(mentioned.into_iter().rev());
    }
    Some(order)
}

/// The dictionary with every reference replaced.
fn with_references(
    dictionary: &[u8],
    mut replace: impl FnMut(u64) -> Option<u64>,
) -> Option<Vec<u8>> {
    let mut written = Vec::with_capacity(dictionary.len());
    let mut rest = dictionary;
    while let Some(at) = find(rest, REFERENCE) {
        let digits = rest[..at].iter().rev().take_while(|byte| byte.is_ascii_digit()).count();
        let (before, number) = rest[..at].split_at(at - digits);
        written.extend(before);
        written.extend(replace(leading_number(number)?)?.to_string().bytes());
        written.extend(REFERENCE);
        rest = &rest[at + REFERENCE.len()..];
    }
    written.extend(rest);
    Some(written)
}

/// The number after the last occurrence of `key`.
fn number_after(bytes: &[u8], key: &[u8]) -> Option<u64> {
    let at = bytes.windows(key.len()).rposition(|window| window == key)?;
    leading_number(&bytes[at + key.len()..])
}

/// The decimal number that `bytes` begin with.
fn leading_number(bytes: &[u8]) -> Option<u64> {
    let digits = bytes.iter().take_while(|byte| byte.is_ascii_digit()).count();
    std::str::from_utf8(&bytes[..digits]).ok()?.parse().ok()
}

fn find(bytes: &[u8], pattern: &[u8]) -> Option<usize> {
    bytes.windows(pattern.len()).position(|window| window == pattern)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A document of four objects, written by hand in the order given.
    fn document(objects: &[(u32, &str)], trailer: &str) -> Vec<u8> {
        let mut bytes = b"%PDF-1.7\n".to_vec();
        let mut offsets = vec![0; objects.len() + 1];
        for (number, body) in objects {
            offsets[*number as usize] = bytes.len();
            bytes.extend(format!("{number} 0 obj\n{body}endobj\n\n").bytes());
        }
        let table = bytes.len();
        bytes.extend(format!("xref\n0 {}\n0000000000 65535 f\r\n", offsets.len()).bytes());
        for offset in &offsets[1..] {
            bytes.extend(format!("{offset:010} 00000 n\r\n").bytes());
        }
        bytes.extend(format!("trailer\n<<\n{trailer}>>\nstartxref\n{table}\n%%EOF").bytes());
        bytes
    }

    #[test]
    fn numbering_and_order_of_resources_do_not_matter() {
        let stream = "<<\n  /Length 8\n>>\nstream\n 9 0 R \n\nendstream\n";
        let one = document(
            &[
                (1, "<<\n  /gs0 2 0 R\n  /gs10 3 0 R\n  /gs2 4 0 R\n>>\n"),
                (2, "<<\n  /a 0\n>>\n"),
                (3, "<<\n  /b 0\n>>\n"),
                (4, stream),
                (5, "<<\n>>\n"),
            ],
            "  /Root 1 0 R\n  /Info 5 0 R\n",
        );
        let two = document(
            &[
                (4, "<<\n>>\n"),
                (1, stream),
                (2, "<<\n  /b 0\n>>\n"),
                (5, "<<\n  /gs2 1 0 R\n  /gs0 3 0 R\n  /gs10 2 0 R\n>>\n"),
                (3, "<<\n  /a 0\n>>\n"),
            ],
            "  /Root 5 0 R\n  /Info 4 0 R\n",
        );
        let fixed = in_fixed_order(&one).unwrap();
        assert_eq!(fixed, in_fixed_order(&two).unwrap());
        assert_eq!(fixed, in_fixed_order(&fixed).unwrap(), "it is its own fixed order");
        let text = String::from_utf8(fixed).unwrap();
        assert!(text.contains("/gs0 2 0 R\n  /gs2 3 0 R\n  /gs10 4 0 R"), "{text}");
        assert!(text.contains("stream\n 9 0 R \n\nendstream"), "streams stay as they are");
    }

    #[test]
    fn what_is_no_such_document_is_refused() {
        assert_eq!(in_fixed_order(b""), None);
        assert_eq!(in_fixed_order(b"%PDF-1.7\nstartxref\n999\n%%EOF"), None);
        let dangling = document(&[(1, "<<\n  /x 7 0 R\n>>\n")], "  /Root 1 0 R\n  /Info 1 0 R\n");
        assert_eq!(in_fixed_order(&dangling), None);
    }
}
