//! Curves against a number of components: shares of variance, scores of a reconstruction, differences of subspaces.
//!
//! Panels in rows. Lines may have a band around them; published values stand beside them as rings. Panels of one scale
//! share their vertical axis, labelled once per row.

use super::axes::{Axis, Frame, label_height, label_room};
use super::canvas::{Anchor, Area, Canvas, Stroke, TextStyle};
use super::fonts::{LABEL_SIZE, SMALL_SIZE, shortened, wrapped};
use super::legend::{self, Entry, Sample};
use super::palette::GREY;
use super::{FigureError, Width};

/// White space around everything, pt.
const MARGIN: f64 = 3.0;
/// Between two panels, pt.
const GUTTER: f64 = 9.0;
/// For a line of text and the space around it, pt.
const LINE: f64 = 10.0;
/// Height of a panel for its width.
const ASPECT: f64 = 0.78;
/// Height of a panel, pt, at most.
const HIGHEST: f64 = 150.0;
/// Below this a score says no more than that it is bad; lines leave the panel there.
const LOWEST_SCORE: f64 = -0.5;

/// What a vertical axis measures.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Scale {
    /// 0 to 1.
    Share,
    /// At most 1, and below 0 if a curve goes there.
    Score,
    /// 0 to 90.
    Degrees,
}

impl Scale {
    fn axis(self, lowest: f64) -> Axis {
        match self {
            Self::Score if lowest < 0.0 => Axis::through_zero(lowest.max(LOWEST_SCORE), 1.0, 4),
            Self::Share | Self::Score => Axis::from_zero(1.0, 5),
            Self::Degrees => Axis { low: 0.0, high: 90.0, ticks: vec![0.0, 30.0, 60.0, 90.0] },
        }
    }
}

/// How a series is drawn.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum LineKind {
    Solid,
    /// In the legend: a line that has a band.
    Banded,
    Dashed,
    /// Rings, for published values.
    Rings,
}

impl LineKind {
    fn sample(self, colour: &'static str) -> Sample {
        match self {
            Self::Solid => Sample::Line(Stroke::solid(colour, 1.1)),
            Self::Banded => Sample::LineWithBand(Stroke::solid(colour, 1.1)),
            Self::Dashed => Sample::Line(Stroke::dashed(colour, 0.9)),
            Self::Rings => Sample::Ring(colour),
        }
    }
}

/// One curve.
#[derive(Debug, Clone, PartialEq)]
pub struct ComponentSeries {
    pub colour: &'static str,
    pub kind: LineKind,
    /// Number of components and value, by rising number; NaN where undefined.
    pub points: Vec<(usize, f64)>,
    /// Lower and upper end of the band at each point; empty if there is none.
    pub band: Vec<(f64, f64)>,
}

/// One panel.
#[derive(Debug, Clone, PartialEq)]
pub struct ComponentPanel {
    pub title: String,
    /// What is measured, with its unit.
    pub label: String,
    pub scale: Scale,
    pub series: Vec<ComponentSeries>,
}

/// The whole figure.
#[derive(Debug, Clone, PartialEq)]
pub struct ComponentFigure {
    pub panels: Vec<ComponentPanel>,
    /// Panels in a full row.
    pub columns: usize,
    /// What is counted: `components`.
    pub counted: &'static str,
    /// Name, colour and kind of each entry.
    pub legend: Vec<(String, &'static str, LineKind)>,
    /// The last lines: what is averaged, where it comes from.
    pub footer: String,
}

impl ComponentFigure {
    /// Draws the figure as SVG.
    pub fn to_svg(&self) -> Result<String, FigureError> {
        if self.panels.is_empty() {
            return Err(FigureError::Empty);
        }
        let layout = Layout::new(self);
        let mut canvas = Canvas::new(layout.width, layout.height);
        legend::draw(&mut canvas, &layout.legend, MARGIN, MARGIN);
        for (index, panel) in self.panels.iter().enumerate() {
            let frame = Frame {
                area: layout.panel_area(index),
                x: Axis::of_counts(largest_count(panel)),
                y: layout.axis(panel.scale),
            };
            let title = shortened(&panel.title, LABEL_SIZE, true, frame.area.width + 4.0);
            let bold = TextStyle { bold: true, ..TextStyle::new(LABEL_SIZE, Anchor::Start) };
            canvas.text((frame.area.left, frame.area.top - 4.0), &title, bold);
            draw_series(&mut canvas, panel, &frame);
            let starts = layout.labels(self, index);
            frame.draw_left(&mut canvas, starts);
            frame.draw_bottom(&mut canvas);
            if starts {
                let upwards =
                    TextStyle { rotation: -90.0, ..TextStyle::new(LABEL_SIZE, Anchor::Middle) };
                let x = frame.area.left - label_room(&frame.y) - 0.35 * LABEL_SIZE;
                canvas.text((x, frame.area.top + frame.area.height / 2.0), &panel.label, upwards);
            }
        }
        let below = layout.bottom + label_height() + LINE;
        let middle = (layout.left + layout.width - MARGIN) / 2.0;
        let style = TextStyle::new(LABEL_SIZE, Anchor::Middle);
        canvas.text((middle, below), &format!("Number of {}", self.counted), style);
        let small = TextStyle { colour: GREY, ..TextStyle::new(SMALL_SIZE, Anchor::Start) };
        for (index, line) in layout.footer.iter().enumerate() {
            canvas.text((MARGIN, below + (index as f64 + 1.2) * LINE), line, small);
        }
        Ok(canvas.finish())
    }
}

/// Where everything goes.
struct Layout {
    width: f64,
    height: f64,
    left: f64,
    top: f64,
    /// Of the last row of panels.
    bottom: f64,
    columns: usize,
    between: f64,
    panel_width: f64,
    panel_height: f64,
    lowest: f64,
    legend: Vec<Vec<Entry>>,
    footer: Vec<String>,
}

impl Layout {
    fn new(figure: &ComponentFigure) -> Self {
        let width = Width::TwoColumns.points();
        let inner = width - 2.0 * MARGIN;
        let columns = figure.columns.clamp(1, figure.panels.len());
        let rows = figure.panels.len().div_ceil(columns);
        let values = figure.panels.iter().flat_map(|panel| &panel.series);
        let values = values.flat_map(|series| &series.points).map(|&(_, value)| value);
        let lowest = values.filter(|value| value.is_finite()).fold(0.0, f64::min);
        let room = figure
            .panels
            .iter()
            .map(|panel| label_room(&panel.scale.axis(lowest)))
            .fold(0.0, f64::max);
        let left = MARGIN + LINE + room;
        // Where neighbours differ in what they measure, each has its labels on its left.
        let differ = figure.panels.windows(2).any(|pair| pair[0].label != pair[1].label);
        let between = if differ { GUTTER + LINE + room } else { GUTTER };
        let gaps = (columns - 1) as f64 * between;
        let panel_width = (width - left - MARGIN - 6.0 - gaps) / columns as f64;
        let panel_height = (ASPECT * panel_width).min(HIGHEST);
        let entries = figure.legend.iter().map(|(name, colour, kind)| {
            Entry::new(kind.sample(colour), shortened(name, SMALL_SIZE, false, 0.9 * inner))
        });
        let legend = legend::rows(entries.collect(), inner);
        let footer = wrapped(&figure.footer, SMALL_SIZE, inner);
        let top = MARGIN + legend.len() as f64 * legend::ROW + 4.0;
        let row = LINE + panel_height + label_height() + 5.0;
        let bottom = top + (rows - 1) as f64 * row + LINE + panel_height;
        let height = bottom + label_height() + LINE + (footer.len() as f64 + 0.5) * LINE + MARGIN;
        Self {
            width,
            height,
            left,
            top,
            bottom,
            columns,
            between,
            panel_width,
            panel_height,
            lowest,
            legend,
            footer,
        }
    }

    fn axis(&self, scale: Scale) -> Axis {
        scale.axis(self.lowest)
    }

    fn panel_area(&self, index: usize) -> Area {
        let (row, column) = (index / self.columns, index % self.columns);
        let height = LINE + self.panel_height + label_height() + 5.0;
        Area {
            left: self.left + column as f64 * (self.panel_width + self.between),
            top: self.top + row as f64 * height + LINE,
            width: self.panel_width,
            height: self.panel_height,
        }
    }

    /// Whether a panel has labels on its left: the first of a row, and one that measures something else than the one
    /// before.
    fn labels(&self, figure: &ComponentFigure, index: usize) -> bool {
        let starts = index.is_multiple_of(self.columns);
        starts || figure.panels[index].label != figure.panels[index - 1].label
    }
}

fn draw_series(canvas: &mut Canvas, panel: &ComponentPanel, frame: &Frame) {
    // Half a line may stand out of the panel, a band may not.
    canvas.clipped(frame.area.grown(0.8), |canvas| {
        for series in &panel.series {
            let end = |end: fn(&(f64, f64)) -> f64| -> Vec<(f64, f64)> {
                let points = series.points.iter().zip(&series.band);
                points.map(|(&(n, _), band)| frame.at(n as f64, end(band))).collect()
            };
            canvas.band(&end(|band| band.0), &end(|band| band.1), series.colour);
        }
        for series in &panel.series {
            let points: Vec<(f64, f64)> =
                series.points.iter().map(|&(n, value)| frame.at(n as f64, value)).collect();
            match series.kind {
                LineKind::Rings => {}
                LineKind::Dashed => canvas.polyline(&points, Stroke::dashed(series.colour, 0.9)),
                LineKind::Solid | LineKind::Banded => {
                    canvas.polyline(&points, Stroke::solid(series.colour, 1.1));
                    // With few points it matters where they are.
                    if points.len() <= 12 {
                        points.iter().for_each(|&at| canvas.circle(at, 1.3, series.colour));
                    }
                }
            }
        }
    });
    // A ring at the edge is drawn whole, one beyond it not at all.
    for series in panel.series.iter().filter(|series| series.kind == LineKind::Rings) {
        for &(n, value) in series.points.iter().filter(|point| point.1 >= frame.y.low) {
            canvas.ring(frame.at(n as f64, value), 1.3, series.colour);
        }
    }
}

/// The largest number of components on a panel.
fn largest_count(panel: &ComponentPanel) -> usize {
    let counts = panel.series.iter().flat_map(|series| &series.points).map(|&(n, _)| n);
    counts.max().unwrap_or(1)
}

#[cfg(test)]
mod tests {
    use super::super::palette::{BLUE, RED};
    use super::super::testing::{assert_all_text_fits, write_sample};
    use super::*;

    fn curve(colour: &'static str, kind: LineKind, count: usize, rate: f64) -> ComponentSeries {
        let value = |n: usize| 1.0 - (1.0 + rate) * (-(n as f64) * rate).exp();
        let step = if kind == LineKind::Rings { 5 } else { 1 };
        ComponentSeries {
            colour,
            kind,
            points: (1..=count).step_by(step).map(|n| (n, value(n))).collect(),
            band: Vec::new(),
        }
    }

    fn figure(panels: usize, count: usize) -> ComponentFigure {
        let panel = |index: usize| ComponentPanel {
            title: ["Index reach", "Baoding harder", "Die reorient"][index % 3].to_owned(),
            label: "R²".to_owned(),
            scale: Scale::Score,
            series: vec![
                curve(BLUE, LineKind::Solid, count, 0.3),
                curve(RED, LineKind::Dashed, count, 0.03 * (index + 1) as f64),
                curve(RED, LineKind::Rings, count, 0.2),
            ],
        };
        ComponentFigure {
            panels: (0..panels).map(panel).collect(),
            columns: 4,
            counted: "synergies",
            legend: vec![
                ("Task-specific".to_owned(), BLUE, LineKind::Solid),
                ("Pooled".to_owned(), RED, LineKind::Dashed),
                ("Published".to_owned(), RED, LineKind::Rings),
            ],
            footer: "Ten fits. Policy: arnold. Physics: as recorded.".to_owned(),
        }
    }

    fn differences() -> ComponentFigure {
        let mut figure = figure(2, 39);
        figure.columns = 2;
        for series in &mut figure.panels[0].series {
            let ends = series.points.iter().map(|(_, value)| (value - 0.1, value + 0.1));
            series.band = ends.collect();
        }
        figure.panels[0].scale = Scale::Share;
        figure.panels[1].scale = Scale::Degrees;
        figure.panels[1].label = "PAD (degrees)".to_owned();
        figure.panels[1].series[0].points.iter_mut().for_each(|point| point.1 *= 80.0);
        figure
    }

    #[test]
    fn all_text_lies_on_the_sheet_and_none_on_other_text() {
        for (panels, count) in [(1, 6), (3, 39), (12, 39), (5, 1)] {
            assert_all_text_fits(&figure(panels, count).to_svg().unwrap());
        }
        assert_all_text_fits(&differences().to_svg().unwrap());
    }

    #[test]
    fn the_same_figure_gives_the_same_bytes_and_undefined_values_are_gaps() {
        let mut figure = figure(3, 39);
        figure.panels[1].series[0].points[7].1 = f64::NAN;
        figure.panels[2].series.clear();
        let svg = figure.to_svg().unwrap();
        assert_eq!(svg, figure.clone().to_svg().unwrap());
        assert!(!svg.contains("NaN") && !svg.contains("inf"));
        figure.panels.clear();
        assert!(matches!(figure.to_svg(), Err(FigureError::Empty)));
    }

    #[test]
    #[ignore = "for a person to look at: FIGURES=/tmp/figures cargo test --release -- --ignored samples"]
    fn samples_of_the_figure_of_component_curves() {
        write_sample("components_12", &figure(12, 39).to_svg().unwrap());
        write_sample("components_differences", &differences().to_svg().unwrap());
    }
}
