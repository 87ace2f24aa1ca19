//! Dimensionality of movement in one task: how much variance the first components hold, and how many are needed.
//!
//! Two panels of steps, joint angles and velocities: across, the number of principal components; upwards, the share of
//! the variance they hold together, with a dashed line at each share of interest. Beside them bars: the apparent
//! dimensionality, i.e. the mean of the two numbers of components at which the steps reach these lines. A policy without
//! a curve, as the human hand, has bars only.

use super::axes::{Axis, Frame, label_height, label_room};
use super::canvas::{Anchor, Area, Canvas, Stroke, TextStyle, decimal};
use super::fonts::{LABEL_SIZE, SMALL_SIZE, shortened, wrapped};
use super::legend::{self, Entry, Sample};
use super::palette::GREY;
use super::{FigureError, Provenance, Width};

/// White space around everything, pt.
const MARGIN: f64 = 3.0;
/// Between two panels, pt.
const GUTTER: f64 = 14.0;
/// For a line of text and the space around it, pt.
const LINE: f64 = 10.0;
/// Height of a panel, pt.
const HEIGHT: f64 = 110.0;

/// One policy and quantity.
#[derive(Debug, Clone, PartialEq)]
pub struct DimensionBar {
    /// Apparent dimensionality.
    pub average: f64,
    /// Share of the variance in the first 1, 2, … components; empty if not known.
    pub cumulative: Vec<f64>,
}

/// One quantity, a bar per policy.
#[derive(Debug, Clone, PartialEq)]
pub struct DimensionPanel {
    pub title: &'static str,
    pub bars: Vec<DimensionBar>,
}

/// The whole figure.
#[derive(Debug, Clone, PartialEq)]
pub struct DimensionFigure {
    /// The task's name in the paper.
    pub title: String,
    /// Name and colour of each policy.
    pub policies: Vec<(String, &'static str)>,
    pub panels: [DimensionPanel; 2],
    /// Shares of the variance with a guide line.
    pub shares: [f64; 2],
    pub joints: usize,
    /// Episodes of each policy.
    pub episodes: usize,
    pub provenance: Provenance,
}

impl DimensionFigure {
    /// Draws the figure as SVG.
    pub fn to_svg(&self) -> Result<String, FigureError> {
        if self.policies.is_empty() || self.joints == 0 {
            return Err(FigureError::Empty);
        }
        let width = Width::TwoColumns.points();
        let inner = width - 2.0 * MARGIN;
        let entry = |(name, colour): &(String, &'static str)| {
            Entry::new(Sample::Bar(colour), shortened(name, SMALL_SIZE, false, 0.45 * inner))
        };
        let mut entries: Vec<Entry> = self.policies.iter().map(entry).collect();
        let guides = self.shares.map(|share| decimal(100.0 * share, 1)).join(" and ");
        let guide = Stroke::dashed(GREY, 0.6);
        entries.push(Entry::new(Sample::Line(guide), format!("{guides} % of the variance")));
        let legend = legend::rows(entries, inner);
        let footer = wrapped(&self.footer(), SMALL_SIZE, inner);
        let top = MARGIN + legend.len() as f64 * legend::ROW + LINE + 9.0;
        let below = top + HEIGHT + label_height() + LINE;
        let height = below + (footer.len() as f64 + 0.7) * LINE + MARGIN;
        let mut canvas = Canvas::new(width, height);
        legend::draw(&mut canvas, &legend, MARGIN, MARGIN);
        let room = (inner - 2.0 * GUTTER) / 3.0;
        for (index, panel) in self.panels.iter().enumerate() {
            let left = MARGIN + index as f64 * (room + GUTTER);
            self.draw_steps(&mut canvas, (left, top, room), panel);
        }
        self.draw_bars(&mut canvas, (MARGIN + 2.0 * (room + GUTTER), top, room));
        let style = TextStyle { colour: GREY, ..TextStyle::new(SMALL_SIZE, Anchor::Start) };
        for (index, line) in footer.iter().enumerate() {
            canvas.text((MARGIN, below + (index as f64 + 1.0) * LINE), line, style);
        }
        Ok(canvas.finish())
    }

    fn draw_steps(&self, canvas: &mut Canvas, place: (f64, f64, f64), panel: &DimensionPanel) {
        let y = Axis::from_zero(1.0, 5);
        let frame = framed(
            canvas,
            place,
            panel.title,
            Axis::of_counts(self.joints),
            y,
            "Share of variance",
        );
        let (left, right) = (frame.area.left, frame.area.right());
        for share in self.shares {
            let y = frame.y_at(share);
            canvas.line((left, y), (right, y), Stroke::dashed(GREY, 0.6));
        }
        canvas.clipped(frame.area.grown(0.8), |canvas| {
            for (bar, (_, colour)) in panel.bars.iter().zip(&self.policies) {
                // A share is reached at its component and holds until the next.
                let steps = bar.cumulative.iter().enumerate().flat_map(|(index, &share)| {
                    let (x, y) = frame.at((index + 1) as f64, share);
                    let next = frame.x_at((index + 2) as f64).min(right);
                    [(x, y), (next, y)]
                });
                canvas.polyline(&steps.collect::<Vec<_>>(), Stroke::solid(colour, 1.1));
            }
        });
        frame.draw_left(canvas, true);
        frame.draw_bottom(canvas);
        let at = (left + frame.area.width / 2.0, frame.area.bottom() + label_height() + 0.8 * LINE);
        canvas.text(at, "Number of components", TextStyle::new(LABEL_SIZE, Anchor::Middle));
    }

    fn draw_bars(&self, canvas: &mut Canvas, place: (f64, f64, f64)) {
        let averages = self.panels.iter().flat_map(|panel| &panel.bars).map(|bar| bar.average);
        let highest = averages.filter(|x| x.is_finite()).fold(0.0, f64::max);
        let x = Axis { low: 0.0, high: self.panels.len() as f64, ticks: Vec::new() };
        let title = "Apparent dimensionality";
        let frame =
            framed(canvas, place, title, x, Axis::of_whole_numbers(highest, 5), "Components");
        let room = 0.8 * frame.area.width / (self.panels.len() * self.policies.len()) as f64;
        let width = room.min(20.0);
        for (group, panel) in self.panels.iter().enumerate() {
            let middle = frame.x_at(group as f64 + 0.5);
            let start = middle - width * panel.bars.len() as f64 / 2.0;
            for (index, (bar, (_, colour))) in panel.bars.iter().zip(&self.policies).enumerate() {
                let top = frame.y_at(bar.average);
                // Bars of neighbouring policies are told apart by a hair of paper.
                let left = start + index as f64 * width + 0.25;
                let height = frame.area.bottom() - top;
                canvas.rectangle(Area { left, top, width: width - 0.5, height }, colour, 1.0);
            }
            let at = (middle, frame.area.bottom() + label_height());
            canvas.text(at, panel.title, TextStyle::new(SMALL_SIZE, Anchor::Middle));
        }
        frame.draw_left(canvas, true);
        frame.draw_baseline(canvas);
    }

    fn footer(&self) -> String {
        let Self { title, joints, episodes, .. } = self;
        let word = if *joints == 1 { "joint" } else { "joints" };
        let human = if self.panels[0].bars.iter().any(|bar| bar.cumulative.is_empty()) {
            " Human: Todorov & Ghahramani 2004."
        } else {
            ""
        };
        let source = self.provenance.label();
        format!("{title}; n = {episodes} episodes per policy, {joints} {word}.{human} {source}")
    }
}

/// A panel at left, top, in so much room, with its title and the label of its vertical axis.
fn framed(
    canvas: &mut Canvas,
    (left, top, room): (f64, f64, f64),
    title: &str,
    x: Axis,
    y: Axis,
    label: &str,
) -> Frame {
    let axis = label_room(&y) + LINE;
    let area = Area { left: left + axis, top, width: room - axis, height: HEIGHT };
    let bold = TextStyle { bold: true, ..TextStyle::new(LABEL_SIZE, Anchor::Start) };
    canvas.text((left, top - 7.0), title, bold);
    let upwards = TextStyle { rotation: -90.0, ..TextStyle::new(LABEL_SIZE, Anchor::Middle) };
    canvas.text((left + 0.8 * LABEL_SIZE, top + HEIGHT / 2.0), label, upwards);
    Frame { area, x, y }
}

#[cfg(test)]
mod tests {
    use super::super::palette::{HUMAN, policy_colours};
    use super::super::testing::{assert_all_text_fits, write_sample};
    use super::*;

    fn figure(joints: usize) -> DimensionFigure {
        let names = ["Expert", "OBC", "Arnold"];
        let mut policies: Vec<(String, &str)> =
            names.map(str::to_owned).into_iter().zip(policy_colours(&names)).collect();
        policies.push(("Human (20 joints)".to_owned(), HUMAN));
        let panel = |title, rate: f64| DimensionPanel {
            title,
            bars: (0..4)
                .map(|policy| DimensionBar {
                    average: 4.0 + 0.5 * f64::from(policy),
                    cumulative: (1..=joints)
                        .filter(|_| policy < 3)
                        .map(|k| 1.0 - (-(rate - 0.05 * f64::from(policy)) * k as f64).exp())
                        .collect(),
                })
                .collect(),
        };
        DimensionFigure {
            title: "Baoding CCW".to_owned(),
            policies,
            panels: [panel("Joint angles", 0.5), panel("Joint velocities", 0.4)],
            shares: [0.85, 0.95],
            joints,
            episodes: 100,
            provenance: Provenance {
                physics: "as recorded".to_owned(),
                policy: "Expert, OBC, Arnold".to_owned(),
            },
        }
    }

    #[test]
    fn all_text_lies_on_the_sheet_and_none_on_other_text() {
        for joints in [1, 3, 23, 38] {
            assert_all_text_fits(&figure(joints).to_svg().unwrap());
        }
    }

    #[test]
    fn the_same_figure_gives_the_same_bytes_and_a_policy_without_curve_has_bars() {
        let mut figure = figure(23);
        let drawn = figure.to_svg().unwrap();
        assert_eq!(drawn, figure.clone().to_svg().unwrap());
        figure.panels[0].bars.pop();
        let svg = figure.to_svg().unwrap();
        assert_eq!(drawn.matches("<rect").count() - svg.matches("<rect").count(), 1);
        assert_eq!(drawn.matches("<polyline").count(), svg.matches("<polyline").count());
    }

    #[test]
    #[ignore = "for a person to look at: FIGURES=/tmp/figures cargo test --release -- --ignored samples"]
    fn samples_of_the_figure_of_dimensions() {
        write_sample("dimensions_23", &figure(23).to_svg().unwrap());
        write_sample("dimensions_1", &figure(1).to_svg().unwrap());
    }
}
