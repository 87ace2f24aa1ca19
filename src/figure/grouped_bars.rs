//! Groups of bars side by side: methods in every task, or sizes of a network, with an average behind a divider.
//!
//! A bar is a mean, its whisker ± the error that the caption names; dots are single episodes or tasks, spread over the
//! bar so that equal ones are seen. A dashed line marks the whole, 100 % of the expert. A ring is the printed value. What
//! is undefined is not drawn.

use super::axes::{Axis, Frame, label_room};
use super::canvas::{Anchor, Area, Canvas, Stroke, TextStyle};
use super::fonts::{LABEL_SIZE, SMALL_SIZE, shortened, text_width, wrapped};
use super::legend::{self, Entry, Sample};
use super::palette::{BLACK, GREY, WHOLE};
use super::{FigureError, Width};

/// White space around everything, pt.
const MARGIN: f64 = 3.0;
/// For a line of text and the space around it, pt.
const LINE: f64 = 10.0;
/// Height of the panel, pt.
const HEIGHT: f64 = 130.0;
/// From one group to the next, in widths of a group's bars.
const SPACING: f64 = 1.15;
/// The average stands so much further to the right.
const DIVIDER: f64 = 0.4;
/// Widest bar, pt.
const WIDEST: f64 = 26.0;
/// More dots than this on one bar are drawn small.
const FEW: usize = 20;
/// Slope of the group names, degrees.
const SLOPE: f64 = 45.0;

/// One bar; NaN where undefined.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct GroupedBar {
    pub mean: f64,
    /// Half the length of the whisker.
    pub error: f64,
    pub dots: Vec<f64>,
    /// The printed value.
    pub published: Option<f64>,
    /// A word above the bar.
    pub note: String,
}

/// The bars of one method, one per group.
#[derive(Debug, Clone, PartialEq)]
pub struct GroupedSeries {
    pub name: String,
    pub colour: &'static str,
    pub bars: Vec<GroupedBar>,
    /// Over all groups.
    pub average: Option<GroupedBar>,
}

/// The whole figure.
#[derive(Debug, Clone, PartialEq)]
pub struct GroupedBarFigure {
    pub groups: Vec<String>,
    pub series: Vec<GroupedSeries>,
    /// What the vertical axis measures, with its unit.
    pub measure: String,
    /// Where the dashed line lies, and its name.
    pub line: Option<(f64, &'static str)>,
    /// What the dots are, in the legend.
    pub dots: &'static str,
    /// What bars and whiskers are, n, and where the numbers come from.
    pub caption: String,
    pub width: Width,
}

impl GroupedBarFigure {
    /// Draws the figure as SVG.
    pub fn to_svg(&self) -> Result<String, FigureError> {
        if self.groups.is_empty() || self.series.is_empty() {
            return Err(FigureError::Empty);
        }
        let width = self.width.points();
        let inner = width - 2.0 * MARGIN;
        let y = self.axis();
        let legend = legend::rows(self.legend(inner), inner);
        let footer = wrapped(&self.caption, SMALL_SIZE, inner);
        let left = MARGIN + LINE + label_room(&y);
        let notes = if self.bars().any(|bar| !bar.note.is_empty()) { LINE } else { 0.0 };
        let area = Area {
            left,
            top: MARGIN + legend.len() as f64 * legend::ROW + 6.0 + notes,
            width: width - left - MARGIN - 4.0,
            height: HEIGHT,
        };
        let frame = Frame { area, x: Axis { low: 0.0, high: self.extent(), ticks: Vec::new() }, y };
        let names: Vec<String> =
            self.groups.iter().map(|name| shortened(name, SMALL_SIZE, false, 110.0)).collect();
        let average = self.has_average().then_some("Average");
        let widths = names.iter().map(String::as_str).chain(average);
        let widths = widths.map(|name| text_width(name, SMALL_SIZE, false));
        let longest = widths.fold(0.0, f64::max);
        // Short names need no slope.
        let is_level = longest + 4.0 <= area.width / self.extent() * SPACING;
        let slope = if is_level { 0.0 } else { SLOPE };
        let names_height = longest * slope.to_radians().sin() + SMALL_SIZE + 5.0;
        let footer_top = area.bottom() + names_height;
        let height = footer_top + (footer.len() as f64 + 0.4) * LINE + MARGIN;

        let mut canvas = Canvas::new(width, height);
        legend::draw(&mut canvas, &legend, MARGIN, MARGIN);
        if let Some((value, _)) = self.line {
            let (from, to) = (frame.at(0.0, value), frame.at(self.extent(), value));
            canvas.line(from, to, Stroke::dashed(WHOLE, 0.8));
        }
        for (place, name) in names.iter().enumerate() {
            let bars: Vec<_> = self.series.iter().map(|series| series.bars.get(place)).collect();
            self.draw_group(&mut canvas, &frame, (place as f64 + 0.5) * SPACING, &bars);
            draw_name(&mut canvas, &frame, (place as f64 + 0.5) * SPACING, name, slope);
        }
        if self.has_average() {
            let x = frame.x_at(self.groups.len() as f64 * SPACING + DIVIDER / 2.0);
            let stroke = Stroke::dashed(GREY, 0.6);
            canvas.line((x, area.top), (x, area.bottom()), stroke);
            let bars: Vec<_> = self.series.iter().map(|series| series.average.as_ref()).collect();
            let middle = (self.groups.len() as f64 + 0.5) * SPACING + DIVIDER;
            self.draw_group(&mut canvas, &frame, middle, &bars);
            draw_name(&mut canvas, &frame, middle, "Average", slope);
        }
        frame.draw_left(&mut canvas, true);
        let zero = frame.y_at(0.0);
        canvas.line((area.left, zero), (area.right(), zero), Stroke::solid(BLACK, 0.6));
        let position = (MARGIN + 0.8 * LABEL_SIZE, area.top + area.height / 2.0);
        let style = TextStyle { rotation: -90.0, ..TextStyle::new(LABEL_SIZE, Anchor::Middle) };
        canvas.text(position, &self.measure, style);
        let style = TextStyle { colour: GREY, ..TextStyle::new(SMALL_SIZE, Anchor::Start) };
        for (index, line) in footer.iter().enumerate() {
            canvas.text((MARGIN, footer_top + (index as f64 + 0.9) * LINE), line, style);
        }
        Ok(canvas.finish())
    }

    fn draw_group(
        &self,
        canvas: &mut Canvas,
        frame: &Frame,
        middle: f64,
        bars: &[Option<&GroupedBar>],
    ) {
        let middle = frame.x_at(middle);
        let unit = frame.area.width / self.extent();
        let bar_width = (unit / bars.len() as f64).min(WIDEST);
        let start = middle - bar_width * bars.len() as f64 / 2.0;
        let zero = frame.y_at(0.0);
        for (index, (bar, series)) in bars.iter().zip(&self.series).enumerate() {
            let Some(bar) = bar.filter(|bar| bar.mean.is_finite()) else { continue };
            let left = start + index as f64 * bar_width;
            let end = frame.y_at(bar.mean);
            // Neighbouring bars are told apart by a hair of paper.
            let filled = Area {
                left: left + 0.2,
                top: end.min(zero),
                width: bar_width - 0.4,
                height: (end - zero).abs(),
            };
            canvas.rectangle(filled, series.colour, 1.0);
            let centre = left + bar_width / 2.0;
            let count = bar.dots.len();
            for (place, &dot) in bar.dots.iter().enumerate() {
                let share = (place as f64 + 0.5) / count as f64 - 0.5;
                let at = (centre + 0.7 * share * bar_width, frame.y_at(dot));
                if count > FEW {
                    canvas.circle(at, 0.35, BLACK);
                } else {
                    canvas.ring(at, 1.1, BLACK);
                }
            }
            let stroke = Stroke::solid(BLACK, 0.7);
            let ends = [bar.mean - bar.error, bar.mean + bar.error].map(|value| frame.y_at(value));
            canvas.line((centre, ends[0]), (centre, ends[1]), stroke);
            let cap = (0.25 * bar_width).min(2.2);
            ends.iter().for_each(|&y| canvas.line((centre - cap, y), (centre + cap, y), stroke));
            if let Some(published) = bar.published {
                canvas.ring((centre, frame.y_at(published)), 1.5, BLACK);
            }
            let style = TextStyle::new(SMALL_SIZE, Anchor::Middle);
            if !bar.note.is_empty() {
                canvas.text((centre, frame.area.top - 3.0), &bar.note, style);
            }
        }
    }

    fn has_average(&self) -> bool {
        self.series.iter().any(|series| series.average.is_some())
    }

    /// Length of the horizontal axis, in widths of a group's bars.
    fn extent(&self) -> f64 {
        let average = if self.has_average() { SPACING + DIVIDER } else { 0.0 };
        self.groups.len() as f64 * SPACING + average
    }

    fn bars(&self) -> impl Iterator<Item = &GroupedBar> {
        self.series.iter().flat_map(|series| series.bars.iter().chain(&series.average))
    }

    fn axis(&self) -> Axis {
        let ends = |bar: &GroupedBar| {
            let whisker = if bar.error.is_finite() { bar.error } else { 0.0 };
            let fixed = [bar.mean - whisker, bar.mean + whisker];
            fixed.into_iter().chain(bar.dots.clone()).chain(bar.published).collect::<Vec<f64>>()
        };
        let values = self.bars().flat_map(ends).chain(self.line.map(|(value, _)| value));
        let (low, high) = values
            .filter(|x| x.is_finite())
            .fold((0.0, 0.0), |(low, high), x| (f64::min(low, x), f64::max(high, x)));
        Axis::through_zero(low, high, 6)
    }

    fn legend(&self, inner: f64) -> Vec<Entry> {
        let mut entries: Vec<Entry> = Vec::new();
        if self.series.len() > 1 || !self.series[0].name.is_empty() {
            entries.extend(self.series.iter().map(|series| {
                let name = shortened(&series.name, SMALL_SIZE, false, 0.4 * inner);
                Entry::new(Sample::Bar(series.colour), name)
            }));
        }
        if self.bars().any(|bar| !bar.dots.is_empty()) {
            let are_small = self.bars().any(|bar| bar.dots.len() > FEW);
            let sample = if are_small { Sample::Dot(BLACK) } else { Sample::Ring(BLACK) };
            entries.push(Entry::new(sample, self.dots));
        }
        if self.bars().any(|bar| bar.published.is_some()) {
            entries.push(Entry::new(Sample::Ring(BLACK), "Printed in the paper"));
        }
        if let Some((_, name)) = self.line {
            entries.push(Entry::new(Sample::Line(Stroke::dashed(WHOLE, 0.8)), name));
        }
        entries
    }
}

/// The name below a group, sloping or level.
fn draw_name(canvas: &mut Canvas, frame: &Frame, middle: f64, name: &str, slope: f64) {
    let (x, y) = (frame.x_at(middle), frame.area.bottom() + SMALL_SIZE + 1.0);
    if slope == 0.0 {
        canvas.text((x, y + 2.0), name, TextStyle::new(SMALL_SIZE, Anchor::Middle));
    } else {
        let style = TextStyle { rotation: -slope, ..TextStyle::new(SMALL_SIZE, Anchor::End) };
        canvas.text((x + 2.0, y), name, style);
    }
}

#[cfg(test)]
mod tests {
    use super::super::palette::method_colours;
    use super::super::testing::{assert_all_text_fits, write_sample};
    use super::*;

    fn figure(groups: usize, names: &[&str], average: bool) -> GroupedBarFigure {
        let bar = |place: usize, shift: f64| GroupedBar {
            mean: 90.0 + shift - 3.0 * place as f64,
            error: 4.0,
            dots: (0..100).map(|i| 40.0 + f64::from(i)).collect(),
            ..GroupedBar::default()
        };
        let series = names.iter().zip(method_colours(names)).enumerate();
        GroupedBarFigure {
            groups: (0..groups).map(|place| format!("Baoding harder {place}")).collect(),
            series: series
                .map(|(index, (name, colour))| GroupedSeries {
                    name: (*name).to_owned(),
                    colour,
                    bars: (0..groups).map(|place| bar(place, 5.0 * index as f64)).collect(),
                    average: average.then(|| bar(0, 0.0)),
                })
                .collect(),
            measure: "Relative performance (%)".to_owned(),
            line: Some((100.0, "Expert")),
            dots: "Episode",
            caption:
                "Mean over seeds ± s.e.m.; n = 5 seeds. Read from published results, not played."
                    .to_owned(),
            width: Width::TwoColumns,
        }
    }

    const FIVE: [&str; 5] = ["bc", "obc_wo_obs_norm", "obc", "obc_ppo", "arnold"];

    #[test]
    fn all_text_lies_on_the_sheet_and_none_on_other_text() {
        assert_all_text_fits(&figure(14, &FIVE, true).to_svg().unwrap());
        assert_all_text_fits(&figure(1, &["arnold"], false).to_svg().unwrap());
        let mut sizes = figure(4, &["obc"], false);
        (sizes.width, sizes.groups) =
            (Width::OneColumn, ["OBC", "M", "S", "XS"].map(str::to_owned).to_vec());
        sizes.series[0].bars.iter_mut().for_each(|bar| bar.note = "4,450,564".to_owned());
        assert_all_text_fits(&sizes.to_svg().unwrap());
    }

    #[test]
    fn the_same_figure_gives_the_same_bytes_and_what_is_undefined_is_not_drawn() {
        let mut figure = figure(3, &FIVE, true);
        let drawn = figure.to_svg().unwrap();
        assert_eq!(drawn, figure.clone().to_svg().unwrap());
        let bar = &mut figure.series[1].bars[1];
        (bar.mean, bar.dots[3]) = (f64::NAN, f64::NAN);
        figure.series[2].bars[0].error = f64::NAN;
        let svg = figure.to_svg().unwrap();
        assert!(!svg.contains("NaN"));
        assert_eq!(drawn.matches("<rect").count() - svg.matches("<rect").count(), 1);
        figure.series.clear();
        assert!(matches!(figure.to_svg(), Err(FigureError::Empty)));
    }

    #[test]
    #[ignore = "for a person to look at: FIGURES=/tmp/figures cargo test --release -- --ignored samples"]
    fn samples_of_grouped_bars() {
        write_sample("grouped_14", &figure(14, &FIVE, true).to_svg().unwrap());
    }
}
