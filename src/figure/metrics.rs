//! Several measures of the same policies: a panel of bars per measure, as in the paper's figure of smoothness.
//!
//! A bar is the mean over tasks ± s.e.m., a dot the mean of one task; a thin line joins a task's dots. The arrow in a
//! title points where better is. Brackets join policies that differ: one star below .05, two below .01, of the corrected
//! p. Every panel has its own vertical axis, which always holds zero; negative bars hang from it. What is undefined is
//! not drawn.

use super::axes::{Axis, Frame, label_room};
use super::canvas::{Anchor, Area, Canvas, Stroke, TextStyle};
use super::fonts::{LABEL_SIZE, SMALL_SIZE, shortened, text_width, wrapped};
use super::legend::{self, Entry, Sample};
use super::palette::{BLACK, GREY};
use super::{FigureError, Provenance, Width};

/// White space around everything, pt.
const MARGIN: f64 = 3.0;
/// Between two panels, pt.
const GUTTER: f64 = 12.0;
/// For a line of text and the space around it, pt.
const LINE: f64 = 10.0;
/// Height of a panel, pt.
const HEIGHT: f64 = 110.0;
/// Height of a bracket with its stars, pt.
const BRACKET: f64 = 8.0;
/// Below this a difference has a star.
const ONE_STAR: f64 = 0.05;
/// Below this it has two.
const TWO_STARS: f64 = 0.01;

/// One policy by one measure; NaN where undefined.
#[derive(Debug, Clone, PartialEq)]
pub struct MetricBar {
    pub mean: f64,
    /// Standard error of the mean.
    pub error: f64,
    /// Means of the tasks, in the same order in all bars.
    pub dots: Vec<f64>,
}

/// A comparison of the bars `a` and `b`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Bracket {
    pub a: usize,
    pub b: usize,
    /// Corrected p.
    pub p: f64,
}

/// One measure.
#[derive(Debug, Clone, PartialEq)]
pub struct MetricPanel {
    pub title: String,
    pub higher_is_better: bool,
    /// One per policy.
    pub bars: Vec<MetricBar>,
    /// All comparisons; those without a star are not drawn.
    pub brackets: Vec<Bracket>,
}

/// The whole figure.
#[derive(Debug, Clone, PartialEq)]
pub struct MetricsFigure {
    /// Name and colour of each policy.
    pub policies: Vec<(String, &'static str)>,
    pub panels: Vec<MetricPanel>,
    /// Tasks behind every bar.
    pub tasks: usize,
    pub provenance: Provenance,
}

impl MetricsFigure {
    /// Draws the figure as SVG.
    pub fn to_svg(&self) -> Result<String, FigureError> {
        if self.policies.is_empty() || self.panels.is_empty() {
            return Err(FigureError::Empty);
        }
        let width = Width::TwoColumns.points();
        let inner = width - 2.0 * MARGIN;
        let entry = |(name, colour): &(String, &'static str)| {
            Entry::new(Sample::Bar(colour), shortened(name, SMALL_SIZE, false, 0.45 * inner))
        };
        let mut entries: Vec<Entry> = self.policies.iter().map(entry).collect();
        entries.push(Entry::new(Sample::Ring(BLACK), "Task"));
        let legend = legend::rows(entries, inner);
        let footer = wrapped(&self.footer(), SMALL_SIZE, inner);
        let levels = self.panels.iter().map(|panel| starred(panel).count()).max().unwrap_or(0);
        let top =
            MARGIN + legend.len() as f64 * legend::ROW + LINE + levels as f64 * BRACKET + 10.0;
        let height = top + HEIGHT + (footer.len() as f64 + 0.9) * LINE + MARGIN;
        let mut canvas = Canvas::new(width, height);
        legend::draw(&mut canvas, &legend, MARGIN, MARGIN);
        let count = self.panels.len() as f64;
        let room = (inner - (count - 1.0) * GUTTER) / count;
        for (index, panel) in self.panels.iter().enumerate() {
            let left = MARGIN + index as f64 * (room + GUTTER);
            let y = panel.axis();
            let axis = label_room(&y);
            let area = Area { left: left + axis, top, width: room - axis, height: HEIGHT };
            let x = Axis { low: 0.0, high: self.policies.len() as f64, ticks: Vec::new() };
            let frame = Frame { area, x, y };
            let title_at = (left, top - levels as f64 * BRACKET - 9.0);
            draw_title(&mut canvas, title_at, panel);
            self.draw_bars(&mut canvas, &frame, panel);
            draw_brackets(&mut canvas, &frame, panel);
        }
        let style = TextStyle { colour: GREY, ..TextStyle::new(SMALL_SIZE, Anchor::Start) };
        for (index, line) in footer.iter().enumerate() {
            canvas.text((MARGIN, top + HEIGHT + (index as f64 + 1.3) * LINE), line, style);
        }
        Ok(canvas.finish())
    }

    fn draw_bars(&self, canvas: &mut Canvas, frame: &Frame, panel: &MetricPanel) {
        let room = frame.area.width / self.policies.len() as f64;
        let (half, zero) = ((0.36 * room).min(14.0), frame.y_at(0.0));
        let middle = |place: usize| frame.x_at(place as f64 + 0.5);
        for (place, (bar, (_, colour))) in panel.bars.iter().zip(&self.policies).enumerate() {
            let end = frame.y_at(bar.mean);
            let (top, height) = (end.min(zero), (end - zero).abs());
            let filled = Area { left: middle(place) - half, top, width: 2.0 * half, height };
            // An undefined mean must not become a bar of no height.
            if bar.mean.is_finite() {
                canvas.rectangle(filled, colour, 1.0);
            }
        }
        let tasks = panel.bars.iter().map(|bar| bar.dots.len()).max().unwrap_or(0);
        for task in 0..tasks {
            let dot = |(place, bar): (usize, &MetricBar)| {
                let value = bar.dots.get(task).copied().unwrap_or(f64::NAN);
                (middle(place), frame.y_at(value))
            };
            let dots: Vec<(f64, f64)> = panel.bars.iter().enumerate().map(dot).collect();
            if dots.len() > 1 {
                canvas.polyline(&dots, Stroke::solid(GREY, 0.35));
            }
            dots.iter().for_each(|&at| canvas.ring(at, 1.1, BLACK));
        }
        for (place, bar) in panel.bars.iter().enumerate() {
            let (x, stroke) = (middle(place), Stroke::solid(BLACK, 0.9));
            let ends = [bar.mean - bar.error, bar.mean + bar.error].map(|value| frame.y_at(value));
            canvas.line((x, ends[0]), (x, ends[1]), stroke);
            ends.iter().for_each(|&y| canvas.line((x - 2.4, y), (x + 2.4, y), stroke));
        }
        frame.draw_left(canvas, true);
        canvas.line((frame.area.left, zero), (frame.area.right(), zero), Stroke::solid(BLACK, 0.6));
    }

    fn footer(&self) -> String {
        let word = if self.tasks == 1 { "task" } else { "tasks" };
        let stars =
            if self.policies.len() > 1 { " * p < .05, ** p < .01, Holm-corrected." } else { "" };
        let (tasks, source) = (self.tasks, self.provenance.label());
        format!(
            "Mean over tasks, ± s.e.m.; n = {tasks} {word}. Arrows point to smoother.{stars} {source}"
        )
    }
}

impl MetricPanel {
    fn axis(&self) -> Axis {
        let ends = |bar: &MetricBar| [bar.mean, bar.mean - bar.error, bar.mean + bar.error];
        let values = self.bars.iter().flat_map(|bar| ends(bar).into_iter().chain(bar.dots.clone()));
        let (low, high) = values
            .filter(|x| x.is_finite())
            .fold((0.0, 0.0), |(low, high), x| (f64::min(low, x), f64::max(high, x)));
        Axis::through_zero(low, high, 4)
    }
}

/// The comparisons that are drawn, narrow ones first.
fn starred(panel: &MetricPanel) -> impl Iterator<Item = Bracket> {
    let mut brackets: Vec<Bracket> =
        panel.brackets.iter().copied().filter(|bracket| bracket.p < ONE_STAR).collect();
    brackets.sort_by_key(|bracket| (bracket.a.abs_diff(bracket.b), bracket.a));
    brackets.into_iter()
}

fn draw_title(canvas: &mut Canvas, (x, y): (f64, f64), panel: &MetricPanel) {
    let style = TextStyle { bold: true, ..TextStyle::new(LABEL_SIZE, Anchor::Start) };
    canvas.text((x, y), &panel.title, style);
    // Whatever typeface the reader has, this is an arrow.
    let x = x + text_width(&panel.title, LABEL_SIZE, true) + 6.0;
    let (tail, head) = if panel.higher_is_better { (y, y - 6.0) } else { (y - 6.0, y) };
    let back = if panel.higher_is_better { 2.4 } else { -2.4 };
    let stroke = Stroke::solid(BLACK, 0.9);
    canvas.line((x, tail), (x, head), stroke);
    canvas.polyline(&[(x - 2.0, head + back), (x, head), (x + 2.0, head + back)], stroke);
}

fn draw_brackets(canvas: &mut Canvas, frame: &Frame, panel: &MetricPanel) {
    for (level, bracket) in starred(panel).enumerate() {
        let y = frame.area.top - 4.0 - level as f64 * BRACKET;
        // A hair of paper between brackets that meet above one bar.
        let x = [bracket.a, bracket.b].map(|place| frame.x_at(place as f64 + 0.5));
        let points = [(x[0], y + 2.0), (x[0], y), (x[1], y), (x[1], y + 2.0)];
        canvas.polyline(&points, Stroke::solid(BLACK, 0.6));
        let stars = if bracket.p < TWO_STARS { "**" } else { "*" };
        let at = (f64::midpoint(x[0], x[1]), y + 0.2);
        canvas.text(at, stars, TextStyle::new(SMALL_SIZE, Anchor::Middle));
    }
}

#[cfg(test)]
mod tests {
    use super::super::palette::policy_colours;
    use super::super::testing::{assert_all_text_fits, write_sample};
    use super::*;

    fn figure(names: &[&str]) -> MetricsFigure {
        let panel = |title: &str, scale: f64, higher_is_better| MetricPanel {
            title: title.to_owned(),
            higher_is_better,
            bars: (0..names.len())
                .map(|place| MetricBar {
                    mean: scale * (1.0 + 0.2 * place as f64),
                    error: 0.06 * scale.abs(),
                    dots: (0..11)
                        .map(|task| scale * (0.8 + 0.2 * place as f64 + 0.04 * f64::from(task)))
                        .collect(),
                })
                .collect(),
            brackets: (1..names.len())
                .flat_map(|b| (0..b).map(move |a| Bracket { a, b, p: 0.03 / (a + b) as f64 }))
                .collect(),
        };
        MetricsFigure {
            policies: names.iter().copied().map(str::to_owned).zip(policy_colours(names)).collect(),
            panels: vec![
                panel("Mean |Δa|", 0.1, false),
                panel("SPARC", -2.3, true),
                panel("LDLJ", -14.0, true),
                panel("Velocity peaks", 6.0, false),
            ],
            tasks: 11,
            provenance: Provenance { physics: "as recorded".to_owned(), policy: names.join(", ") },
        }
    }

    const THREE: [&str; 3] = ["Expert", "Single-task OBC", "Multi-task OBC"];

    #[test]
    fn all_text_lies_on_the_sheet_and_none_on_other_text() {
        assert_all_text_fits(&figure(&THREE).to_svg().unwrap());
        assert_all_text_fits(&figure(&["MyoSuite elbow baseline (NPG)"]).to_svg().unwrap());
        let long =
            "a policy whose name is a path of more letters than fit into half of a page, by far";
        assert_all_text_fits(&figure(&[long, "Arnold", "OBC", "Expert"]).to_svg().unwrap());
    }

    #[test]
    fn the_same_figure_gives_the_same_bytes_and_undefined_values_are_not_drawn() {
        let mut figure = figure(&THREE);
        let drawn = figure.to_svg().unwrap();
        assert_eq!(drawn, figure.clone().to_svg().unwrap());
        let bar = &mut figure.panels[0].bars[1];
        (bar.mean, bar.error, bar.dots[3]) = (f64::NAN, f64::NAN, f64::NAN);
        let svg = figure.to_svg().unwrap();
        assert!(!svg.contains("NaN"));
        let count = |svg: &str, element: &str| svg.matches(element).count();
        assert_eq!(count(&drawn, "<rect") - count(&svg, "<rect"), 1);
    }

    #[test]
    fn only_differences_below_five_percent_have_a_bracket() {
        let mut figure = figure(&THREE);
        let drawn = |figure: &MetricsFigure| figure.to_svg().unwrap().matches(">**</text>").count();
        assert_eq!(drawn(&figure), 0);
        figure.panels[2].brackets = vec![
            Bracket { a: 0, b: 1, p: 0.05 },
            Bracket { a: 0, b: 2, p: 0.0099 },
            Bracket { a: 1, b: 2, p: f64::NAN },
        ];
        assert_eq!(drawn(&figure), 1);
    }

    #[test]
    #[ignore = "for a person to look at: FIGURES=/tmp/figures cargo test --release -- --ignored samples"]
    fn samples_of_the_figure_of_metrics() {
        write_sample("metrics_3", &figure(&THREE).to_svg().unwrap());
        write_sample("metrics_1", &figure(&["Arnold"]).to_svg().unwrap());
    }
}
