//! What goes to stdout and stderr: tables, JSON, errors with their hint.

use std::io::{IsTerminal, Write};

use crate::assets::AssetError;

/// An error for the person at the front desk, together with what to type next.
#[derive(Debug, thiserror::Error)]
#[error("{message}")]
pub struct Hinted {
    /// What went wrong, where.
    pub message: String,
    /// What to do about it.
    pub hint: String,
}

impl Hinted {
    /// An error with its remedy, ready for `?`.
    #[expect(clippy::new_ret_no_self, reason = "it is only ever made to be returned as an error")]
    pub fn new(message: impl Into<String>, hint: impl Into<String>) -> anyhow::Error {
        anyhow::Error::new(Self { message: message.into(), hint: hint.into() })
    }
}

/// Colours of words that a person looks for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Paint {
    Error,
    Hint,
}

/// `word` in its colour if `wanted`.
fn painted(word: &str, paint: Paint, wanted: bool) -> String {
    let code = match paint {
        Paint::Error => "1;31",
        Paint::Hint => "1;36",
    };
    if wanted { format!("\x1b[{code}m{word}\x1b[0m") } else { word.to_owned() }
}

/// Whether stderr shows colours: it is a terminal, and `NO_COLOR` is not set (<https://no-color.org>).
fn wants_colours() -> bool {
    let refuses = std::env::var_os("NO_COLOR").is_some_and(|value| !value.is_empty());
    std::io::stderr().is_terminal() && !refuses
}

/// Prints `error: …` and, after a blank line, `hint: …` if there is one.
pub fn print_error(error: &anyhow::Error) {
    let hint = error.chain().find_map(|cause| {
        let written = cause.downcast_ref::<Hinted>().map(|hinted| hinted.hint.clone());
        written.or_else(|| cause.downcast_ref::<AssetError>().map(AssetError::hint))
    });
    let colours = wants_colours();
    eprintln!("{} {}", painted("error:", Paint::Error, colours), message(error));
    if let Some(hint) = hint {
        eprintln!("\n{} {hint}", painted("hint:", Paint::Hint, colours));
    }
}

/// Prints what is wrong with the arguments, ending like every other error: with what to type next.
pub fn print_usage_error(error: &clap::Error) {
    let text = error.render().to_string();
    eprint!(
        "{}",
        text.replace(
            "For more information, try '--help'.",
            "hint: `--help` lists what can be given"
        )
    );
}

/// The whole chain of causes in one sentence, each said once: many errors already quote their cause.
fn message(error: &anyhow::Error) -> String {
    error.chain().map(ToString::to_string).fold(String::new(), |said, cause| match said.as_str() {
        "" => cause,
        _ if said.contains(&cause) => said,
        _ => format!("{said}: {cause}"),
    })
}

/// Whether the reader of stdout went away, as `… | head` does: nobody is left to tell.
#[must_use]
pub fn is_closed_pipe(error: &anyhow::Error) -> bool {
    error.chain().any(|cause| {
        let kind = cause.downcast_ref::<std::io::Error>().map(std::io::Error::kind);
        let json =
            cause.downcast_ref::<serde_json::Error>().and_then(serde_json::Error::io_error_kind);
        kind.or(json) == Some(std::io::ErrorKind::BrokenPipe)
    })
}

/// Prints one JSON document to stdout, indented by two spaces.
pub fn print_json(document: &serde_json::Value) -> anyhow::Result<()> {
    let mut stdout = std::io::stdout().lock();
    serde_json::to_writer_pretty(&mut stdout, document)?;
    Ok(writeln!(stdout)?)
}

/// Prints text to stdout.
pub fn print_text(text: &str) -> anyhow::Result<()> {
    Ok(std::io::stdout().lock().write_all(text.as_bytes())?)
}

/// Alignment of a table's column.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Align {
    Left,
    Right,
}

/// A plain-text table: header, a rule, rows; columns two spaces apart.
#[must_use]
pub fn table(columns: &[(&str, Align)], rows: &[Vec<String>]) -> String {
    let width = |text: &str| text.chars().count();
    let widths: Vec<usize> = columns
        .iter()
        .enumerate()
        .map(|(i, (title, _))| {
            rows.iter()
                .filter_map(|row| row.get(i))
                .map(|c| width(c))
                .fold(width(title), usize::max)
        })
        .collect();
    let line = |cells: &mut dyn Iterator<Item = &str>| {
        let mut text = String::new();
        for ((cell, &(_, align)), &column) in cells.zip(columns).zip(&widths) {
            let pad = " ".repeat(column.saturating_sub(width(cell)));
            match align {
                Align::Left => text.extend([cell, &pad, "  "]),
                Align::Right => text.extend([&pad, cell, "  "]),
            }
        }
        text.truncate(text.trim_end().len());
        text.push('\n');
        text
    };
    let mut text = line(&mut columns.iter().map(|(title, _)| *title));
    let rule: Vec<String> = widths.iter().map(|&n| "─".repeat(n)).collect();
    text += &line(&mut rule.iter().map(String::as_str));
    for row in rows {
        text += &line(&mut row.iter().map(String::as_str));
    }
    text
}

/// The `warnings` of a result document below an empty line, each from a line of its own on.
#[must_use]
pub fn warnings(result: &serde_json::Value) -> String {
    let warnings = result["warnings"].as_array().into_iter().flatten();
    let lines: String = warnings
        .filter_map(|warning| Some(wrapped(&format!("warning: {}", warning.as_str()?))))
        .collect();
    if lines.is_empty() { lines } else { format!("\n{lines}") }
}

/// `text` in lines as wide as a terminal, where its words allow, all but the first indented.
fn wrapped(text: &str) -> String {
    const WIDTH: usize = 80;
    let mut lines = String::new();
    let mut used = 0;
    for word in text.split_whitespace() {
        let length = word.chars().count();
        let gap = match used {
            0 => "",
            _ if used + 1 + length <= WIDTH => " ",
            _ => "\n  ",
        };
        used = if gap.starts_with('\n') { 2 } else { used + gap.len() } + length;
        lines.extend([gap, word]);
    }
    lines.push('\n');
    lines
}

/// A command to type, in lines no wider than a terminal where its words allow, which a shell joins again.
#[must_use]
pub fn command_lines(command: &str) -> String {
    const WIDTH: usize = 76;
    let mut lines = String::from("    ");
    let mut used = 4;
    for (place, word) in command.split(' ').enumerate() {
        let length = word.chars().count();
        if place > 0 && (used + 1 + length > WIDTH || word == "--run") {
            lines += " \\\n      ";
            used = 6;
        } else if place > 0 {
            lines.push(' ');
            used += 1;
        }
        lines += word;
        used += length;
    }
    lines.push('\n');
    lines
}

/// A number with so many decimals; a dash where it is undefined.
#[must_use]
pub fn number(value: &serde_json::Value, digits: usize) -> String {
    value.as_f64().map_or_else(|| "–".to_owned(), |x| format!("{x:.digits$}"))
}

/// A p value: four decimals, and below what they can show, the bound.
#[must_use]
pub fn probability(value: &serde_json::Value) -> String {
    match value.as_f64() {
        None => "–".to_owned(),
        Some(p) if p < 0.000_05 => "<.0001".to_owned(),
        Some(p) => format!("{p:.4}"),
    }
}

/// A whole number with its digits in groups of three.
#[must_use]
pub fn grouped(number: u64) -> String {
    let digits = number.to_string();
    let mut text = String::new();
    for (index, digit) in digits.chars().enumerate() {
        if index > 0 && (digits.len() - index).is_multiple_of(3) {
            text.push(',');
        }
        text.push(digit);
    }
    text
}

/// A curve of numbers in 0..1 as one line of at most `most` blocks; undefined values are gaps. Of more values, evenly
/// spaced ones are shown, the first and the last among them.
#[must_use]
pub fn sparkline(values: &[f64], most: usize) -> String {
    const BLOCKS: [char; 8] = ['▁', '▂', '▃', '▄', '▅', '▆', '▇', '█'];
    let (count, last) = (values.len().min(most), values.len().saturating_sub(1));
    (0..count)
        .map(|place| if count > 1 { values[place * last / (count - 1)] } else { values[last] })
        .map(|x| if x.is_nan() { ' ' } else { BLOCKS[((x.clamp(0.0, 1.0) * 8.0) as usize).min(7)] })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn long_warnings_are_wrapped_between_words() {
        let word = "abcdefg ".repeat(12);
        let text = warnings(&serde_json::json!({ "warnings": [word.trim(), "short"] }));
        let lines: Vec<&str> = text.lines().collect();
        assert_eq!(lines.len(), 4);
        assert!(lines[0].is_empty() && lines[2].starts_with("  abcdefg"));
        assert!(lines[1].len() <= 80 && lines[1].len() > 72, "{}", lines[1].len());
        assert_eq!(lines[3], "warning: short");
        assert_eq!(warnings(&serde_json::json!({ "warnings": [] })), "");
    }

    #[test]
    fn a_long_command_is_broken_where_a_shell_joins_it() {
        let command = format!("program --runs {}", "folder/name ".repeat(12).trim());
        let lines = command_lines(&command);
        assert!(lines.lines().count() > 1 && lines.lines().all(|line| line.len() <= 80), "{lines}");
        let joined = lines.replace("\\\n", "");
        assert_eq!(joined.split_whitespace().collect::<Vec<_>>().join(" "), command);
    }

    #[test]
    fn a_curve_keeps_its_ends_and_its_gaps() {
        assert_eq!(sparkline(&[0.0, 0.5, f64::NAN, 1.0], 9), "▁▅ █");
        let rising: Vec<f64> = (0..80).map(|i| f64::from(i) / 79.0).collect();
        let line: Vec<char> = sparkline(&rising, 32).chars().collect();
        assert_eq!((line.len(), line[0], line[31]), (32, '▁', '█'));
        assert!(line.is_sorted());
        assert_eq!(sparkline(&[], 5), "");
        assert_eq!(sparkline(&[0.2], 1), "▂");
    }

    #[test]
    fn words_are_coloured_only_where_colours_are_wanted() {
        assert_eq!(painted("error:", Paint::Error, true), "\x1b[1;31merror:\x1b[0m");
        assert_eq!(painted("hint:", Paint::Hint, false), "hint:");
    }
}
