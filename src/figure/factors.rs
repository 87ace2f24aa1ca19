//! Factors of muscle activity: their waveforms over the gait cycle, and how much each muscle loads on them.
//!
//! Left: one waveform below the other, in standard deviations; across: the cycle in percent. Right: the loadings, −1 to
//! 1, one row per muscle and one column per factor; red is positive, blue negative, stronger is larger.

use super::axes::{Axis, Frame, label_height, label_room};
use super::canvas::{Anchor, Area, Canvas, Stroke, TextStyle};
use super::fonts::{LABEL_SIZE, SMALL_SIZE, text_width, wrapped};
use super::palette::{BLACK, BLUE, GREY, RED};
use super::{FigureError, Width};

/// White space around everything, pt.
const MARGIN: f64 = 3.0;
/// For a line of text and the space around it, pt.
const LINE: f64 = 10.0;
/// Height of a muscle's row, pt, at least.
const ROW: f64 = 12.0;
/// Height of a waveform with the space below it, pt, at least.
const WAVEFORM: f64 = 38.0;
/// Between two waveforms, pt.
const GAP: f64 = 8.0;
/// Between waveforms and loadings, pt.
const GUTTER: f64 = 24.0;
/// Width of a factor's column, pt, at most.
const COLUMN: f64 = 44.0;

/// One factor.
#[derive(Debug, Clone, PartialEq)]
pub struct FactorPanel {
    /// Of the total variance, 0 to 1.
    pub share: f64,
    /// The first point is at 0 %, the last at 100 %.
    pub waveform: Vec<f64>,
    /// One per muscle.
    pub loadings: Vec<f64>,
}

/// The whole figure.
#[derive(Debug, Clone, PartialEq)]
pub struct FactorFigure {
    pub muscles: Vec<String>,
    pub factors: Vec<FactorPanel>,
    /// The last lines: policy, rotation.
    pub footer: String,
}

impl FactorFigure {
    /// Draws the figure as SVG.
    pub fn to_svg(&self) -> Result<String, FigureError> {
        if self.factors.is_empty() || self.muscles.is_empty() {
            return Err(FigureError::Empty);
        }
        let width = Width::TwoColumns.points();
        let (muscles, factors) = (self.muscles.len() as f64, self.factors.len() as f64);
        let height = (ROW * muscles).max(WAVEFORM * factors);
        let y = self.vertical();
        let names = self.muscles.iter().map(|name| text_width(name, SMALL_SIZE, false));
        let names = names.fold(0.0, f64::max) + 4.0;
        let left = MARGIN + LINE + label_room(&y);
        let inner = width - left - MARGIN;
        let column = ((inner / 2.0 - GUTTER - names) / factors).min(COLUMN);
        let top = MARGIN + LINE + 2.0;
        let map =
            Area { left: width - MARGIN - column * factors, top, width: column * factors, height };
        let waves = Area { left, top, width: map.left - names - GUTTER - left, height };
        let footer = wrapped(&self.footer, SMALL_SIZE, width - 2.0 * MARGIN);
        let label_baseline = top + height + label_height() + LINE;
        let footer_top = label_baseline + 4.0;
        let sheet = footer_top + (footer.len() as f64 + 0.4) * LINE + MARGIN;

        let mut canvas = Canvas::new(width, sheet);
        self.draw_waveforms(&mut canvas, waves, &y);
        self.draw_loadings(&mut canvas, map);
        let style = TextStyle::new(LABEL_SIZE, Anchor::Middle);
        canvas.text((waves.left + waves.width / 2.0, label_baseline), "Gait cycle (%)", style);
        canvas.text((map.left + map.width / 2.0, label_baseline), "Loading", style);
        let position = (MARGIN + 0.8 * LABEL_SIZE, top + height / 2.0);
        canvas.text(position, "Waveform (s.d.)", TextStyle { rotation: -90.0, ..style });
        let style = TextStyle { colour: GREY, ..TextStyle::new(SMALL_SIZE, Anchor::Start) };
        for (index, line) in footer.iter().enumerate() {
            canvas.text((MARGIN, footer_top + (index as f64 + 0.9) * LINE), line, style);
        }
        Ok(canvas.finish())
    }

    /// One for all waveforms, with ticks at zero and the last whole number.
    fn vertical(&self) -> Axis {
        let values =
            || self.factors.iter().flat_map(|f| &f.waveform).copied().filter(|x| x.is_finite());
        let (low, high) = (values().fold(-1.0, f64::min), values().fold(1.0, f64::max));
        Axis { low, high, ticks: vec![0.0, high.floor()] }
    }

    fn draw_waveforms(&self, canvas: &mut Canvas, area: Area, y: &Axis) {
        let count = self.factors.len();
        let room = (area.height + GAP) / count as f64;
        let x = Axis { low: 0.0, high: 100.0, ticks: vec![0.0, 25.0, 50.0, 75.0, 100.0] };
        for (index, factor) in self.factors.iter().enumerate() {
            let area = Area { top: area.top + index as f64 * room, height: room - GAP, ..area };
            let frame = Frame { area, x: x.clone(), y: y.clone() };
            canvas.line(frame.at(0.0, 0.0), frame.at(100.0, 0.0), Stroke::solid(GREY, 0.4));
            let last = factor.waveform.len().saturating_sub(1).max(1) as f64;
            let at = |(point, &value): (usize, &f64)| frame.at(100.0 * point as f64 / last, value);
            let points: Vec<_> = factor.waveform.iter().enumerate().map(at).collect();
            canvas.polyline(&points, Stroke::solid(BLACK, 1.2));
            frame.draw_left(canvas, true);
            if index + 1 == count {
                frame.draw_bottom(canvas);
            }
            let name = format!("F{}, {:.1} %", index + 1, 100.0 * factor.share);
            let style = TextStyle { bold: true, ..TextStyle::new(SMALL_SIZE, Anchor::End) };
            canvas.text((area.right(), area.top - 1.2), &name, style);
        }
    }

    fn draw_loadings(&self, canvas: &mut Canvas, area: Area) {
        let row = area.height / self.muscles.len() as f64;
        let column = area.width / self.factors.len() as f64;
        let baseline = |muscle: usize| area.top + (muscle as f64 + 0.5) * row + 0.36 * SMALL_SIZE;
        for (muscle, name) in self.muscles.iter().enumerate() {
            let style = TextStyle::new(SMALL_SIZE, Anchor::End);
            canvas.text((area.left - 3.0, baseline(muscle)), name, style);
        }
        for (index, factor) in self.factors.iter().enumerate() {
            let left = area.left + index as f64 * column;
            let middle = left + column / 2.0;
            let style = TextStyle { bold: true, ..TextStyle::new(SMALL_SIZE, Anchor::Middle) };
            canvas.text((middle, area.top - 3.0), &format!("F{}", index + 1), style);
            for (muscle, &loading) in factor.loadings.iter().enumerate() {
                let top = area.top + muscle as f64 * row;
                let cell = Area {
                    left: left + 0.25,
                    top: top + 0.25,
                    width: column - 0.5,
                    height: row - 0.5,
                };
                let colour = if loading < 0.0 { BLUE } else { RED };
                // Two decimals are enough, and keep the bytes short.
                let strength = (85.0 * loading.abs().min(1.0)).round() / 100.0;
                canvas.rectangle(cell, colour, strength);
                if column > 2.6 * SMALL_SIZE {
                    let style = TextStyle::new(SMALL_SIZE - 1.0, Anchor::Middle);
                    canvas.text((middle, baseline(muscle)), &signed(loading), style);
                }
            }
        }
    }
}

/// Two decimals with a real minus; never minus zero.
fn signed(value: f64) -> String {
    let text = format!("{value:.2}");
    if text == "-0.00" { "0.00".to_owned() } else { text.replace('-', "−") }
}

#[cfg(test)]
mod tests {
    use super::super::export::pdf_from_svg;
    use super::super::testing::{assert_all_text_fits, write_sample};
    use super::*;

    fn figure(count: usize) -> FactorFigure {
        let wave = |factor: usize, points: usize| -> Vec<f64> {
            let phase = |i: usize| std::f64::consts::TAU * (i + 30 * factor) as f64 / points as f64;
            (0..points).map(|i| 1.6 * phase(i).sin()).collect()
        };
        let factor = |factor: usize| FactorPanel {
            share: 0.4 / (factor + 1) as f64,
            waveform: wave(factor, 200),
            loadings: (0..14).map(|m| ((3 * m + 5 * factor) as f64).sin()).collect(),
        };
        FactorFigure {
            muscles: (0..14).map(|muscle| format!("MUS{muscle}")).collect(),
            factors: (0..count).map(factor).collect(),
            footer: "Policy: arnold. Rotation: varimax. Explained variance: 94.7 %.".to_owned(),
        }
    }

    #[test]
    fn all_text_lies_on_the_sheet_and_the_bytes_are_the_same() {
        for count in [1, 4, 10] {
            let svg = figure(count).to_svg().unwrap();
            assert_all_text_fits(&svg);
            assert_eq!(svg, figure(count).to_svg().unwrap());
            assert_eq!(pdf_from_svg(&svg).unwrap(), pdf_from_svg(&svg).unwrap());
        }
        let none = FactorFigure { factors: Vec::new(), ..figure(1) };
        assert!(matches!(none.to_svg(), Err(FigureError::Empty)));
    }

    #[test]
    fn loadings_are_written_with_a_sign_that_is_never_that_of_zero() {
        assert_eq!([-0.001, -0.5, 0.987].map(signed), ["0.00", "−0.50", "0.99"]);
    }

    #[test]
    #[ignore = "for a person to look at: FIGURES=/tmp/figures cargo test --release -- --ignored samples"]
    fn samples_of_the_factor_figure() {
        write_sample("factors_4", &figure(4).to_svg().unwrap());
        write_sample("factors_10", &figure(10).to_svg().unwrap());
    }
}
