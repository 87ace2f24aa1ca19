//! Radar: methods as closed polygons over the tasks, in percent of the experts.
//!
//! Task k lies at the angle 2πk/n from the right, counter-clockwise. A polygon joins the means, its band is ± s.e.m.;
//! dashed circles lie at 50 and 100 %, dots on the outer one are the experts. The rim is 130 %, or further out if a mean
//! is. A polygon is broken where a value is undefined.

use super::canvas::{Anchor, Canvas, Point, Stroke, TextStyle};
use super::fonts::{SMALL_SIZE, text_width, wrapped};
use super::legend::{self, Entry, Sample};
use super::palette::{BLACK, GREY};
use super::{FigureError, Width};

/// White space around everything, pt.
const MARGIN: f64 = 3.0;
/// For a line of text and the space around it, pt.
const LINE: f64 = 10.0;
/// Value at the rim, percent, if nothing lies further out.
const RIM: f64 = 130.0;
/// Between the rim and the names, pt.
const GAP: f64 = 7.0;
/// Colour of the experts.
const EXPERT: &str = "#9C9C9C";

/// One method; percent, NaN where undefined.
#[derive(Debug, Clone, PartialEq)]
pub struct RadarSeries {
    pub name: String,
    pub colour: &'static str,
    pub mean: Vec<f64>,
    pub error: Vec<f64>,
}

/// The whole figure.
#[derive(Debug, Clone, PartialEq)]
pub struct RadarFigure {
    /// Names of the axes.
    pub tasks: Vec<String>,
    pub series: Vec<RadarSeries>,
    pub caption: String,
}

impl RadarFigure {
    /// Draws the figure as SVG. Three tasks are the fewest that span an area.
    pub fn to_svg(&self) -> Result<String, FigureError> {
        if self.tasks.len() < 3 || self.series.is_empty() {
            return Err(FigureError::Empty);
        }
        let width = Width::OneColumn.points();
        let inner = width - 2.0 * MARGIN;
        let mut entries: Vec<Entry> = self
            .series
            .iter()
            .map(|s| {
                Entry::new(Sample::LineWithBand(Stroke::solid(s.colour, 1.1)), s.name.as_str())
            })
            .collect();
        entries.push(Entry::new(Sample::Dot(EXPERT), "Expert"));
        let legend = legend::rows(entries, inner);
        let footer = wrapped(&self.caption, SMALL_SIZE, inner);
        // Names have two lines: the polygon is what the room is for.
        let lines = self.tasks.iter().flat_map(|name| lines_of(name));
        let longest = lines.map(|line| text_width(&line, SMALL_SIZE, false));
        let beside = longest.fold(0.0, f64::max) + GAP + 2.0;
        let radius = (width / 2.0 - MARGIN - beside).max(40.0);
        let above = MARGIN + legend.len() as f64 * legend::ROW + 1.6 * LINE + GAP;
        let centre = (width / 2.0, above + radius);
        let below = centre.1 + radius + GAP + 1.6 * LINE;
        let height = below + (footer.len() as f64 + 0.8) * LINE + MARGIN;
        let plot = Plot { centre, radius, rim: self.rim(), axes: self.tasks.len() };

        let mut canvas = Canvas::new(width, height);
        legend::draw(&mut canvas, &legend, MARGIN, MARGIN);
        plot.draw_web(&mut canvas);
        for series in &self.series {
            let edge = |sign: f64| -> Vec<Point> {
                let values = series.mean.iter().zip(&series.error);
                // Without an error there is no band, not a broken one.
                let ends: Vec<f64> = values
                    .map(|(mean, error)| (mean + sign * error).max(0.0) + 0.0 * error)
                    .collect();
                plot.polygon(&ends)
            };
            canvas.band(&edge(-1.0), &edge(1.0), series.colour);
        }
        for series in &self.series {
            let line = Stroke::solid(series.colour, 1.1);
            canvas.polyline(&plot.polygon(&series.mean), line);
        }
        self.draw_names(&mut canvas, &plot);
        let style = TextStyle { colour: GREY, ..TextStyle::new(SMALL_SIZE, Anchor::Start) };
        for (index, line) in footer.iter().enumerate() {
            canvas.text((MARGIN, below + (index as f64 + 0.9) * LINE), line, style);
        }
        Ok(canvas.finish())
    }

    fn draw_names(&self, canvas: &mut Canvas, plot: &Plot) {
        for (axis, name) in self.tasks.iter().enumerate() {
            let (x, y) = plot.at_radius(axis, plot.radius + GAP);
            let side = plot.angle(axis).cos();
            let anchor = match side {
                side if side > 0.05 => Anchor::Start,
                side if side < -0.05 => Anchor::End,
                _ => Anchor::Middle,
            };
            let lines = lines_of(name);
            let between = lines.len() as f64 - 1.0;
            // The middle of the name lies on its spoke, or above and below the circle its nearest line.
            let outwards = plot.angle(axis).sin() * between / 2.0;
            for (place, line) in lines.iter().enumerate() {
                let offset = place as f64 - between / 2.0 - outwards;
                let at = (x, y + 0.36 * SMALL_SIZE + 0.8 * LINE * offset);
                canvas.text(at, line, TextStyle::new(SMALL_SIZE, anchor));
            }
        }
        // Between the first two spokes, where no name and seldom a polygon's corner is.
        let angle = std::f64::consts::PI / plot.axes as f64;
        for level in [50.0, 100.0] {
            let r = plot.radius * level / plot.rim;
            let at = (plot.centre.0 + r * angle.cos() + 1.5, plot.centre.1 - r * angle.sin());
            let style = TextStyle { colour: BLACK, ..TextStyle::new(5.5, Anchor::Start) };
            canvas.text(at, &format!("{level:.0} %"), style);
        }
    }

    fn rim(&self) -> f64 {
        let means = self.series.iter().flat_map(|series| &series.mean).copied();
        let highest = means.filter(|x| x.is_finite()).fold(0.0, f64::max);
        if highest > RIM { (highest / 10.0).ceil() * 10.0 } else { RIM }
    }
}

/// A name in two lines: its last word has one of its own.
fn lines_of(name: &str) -> Vec<String> {
    match name.rsplit_once(' ') {
        Some((first, last)) => vec![first.to_owned(), last.to_owned()],
        None => vec![name.to_owned()],
    }
}

/// From axis and value to a position.
struct Plot {
    centre: Point,
    radius: f64,
    rim: f64,
    axes: usize,
}

impl Plot {
    /// Spokes, circles, experts.
    fn draw_web(&self, canvas: &mut Canvas) {
        for axis in 0..self.axes {
            canvas.line(self.centre, self.at(axis, self.rim), Stroke::solid("#DDDDDD", 0.5));
            canvas.line(self.centre, self.at(axis, 100.0), Stroke::solid(EXPERT, 0.7));
        }
        for level in [50.0, 100.0] {
            canvas.polyline(&self.circle(level), Stroke::dashed(GREY, 0.6));
        }
        canvas.polyline(&self.circle(self.rim), Stroke::solid("#DDDDDD", 0.5));
        (0..self.axes).for_each(|axis| canvas.circle(self.at(axis, 100.0), 1.6, EXPERT));
    }

    fn angle(&self, axis: usize) -> f64 {
        std::f64::consts::TAU * axis as f64 / self.axes as f64
    }

    fn at_radius(&self, axis: usize, radius: f64) -> Point {
        let angle = self.angle(axis);
        (self.centre.0 + radius * angle.cos(), self.centre.1 - radius * angle.sin())
    }

    fn at(&self, axis: usize, value: f64) -> Point {
        self.at_radius(axis, self.radius * value / self.rim)
    }

    /// The points of all axes, the first once more at the end.
    fn polygon(&self, values: &[f64]) -> Vec<Point> {
        let points = values.iter().enumerate().map(|(axis, &value)| self.at(axis, value));
        points.chain(values.first().map(|&value| self.at(0, value))).collect()
    }

    fn circle(&self, value: f64) -> Vec<Point> {
        let radius = self.radius * value / self.rim;
        (0..=180)
            .map(|step| {
                let angle = std::f64::consts::TAU * f64::from(step) / 180.0;
                (self.centre.0 + radius * angle.cos(), self.centre.1 - radius * angle.sin())
            })
            .collect()
    }
}

#[cfg(test)]
mod tests {
    use super::super::testing::{assert_all_text_fits, write_sample};
    use super::*;

    const TASKS: [&str; 14] = [
        "Baoding CCW",
        "Baoding CW",
        "Baoding harder",
        "Baoding hard",
        "Elbow pose",
        "Index reach",
        "Little reach",
        "Middle reach",
        "Ring reach",
        "Thumb reach",
        "Walk to point",
        "Pen reorient",
        "Object relocation",
        "Die reorient",
    ];

    fn figure(tasks: usize) -> RadarFigure {
        let series = |name: &str, colour, base: f64| RadarSeries {
            name: name.to_owned(),
            colour,
            mean: (0..tasks).map(|k| base - 3.0 * k as f64).collect(),
            error: vec![3.0; tasks],
        };
        RadarFigure {
            tasks: TASKS[..tasks].iter().map(|name| (*name).to_owned()).collect(),
            series: vec![
                series("PPO", "#C44E52", 60.0),
                series("BC", "#CCB974", 90.0),
                series("Arnold", "#4C72B0", 121.0),
            ],
            caption: "Mean over seeds ± s.e.m., in percent of the experts; n = 3–5 seeds."
                .to_owned(),
        }
    }

    #[test]
    fn all_text_lies_on_the_sheet_and_none_on_other_text() {
        for tasks in [3, 11, 14] {
            assert_all_text_fits(&figure(tasks).to_svg().unwrap());
        }
    }

    #[test]
    fn the_same_figure_gives_the_same_bytes_and_undefined_values_break_the_polygon() {
        let mut figure = figure(14);
        let drawn = figure.to_svg().unwrap();
        assert_eq!(drawn, figure.clone().to_svg().unwrap());
        figure.series[0].mean[4] = f64::NAN;
        figure.series[1].error = vec![f64::NAN; 14];
        let svg = figure.to_svg().unwrap();
        assert!(!svg.contains("NaN"));
        assert_eq!(svg.matches("<polyline").count(), drawn.matches("<polyline").count() + 1);
        figure.tasks.truncate(2);
        assert!(matches!(figure.to_svg(), Err(FigureError::Empty)));
    }

    #[test]
    fn the_first_axis_points_right_and_the_next_ones_turn_against_the_clock() {
        let plot = Plot { centre: (0.0, 0.0), radius: 1.0, rim: 100.0, axes: 4 };
        let near = |(x, y): Point, (u, v): Point| (x - u).abs() < 1e-12 && (y - v).abs() < 1e-12;
        assert!(near(plot.at(0, 100.0), (1.0, 0.0)));
        assert!(near(plot.at(1, 50.0), (0.0, -0.5)));
    }

    #[test]
    #[ignore = "for a person to look at: FIGURES=/tmp/figures cargo test --release -- --ignored samples"]
    fn samples_of_the_radar() {
        write_sample("radar_14", &figure(14).to_svg().unwrap());
    }
}
