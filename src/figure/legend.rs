//! The legend above the panels: a sample of each line and its name, in as many rows as needed.

use super::canvas::{Anchor, Area, Canvas, Stroke, TextStyle};
use super::fonts::{SMALL_SIZE, text_width};

/// Length of a sample, pt.
const SAMPLE: f64 = 13.0;
/// Between a sample and its name, pt.
const GAP: f64 = 3.0;
/// Between two entries, pt.
const BETWEEN: f64 = 11.0;
/// Height of a row, pt.
pub(super) const ROW: f64 = 10.5;

/// What stands for an entry.
#[derive(Debug, Clone, Copy)]
pub(super) enum Sample {
    Line(Stroke),
    /// A line inside its band.
    LineWithBand(Stroke),
    Bar(&'static str),
    Ring(&'static str),
    Dot(&'static str),
}

/// A sample and its name.
#[derive(Debug, Clone)]
pub(super) struct Entry {
    pub(super) sample: Sample,
    pub(super) name: String,
}

impl Entry {
    pub(super) fn new(sample: Sample, name: impl Into<String>) -> Self {
        Self { sample, name: name.into() }
    }

    fn width(&self) -> f64 {
        SAMPLE + GAP + text_width(&self.name, SMALL_SIZE, false)
    }
}

/// Puts the entries into rows no wider than `width`, in their order.
pub(super) fn rows(entries: Vec<Entry>, width: f64) -> Vec<Vec<Entry>> {
    let mut rows: Vec<Vec<Entry>> = Vec::new();
    let mut used = 0.0;
    for entry in entries {
        let needed = entry.width();
        match rows.last_mut() {
            Some(row) if used + BETWEEN + needed <= width => {
                used += BETWEEN + needed;
                row.push(entry);
            }
            _ => {
                used = needed;
                rows.push(vec![entry]);
            }
        }
    }
    rows
}

/// Draws the rows from `left`, `top` downwards.
pub(super) fn draw(canvas: &mut Canvas, rows: &[Vec<Entry>], left: f64, top: f64) {
    for (index, row) in rows.iter().enumerate() {
        let middle = top + (index as f64 + 0.5) * ROW;
        let mut x = left;
        for entry in row {
            draw_sample(canvas, entry.sample, x, middle);
            let position = (x + SAMPLE + GAP, middle + 0.36 * SMALL_SIZE);
            canvas.text(position, &entry.name, TextStyle::new(SMALL_SIZE, Anchor::Start));
            x += entry.width() + BETWEEN;
        }
    }
}

fn draw_sample(canvas: &mut Canvas, sample: Sample, x: f64, y: f64) {
    let band = Area { left: x, top: y - 3.0, width: SAMPLE, height: 6.0 };
    match sample {
        Sample::Line(stroke) => canvas.line((x, y), (x + SAMPLE, y), stroke),
        Sample::LineWithBand(stroke) => {
            canvas.rectangle(band, stroke.colour, 0.2);
            canvas.line((x, y), (x + SAMPLE, y), stroke);
        }
        Sample::Bar(colour) => {
            canvas.rectangle(Area { left: x + 4.0, width: SAMPLE - 4.0, ..band }, colour, 1.0);
        }
        Sample::Ring(colour) => canvas.ring((x + SAMPLE - 4.5, y), 1.6, colour),
        Sample::Dot(colour) => canvas.circle((x + SAMPLE - 4.5, y), 1.6, colour),
    }
}
