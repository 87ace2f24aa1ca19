//! Bars: performance per task, with error bars, one or more policies side by side.
//!
//! A small ring, where given, is the published value. A thin grey line marks a relative performance of 100 %, i.e. the
//! baseline. Undefined means have no bar, undefined errors no error bar.

use super::axes::{Axis, Frame, label_room};
use super::canvas::{Anchor, Area, Canvas, Stroke, TextStyle};
use super::fonts::{LABEL_SIZE, SMALL_SIZE, text_width, wrapped};
use super::legend::{self, Entry, Sample};
use super::palette::{BLACK, GREY};
use super::{FigureError, Performance, Provenance, Uncertainty, Width, count_label};

/// White space around everything, pt.
const MARGIN: f64 = 3.0;
/// For a line of text and the space around it, pt.
const LINE: f64 = 10.0;
/// Height of the panel, pt.
const HEIGHT: f64 = 120.0;
/// Share of a task's room that its bars take.
const FILLED: f64 = 0.74;
/// Slope of the task names, degrees.
const SLOPE: f64 = 45.0;

/// One bar; NaN where undefined.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Bar {
    pub mean: f64,
    /// Lower end of the error bar.
    pub low: f64,
    /// Upper end of the error bar.
    pub high: f64,
    /// Episodes or seeds behind it.
    pub count: usize,
    /// The published value.
    pub published: Option<f64>,
}

/// The bars of one policy, one per task.
#[derive(Debug, Clone, PartialEq)]
pub struct BarSeries {
    /// Name in the legend.
    pub name: String,
    /// From [`super::palette`].
    pub colour: &'static str,
    pub bars: Vec<Bar>,
}

/// The whole figure.
#[derive(Debug, Clone, PartialEq)]
pub struct BarFigure {
    /// Names of the tasks, from left to right.
    pub tasks: Vec<String>,
    pub series: Vec<BarSeries>,
    pub performance: Performance,
    pub uncertainty: Uncertainty,
    /// What a bar averages, e.g. `episodes`.
    pub unit: &'static str,
    pub provenance: Provenance,
    pub width: Width,
}

impl BarFigure {
    /// Draws the figure as SVG.
    pub fn to_svg(&self) -> Result<String, FigureError> {
        if self.tasks.is_empty() || self.series.is_empty() {
            return Err(FigureError::Empty);
        }
        let width = self.width.points();
        let y = Axis::from_zero(self.highest().max(self.performance.whole()), 5);
        let legend = legend::rows(self.legend(), width - 2.0 * MARGIN);
        let footer = wrapped(&self.footer(), SMALL_SIZE, width - 2.0 * MARGIN);
        let names = self.tasks.iter().map(|name| text_width(name, SMALL_SIZE, false));
        let slope = SLOPE.to_radians();
        let names_height = names.fold(0.0, f64::max) * slope.sin() + SMALL_SIZE + 3.0;
        let left = MARGIN + LINE + label_room(&y);
        let area = Area {
            left,
            top: MARGIN + legend.len() as f64 * legend::ROW + 6.0,
            width: width - left - MARGIN - 4.0,
            height: HEIGHT,
        };
        let x = Axis { low: 0.0, high: self.tasks.len() as f64, ticks: Vec::new() };
        let frame = Frame { area, x, y };
        let footer_top = area.bottom() + names_height;
        let height = footer_top + (footer.len() as f64 + 0.4) * LINE + MARGIN;

        let mut canvas = Canvas::new(width, height);
        legend::draw(&mut canvas, &legend, MARGIN, MARGIN);
        if self.performance == Performance::Relative {
            let (from, to) = (frame.at(0.0, 100.0), frame.at(self.tasks.len() as f64, 100.0));
            canvas.line(from, to, Stroke::solid(GREY, 0.6));
        }
        for (task, name) in self.tasks.iter().enumerate() {
            self.draw_task(&mut canvas, &frame, task);
            let position = (frame.x_at(task as f64 + 0.5) + 2.0, area.bottom() + SMALL_SIZE + 1.0);
            let style = TextStyle { rotation: -SLOPE, ..TextStyle::new(SMALL_SIZE, Anchor::End) };
            canvas.text(position, name, style);
        }
        frame.draw_left(&mut canvas, true);
        frame.draw_baseline(&mut canvas);
        let position = (MARGIN + 0.8 * LABEL_SIZE, area.top + area.height / 2.0);
        let style = TextStyle { rotation: -90.0, ..TextStyle::new(LABEL_SIZE, Anchor::Middle) };
        canvas.text(position, self.performance.label(), style);
        let style = TextStyle { colour: GREY, ..TextStyle::new(SMALL_SIZE, Anchor::Start) };
        for (index, line) in footer.iter().enumerate() {
            canvas.text((MARGIN, footer_top + (index as f64 + 0.9) * LINE), line, style);
        }
        Ok(canvas.finish())
    }

    fn draw_task(&self, canvas: &mut Canvas, frame: &Frame, task: usize) {
        let room = frame.area.width / self.tasks.len() as f64;
        let bar_width = (FILLED * room / self.series.len() as f64).min(24.0);
        let start = frame.x_at(task as f64 + 0.5) - bar_width * self.series.len() as f64 / 2.0;
        for (index, series) in self.series.iter().enumerate() {
            let Some(bar) = series.bars.get(task) else { continue };
            let left = start + index as f64 * bar_width;
            let middle = left + bar_width / 2.0;
            let top = frame.y_at(bar.mean);
            // Bars of neighbouring policies are told apart by a hair of paper.
            let filled = Area {
                left: left + 0.25,
                top,
                width: bar_width - 0.5,
                height: frame.area.bottom() - top,
            };
            canvas.rectangle(filled, series.colour, 1.0);
            let stroke = Stroke::solid(BLACK, 0.7);
            let (low, high) = (frame.y_at(bar.low), frame.y_at(bar.high));
            canvas.line((middle, low), (middle, high), stroke);
            let cap = (0.22 * bar_width).min(2.2);
            canvas.line((middle - cap, low), (middle + cap, low), stroke);
            canvas.line((middle - cap, high), (middle + cap, high), stroke);
            if let Some(published) = bar.published {
                canvas.ring((middle, frame.y_at(published)), 1.6, BLACK);
            }
        }
    }

    fn bars(&self) -> impl Iterator<Item = &Bar> + Clone {
        self.series.iter().flat_map(|series| &series.bars)
    }

    /// The highest defined value that must be on the sheet.
    fn highest(&self) -> f64 {
        let values =
            self.bars().flat_map(|bar| [bar.mean, bar.high].into_iter().chain(bar.published));
        values.filter(|x| x.is_finite()).fold(0.0, f64::max)
    }

    fn legend(&self) -> Vec<Entry> {
        let mut entries: Vec<Entry> = self
            .series
            .iter()
            .map(|series| Entry::new(Sample::Bar(series.colour), series.name.as_str()))
            .collect();
        if self.bars().any(|bar| bar.published.is_some()) {
            entries.push(Entry::new(Sample::Ring(BLACK), "Published"));
        }
        if self.performance == Performance::Relative {
            entries.push(Entry::new(Sample::Line(Stroke::solid(GREY, 0.6)), "Baseline"));
        }
        entries
    }

    fn footer(&self) -> String {
        let counts = count_label(self.bars().map(|bar| bar.count));
        let error = self.uncertainty.label();
        format!("Mean, {error}; {counts} {} per bar. {}", self.unit, self.provenance.label())
    }
}

#[cfg(test)]
mod tests {
    use super::super::export::pdf_from_svg;
    use super::super::palette::{BLUE, VIOLET};
    use super::super::testing::{assert_all_text_fits, write_sample};
    use super::*;

    const TASKS: [&str; 14] = [
        "Index reach",
        "Little reach",
        "Middle reach",
        "Ring reach",
        "Thumb reach",
        "Elbow pose",
        "Baoding CW",
        "Baoding CCW",
        "Baoding harder",
        "Baoding hard",
        "Die reorient",
        "Pen reorient",
        "Object relocation",
        "Walk to point",
    ];

    fn figure(task_count: usize, width: Width) -> BarFigure {
        let series = |name: &str, colour, offset: f64| BarSeries {
            name: name.to_owned(),
            colour,
            bars: (0..task_count)
                .map(|task| {
                    let mean = 0.9 - 0.05 * task as f64 - offset;
                    Bar {
                        mean,
                        low: mean - 0.03,
                        high: mean + 0.03,
                        count: 200,
                        published: Some(mean + 0.01),
                    }
                })
                .collect(),
        };
        BarFigure {
            tasks: TASKS[..task_count].iter().map(|&name| name.to_owned()).collect(),
            series: vec![series("Arnold", BLUE, 0.0), series("Experts", VIOLET, 0.05)],
            performance: Performance::SolvedFraction,
            uncertainty: Uncertainty::StandardError,
            unit: "episodes",
            provenance: Provenance {
                physics: "MuJoCo 2.3.7".to_owned(),
                policy: "arnold".to_owned(),
            },
            width,
        }
    }

    #[test]
    fn all_text_lies_on_the_sheet_and_none_on_other_text() {
        for (tasks, width) in
            [(14, Width::TwoColumns), (14, Width::OneColumn), (1, Width::OneColumn)]
        {
            assert_all_text_fits(&figure(tasks, width).to_svg().unwrap());
        }
    }

    #[test]
    fn the_same_figure_gives_the_same_bytes() {
        let figure = figure(14, Width::TwoColumns);
        let (one, two) = (figure.to_svg().unwrap(), figure.clone().to_svg().unwrap());
        assert_eq!(one, two);
        assert!(pdf_from_svg(&one).unwrap() == pdf_from_svg(&two).unwrap(), "the PDF changes");
    }

    #[test]
    fn an_undefined_error_has_no_error_bar_and_an_undefined_mean_no_bar() {
        let mut figure = figure(2, Width::OneColumn);
        let drawn = figure.to_svg().unwrap();
        figure.series[0].bars[0] =
            Bar { mean: f64::NAN, low: f64::NAN, high: f64::NAN, count: 0, published: None };
        let svg = figure.to_svg().unwrap();
        assert!(!svg.contains("NaN"));
        let count = |svg: &str, element: &str| svg.matches(element).count();
        assert_eq!(count(&drawn, "<rect") - count(&svg, "<rect"), 1);
        assert_eq!(count(&drawn, "<polyline") - count(&svg, "<polyline"), 3);
    }

    #[test]
    #[ignore = "for a person to look at: FIGURES=/tmp/figures cargo test --release -- --ignored samples"]
    fn samples_of_the_bar_figure() {
        write_sample("bars_14", &figure(14, Width::TwoColumns).to_svg().unwrap());
        write_sample("bars_14_one_column", &figure(14, Width::OneColumn).to_svg().unwrap());
        write_sample("bars_1", &figure(1, Width::OneColumn).to_svg().unwrap());
        let mut relative = figure(6, Width::OneColumn);
        relative.performance = Performance::Relative;
        relative.series.truncate(1);
        for bar in &mut relative.series[0].bars {
            let Bar { mean, low, high, .. } = *bar;
            *bar = Bar {
                mean: 125.0 * mean,
                low: 125.0 * low,
                high: 125.0 * high,
                published: None,
                ..*bar
            };
        }
        write_sample("bars_relative", &relative.to_svg().unwrap());
    }
}
