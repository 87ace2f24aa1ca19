//! A gallery: one Markdown page with a picture of every figure that there is, shown as it is by whatever shows Markdown.

use std::fmt::Write;

/// A figure of the page.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Picture {
    /// As `Fig. 3B`, or the command that drew it.
    pub title: String,
    pub shows: String,
    /// Where its numbers are from.
    pub from: String,
    /// Name of its files, without extension; the SVG of that name is shown.
    pub stem: String,
    /// Extensions of its files besides.
    pub others: Vec<String>,
}

/// The page; `made_by` is the command that makes it again.
#[must_use]
pub fn page(pictures: &[Picture], made_by: &str) -> String {
    let mut page = format!("# Gallery\n\nMade by {}.\n", code(made_by));
    for picture in pictures {
        let Picture { title, shows, from, stem, others } = picture;
        let (title, shows, from) = (plain(title), plain(shows), plain(from));
        let colon = if shows.is_empty() { "" } else { ": " };
        let links = others.iter().map(|extension| {
            format!("[{}]({}.{extension})", extension.to_uppercase(), address(stem))
        });
        let _infallible = write!(
            page,
            "\n## {title}{colon}{shows}\n\n![{title}{colon}{shows}]({}.svg)\n\nFrom {from}. {}\n",
            address(stem),
            links.collect::<Vec<_>>().join(" · ")
        );
    }
    page
}

/// A command as Markdown shows code: nothing in it is markup but the fence around it.
fn code(command: &str) -> String {
    let shown: String = command.chars().filter(|letter| !letter.is_control()).collect();
    if shown.contains('`') { format!("``` {shown} ```") } else { format!("`{shown}`") }
}

/// Text that Markdown takes for nothing but text.
fn plain(text: &str) -> String {
    let special = |letter: char| "\\`*_[]<>#|!".contains(letter);
    let shown = text.chars().filter(|letter| !letter.is_control());
    shown.flat_map(|letter| special(letter).then_some('\\').into_iter().chain([letter])).collect()
}

/// A file's name as an address.
fn address(name: &str) -> String {
    let mut address = String::new();
    for byte in name.bytes() {
        if byte.is_ascii_alphanumeric() || b"-_.~".contains(&byte) {
            address.push(byte.into());
        } else {
            let _infallible = write!(address, "%{byte:02X}");
        }
    }
    address
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_picture_is_there_and_no_name_is_taken_for_markup() {
        let picture = |stem: &str| Picture {
            title: "Fig. 3B".to_owned(),
            shows: "a_b <i>".to_owned(),
            from: "run csi-1".to_owned(),
            stem: stem.to_owned(),
            others: vec!["pdf".to_owned()],
        };
        let page = page(&[picture("radar"), picture("a b)")], "arnold-analyze figures fig3b_radar");
        assert!(page.contains("Made by `arnold-analyze figures fig3b_radar`."));
        assert!(page.contains("## Fig. 3B: a\\_b \\<i\\>\n"));
        assert!(page.contains("](radar.svg)") && page.contains("[PDF](radar.pdf)"));
        assert!(page.contains("](a%20b%29.svg)"));
    }
}
