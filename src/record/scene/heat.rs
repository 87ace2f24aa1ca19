//! The heat map: muscles from top to bottom, steps from left to right, coloured by activation; a line stands at the step
//! that is shown.

use re_sdk::EntityPath;
use re_sdk_types::archetypes::{Image, LineStrips2D};
use re_sdk_types::components::{Color, LineStrip2D, MagnificationFilter, Radius};

use crate::units::Seconds;

use super::palette;
use super::store::{SceneError, Store};

/// Width of the picture over its height: long, and not too flat to tell muscles apart.
const SHAPE: usize = 4;

/// Where the map of a take stands.
pub(super) fn path(take: &EntityPath) -> EntityPath {
    take.join(&EntityPath::from_single_string("muscles_by_time"))
}

/// Pixels of a muscle from top to bottom and of a step from left to right, for a map of `steps` × `muscles`.
fn pixels(muscles: usize, steps: usize) -> (usize, usize) {
    let (muscles, steps) = (muscles.max(1), steps.max(1));
    ((steps / (SHAPE * muscles)).max(1), (SHAPE * muscles / steps).max(1))
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
        .with_radii(steps.iter().map(|_| Radius::from(0.3 * wide.max(high) as f32)))
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
