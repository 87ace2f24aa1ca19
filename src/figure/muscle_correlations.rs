//! Bars of how alike muscle activity is to that of people: the human reference first, then the policies.
//!
//! A bar is the mean over people, its error bar the standard error, each dot one person; the dots are spread evenly over
//! ±0.08 of a bar's room, so that none hides another. A star over two bars: their difference has p < .05.

use super::axes::{Axis, Frame, label_room};
use super::canvas::{Anchor, Area, Canvas, Stroke, TextStyle};
use super::fonts::{LABEL_SIZE, SMALL_SIZE, shortened, wrapped};
use super::palette::{BLACK, GREY};
use super::{FigureError, Width};

/// White space around everything, pt.
const MARGIN: f64 = 3.0;
/// For a line of text and the space around it, pt.
const LINE: f64 = 10.0;
/// Height of the panel, pt.
const HEIGHT: f64 = 130.0;
/// Height of a bracket with its star, pt.
const BRACKET: f64 = 9.0;
/// Dots lie within this share of a bar's room to either side of its middle.
const SPREAD: f64 = 0.08;

/// One bar; NaN where undefined.
#[derive(Debug, Clone, PartialEq)]
pub struct CorrelationBar {
    pub name: String,
    /// From [`super::palette`].
    pub colour: &'static str,
    /// One per person.
    pub people: Vec<f64>,
    pub mean: f64,
    pub standard_error: f64,
}

/// The whole figure.
#[derive(Debug, Clone, PartialEq)]
pub struct CorrelationFigure {
    pub bars: Vec<CorrelationBar>,
    /// Places of bars that differ.
    pub different: Vec<(usize, usize)>,
    /// The last lines: people, recordings, warnings.
    pub footer: String,
}

impl CorrelationFigure {
    /// Draws the figure as SVG.
    pub fn to_svg(&self) -> Result<String, FigureError> {
        if self.bars.is_empty() {
            return Err(FigureError::Empty);
        }
        let width = Width::OneColumn.points();
        let y = self.vertical();
        let footer = wrapped(&self.footer, SMALL_SIZE, width - 2.0 * MARGIN);
        let left = MARGIN + LINE + label_room(&y);
        let area = Area {
            left,
            top: MARGIN + 5.0 + self.different.len() as f64 * BRACKET,
            // Few bars need no whole column.
            width: (width - left - MARGIN).min(74.0 * self.bars.len() as f64),
            height: HEIGHT,
        };
        let x = Axis { low: 0.0, high: self.bars.len() as f64, ticks: Vec::new() };
        let frame = Frame { area, x, y };
        let footer_top = area.bottom() + LINE + 4.0;
        let height = footer_top + (footer.len() as f64 + 0.4) * LINE + MARGIN;
        let mut canvas = Canvas::new(width, height);
        for (index, bar) in self.bars.iter().enumerate() {
            draw_bar(&mut canvas, &frame, index, bar);
        }
        frame.draw_left(&mut canvas, true);
        if frame.y.low < 0.0 {
            let ends = (frame.at(0.0, 0.0), frame.at(frame.x.high, 0.0));
            canvas.line(ends.0, ends.1, Stroke::solid(GREY, 0.6));
        }
        frame.draw_baseline(&mut canvas);
        for (level, &(a, b)) in self.different.iter().rev().enumerate() {
            let bracket = area.top - 3.0 - level as f64 * BRACKET;
            let (from, to) = (frame.x_at(a as f64 + 0.55), frame.x_at(b as f64 + 0.45));
            canvas.line((from, bracket), (to, bracket), Stroke::solid(BLACK, 0.7));
            let style = TextStyle::new(LABEL_SIZE, Anchor::Middle);
            canvas.text((f64::midpoint(from, to), bracket + 0.4), "*", style);
        }
        let position = (MARGIN + 0.8 * LABEL_SIZE, area.top + area.height / 2.0);
        let style = TextStyle { rotation: -90.0, ..TextStyle::new(LABEL_SIZE, Anchor::Middle) };
        canvas.text(position, "Correlation with people (r)", style);
        let style = TextStyle { colour: GREY, ..TextStyle::new(SMALL_SIZE, Anchor::Start) };
        for (index, line) in footer.iter().enumerate() {
            canvas.text((MARGIN, footer_top + (index as f64 + 0.9) * LINE), line, style);
        }
        Ok(canvas.finish())
    }

    /// From zero, or the quarter below the lowest value, to one.
    fn vertical(&self) -> Axis {
        let values = self
            .bars
            .iter()
            .flat_map(|bar| bar.people.iter().copied().chain([bar.mean - bar.standard_error]));
        let lowest = values.filter(|x| x.is_finite()).fold(0.0, f64::min);
        let quarters = ((-lowest / 0.25).ceil() as usize).min(4);
        let low = -0.25 * quarters as f64;
        Axis { low, high: 1.0, ticks: (0..=4 + quarters).map(|i| low + 0.25 * i as f64).collect() }
    }
}

fn draw_bar(canvas: &mut Canvas, frame: &Frame, index: usize, bar: &CorrelationBar) {
    let middle = index as f64 + 0.5;
    let (left, right) = (frame.x_at(middle - 0.36), frame.x_at(middle + 0.36));
    let (zero, end) = (frame.y_at(0.0), frame.y_at(bar.mean));
    let filled = Area { left, top: zero.min(end), width: right - left, height: (zero - end).abs() };
    canvas.rectangle(filled, bar.colour, 1.0);
    let x = frame.x_at(middle);
    let stroke = Stroke::solid(BLACK, 0.8);
    let [low, high] =
        [bar.mean - bar.standard_error, bar.mean + bar.standard_error].map(|y| frame.y_at(y));
    canvas.line((x, low), (x, high), stroke);
    for y in [low, high] {
        canvas.line((x - 2.2, y), (x + 2.2, y), stroke);
    }
    let last = bar.people.len().saturating_sub(1).max(1) as f64;
    for (place, &person) in bar.people.iter().enumerate() {
        let offset = SPREAD * (2.0 * place as f64 / last - 1.0);
        canvas.ring((frame.x_at(middle + offset), frame.y_at(person)), 1.4, BLACK);
    }
    let room = frame.x_at(1.0) - frame.x_at(0.0) - 2.0;
    let name = shortened(&bar.name, SMALL_SIZE, false, room);
    let position = (x, frame.area.bottom() + SMALL_SIZE + 2.0);
    canvas.text(position, &name, TextStyle::new(SMALL_SIZE, Anchor::Middle));
}

#[cfg(test)]
mod tests {
    use super::super::export::pdf_from_svg;
    use super::super::palette;
    use super::super::testing::{assert_all_text_fits, write_sample};
    use super::*;

    fn figure(lowest: f64) -> CorrelationFigure {
        let names = ["Human", "Arnold", "OBC", "Kinesis", "a policy with a long name"];
        let colours = palette::policy_colours(&names);
        let bar = |(place, (name, colour)): (usize, (&&str, &'static str))| {
            let mean = 0.8 - 0.1 * place as f64;
            CorrelationBar {
                name: (*name).to_owned(),
                colour,
                people: (0..9).map(|i| mean + 0.02 * f64::from(i - 4)).chain([lowest]).collect(),
                mean,
                standard_error: 0.03,
            }
        };
        CorrelationFigure {
            bars: names.iter().zip(colours).enumerate().map(bar).collect(),
            different: vec![(1, 2), (1, 3)],
            footer: "Mean, ± s.e.m.; each dot one of 9 people who walked at 4.5 km/h.".to_owned(),
        }
    }

    #[test]
    fn all_text_lies_on_the_sheet_and_the_bytes_are_the_same() {
        for lowest in [0.1, -0.3, f64::NAN] {
            let svg = figure(lowest).to_svg().unwrap();
            assert_all_text_fits(&svg);
            assert_eq!(svg, figure(lowest).to_svg().unwrap());
            assert_eq!(pdf_from_svg(&svg).unwrap(), pdf_from_svg(&svg).unwrap());
            assert_eq!(svg.matches(">*<").count(), 2);
        }
    }

    #[test]
    fn the_axis_reaches_below_zero_only_if_somebody_does() {
        assert_eq!(figure(0.1).vertical().labels().join(" "), "0.00 0.25 0.50 0.75 1.00");
        assert!(figure(-0.3).vertical().labels().join(" ").starts_with("−0.50 −0.25 0.00"));
        let empty = CorrelationFigure { bars: Vec::new(), ..figure(0.1) };
        assert!(matches!(empty.to_svg(), Err(FigureError::Empty)));
    }

    #[test]
    #[ignore = "for a person to look at: FIGURES=/tmp/figures cargo test --release -- --ignored samples"]
    fn samples_of_the_correlation_figure() {
        write_sample("correlations", &figure(-0.3).to_svg().unwrap());
    }
}
