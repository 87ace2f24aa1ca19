//! The heat map: muscles from top to bottom, steps from left to right, coloured by activation; a line stands at the step
//! that is shown.
//!
//! The viewer has no axes for pictures. So names of muscles stand as labels in a margin to the left, as many as can be read
//! below each other where the views open; the notes have all of them.

use re_sdk::EntityPath;
use re_sdk_types::archetypes::{Image, LineStrips2D, Points2D};
use re_sdk_types::components::{Color, LineStrip2D, MagnificationFilter, Radius, ShowLabels, Text};

use crate::units::Seconds;

use super::palette;
use super::store::{SceneError, Store};

/// Width of the picture over its height: long, and not too flat to tell muscles apart.
const SHAPE: usize = 4;

/// Names that can be read below each other.
const NAMES: usize = 11;
/// The margin for names, as a share of the map's width.
const MARGIN: f32 = 0.16;
/// Half of the line that stands at the step, in points of the screen.
const LINE: f32 = 0.75;

/// Where the map of a take stands.
pub(super) fn path(take: &EntityPath) -> EntityPath {
    take.join(&EntityPath::from_single_string("muscles_by_time"))
}

/// Pixels of a muscle from top to bottom and of a step from left to right, for a map of `steps` × `muscles`.
fn pixels(muscles: usize, steps: usize) -> (usize, usize) {
    let (muscles, steps) = (muscles.max(1), steps.max(1));
    ((steps / (SHAPE * muscles)).max(1), (SHAPE * muscles / steps).max(1))
}

/// From one muscle that is named to the next.
fn stride(muscles: usize) -> usize {
    muscles.div_ceil(NAMES).max(1)
}

/// What stands above the map.
pub(super) fn title(muscles: usize) -> String {
    let named = match stride(muscles) {
        1 => String::new(),
        2 => ", every second named".to_owned(),
        3 => ", every third named".to_owned(),
        stride => format!(", every {stride}th named"),
    };
    format!("Activation of {muscles} muscles{named}")
}

/// The rows of the map, for the notes.
#[must_use]
pub fn rows_in_words(muscles: &[String]) -> String {
    format!("rows of the map, from top to bottom: {}", muscles.join(", "))
}

/// The part of the plane that is seen: the map and its margin, as ranges of x and y.
pub(super) fn bounds(muscles: usize, steps: usize) -> ([f64; 2], [f64; 2]) {
    let (high, wide) = pixels(muscles, steps);
    let (width, height) = ((wide * steps.max(1)) as f64, (high * muscles.max(1)) as f64);
    ([-f64::from(MARGIN) * width, width], [0.0, height])
}

/// Writes the names of muscles beside their rows.
pub(super) fn name_rows(
    store: &mut Store,
    take: &EntityPath,
    muscles: &[String],
    steps: usize,
) -> Result<(), SceneError> {
    let (high, wide) = pixels(muscles.len(), steps);
    let x = -0.5 * MARGIN * (wide * steps.max(1)) as f32;
    let [red, green, blue] = palette::NAME;
    let named = || muscles.iter().enumerate().step_by(stride(muscles.len()));
    let points = Points2D::new(named().map(|(row, _)| [x, (row as f32 + 0.5) * high as f32]))
        .with_labels(named().map(|(_, name)| Text::from(name.as_str())))
        .with_show_labels(ShowLabels::from(true))
        .with_colors(named().map(|_| Color::from_rgb(red, green, blue)))
        .with_radii([Radius::new_ui_points(0.0)]);
    store.fixed(path(take).join(&EntityPath::from_single_string("names")), &points)
}

/// Draws `rows`, one per step, into a map of `steps`; what is not known yet stays dark.
pub(super) fn show<'a>(
    store: &mut Store,
    take: &EntityPath,
    muscles: usize,
    steps: usize,
    rows: impl Iterator<Item = &'a [f32]>,
) -> Result<(), SceneError> {
    let (high, wide) = pixels(muscles, steps);
    let (width, height) = (wide * steps.max(1), high * muscles.max(1));
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
    store: &mut Store,
    take: &EntityPath,
    muscles: usize,
    all: usize,
    steps: &[usize],
    interval: Seconds,
) -> Result<(), SceneError> {
    let (high, wide) = pixels(muscles, all);
    let bottom = (high * muscles) as f32;
    let line = |&step: &usize| {
        let x = (wide * step) as f32;
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_map_is_never_much_flatter_nor_higher_than_its_shape() {
        for (muscles, steps) in [(6, 100), (39, 200), (80, 1000), (63, 150), (39, 5000), (1, 1)] {
            let (high, wide) = pixels(muscles, steps);
            let shape = (wide * steps) as f64 / (high * muscles) as f64;
            assert!((1.9..8.1).contains(&shape), "{muscles} × {steps}: {shape}");
        }
    }
}
