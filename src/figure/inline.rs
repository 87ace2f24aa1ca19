//! A figure's SVG as a part of an HTML page.
//!
//! The drawing is read as XML and written again: only the elements and attributes that our canvas uses, every text and
//! every value escaped, so nothing in a file can become a script, a link or a request. Anything else is refused by its
//! name. Identifiers get a prefix, because a page holds several drawings. Colours become CSS variables `--c-RRGGBB`, for
//! which [`colour_rules`] gives the values on light and on dark paper.

use std::collections::BTreeSet;
use std::fmt::Write;

use resvg::usvg::roxmltree::{Document, Node};

use super::canvas::escaped;
use super::{FigureError, Theme};

/// Elements of our drawings.
const ELEMENTS: [&str; 8] =
    ["svg", "g", "clipPath", "rect", "circle", "polyline", "polygon", "text"];
/// Attributes of our drawings.
const ATTRIBUTES: [&str; 22] = [
    "width",
    "height",
    "viewBox",
    "x",
    "y",
    "cx",
    "cy",
    "r",
    "points",
    "fill",
    "fill-opacity",
    "stroke",
    "stroke-width",
    "stroke-dasharray",
    "stroke-linejoin",
    "transform",
    "font-family",
    "font-size",
    "font-weight",
    "text-anchor",
    "id",
    "clip-path",
];
/// Our drawings are nested less deeply than this.
const DEEPEST: usize = 8;
/// Values that name a resource, apart from a clip of the drawing itself.
const CLIP: &str = "url(#";

/// A drawing for a page, and the colours it names.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct InlineSvg {
    pub markup: String,
    /// As `RRGGBB`.
    pub colours: BTreeSet<String>,
}

/// Makes `svg` a part of a page; `prefix` tells its identifiers from those of other drawings, `label` says what it shows
/// to those who cannot see it.
pub fn inline_svg(svg: &str, prefix: &str, label: &str) -> Result<InlineSvg, FigureError> {
    let invalid = |what: String| FigureError::InvalidSvg { what };
    let document = Document::parse(svg).map_err(|error| invalid(error.to_string()))?;
    let root = document.root_element();
    if root.tag_name().name() != "svg" {
        return Err(invalid(format!("its root is `{}`", root.tag_name().name())));
    }
    let mut inline =
        InlineSvg { markup: String::with_capacity(svg.len()), colours: BTreeSet::new() };
    let opening = format!(r#" role="img" aria-label="{}""#, escaped(label));
    inline.element(root, prefix, &opening, 0).map_err(invalid)?;
    Ok(inline)
}

impl InlineSvg {
    fn element(
        &mut self,
        node: Node<'_, '_>,
        prefix: &str,
        more: &str,
        depth: usize,
    ) -> Result<(), String> {
        let name = node.tag_name().name();
        if depth > DEEPEST {
            return Err(format!("it is nested more than {DEEPEST} deep"));
        }
        if !ELEMENTS.contains(&name) {
            return Err(format!("there is no `{name}` in our drawings"));
        }
        self.markup.extend(["<", name, more]);
        for attribute in node.attributes() {
            let (name, value) = (attribute.name(), attribute.value());
            if !ATTRIBUTES.contains(&name) {
                return Err(format!("there is no attribute `{name}` in our drawings"));
            }
            let value = match (name, value.strip_prefix(CLIP)) {
                ("id", _) => format!("{prefix}{}", escaped(value)),
                ("clip-path", Some(clip)) => format!("{CLIP}{prefix}{}", escaped(clip)),
                (_, _) if value.contains("url(") => {
                    return Err(format!("`{name}` names another resource"));
                }
                _ => self.colour(value).unwrap_or_else(|| escaped(value)),
            };
            let written = write!(self.markup, r#" {name}="{value}""#);
            written.map_err(|error| error.to_string())?;
        }
        self.markup.push('>');
        for child in node.children() {
            if child.is_element() {
                self.element(child, prefix, "", depth + 1)?;
            } else if let Some(text) = child.text().filter(|_| child.is_text()) {
                self.markup.push_str(&escaped(text));
            }
        }
        self.markup.extend(["</", name, ">"]);
        Ok(())
    }

    /// The variable that stands for a colour.
    fn colour(&mut self, value: &str) -> Option<String> {
        let digits = value.strip_prefix('#')?;
        let is_colour = digits.len() == 6 && digits.bytes().all(|byte| byte.is_ascii_hexdigit());
        is_colour.then(|| {
            let digits = digits.to_ascii_uppercase();
            let variable = format!("var(--c-{digits})");
            self.colours.insert(digits);
            variable
        })
    }
}

/// CSS that gives every one of `colours` its value in `theme`.
#[must_use]
pub fn colour_rules(colours: &BTreeSet<String>, theme: Theme) -> String {
    let rule = |digits: &String| format!("--c-{digits}:{};", theme.colour(&format!("#{digits}")));
    colours.iter().map(rule).collect()
}

#[cfg(test)]
mod tests {
    use super::super::palette::{BLACK, BLUE, WHITE};
    use super::*;

    const OURS: &str = r##"<svg xmlns="http://www.w3.org/2000/svg" width="10pt" height="9pt" viewBox="0 0 10 9">
<rect width="10" height="9" fill="#FFFFFF"/>
<clipPath id="clip1"><rect x="0" y="0" width="1" height="1"/></clipPath>
<g clip-path="url(#clip1)"><polyline points="0,0 1,1" fill="none" stroke="#4C72B0"/></g>
<text x="1" y="2" fill="#1A1A1A">a &lt;b&gt; &amp; "c"</text></svg>"##;

    #[test]
    fn a_drawing_keeps_its_text_and_gets_its_own_identifiers_and_colours() {
        let inline = inline_svg(OURS, "f3-", "a & b").unwrap();
        for part in [
            r#"<clipPath id="f3-clip1">"#,
            r#"clip-path="url(#f3-clip1)""#,
            r#"stroke="var(--c-4C72B0)""#,
            "a &lt;b&gt; &amp; &quot;c&quot;",
            r#"aria-label="a &amp; b""#,
        ] {
            assert!(inline.markup.contains(part), "{part} in {}", inline.markup);
        }
        let light = colour_rules(&inline.colours, Theme::Light);
        assert_eq!(light, format!("--c-1A1A1A:{BLACK};--c-4C72B0:{BLUE};--c-FFFFFF:{WHITE};"));
        assert_ne!(colour_rules(&inline.colours, Theme::Dark), light);
    }

    #[test]
    fn what_is_no_drawing_of_ours_is_refused_by_its_name() {
        let inside =
            |part: &str| OURS.replace("<rect width=\"10\"", &format!("{part}<rect width=\"10\""));
        for (svg, said) in [
            (inside("<script>alert(1)</script>"), "script"),
            (inside("<image href=\"http://x/y.png\"/>"), "image"),
            (inside("<foreignObject/>"), "foreignObject"),
            (inside("<rect onload=\"alert(1)\"/>"), "onload"),
            (inside("<rect style=\"fill:url(http://x)\"/>"), "style"),
            (inside("<rect fill=\"url(http://x/y)\"/>"), "fill"),
            (inside("<a href=\"http://x\">y</a>"), "`a`"),
            (OURS.replace("<svg", "<html").replace("</svg", "</html"), "html"),
            (inside(&format!("{}{}", "<g>".repeat(999), "</g>".repeat(999))), "nested"),
            ("<svg".to_owned(), "SVG"),
            (format!("<!DOCTYPE svg [<!ENTITY a \"b\">]>{OURS}"), "DTD"),
        ] {
            let error = inline_svg(&svg, "f-", "x").unwrap_err().to_string();
            assert!(error.contains(said), "{said}: {error}");
        }
    }

    #[test]
    fn comments_and_what_would_close_an_attribute_do_not_come_through() {
        let svg = OURS.replace("a &lt;b", "<!-- --><![CDATA[</svg><script>]]>");
        let inline = inline_svg(&svg, "f-", "\"><script>").unwrap();
        assert!(!inline.markup.contains("<script") && !inline.markup.contains("<!--"));
        assert!(inline.markup.contains("&lt;/svg&gt;&lt;script&gt;"));
    }
}
