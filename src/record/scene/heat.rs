//! The heat map: muscles from top to bottom, steps from left to right, coloured by activation; a line stands at the step
//! that is shown.
//!
//! The viewer has no axes for pictures. So names of muscles stand as labels in a margin to the left, as many as can be read
//! below each other where the views open; the notes have all of them. Rows and columns are whole pixels.

use re_sdk::EntityPath;
use re_sdk_types::archetypes::{Image, LineStrips2D, Points2D};
use re_sdk_types::components::{Color, LineStrip2D, MagnificationFilter, Radius, ShowLabels, Text};

use crate::units::Seconds;

use super::palette;
use super::store::{SceneError, Store};

/// Width of the map over its height, which fills its view.
const SHAPE: f64 = 3.3;
/// A map may be flatter or higher than that by this share.
const OFF_SHAPE: f64 = 0.1;
/// Pixels from which it is tried to come so near to it, along the thinner side of a cell.
const FINEST: usize = 4;

/// Names that can be read below each other where one take is shown, and where several stand side by side.
const NAMES: [usize; 2] = [11, 8];
/// The margin for names, as a share of the map's width.
const MARGIN: f32 = 0.16;
/// Half of the line that stands at the step, in points of the screen.
const LINE: f32 = 0.75;

/// Where the map of a take stands.
pub(super) fn path(take: &EntityPath) -> EntityPath {
    take.join(&EntityPath::from_single_string("muscles_by_time"))
}

/// The rows of the map, for the notes.
#[must_use]
pub fn rows_in_words(muscles: &[String]) -> String {
    format!("rows of the map, from top to bottom: {}", muscles.join(", "))
}

/// How large a map is.
#[derive(Debug, Clone, Copy)]
pub(super) struct Map {
    muscles: usize,
    steps: usize,
    /// Pixels of a muscle from top to bottom.
    high: usize,
    /// Pixels of a step from left to right.
    wide: usize,
    /// From one muscle that is named to the next.
    stride: usize,
}

impl Map {
    /// The map of `steps` × `muscles` in one of so many `takes`.
    pub(super) fn new(muscles: usize, steps: usize, takes: usize) -> Self {
        let (high, wide) = pixels(muscles.max(1), steps.max(1));
        let stride = muscles.div_ceil(NAMES[usize::from(takes > 1)]).max(1);
        Self { muscles, steps, high, wide, stride }
    }

    fn width(self) -> usize {
        self.wide * self.steps.max(1)
    }

    fn height(self) -> usize {
        self.high * self.muscles.max(1)
    }

    /// What stands above it.
    pub(super) fn title(self) -> String {
        let named = match self.stride {
            1 => String::new(),
            2 => ", every second named".to_owned(),
            3 => ", every third named".to_owned(),
            stride => format!(", every {stride}th named"),
        };
        format!("Activation of {} muscles{named}", self.muscles)
    }

    /// The part of the plane that is seen: the map and its margin, as ranges of x and y.
    pub(super) fn bounds(self) -> ([f64; 2], [f64; 2]) {
        let (width, height) = (self.width() as f64, self.height() as f64);
        ([-f64::from(MARGIN) * width, width], [0.0, height])
    }

    /// Writes the names of `muscles` beside their rows.
    pub(super) fn name_rows(
        self,
        store: &mut Store,
        take: &EntityPath,
        muscles: &[String],
    ) -> Result<(), SceneError> {
        let x = -0.5 * MARGIN * self.width() as f32;
        let [red, green, blue] = palette::NAME;
        let named = || muscles.iter().enumerate().step_by(self.stride);
        let y = |row: usize| (row as f32 + 0.5) * self.high as f32;
        let points = Points2D::new(named().map(|(row, _)| [x, y(row)]))
            .with_labels(named().map(|(_, name)| Text::from(name.as_str())))
            .with_show_labels(ShowLabels::from(true))
            .with_colors(named().map(|_| Color::from_rgb(red, green, blue)))
            .with_radii([Radius::new_ui_points(0.0)]);
        store.fixed(path(take).join(&EntityPath::from_single_string("names")), &points)
    }

    /// Draws `rows`, one per step; what is not known yet stays dark.
    pub(super) fn show<'a>(
        self,
        store: &mut Store,
        take: &EntityPath,
        rows: impl Iterator<Item = &'a [f32]>,
    ) -> Result<(), SceneError> {
        let Self { muscles, steps, high, wide, .. } = self;
        let (width, height) = (self.width(), self.height());
        let mut picture = vec![16_u8; 3 * width * height];
        for (step, row) in rows.take(steps).enumerate() {
            for (muscle, &activation) in row.iter().enumerate().take(muscles) {
                let colour = palette::activation(activation);
                for y in high * muscle..high * (muscle + 1) {
                    for x in wide * step..wide * (step + 1) {
                        picture[3 * (y * width + x)..][..3].copy_from_slice(&colour);
                    }
                }
            }
        }
        let image = Image::from_rgb24(picture, [width as u32, height as u32])
            .with_magnification_filter(MagnificationFilter::Nearest);
        store.fixed(path(take), &image)
    }

    /// Puts the line where the frames of `steps` are.
    pub(super) fn point(
        self,
        store: &mut Store,
        take: &EntityPath,
        steps: &[usize],
        interval: Seconds,
    ) -> Result<(), SceneError> {
        let bottom = (self.high * self.muscles) as f32;
        let line = |&step: &usize| {
            let x = (self.wide * step) as f32;
            LineStrip2D::from([[x, 0.0], [x, bottom]])
        };
        let [red, green, blue] = palette::CURSOR;
        let columns = LineStrips2D::update_fields()
            .with_strips(steps.iter().map(line))
            .with_colors(steps.iter().map(|_| Color::from_rgb(red, green, blue)))
            .with_radii(steps.iter().map(|_| Radius::new_ui_points(LINE)))
            .columns_of_unit_batches()?;
        let path = path(take).join(&EntityPath::from_single_string("now"));
        store.rows(path, steps, interval, columns)
    }
}

/// Pixels of a muscle from top to bottom and of a step from left to right, for a map of `steps` × `muscles`: the fewest that
/// give it nearly its shape, or come nearest to it.
fn pixels(muscles: usize, steps: usize) -> (usize, usize) {
    let cell = steps as f64 / (SHAPE * muscles as f64);
    let tried = (1..=FINEST).map(|thin| {
        let thick = |share: f64| ((thin as f64 * share).round() as usize).max(1);
        if cell >= 1.0 { (thick(cell), thin) } else { (thin, thick(1.0 / cell)) }
    });
    let mut nearest = (f64::INFINITY, (1, 1));
    for (high, wide) in tried {
        let off = (cell * wide as f64 / high as f64).ln().abs();
        if off < nearest.0 {
            nearest = (off, (high, wide));
        }
        if off < OFF_SHAPE {
            break;
        }
    }
    nearest.1
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_map_has_nearly_its_shape() {
        for (muscles, steps) in [
            (6, 101),
            (39, 101),
            (39, 201),
            (80, 1001),
            (63, 151),
            (80, 151),
            (39, 5001),
            (290, 1001),
        ] {
            let (high, wide) = pixels(muscles, steps);
            let shape = (wide * steps) as f64 / (high * muscles) as f64;
            assert!((2.8..3.9).contains(&shape), "{muscles} × {steps}: {shape}");
            assert!(high.min(wide) <= FINEST, "{high} × {wide}");
        }
    }

    #[test]
    fn as_many_muscles_are_named_as_can_be_read() {
        assert_eq!(Map::new(6, 100, 1).title(), "Activation of 6 muscles");
        assert_eq!(Map::new(39, 100, 1).title(), "Activation of 39 muscles, every 4th named");
        assert_eq!(Map::new(39, 100, 3).title(), "Activation of 39 muscles, every 5th named");
    }
}
