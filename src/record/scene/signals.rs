//! Signals over time, below `TAKE/signals`: one entity per quantity, one line per element.

use re_sdk::EntityPath;
use re_sdk_types::archetypes::{Scalars, SeriesLines};
use re_sdk_types::components::{
    AggregationPolicy, Color, InterpolationMode, Name, Scalar, StrokeWidth,
};

use crate::units::Seconds;

use super::palette;
use super::store::{SceneError, Store};

/// What values a quantity can have.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum Scale {
    #[default]
    Free,
    /// Between 0 and 1.
    Share,
    /// 0 or 1.
    Flag,
}

impl Scale {
    /// What its plot shows from bottom to top, with a little air; `None`: what there is.
    pub(super) fn range(self) -> Option<[f64; 2]> {
        match self {
            Self::Free => None,
            Self::Share => Some([-0.04, 1.04]),
            Self::Flag => Some([-0.2, 1.2]),
        }
    }
}

/// A quantity with one or several elements at every step.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Signal {
    /// Where it stands below `signals`, in one word.
    pub name: String,
    /// What a person reads above the plot, with the unit.
    pub title: String,
    pub elements: Vec<String>,
    /// Whether it is known only after the step.
    pub after_step: bool,
    pub scale: Scale,
    /// One row per step.
    pub values: Vec<f64>,
}

impl Signal {
    fn rows(&self) -> Result<usize, SceneError> {
        let width = self.elements.len().max(1);
        if self.values.len().is_multiple_of(width) {
            return Ok(self.values.len() / width);
        }
        let (name, found) = (self.name.clone(), self.values.len() % width);
        Err(SceneError::Width { name, found, expected: width })
    }

    /// Where it stands below a take.
    pub(super) fn path(&self, take: &EntityPath) -> EntityPath {
        take.join(&EntityPath::from_single_string("signals"))
            .join(&EntityPath::from_single_string(self.name.as_str()))
    }

    /// Says what the lines are.
    pub(super) fn introduce(&self, store: &mut Store, take: &EntityPath) -> Result<(), SceneError> {
        let colour = |index| {
            let [red, green, blue] = palette::line(index);
            Color::from_rgb(red, green, blue)
        };
        let name = |element: &String| match element.as_str() {
            "" => Name::from(self.title.as_str()),
            element => Name::from(element),
        };
        let lines = SeriesLines::update_fields()
            .with_names(self.elements.iter().map(name))
            .with_colors((0..self.elements.len()).map(colour))
            .with_widths(self.elements.iter().map(|_| StrokeWidth::from(1.5)))
            // A mean of what happened would be a value that never was.
            .with_aggregation_policy(AggregationPolicy::MinMax);
        let lines = match self.scale {
            Scale::Flag => lines.with_interpolation_mode(InterpolationMode::StepAfter),
            Scale::Free | Scale::Share => lines,
        };
        store.fixed(self.path(take), &lines)
    }

    /// Says the values of all steps.
    pub(super) fn show(
        &self,
        store: &mut Store,
        take: &EntityPath,
        interval: Seconds,
    ) -> Result<(), SceneError> {
        let first = usize::from(self.after_step);
        let frames: Vec<usize> = (first..first + self.rows()?).collect();
        self.show_at(store, take, &frames, interval)
    }

    /// Says the values, which stand at `frames`.
    pub(super) fn show_at(
        &self,
        store: &mut Store,
        take: &EntityPath,
        frames: &[usize],
        interval: Seconds,
    ) -> Result<(), SceneError> {
        if frames.is_empty() {
            return Ok(());
        }
        let columns = Scalars::update_fields()
            .with_scalars(self.values.iter().map(|&value| Scalar::from(value)))
            .columns(frames.iter().map(|_| self.elements.len().max(1)))?;
        store.rows(self.path(take), frames, interval, columns)
    }
}
