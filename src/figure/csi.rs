//! The figure of control-subspace inactivation: what a policy still achieves when its actions are squeezed into a few
//! components, and how much variance those components explain.
//!
//! One panel per task, four in a row. Across: number of components. Left axis, solid lines with bands: performance.
//! Right axis, dashed lines: cumulative explained variance; it is scaled so that an explained variance of 1 lies at the
//! height of a perfect (or baseline) performance. A thin grey line is the policy without projection. All panels share
//! their vertical axes, so they can be compared along a row and down a column.

use super::axes::{Axis, Frame, label_height, label_room, y_in};
use super::canvas::{Anchor, Area, Canvas, Stroke, TextStyle};
use super::fonts::{LABEL_SIZE, SMALL_SIZE, shortened, wrapped};
use super::legend::{self, Entry, Sample};
use super::palette::{BLUE, GREY, RED, VIOLET};
use super::{FigureError, Performance, Provenance, Uncertainty, Width, count_label};

/// Panels in a full row.
const PANELS_PER_ROW: usize = 4;
/// White space around everything, pt.
const MARGIN: f64 = 3.0;
/// Between two panels, pt.
const GUTTER: f64 = 9.0;
/// For a line of text and the space around it, pt.
const LINE: f64 = 10.0;
/// Width of published lines, pt.
const PUBLISHED: f64 = 0.4;
/// Height of a panel for its width, unless it is alone.
const ASPECT: f64 = 0.78;

/// Which components the actions are squeezed into.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Basis {
    /// The task's own.
    TaskSpecific,
    /// Those of all tasks together.
    Pooled,
    /// Those of the expert's actions.
    Expert,
    /// Those of another policy's actions.
    Other,
}

/// What the dashed lines are.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Reconstruction {
    /// Of the actions, by principal components.
    ExplainedVariance,
    /// Of the excitations rebuilt from synergies.
    RSquared,
}

impl Reconstruction {
    fn label(self) -> &'static str {
        match self {
            Self::ExplainedVariance => "Explained variance",
            Self::RSquared => "R²",
        }
    }
}

impl Basis {
    fn colour(self) -> &'static str {
        match self {
            Self::TaskSpecific => BLUE,
            Self::Pooled => RED,
            Self::Expert | Self::Other => VIOLET,
        }
    }

    fn label(self) -> &'static str {
        match self {
            Self::TaskSpecific => "Task-specific",
            Self::Pooled => "Pooled",
            Self::Expert => "Expert's",
            Self::Other => "Another policy's",
        }
    }
}

/// Performance with some number of components; NaN where undefined.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CsiPoint {
    pub components: usize,
    pub mean: f64,
    /// Lower end of the band.
    pub low: f64,
    /// Upper end of the band.
    pub high: f64,
}

/// The curves of one basis.
#[derive(Debug, Clone, PartialEq)]
pub struct CsiSeries {
    pub basis: Basis,
    /// By rising number of components.
    pub points: Vec<CsiPoint>,
    /// Cumulative explained variance, 0 to 1, from one component on.
    pub explained_variance: Vec<f64>,
    /// Episodes behind every point.
    pub episodes: usize,
}

/// One task.
#[derive(Debug, Clone, PartialEq)]
pub struct CsiPanel {
    /// The task's name in the paper.
    pub title: String,
    pub series: Vec<CsiSeries>,
    /// Performance without projection, in the unit of the points.
    pub unprojected: Option<f64>,
}

/// The whole figure.
#[derive(Debug, Clone, PartialEq)]
pub struct CsiFigure {
    pub panels: Vec<CsiPanel>,
    pub performance: Performance,
    pub reconstruction: Reconstruction,
    pub uncertainty: Uncertainty,
    pub provenance: Provenance,
    pub width: Width,
}

impl CsiFigure {
    /// Draws the figure as SVG.
    pub fn to_svg(&self) -> Result<String, FigureError> {
        self.to_svg_over(&[])
    }

    /// The same with published curves behind: for each panel their series, drawn thin, without bands.
    pub fn to_svg_over(&self, published: &[Vec<CsiSeries>]) -> Result<String, FigureError> {
        if self.panels.is_empty() {
            return Err(FigureError::Empty);
        }
        let layout = Layout::new(self, published.iter().any(|series| !series.is_empty()));
        let mut canvas = Canvas::new(self.width.points(), layout.height);
        legend::draw(&mut canvas, &layout.legend, MARGIN, MARGIN);
        for (index, panel) in self.panels.iter().enumerate() {
            let frame = Frame {
                area: layout.panel_area(index),
                x: Axis::of_counts(largest_count(panel)),
                y: layout.performance.clone(),
            };
            let title = shortened(&panel.title, LABEL_SIZE, true, frame.area.width + GUTTER - 2.0);
            let position = (frame.area.left, frame.area.top - 4.0);
            let style = TextStyle { bold: true, ..TextStyle::new(LABEL_SIZE, Anchor::Start) };
            canvas.text(position, &title, style);
            let behind = published.get(index).map_or(&[][..], Vec::as_slice);
            draw_published(&mut canvas, behind, &frame);
            draw_curves(&mut canvas, panel, &frame, &layout.explained);
            let is_first = index.is_multiple_of(layout.columns);
            let is_last =
                (index + 1).is_multiple_of(layout.columns) || index + 1 == self.panels.len();
            frame.draw_left(&mut canvas, is_first);
            frame.draw_right(&mut canvas, &layout.explained, is_last);
            frame.draw_bottom(&mut canvas);
        }
        self.draw_labels(&mut canvas, &layout);
        Ok(canvas.finish())
    }

    /// The axis labels, once for the whole grid, and the footer.
    fn draw_labels(&self, canvas: &mut Canvas, layout: &Layout) {
        let grid = layout.grid();
        let middle = (grid.left + grid.width / 2.0, grid.top + grid.height / 2.0);
        let style = TextStyle::new(LABEL_SIZE, Anchor::Middle);
        let left = MARGIN + 0.8 * LABEL_SIZE;
        let upwards = TextStyle { rotation: -90.0, ..style };
        canvas.text((left, middle.1), self.performance.label(), upwards);
        // Beside the last panel of a short row the label would float, so it keeps to the right edge of the grid.
        let right = grid.right() + label_room(&layout.explained) + 0.5 * LINE + 0.5 * LABEL_SIZE;
        canvas.text((right, middle.1), self.reconstruction.label(), upwards);
        let below = grid.bottom() + label_height() + LINE;
        canvas.text((middle.0, below), "Number of components", style);
        let small = TextStyle { colour: GREY, ..TextStyle::new(SMALL_SIZE, Anchor::Start) };
        for (index, line) in layout.footer.iter().enumerate() {
            canvas.text((MARGIN, below + (index as f64 + 1.2) * LINE), line, small);
        }
    }

    fn legend(&self, with_published: bool) -> Vec<Entry> {
        let mut bases: Vec<Basis> =
            self.panels.iter().flat_map(|panel| &panel.series).map(|series| series.basis).collect();
        bases.sort();
        bases.dedup();
        let mut entries: Vec<Entry> = bases
            .into_iter()
            .map(|basis| {
                let stroke = performance_stroke(basis);
                let sample = match self.uncertainty {
                    Uncertainty::Unknown => Sample::Line(stroke),
                    _ => Sample::LineWithBand(stroke),
                };
                Entry::new(sample, basis.label())
            })
            .collect();
        let dashed = Sample::Line(Stroke::dashed(GREY, 0.9));
        entries.push(Entry::new(dashed, self.reconstruction.label()));
        if self.panels.iter().any(|panel| panel.unprojected.is_some()) {
            entries.push(Entry::new(Sample::Line(unprojected_stroke()), "Not projected"));
        }
        if with_published {
            entries
                .push(Entry::new(Sample::Line(Stroke::solid(BLUE, PUBLISHED)), "Thin: published"));
        }
        entries
    }

    fn footer(&self) -> String {
        let series = self.panels.iter().flat_map(|panel| &panel.series);
        let counts = count_label(series.map(|series| series.episodes));
        let band = self.uncertainty.label();
        format!("Mean, {band}; {counts} episodes per point. {}", self.provenance.label())
    }
}

/// Where everything goes.
struct Layout {
    columns: usize,
    rows: usize,
    panel_width: f64,
    panel_height: f64,
    left: f64,
    top: f64,
    height: f64,
    performance: Axis,
    explained: Axis,
    legend: Vec<Vec<Entry>>,
    footer: Vec<String>,
}

impl Layout {
    fn new(figure: &CsiFigure, with_published: bool) -> Self {
        let width = figure.width.points();
        let most = match figure.width {
            Width::OneColumn => PANELS_PER_ROW / 2,
            Width::TwoColumns => PANELS_PER_ROW,
        };
        let columns = figure.panels.len().min(most);
        let rows = figure.panels.len().div_ceil(columns);
        let whole = figure.performance.whole();
        let highest = highest(figure).max(whole);
        // Up to a little above the highest value, not to the tick beyond it: few panels need that room.
        let performance = Axis::from_zero(highest, 5).ending_at(1.04 * highest);
        // Ticks of both axes lie at the same heights, as far as shares go.
        let shares = performance.ticks.iter().map(|tick| tick / whole);
        let explained = Axis {
            low: 0.0,
            high: performance.high / whole,
            ticks: shares.filter(|&share| share <= 1.0 + 1e-9).collect(),
        };
        let legend = legend::rows(figure.legend(with_published), width - 2.0 * MARGIN);
        let footer = wrapped(&figure.footer(), SMALL_SIZE, width - 2.0 * MARGIN);

        let left = MARGIN + LINE + label_room(&performance);
        let right = MARGIN + LINE + label_room(&explained);
        let gutters = (columns - 1) as f64 * GUTTER;
        let panel_width = (width - left - right - gutters) / columns as f64;
        let panel_height = (ASPECT * panel_width).min(150.0);
        let top = MARGIN + legend.len() as f64 * legend::ROW + 4.0;
        let mut layout = Self {
            columns,
            rows,
            panel_width,
            panel_height,
            left,
            top,
            height: 0.0,
            performance,
            explained,
            legend,
            footer,
        };
        let below = label_height() + LINE + (layout.footer.len() as f64 + 0.5) * LINE;
        layout.height = layout.grid().bottom() + below + MARGIN;
        layout
    }

    /// From the top of one row of panels to the top of the next.
    fn row_height(&self) -> f64 {
        LINE + self.panel_height + label_height() + 5.0
    }

    fn panel_area(&self, index: usize) -> Area {
        let (row, column) = (index / self.columns, index % self.columns);
        Area {
            left: self.left + column as f64 * (self.panel_width + GUTTER),
            top: self.top + row as f64 * self.row_height() + LINE,
            width: self.panel_width,
            height: self.panel_height,
        }
    }

    /// From the first panel to the last, without the labels around them.
    fn grid(&self) -> Area {
        let first = self.panel_area(0);
        let last = self.panel_area(self.rows * self.columns - 1);
        Area { width: last.right() - first.left, height: last.bottom() - first.top, ..first }
    }
}

fn performance_stroke(basis: Basis) -> Stroke {
    Stroke::solid(basis.colour(), 1.1)
}

fn unprojected_stroke() -> Stroke {
    Stroke::solid(GREY, 0.6)
}

/// Published curves, thin.
fn draw_published(canvas: &mut Canvas, published: &[CsiSeries], frame: &Frame) {
    if published.is_empty() {
        return;
    }
    canvas.clipped(frame.area.grown(0.8), |canvas| {
        for series in published {
            let points: Vec<(f64, f64)> =
                series.points.iter().map(|p| frame.at(p.components as f64, p.mean)).collect();
            canvas.polyline(&points, Stroke::solid(series.basis.colour(), PUBLISHED));
        }
    });
}

fn draw_curves(canvas: &mut Canvas, panel: &CsiPanel, frame: &Frame, explained: &Axis) {
    // Half a line may stand out of the panel, a band may not.
    canvas.clipped(frame.area.grown(0.8), |canvas| {
        if let Some(unprojected) = panel.unprojected {
            let y = frame.y_at(unprojected);
            let (left, right) = (frame.area.left, frame.area.right());
            canvas.line((left, y), (right, y), unprojected_stroke());
        }
        for series in &panel.series {
            let line = |value: fn(&CsiPoint) -> f64| -> Vec<(f64, f64)> {
                let points = series.points.iter();
                points.map(|point| frame.at(point.components as f64, value(point))).collect()
            };
            canvas.band(&line(|p| p.low), &line(|p| p.high), series.basis.colour());
        }
        for series in &panel.series {
            let shares: Vec<(f64, f64)> = series
                .explained_variance
                .iter()
                .enumerate()
                .map(|(index, &share)| {
                    (frame.x_at((index + 1) as f64), y_in(&frame.area, explained, share))
                })
                .collect();
            canvas.polyline(&shares, Stroke::dashed(series.basis.colour(), 0.8));
        }
        for series in &panel.series {
            let points: Vec<(f64, f64)> =
                series.points.iter().map(|p| frame.at(p.components as f64, p.mean)).collect();
            canvas.polyline(&points, performance_stroke(series.basis));
            // With few points it matters where they are.
            if series.points.len() <= 12 {
                points.iter().for_each(|&at| canvas.circle(at, 1.3, series.basis.colour()));
            }
        }
    });
}

/// The largest number of components on a panel.
fn largest_count(panel: &CsiPanel) -> usize {
    let counts = panel.series.iter().map(|series| {
        let points = series.points.iter().map(|p| p.components).max().unwrap_or(1);
        points.max(series.explained_variance.len())
    });
    counts.max().unwrap_or(1)
}

/// The highest defined mean or reference; bands may be cut.
fn highest(figure: &CsiFigure) -> f64 {
    let means = figure.panels.iter().flat_map(|panel| {
        let points = panel.series.iter().flat_map(|series| &series.points).map(|point| point.mean);
        points.chain(panel.unprojected)
    });
    means.filter(|x| x.is_finite()).fold(0.0, f64::max)
}

#[cfg(test)]
mod tests {
    use super::super::export::{pdf_from_svg, png_from_svg};
    use super::super::testing::{assert_all_text_fits, write_sample};
    use super::*;

    /// Curves that rise like real ones, by a formula.
    fn figure(panel_counts: &[usize], width: Width) -> CsiFigure {
        let panels = panel_counts.iter().enumerate().map(|(index, &count)| {
            let best = 0.95 - 0.06 * (index % 7) as f64;
            let series = |basis, needed: f64, episodes| CsiSeries {
                basis,
                points: (1..=count)
                    .map(|components| {
                        let k = components as f64 / count as f64;
                        let mean = best / (1.0 + (-(k - needed) * 14.0).exp());
                        let error = 0.05 * (1.0 - mean);
                        CsiPoint { components, mean, low: mean - error, high: mean + error }
                    })
                    .collect(),
                explained_variance: (1..=count)
                    .map(|c| 1.0 - (-(6.0 - 4.0 * needed) * c as f64 / count as f64).exp())
                    .collect(),
                episodes,
            };
            CsiPanel {
                title: ["Index reach", "Elbow pose", "Baoding harder", "Object relocation"]
                    [index % 4]
                    .to_owned(),
                series: vec![
                    series(Basis::TaskSpecific, 0.25, 20),
                    series(Basis::Pooled, 0.55, 100),
                ],
                unprojected: Some(best),
            }
        });
        CsiFigure {
            panels: panels.collect(),
            performance: Performance::SolvedFraction,
            reconstruction: Reconstruction::ExplainedVariance,
            uncertainty: Uncertainty::StandardError,
            provenance: Provenance {
                physics: "MuJoCo 2.3.7".to_owned(),
                policy: "arnold".to_owned(),
            },
            width,
        }
    }

    #[test]
    fn the_same_figure_gives_the_same_bytes() {
        let figure = figure(&[39, 6, 63], Width::TwoColumns);
        let (one, two) = (figure.to_svg().unwrap(), figure.clone().to_svg().unwrap());
        assert_eq!(one, two);
        let pdf = pdf_from_svg(&one).unwrap();
        // Two fonts come in either order: ten equal draws by luck are one in a thousand.
        for _ in 0..10 {
            assert!(pdf == pdf_from_svg(&two).unwrap(), "the PDF changes from run to run");
        }
        let same_picture = png_from_svg(&one, 150.0).unwrap() == png_from_svg(&two, 150.0).unwrap();
        assert!(same_picture, "the PNG changes from run to run");
    }

    #[test]
    fn all_text_lies_on_the_sheet_and_none_on_other_text() {
        for (panels, width) in [
            (vec![39], Width::OneColumn),
            (vec![6], Width::TwoColumns),
            (vec![39, 6, 63], Width::OneColumn),
            (vec![39, 6, 63, 80, 39, 39, 39, 1], Width::TwoColumns),
            (vec![39; 14], Width::TwoColumns),
        ] {
            assert_all_text_fits(&figure(&panels, width).to_svg().unwrap());
        }
    }

    #[test]
    fn undefined_values_leave_gaps_and_no_nan() {
        let mut figure = figure(&[39, 6], Width::TwoColumns);
        figure.panels[0].series[0].points[5].mean = f64::NAN;
        figure.panels[0].series[0].points[5].low = f64::NAN;
        figure.panels[1].series[1].explained_variance = vec![f64::NAN; 6];
        figure.panels[1].unprojected = Some(f64::INFINITY);
        let svg = figure.to_svg().unwrap();
        assert!(!svg.contains("NaN") && !svg.contains("inf"));
        assert!(pdf_from_svg(&svg).is_ok());
    }

    #[test]
    fn published_curves_lie_thin_behind_and_are_named() {
        let figure = figure(&[39, 39], Width::TwoColumns);
        let plain = figure.to_svg().unwrap();
        assert_eq!(figure.to_svg_over(&[Vec::new()]).unwrap(), plain);
        let published = vec![figure.panels[0].series.clone(), Vec::new()];
        let svg = figure.to_svg_over(&published).unwrap();
        assert!(svg.contains("Thin: published") && !plain.contains("Thin: published"));
        assert_all_text_fits(&svg);
        // Two lines in the first panel and one in the legend.
        let lines = |svg: &str| svg.matches("<polyline").count();
        assert_eq!(lines(&svg) - lines(&plain), 3);
    }

    #[test]
    fn a_figure_without_panels_is_an_error_and_one_without_curves_is_not() {
        let mut figure = figure(&[6], Width::OneColumn);
        figure.panels[0].series.clear();
        assert!(figure.to_svg().is_ok());
        figure.panels.clear();
        assert!(matches!(figure.to_svg(), Err(FigureError::Empty)));
    }

    #[test]
    fn what_is_shown_is_said() {
        let mut figure = figure(&[6, 6], Width::TwoColumns);
        figure.uncertainty = Uncertainty::Bootstrap { confidence: 0.95 };
        let svg = figure.to_svg().unwrap();
        for said in ["95% bootstrap interval", "n = 20–100", "MuJoCo 2.3.7", "arnold", "Pooled"] {
            assert!(svg.contains(said), "{said}");
        }
    }

    #[test]
    #[ignore = "for a person to look at: FIGURES=/tmp/figures cargo test --release -- --ignored samples"]
    fn samples_of_the_csi_figure() {
        let samples = [
            ("csi_1", vec![39], Width::OneColumn),
            ("csi_4_one_column", vec![39, 6, 63, 80], Width::OneColumn),
            ("csi_2", vec![39, 6], Width::TwoColumns),
            ("csi_8", vec![39, 6, 63, 80, 39, 39, 39, 6], Width::TwoColumns),
            (
                "csi_14",
                [vec![39; 5], vec![6], vec![39; 6], vec![63, 80]].concat(),
                Width::TwoColumns,
            ),
        ];
        for (name, panels, width) in samples {
            write_sample(name, &figure(&panels, width).to_svg().unwrap());
        }
        let mut relative = figure(&[39, 6, 63, 80], Width::TwoColumns);
        relative.performance = Performance::Relative;
        relative.uncertainty = Uncertainty::Bootstrap { confidence: 0.95 };
        for panel in &mut relative.panels {
            panel.unprojected = panel.unprojected.map(|p| 125.0 * p);
            for point in panel.series.iter_mut().flat_map(|series| &mut series.points) {
                *point = CsiPoint {
                    mean: 125.0 * point.mean,
                    low: 125.0 * point.low,
                    high: 125.0 * point.high,
                    ..*point
                };
            }
        }
        write_sample("csi_relative", &relative.to_svg().unwrap());
    }
}
