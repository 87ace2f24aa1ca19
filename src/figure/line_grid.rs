//! Curves in a grid of panels: learning curves over training steps, performance over numbers of components.
//!
//! A strong line is a mean, its band what the caption says; thin lines, or dots, are single seeds. A dashed line marks
//! the whole, 100 % of the expert; a dotted one a step. Panels share their vertical axis, and their horizontal one unless
//! told otherwise. Lines of more than [`MOST_POINTS`] points are drawn through evenly spaced ones of them: nobody sees
//! the others on paper, and the table has them all.

use super::axes::{Axis, Frame, label_height, label_room};
use super::canvas::{Anchor, Area, Canvas, Stroke, TextStyle};
use super::fonts::{LABEL_SIZE, SMALL_SIZE, shortened, wrapped};
use super::legend::{self, Entry, Sample};
use super::palette::{GREY, WHOLE};
use super::{FigureError, Width};

/// White space around everything, pt.
const MARGIN: f64 = 3.0;
/// Between two panels, pt.
const GUTTER: f64 = 13.0;
/// For a line of text and the space around it, pt.
const LINE: f64 = 10.0;
/// Height of a panel for its width.
const ASPECT: f64 = 0.78;
/// Of a longer line, so many points are drawn.
const MOST_POINTS: usize = 800;

/// One line of a panel.
#[derive(Debug, Clone, PartialEq)]
pub struct LineSeries {
    /// In the legend; series of one name have one entry.
    pub name: String,
    pub colour: &'static str,
    /// Positions across and values; NaN breaks the line.
    pub mean: Vec<(f64, f64)>,
    /// Half the width of the band at every point; empty for no band.
    pub spread: Vec<f64>,
    /// Single seeds, drawn thin; none if there is only one.
    pub seeds: Vec<Vec<(f64, f64)>>,
    /// Dots instead of thin lines, and on the mean.
    pub dotted: bool,
}

/// One panel.
#[derive(Debug, Clone, PartialEq)]
pub struct LinePanel {
    pub title: String,
    pub series: Vec<LineSeries>,
}

/// The whole figure.
#[derive(Debug, Clone, PartialEq)]
pub struct LineGridFigure {
    pub panels: Vec<LinePanel>,
    /// What the axes measure, with units.
    pub across: String,
    pub upwards: String,
    /// Ends of the axes; without them, all there is.
    pub x_end: Option<f64>,
    pub y_end: Option<f64>,
    /// Each panel has its own horizontal axis.
    pub own_x: bool,
    /// A dashed line at this value, with its name.
    pub line: Option<(f64, &'static str)>,
    /// A dotted line at this position.
    pub mark: Option<f64>,
    pub caption: String,
}

impl LineGridFigure {
    /// Draws the figure as SVG.
    pub fn to_svg(&self) -> Result<String, FigureError> {
        if self.panels.is_empty() {
            return Err(FigureError::Empty);
        }
        let is_alone = self.panels.len() == 1;
        let width = if is_alone { Width::OneColumn } else { Width::TwoColumns }.points();
        let columns = self.panels.len().min(4);
        let rows = self.panels.len().div_ceil(columns);
        let y = self.y_axis();
        let inner = width - 2.0 * MARGIN;
        let legend = legend::rows(self.legend(inner), inner);
        let footer = wrapped(&self.caption, SMALL_SIZE, inner);
        let left = MARGIN + LINE + label_room(&y);
        let gutters = (columns - 1) as f64 * GUTTER;
        let panel_width = (width - left - MARGIN - 6.0 - gutters) / columns as f64;
        let panel_height = (ASPECT * panel_width).min(140.0);
        let top = MARGIN + legend.len() as f64 * legend::ROW + 4.0;
        let row_height = LINE + panel_height + label_height() + 5.0;
        let below = top + rows as f64 * row_height + LINE;
        let height = below + (footer.len() as f64 + 0.6) * LINE + MARGIN;
        let mut canvas = Canvas::new(width, height);
        legend::draw(&mut canvas, &legend, MARGIN, MARGIN);
        for (index, panel) in self.panels.iter().enumerate() {
            let (row, column) = (index / columns, index % columns);
            let area = Area {
                left: left + column as f64 * (panel_width + GUTTER),
                top: top + row as f64 * row_height + LINE,
                width: panel_width,
                height: panel_height,
            };
            let shown: &[LinePanel] =
                if self.own_x { std::slice::from_ref(panel) } else { &self.panels };
            let frame = Frame { area, x: self.x_axis(shown), y: y.clone() };
            let title = shortened(&panel.title, LABEL_SIZE, true, panel_width + GUTTER - 2.0);
            let bold = TextStyle { bold: true, ..TextStyle::new(LABEL_SIZE, Anchor::Start) };
            canvas.text((area.left, area.top - 4.0), &title, bold);
            self.draw_panel(&mut canvas, &frame, panel);
            frame.draw_left(&mut canvas, column == 0);
            frame.draw_bottom(&mut canvas);
        }
        let style = TextStyle::new(LABEL_SIZE, Anchor::Middle);
        let middle = (top + rows as f64 * row_height / 2.0, left + (width - left - MARGIN) / 2.0);
        let upwards = TextStyle { rotation: -90.0, ..style };
        canvas.text((MARGIN + 0.8 * LABEL_SIZE, middle.0), &self.upwards, upwards);
        canvas.text((middle.1, below - 0.3 * LINE), &self.across, style);
        let small = TextStyle { colour: GREY, ..TextStyle::new(SMALL_SIZE, Anchor::Start) };
        for (index, line) in footer.iter().enumerate() {
            canvas.text((MARGIN, below + (index as f64 + 0.9) * LINE), line, small);
        }
        Ok(canvas.finish())
    }

    fn draw_panel(&self, canvas: &mut Canvas, frame: &Frame, panel: &LinePanel) {
        let area = frame.area;
        // Dots at the edge are drawn whole; lines that go on beyond a given end are cut.
        let room = if self.x_end.is_some() { 0.8 } else { 2.2 };
        canvas.clipped(area.grown(room), |canvas| {
            if let Some((value, _)) = self.line {
                let y = frame.y_at(value);
                canvas.line((area.left, y), (area.right(), y), Stroke::dashed(WHOLE, 0.7));
            }
            if let Some(at) = self.mark {
                let x = frame.x_at(at);
                canvas.line((x, area.top), (x, area.bottom()), Stroke::dashed(GREY, 0.5));
            }
            let place = |points: &[(f64, f64)]| -> Vec<(f64, f64)> {
                thinned(points).map(|(x, y)| frame.at(x, y)).collect()
            };
            for series in &panel.series {
                let edge = |sign: f64| -> Vec<(f64, f64)> {
                    let points = series.mean.iter().zip(&series.spread);
                    let moved: Vec<(f64, f64)> =
                        points.map(|((x, y), spread)| (*x, y + sign * spread)).collect();
                    place(&moved)
                };
                canvas.band(&edge(-1.0), &edge(1.0), series.colour);
                for seed in &series.seeds {
                    if series.dotted {
                        place(seed).iter().for_each(|&at| canvas.ring(at, 1.2, series.colour));
                    } else {
                        canvas.polyline(&place(seed), Stroke::solid(series.colour, 0.3));
                    }
                }
            }
            for series in &panel.series {
                let points = place(&series.mean);
                canvas.polyline(&points, Stroke::solid(series.colour, 1.1));
                if series.dotted {
                    points.iter().for_each(|&at| canvas.circle(at, 1.3, series.colour));
                }
            }
        });
    }

    fn legend(&self, inner: f64) -> Vec<Entry> {
        let mut entries: Vec<Entry> = Vec::new();
        let mut known: Vec<&str> = Vec::new();
        for series in self.panels.iter().flat_map(|panel| &panel.series) {
            if known.contains(&series.name.as_str()) {
                continue;
            }
            known.push(&series.name);
            let stroke = Stroke::solid(series.colour, 1.1);
            let has_band = self.panels.iter().flat_map(|panel| &panel.series);
            let has_band = has_band.clone().any(|s| s.name == series.name && !s.spread.is_empty());
            let sample = if has_band { Sample::LineWithBand(stroke) } else { Sample::Line(stroke) };
            entries
                .push(Entry::new(sample, shortened(&series.name, SMALL_SIZE, false, 0.4 * inner)));
        }
        if let Some((_, name)) = self.line {
            entries.push(Entry::new(Sample::Line(Stroke::dashed(WHOLE, 0.7)), name));
        }
        entries
    }

    fn x_axis(&self, panels: &[LinePanel]) -> Axis {
        let series = panels.iter().flat_map(|panel| &panel.series);
        let points =
            series.flat_map(|series| series.mean.iter().chain(series.seeds.iter().flatten()));
        let last = points.map(|(x, _)| *x).filter(|x| x.is_finite()).fold(0.0, f64::max);
        let last = if last > 0.0 { last } else { 1.0 };
        let intervals = if panels.len() == 1 && self.panels.len() == 1 { 5 } else { 2 };
        match self.x_end {
            Some(end) => Axis::from_zero(end, intervals).ending_at(end),
            None if self.counts_across() => Axis::of_whole_numbers(last, intervals).ending_at(last),
            None => Axis::from_zero(last, intervals).ending_at(last),
        }
    }

    /// Whether all positions across are whole numbers, as numbers of components are.
    fn counts_across(&self) -> bool {
        let mut positions =
            self.panels.iter().flat_map(|panel| &panel.series).flat_map(|s| &s.mean);
        positions.all(|(x, _)| x.fract() == 0.0)
    }

    fn y_axis(&self) -> Axis {
        let series = self.panels.iter().flat_map(|panel| &panel.series);
        let values = series.flat_map(|series| {
            let mean = series.mean.iter().map(|(_, y)| *y);
            mean.chain(series.seeds.iter().flatten().map(|(_, y)| *y))
        });
        let values = values.chain(self.line.map(|(value, _)| value));
        let (low, high) = values
            .filter(|y| y.is_finite())
            .fold((0.0, 0.0), |(low, high), y| (f64::min(low, y), f64::max(high, y)));
        match self.y_end {
            Some(end) => Axis::from_zero(end, 6).ending_at(end),
            // Smoothing may swing a hair below zero: that needs no axis of its own.
            None if low > -0.05 * high => Axis::from_zero(high, 5),
            None => Axis::through_zero(low, high, 5),
        }
    }
}

/// At most [`MOST_POINTS`] of `points`, evenly spaced, the first and the last among them.
fn thinned(points: &[(f64, f64)]) -> impl Iterator<Item = (f64, f64)> {
    let count = points.len().min(MOST_POINTS);
    let last = points.len().saturating_sub(1);
    (0..count).map(move |i| if count > 1 { points[i * last / (count - 1)] } else { points[0] })
}

#[cfg(test)]
mod tests {
    use super::super::palette::{BLUE, RED};
    use super::super::testing::{assert_all_text_fits, write_sample};
    use super::*;

    fn figure(panels: usize, points: usize) -> LineGridFigure {
        let curve = |rate: f64| -> Vec<(f64, f64)> {
            let steps = (0..points).map(|i| 2.0 * i as f64 / points as f64);
            steps.map(|x| (x, 105.0 * (1.0 - (-rate * x).exp()))).collect()
        };
        let series = |name: &str, colour, rate: f64| LineSeries {
            name: name.to_owned(),
            colour,
            mean: curve(rate),
            spread: vec![6.0; points],
            seeds: vec![curve(0.9 * rate), curve(1.1 * rate)],
            dotted: points < 20,
        };
        LineGridFigure {
            panels: (0..panels)
                .map(|_| LinePanel {
                    title: "Object relocation".to_owned(),
                    series: vec![series("Pretrained", BLUE, 3.0), series("Scratch", RED, 1.0)],
                })
                .collect(),
            across: "Training steps (millions)".to_owned(),
            upwards: "Relative performance (%)".to_owned(),
            x_end: None,
            y_end: None,
            own_x: false,
            line: Some((100.0, "Expert")),
            mark: Some(1.0),
            caption: "Mean over seeds ± s.d.; n = 2 seeds. Read from event files.".to_owned(),
        }
    }

    #[test]
    fn all_text_lies_on_the_sheet_and_none_on_other_text() {
        for (panels, points) in [(1, 100), (2, 10), (4, 5000), (13, 50)] {
            assert_all_text_fits(&figure(panels, points).to_svg().unwrap());
        }
        let empty = LineGridFigure { panels: Vec::new(), ..figure(1, 1) };
        assert!(matches!(empty.to_svg(), Err(FigureError::Empty)));
    }

    #[test]
    fn the_same_figure_gives_the_same_bytes_and_long_lines_stay_small() {
        let figure = figure(4, 100_000);
        let drawn = figure.to_svg().unwrap();
        assert_eq!(drawn, figure.clone().to_svg().unwrap());
        assert!(drawn.len() < 1_000_000, "{} bytes", drawn.len());
    }

    #[test]
    fn undefined_points_break_a_line_and_lines_may_be_empty() {
        let mut figure = figure(1, 9);
        let drawn = figure.to_svg().unwrap();
        figure.panels[0].series[0].mean[4].1 = f64::NAN;
        figure.panels[0].series[1].seeds.clear();
        let svg = figure.to_svg().unwrap();
        assert!(!svg.contains("NaN"));
        assert_ne!(svg, drawn);
        figure.panels[0].series[0].mean.clear();
        figure.panels[0].series[0].spread.clear();
        assert!(figure.to_svg().is_ok());
    }

    #[test]
    fn an_axis_that_ends_somewhere_has_no_tick_beyond() {
        let mut figure = figure(2, 30);
        (figure.x_end, figure.y_end) = (Some(68.0), Some(120.0));
        assert_eq!(figure.y_axis().labels(), ["0", "20", "40", "60", "80", "100", "120"]);
        assert_eq!(figure.x_axis(&figure.panels).labels(), ["0", "50"]);
        assert_all_text_fits(&figure.to_svg().unwrap());
    }

    #[test]
    fn thinning_keeps_both_ends() {
        let points: Vec<(f64, f64)> = (0..5000).map(|i| (f64::from(i), 0.0)).collect();
        let kept: Vec<(f64, f64)> = thinned(&points).collect();
        assert_eq!((kept.len(), kept[0].0, kept[MOST_POINTS - 1].0), (MOST_POINTS, 0.0, 4999.0));
        assert_eq!(thinned(&points[..1]).count(), 1);
        assert_eq!(thinned(&[]).count(), 0);
    }

    #[test]
    #[ignore = "for a person to look at: FIGURES=/tmp/figures cargo test --release -- --ignored samples"]
    fn samples_of_the_grid_of_lines() {
        write_sample("lines_4", &figure(4, 200).to_svg().unwrap());
    }
}
