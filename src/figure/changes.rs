//! Change per task: open dots are seeds, a filled dot is their mean ± standard deviation, a dashed line is no change.
//!
//! Tasks come in the order given. What is undefined is not drawn.

use super::axes::{Axis, Frame, label_room};
use super::canvas::{Anchor, Area, Canvas, Stroke, TextStyle};
use super::fonts::{LABEL_SIZE, SMALL_SIZE, text_width, wrapped};
use super::legend::{self, Entry, Sample};
use super::palette::{BLACK, GREY};
use super::{FigureError, Width};

/// White space around everything, pt.
const MARGIN: f64 = 3.0;
/// For a line of text and the space around it, pt.
const LINE: f64 = 10.0;
/// Height of the panel, pt.
const HEIGHT: f64 = 130.0;

/// One task; percent, NaN where undefined.
#[derive(Debug, Clone, PartialEq)]
pub struct ChangeDot {
    pub task: String,
    pub seeds: Vec<f64>,
    pub mean: f64,
    pub deviation: f64,
}

/// The whole figure.
#[derive(Debug, Clone, PartialEq)]
pub struct ChangeFigure {
    pub tasks: Vec<ChangeDot>,
    pub colour: &'static str,
    /// What the vertical axis measures, with its unit.
    pub measure: String,
    pub caption: String,
}

impl ChangeFigure {
    /// Draws the figure as SVG.
    pub fn to_svg(&self) -> Result<String, FigureError> {
        if self.tasks.is_empty() {
            return Err(FigureError::Empty);
        }
        let width = Width::OneColumn.points();
        let inner = width - 2.0 * MARGIN;
        let y = self.axis();
        let entries = vec![
            Entry::new(Sample::Ring(self.colour), "Seed"),
            Entry::new(Sample::Dot(self.colour), "Mean ± s.d. over seeds"),
        ];
        let legend = legend::rows(entries, inner);
        let footer = wrapped(&self.caption, SMALL_SIZE, inner);
        // Names slope at 45°: they reach as far down as to the left.
        let reach = |task: &ChangeDot| {
            text_width(&task.task, SMALL_SIZE, false) * std::f64::consts::FRAC_1_SQRT_2
        };
        let names_height = self.tasks.iter().map(reach).fold(0.0, f64::max) + SMALL_SIZE + 3.0;
        let slot = (inner - LINE - label_room(&y)) / self.tasks.len() as f64;
        let beyond = |(place, task): (usize, &ChangeDot)| {
            reach(task) + SMALL_SIZE - (place as f64 + 0.5) * slot
        };
        let names_room = self.tasks.iter().enumerate().map(beyond).fold(0.0, f64::max);
        let left = MARGIN + names_room.max(LINE + label_room(&y));
        let top = MARGIN + legend.len() as f64 * legend::ROW + 6.0;
        let area = Area { left, top, width: width - left - MARGIN - 4.0, height: HEIGHT };
        let x = Axis { low: 0.0, high: self.tasks.len() as f64, ticks: Vec::new() };
        let frame = Frame { area, x, y };
        let footer_top = area.bottom() + names_height;
        let height = footer_top + (footer.len() as f64 + 0.4) * LINE + MARGIN;
        let mut canvas = Canvas::new(width, height);
        legend::draw(&mut canvas, &legend, MARGIN, MARGIN);
        let zero = (frame.at(0.0, 0.0), frame.at(self.tasks.len() as f64, 0.0));
        canvas.line(zero.0, zero.1, Stroke::dashed(GREY, 0.7));
        for (place, task) in self.tasks.iter().enumerate() {
            let x = frame.x_at(place as f64 + 0.5);
            let ends = [task.mean - task.deviation, task.mean + task.deviation];
            let ends = ends.map(|value| frame.y_at(value));
            canvas.line((x, ends[0]), (x, ends[1]), Stroke::solid(self.colour, 1.0));
            let count = task.seeds.len();
            for (seed, &value) in task.seeds.iter().enumerate() {
                let share = (seed as f64 + 0.5) / count as f64 - 0.5;
                canvas.ring((x + 5.0 * share, frame.y_at(value)), 1.3, self.colour);
            }
            canvas.circle((x, frame.y_at(task.mean)), 2.0, self.colour);
            let at = (x + 2.0, area.bottom() + SMALL_SIZE + 1.0);
            let style = TextStyle { rotation: -45.0, ..TextStyle::new(SMALL_SIZE, Anchor::End) };
            canvas.text(at, &task.task, style);
        }
        frame.draw_left(&mut canvas, true);
        frame.draw_baseline(&mut canvas);
        let position = (MARGIN + 0.8 * LABEL_SIZE, area.top + area.height / 2.0);
        let style = TextStyle {
            rotation: -90.0,
            colour: BLACK,
            ..TextStyle::new(LABEL_SIZE, Anchor::Middle)
        };
        canvas.text(position, &self.measure, style);
        let style = TextStyle { colour: GREY, ..TextStyle::new(SMALL_SIZE, Anchor::Start) };
        for (index, line) in footer.iter().enumerate() {
            canvas.text((MARGIN, footer_top + (index as f64 + 0.9) * LINE), line, style);
        }
        Ok(canvas.finish())
    }

    fn axis(&self) -> Axis {
        let values = self.tasks.iter().flat_map(|task| {
            let ends = [task.mean - task.deviation, task.mean + task.deviation, task.mean];
            ends.into_iter().chain(task.seeds.clone()).collect::<Vec<f64>>()
        });
        let (low, high) = values
            .filter(|x| x.is_finite())
            .fold((0.0, 0.0), |(low, high), x| (f64::min(low, x), f64::max(high, x)));
        Axis::through_zero(low, high, 6)
    }
}

#[cfg(test)]
mod tests {
    use super::super::palette::VIOLET;
    use super::super::testing::{assert_all_text_fits, write_sample};
    use super::*;

    fn figure(tasks: usize) -> ChangeFigure {
        ChangeFigure {
            tasks: (0..tasks)
                .map(|place| ChangeDot {
                    task: format!("Baoding harder {place}"),
                    seeds: vec![-80.0 + 6.0 * place as f64, -70.0 + 6.0 * place as f64, -60.0],
                    mean: -75.0 + 6.0 * place as f64,
                    deviation: 8.0,
                })
                .collect(),
            colour: VIOLET,
            measure: "Change against OBC (%)".to_owned(),
            caption: "n = 3 seeds. Read from published results, not played.".to_owned(),
        }
    }

    #[test]
    fn all_text_lies_on_the_sheet_and_none_on_other_text() {
        assert_all_text_fits(&figure(14).to_svg().unwrap());
        assert_all_text_fits(&figure(1).to_svg().unwrap());
    }

    #[test]
    fn the_same_figure_gives_the_same_bytes_and_undefined_tasks_are_empty() {
        let mut figure = figure(3);
        let drawn = figure.to_svg().unwrap();
        assert_eq!(drawn, figure.clone().to_svg().unwrap());
        let task = &mut figure.tasks[1];
        (task.mean, task.seeds) = (f64::NAN, vec![f64::NAN; 3]);
        let svg = figure.to_svg().unwrap();
        // A ring is two circles: three seeds and the mean are gone.
        assert_eq!(drawn.matches("<circle").count() - svg.matches("<circle").count(), 7);
        figure.tasks.clear();
        assert!(matches!(figure.to_svg(), Err(FigureError::Empty)));
    }

    #[test]
    #[ignore = "for a person to look at: FIGURES=/tmp/figures cargo test --release -- --ignored samples"]
    fn samples_of_changes() {
        write_sample("changes_14", &figure(14).to_svg().unwrap());
    }
}
