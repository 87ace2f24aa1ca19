//! A sheet to draw on, which becomes SVG text.
//!
//! Lengths are points, y points down. Every number has at most two decimals, elements come in the order they were
//! drawn, and nothing is named after a clock or a counter of the process: the same drawing is the same bytes. What is
//! not a finite number is not drawn: lines break there, other marks are left out.

use std::fmt::Write;

use super::fonts::FAMILY;
use super::palette::{BLACK, WHITE};

/// A position, pt.
pub(super) type Point = (f64, f64);

/// How a line looks.
#[derive(Debug, Clone, Copy)]
pub(super) struct Stroke {
    pub(super) colour: &'static str,
    pub(super) width: f64,
    pub(super) dashed: bool,
}

impl Stroke {
    /// A solid line.
    pub(super) fn solid(colour: &'static str, width: f64) -> Self {
        Self { colour, width, dashed: false }
    }

    /// A dashed line.
    pub(super) fn dashed(colour: &'static str, width: f64) -> Self {
        Self { colour, width, dashed: true }
    }

    fn attributes(&self) -> String {
        let dashes = if self.dashed { r#" stroke-dasharray="2.4 1.6""# } else { "" };
        let Self { colour, width, .. } = self;
        format!(r#"fill="none" stroke="{colour}" stroke-width="{}"{dashes}"#, decimal(*width, 2))
    }
}

/// Which part of a text lies at its position.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Anchor {
    Start,
    Middle,
    End,
}

/// How text looks.
#[derive(Debug, Clone, Copy)]
pub(super) struct TextStyle {
    pub(super) size: f64,
    pub(super) anchor: Anchor,
    pub(super) colour: &'static str,
    pub(super) bold: bool,
    /// Clockwise, degrees.
    pub(super) rotation: f64,
}

impl TextStyle {
    /// Upright black text.
    pub(super) fn new(size: f64, anchor: Anchor) -> Self {
        Self { size, anchor, colour: BLACK, bold: false, rotation: 0.0 }
    }
}

/// A rectangle, pt.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Area {
    pub(super) left: f64,
    pub(super) top: f64,
    pub(super) width: f64,
    pub(super) height: f64,
}

impl Area {
    pub(super) fn right(&self) -> f64 {
        self.left + self.width
    }

    pub(super) fn bottom(&self) -> f64 {
        self.top + self.height
    }

    /// The same area with a margin around it.
    pub(super) fn grown(&self, margin: f64) -> Self {
        Self {
            left: self.left - margin,
            top: self.top - margin,
            width: self.width + 2.0 * margin,
            height: self.height + 2.0 * margin,
        }
    }
}

/// The sheet.
#[derive(Debug)]
pub(super) struct Canvas {
    width: f64,
    height: f64,
    body: String,
    clips: usize,
}

impl Canvas {
    pub(super) fn new(width: f64, height: f64) -> Self {
        Self { width, height, body: String::new(), clips: 0 }
    }

    /// The finished SVG.
    pub(super) fn finish(self) -> String {
        let (width, height) = (decimal(self.width, 2), decimal(self.height, 2));
        format!(
            "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{width}pt\" height=\"{height}pt\" \
             viewBox=\"0 0 {width} {height}\" font-family=\"{FAMILY}\">\n\
             <rect width=\"{width}\" height=\"{height}\" fill=\"{WHITE}\"/>\n{}</svg>\n",
            self.body
        )
    }

    fn add(&mut self, element: &str) {
        self.body.push_str(element);
        self.body.push('\n');
    }

    pub(super) fn line(&mut self, from: Point, to: Point, stroke: Stroke) {
        self.polyline(&[from, to], stroke);
    }

    /// A line through `points`, broken where one is undefined. A point alone between gaps becomes a dot.
    pub(super) fn polyline(&mut self, points: &[Point], stroke: Stroke) {
        for run in points.split(|point| !is_finite(*point)) {
            match run {
                [] => {}
                [alone] => self.circle(*alone, 0.75 * stroke.width, stroke.colour),
                _ => {
                    let path = path(run);
                    let attributes = stroke.attributes();
                    self.add(&format!(
                        r#"<polyline points="{path}" {attributes} stroke-linejoin="round"/>"#
                    ));
                }
            }
        }
    }

    /// The area between two lines with points above each other, broken where one is undefined.
    pub(super) fn band(&mut self, lower: &[Point], upper: &[Point], colour: &str) {
        let pairs: Vec<(Point, Point)> = lower.iter().copied().zip(upper.iter().copied()).collect();
        for run in pairs.split(|(low, high)| !is_finite(*low) || !is_finite(*high)) {
            if run.len() < 2 {
                continue;
            }
            let there = run.iter().map(|(low, _)| *low);
            let back = run.iter().rev().map(|(_, high)| *high);
            let outline = path(&there.chain(back).collect::<Vec<_>>());
            self.add(&format!(
                r#"<polygon points="{outline}" fill="{colour}" fill-opacity="0.2"/>"#
            ));
        }
    }

    pub(super) fn rectangle(&mut self, area: Area, colour: &str, opacity: f64) {
        let Area { left, top, width, height } = area;
        if ![left, top, width, height].iter().all(|x| x.is_finite()) {
            return;
        }
        let opacity =
            if opacity < 1.0 { format!(r#" fill-opacity="{opacity}""#) } else { String::new() };
        self.add(&format!(
            r#"<rect x="{}" y="{}" width="{}" height="{}" fill="{colour}"{opacity}/>"#,
            decimal(left, 2),
            decimal(top, 2),
            decimal(width, 2),
            decimal(height, 2)
        ));
    }

    pub(super) fn circle(&mut self, centre: Point, radius: f64, colour: &str) {
        if is_finite(centre) && radius.is_finite() {
            let (x, y, radius) = (decimal(centre.0, 2), decimal(centre.1, 2), decimal(radius, 2));
            self.add(&format!(r#"<circle cx="{x}" cy="{y}" r="{radius}" fill="{colour}"/>"#));
        }
    }

    /// A circle filled with paper, to be seen on any ground.
    pub(super) fn ring(&mut self, centre: Point, radius: f64, colour: &'static str) {
        self.circle(centre, radius + 0.3, colour);
        self.circle(centre, radius - 0.3, WHITE);
    }

    /// One line of text with its baseline at `position`.
    pub(super) fn text(&mut self, position: Point, text: &str, style: TextStyle) {
        if !is_finite(position) {
            return;
        }
        let (x, y) = (decimal(position.0, 2), decimal(position.1, 2));
        let anchor = match style.anchor {
            Anchor::Start => "",
            Anchor::Middle => r#" text-anchor="middle""#,
            Anchor::End => r#" text-anchor="end""#,
        };
        let weight = if style.bold { r#" font-weight="bold""# } else { "" };
        let rotation = if style.rotation == 0.0 {
            String::new()
        } else {
            format!(r#" transform="rotate({} {x} {y})""#, decimal(style.rotation, 2))
        };
        self.add(&format!(
            r#"<text x="{x}" y="{y}" font-size="{}" fill="{}"{anchor}{weight}{rotation}>{}</text>"#,
            decimal(style.size, 2),
            style.colour,
            escaped(text)
        ));
    }

    /// Draws what may leave `area` and cuts it off there.
    pub(super) fn clipped(&mut self, area: Area, draw: impl FnOnce(&mut Self)) {
        self.clips += 1;
        let id = format!("clip{}", self.clips);
        let Area { left, top, width, height } = area;
        self.add(&format!(
            r#"<clipPath id="{id}"><rect x="{}" y="{}" width="{}" height="{}"/></clipPath><g clip-path="url(#{id})">"#,
            decimal(left, 2),
            decimal(top, 2),
            decimal(width, 2),
            decimal(height, 2)
        ));
        draw(self);
        self.add("</g>");
    }
}

fn is_finite((x, y): Point) -> bool {
    x.is_finite() && y.is_finite()
}

fn path(points: &[Point]) -> String {
    let mut path = String::with_capacity(14 * points.len());
    for (index, (x, y)) in points.iter().enumerate() {
        let gap = if index == 0 { "" } else { " " };
        let written = write!(path, "{gap}{},{}", decimal(*x, 2), decimal(*y, 2));
        debug_assert!(written.is_ok(), "writing to a string cannot fail");
    }
    path
}

/// A number with at most `places` decimals, without trailing zeros, never `-0`.
pub(super) fn decimal(value: f64, places: usize) -> String {
    let text = format!("{value:.places$}");
    let text = if places > 0 { text.trim_end_matches('0').trim_end_matches('.') } else { &text };
    if text == "-0" { "0".to_owned() } else { text.to_owned() }
}

/// Text as XML wants it. Control characters, which XML cannot hold, are left out.
pub(super) fn escaped(text: &str) -> String {
    let mut escaped = String::with_capacity(text.len());
    for letter in text.chars().filter(|c| !c.is_control()) {
        match letter {
            '&' => escaped.push_str("&amp;"),
            '<' => escaped.push_str("&lt;"),
            '>' => escaped.push_str("&gt;"),
            '"' => escaped.push_str("&quot;"),
            other => escaped.push(other),
        }
    }
    escaped
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_short_and_never_minus_zero() {
        let found = [1.0, 0.125, -0.001, 12.5, -3.456, 100.0].map(|x| decimal(x, 2));
        assert_eq!(found, ["1", "0.12", "0", "12.5", "-3.46", "100"]);
        assert_eq!(decimal(100.0, 0), "100");
    }

    #[test]
    fn undefined_points_break_a_line_and_are_not_drawn() {
        let mut canvas = Canvas::new(10.0, 10.0);
        let stroke = Stroke::solid(BLACK, 1.0);
        let points = [(0.0, 0.0), (1.0, 1.0), (2.0, f64::NAN), (3.0, 3.0), (4.0, 4.0)];
        canvas.polyline(&points, stroke);
        canvas.band(&points, &points, BLACK);
        canvas.circle((f64::INFINITY, 0.0), 1.0, BLACK);
        canvas.text((0.0, f64::NAN), "no", TextStyle::new(7.0, Anchor::Start));
        let svg = canvas.finish();
        assert_eq!(svg.matches("<polyline").count(), 2);
        assert_eq!(svg.matches("<polygon").count(), 2);
        assert!(!svg.contains("NaN") && !svg.contains("inf") && !svg.contains("<text"));
    }

    #[test]
    fn text_cannot_break_out_of_its_element() {
        assert_eq!(escaped("<a & \"b\">\u{0}\n"), "&lt;a &amp; &quot;b&quot;&gt;");
    }
}
