//! The one typeface of the figures, Noto Sans, carried inside the program, so that a figure looks the same everywhere
//! and text can be measured before it is placed.

use std::sync::{Arc, OnceLock};

use resvg::usvg::{Node, Options, Tree, fontdb::Database};

use super::canvas::escaped;

/// What the SVG names: our typeface, then what a computer without it may have.
pub(super) const FAMILY: &str = "Noto Sans, Helvetica, Arial, sans-serif";

/// Size of titles and axis labels, pt.
pub(super) const LABEL_SIZE: f64 = 7.5;
/// Size of everything smaller, pt.
pub(super) const SMALL_SIZE: f64 = 7.0;

/// Options that know our typeface and nothing of the system's.
pub(super) fn options() -> Options<'static> {
    static FONTS: OnceLock<Arc<Database>> = OnceLock::new();
    let fonts = FONTS.get_or_init(|| {
        let mut fonts = Database::new();
        fonts.load_font_data(notosans::REGULAR_TTF.to_vec());
        fonts.load_font_data(notosans::BOLD_TTF.to_vec());
        fonts.set_sans_serif_family("Noto Sans");
        Arc::new(fonts)
    });
    // One point is one unit.
    Options {
        dpi: 72.0,
        fontdb: fonts.clone(),
        font_family: FAMILY.to_owned(),
        ..Options::default()
    }
}

/// Width of a line of text, pt.
pub(super) fn text_width(text: &str, size: f64, bold: bool) -> f64 {
    let weight = if bold { "bold" } else { "normal" };
    let svg = format!(
        r#"<svg xmlns="http://www.w3.org/2000/svg" width="9999" height="99"><text font-family="{FAMILY}" font-size="{size}" font-weight="{weight}">{}</text></svg>"#,
        escaped(text)
    );
    let tree = Tree::from_str(&svg, &options()).ok();
    let width = tree.and_then(|tree| match tree.root().children().first() {
        Some(Node::Text(text)) => Some(f64::from(text.bounding_box().width())),
        _ => None,
    });
    // Text without a visible letter has no box.
    width.unwrap_or(0.0)
}

/// `text` in lines no wider than `width`, broken at spaces.
pub(super) fn wrapped(text: &str, size: f64, width: f64) -> Vec<String> {
    let mut lines: Vec<String> = Vec::new();
    for word in text.split_whitespace() {
        let longer = lines.last().map(|line| format!("{line} {word}"));
        match (longer, lines.last_mut()) {
            (Some(longer), Some(line)) if text_width(&longer, size, false) <= width => {
                *line = longer;
            }
            _ => lines.push(word.to_owned()),
        }
    }
    lines
}

/// `text`, shortened with an ellipsis until it is no wider than `width`.
pub(super) fn shortened(text: &str, size: f64, bold: bool, width: f64) -> String {
    let mut fitting = text.to_owned();
    let mut letters: Vec<char> = text.chars().collect();
    while text_width(&fitting, size, bold) > width && letters.pop().is_some() {
        fitting = letters.iter().collect::<String>().trim_end().to_owned() + "…";
    }
    fitting
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bold_and_longer_text_is_wider() {
        let plain = text_width("Baoding", 7.0, false);
        assert!(plain > 20.0 && plain < 40.0, "{plain}");
        assert!(text_width("Baoding", 7.0, true) > plain);
        assert!(text_width("Baoding CW", 7.0, false) > plain);
        assert!((text_width("Baoding", 14.0, false) - 2.0 * plain).abs() < 0.1);
    }

    #[test]
    fn lines_are_broken_at_spaces_and_fit() {
        let lines = wrapped("one two three four five six", 7.0, 40.0);
        assert!(lines.len() > 1);
        assert!(lines.iter().all(|line| text_width(line, 7.0, false) <= 40.0));
        assert_eq!(lines.join(" "), "one two three four five six");
    }

    #[test]
    fn a_long_title_ends_in_an_ellipsis() {
        assert_eq!(shortened("Pen", 7.0, true, 100.0), "Pen");
        let title = shortened("A title that is far too long", 7.0, true, 50.0);
        assert!(title.ends_with('…') && text_width(&title, 7.0, true) <= 50.0);
    }
}
