//! Muscle activity over the gait cycle: people thin and grey, their mean black, each policy in its colour.
//!
//! Every trace is divided by its own maximum, so that only its shape is compared. Across: the cycle from one heel strike
//! to the next, in percent.

use super::axes::{Axis, Frame, label_height, label_room};
use super::canvas::{Anchor, Area, Canvas, Stroke, TextStyle};
use super::fonts::{LABEL_SIZE, SMALL_SIZE, wrapped};
use super::legend::{self, Entry, Sample};
use super::palette::{BLACK, GREY, PEOPLE};
use super::{FigureError, Width};

/// White space around everything, pt.
const MARGIN: f64 = 3.0;
/// Between two panels, pt.
const GUTTER: f64 = 16.0;
/// For a line of text and the space around it, pt.
const LINE: f64 = 10.0;
/// Height of a panel, pt.
const HEIGHT: f64 = 78.0;

/// One muscle; traces have any number of points, the first at 0 %, the last at 100 %.
#[derive(Debug, Clone, PartialEq)]
pub struct ProfilePanel {
    pub muscle: String,
    pub people: Vec<Vec<f64>>,
    pub mean: Vec<f64>,
    /// One per policy of the figure.
    pub policies: Vec<Vec<f64>>,
}

/// The whole figure.
#[derive(Debug, Clone, PartialEq)]
pub struct ProfileFigure {
    pub panels: Vec<ProfilePanel>,
    /// Name and colour.
    pub policies: Vec<(String, &'static str)>,
    /// The last lines: people, recordings, warnings.
    pub footer: String,
}

impl ProfileFigure {
    /// Draws the figure as SVG.
    pub fn to_svg(&self) -> Result<String, FigureError> {
        if self.panels.is_empty() {
            return Err(FigureError::Empty);
        }
        let width = Width::TwoColumns.points();
        let legend = legend::rows(self.legend(), width - 2.0 * MARGIN);
        let y = Axis::from_zero(1.0, 2);
        let x = Axis { low: 0.0, high: 100.0, ticks: vec![0.0, 50.0, 100.0] };
        let left = MARGIN + LINE + label_room(&y);
        let count = self.panels.len() as f64;
        let panel_width = (width - left - MARGIN - 6.0 - (count - 1.0) * GUTTER) / count;
        let top = MARGIN + legend.len() as f64 * legend::ROW + LINE + 4.0;
        let footer = wrapped(&self.footer, SMALL_SIZE, width - 2.0 * MARGIN);
        let label_baseline = top + HEIGHT + label_height() + LINE;
        let footer_top = label_baseline + 4.0;
        let height = footer_top + (footer.len() as f64 + 0.4) * LINE + MARGIN;

        let mut canvas = Canvas::new(width, height);
        legend::draw(&mut canvas, &legend, MARGIN, MARGIN);
        for (index, panel) in self.panels.iter().enumerate() {
            let left = left + index as f64 * (panel_width + GUTTER);
            let area = Area { left, top, width: panel_width, height: HEIGHT };
            let frame = Frame { area, x: x.clone(), y: y.clone() };
            let style = TextStyle { bold: true, ..TextStyle::new(LABEL_SIZE, Anchor::Start) };
            canvas.text((left, top - 4.0), &panel.muscle, style);
            self.draw_traces(&mut canvas, &frame, panel);
            frame.draw_left(&mut canvas, index == 0);
            frame.draw_bottom(&mut canvas);
        }
        let position = (MARGIN + 0.8 * LABEL_SIZE, top + HEIGHT / 2.0);
        let style = TextStyle { rotation: -90.0, ..TextStyle::new(LABEL_SIZE, Anchor::Middle) };
        canvas.text(position, "Activity / its maximum", style);
        let middle = f64::midpoint(left, width - MARGIN);
        let style = TextStyle::new(LABEL_SIZE, Anchor::Middle);
        canvas.text((middle, label_baseline), "Gait cycle (%)", style);
        let style = TextStyle { colour: GREY, ..TextStyle::new(SMALL_SIZE, Anchor::Start) };
        for (index, line) in footer.iter().enumerate() {
            canvas.text((MARGIN, footer_top + (index as f64 + 0.9) * LINE), line, style);
        }
        Ok(canvas.finish())
    }

    fn draw_traces(&self, canvas: &mut Canvas, frame: &Frame, panel: &ProfilePanel) {
        let trace = |canvas: &mut Canvas, values: &[f64], stroke: Stroke| {
            let last = values.len().saturating_sub(1).max(1) as f64;
            let at = |(point, &value): (usize, &f64)| frame.at(100.0 * point as f64 / last, value);
            canvas.polyline(&values.iter().enumerate().map(at).collect::<Vec<_>>(), stroke);
        };
        // Envelopes may be negative by a little; what leaves the panel is cut off.
        canvas.clipped(frame.area.grown(1.0), |canvas| {
            for person in &panel.people {
                trace(canvas, person, Stroke::solid(PEOPLE, 0.35));
            }
            trace(canvas, &panel.mean, Stroke::solid(BLACK, 1.3));
            for (values, (_, colour)) in panel.policies.iter().zip(&self.policies) {
                trace(canvas, values, Stroke::solid(colour, 1.3));
            }
        });
    }

    fn legend(&self) -> Vec<Entry> {
        let line = |colour, width| Sample::Line(Stroke::solid(colour, width));
        let people = [
            Entry::new(line(PEOPLE, 0.6), "Each person"),
            Entry::new(line(BLACK, 1.3), "Mean of people"),
        ];
        let policies =
            self.policies.iter().map(|(name, colour)| Entry::new(line(colour, 1.3), name));
        people.into_iter().chain(policies).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::super::export::pdf_from_svg;
    use super::super::palette;
    use super::super::testing::assert_all_text_fits;
    use super::*;

    fn figure(policies: &[&str]) -> ProfileFigure {
        let wave = |shift: usize, points: usize| -> Vec<f64> {
            let phase = |i: usize| std::f64::consts::TAU * (i + shift) as f64 / points as f64;
            (0..points).map(|i| 0.5 + 0.5 * phase(i).sin()).collect()
        };
        let muscles = ["Soleus", "Medial Gastrocnemius", "Lateral Gastrocnemius", "Biceps Femoris"];
        let panel = |muscle: &&str| ProfilePanel {
            muscle: (*muscle).to_owned(),
            people: (0..9).map(|person| wave(person, 100)).collect(),
            mean: wave(4, 100),
            policies: (0..policies.len()).map(|policy| wave(20 * policy, 200)).collect(),
        };
        let names = policies.iter().map(|name| (*name).to_owned());
        ProfileFigure {
            panels: muscles.iter().map(panel).collect(),
            policies: names.zip(palette::policy_colours(policies)).collect(),
            footer: "9 people who walked at 4.5 km/h.".to_owned(),
        }
    }

    #[test]
    fn all_text_lies_on_the_sheet_and_the_bytes_are_the_same() {
        for policies in [&["arnold", "obc", "kinesis", "mine"][..], &[]] {
            let svg = figure(policies).to_svg().unwrap();
            assert_all_text_fits(&svg);
            assert_eq!(svg, figure(policies).to_svg().unwrap());
            assert_eq!(pdf_from_svg(&svg).unwrap(), pdf_from_svg(&svg).unwrap());
        }
    }

    #[test]
    fn policies_of_the_paper_have_its_colours_and_others_their_own() {
        let svg = figure(&["Arnold", "mine"]).to_svg().unwrap();
        let colours = palette::policy_colours(&["Arnold", "mine"]);
        assert_eq!(colours[0], "#2580B8");
        assert!(colours.iter().all(|colour| svg.contains(colour)));
        let people = svg.matches(&format!("stroke=\"{PEOPLE}\" stroke-width=\"0.35\"")).count();
        assert_eq!(people, 4 * 9);
    }
}
