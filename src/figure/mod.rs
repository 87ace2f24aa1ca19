//! The printer: figures as SVG, PDF and PNG, the same bytes for the same input.
//!
//! A figure is a plain struct ([`CsiFigure`], [`BarFigure`]) that draws itself into SVG text; [`write_figure`] puts the
//! SVG and what is made from it on disk. All lengths are in points (1/72 inch), the unit of type and journals.

mod axes;
mod bars;
mod canvas;
mod changes;
mod component_curves;
mod csi;
mod dimensions;
mod export;
mod factors;
mod fonts;
mod grouped_bars;
mod inline;
mod legend;
mod line_grid;
mod metrics;
mod muscle_correlations;
mod muscle_profiles;
pub mod palette;
mod pdf;
mod radar;
#[cfg(test)]
mod testing;
mod theme;

pub use bars::{Bar, BarFigure, BarSeries};
pub use changes::{ChangeDot, ChangeFigure};
pub use component_curves::{ComponentFigure, ComponentPanel, ComponentSeries, LineKind, Scale};
pub use csi::{Basis, CsiFigure, CsiPanel, CsiPoint, CsiSeries, Reconstruction};
pub use dimensions::{DimensionBar, DimensionFigure, DimensionPanel};
pub use export::{PNG_DPI, pdf_from_svg, png_from_svg, write_figure};
pub use factors::{FactorFigure, FactorPanel};
pub use grouped_bars::{GroupedBar, GroupedBarFigure, GroupedSeries};
pub use inline::{InlineSvg, colour_rules, inline_svg};
pub use line_grid::{LineGridFigure, LinePanel, LineSeries};
pub use metrics::{Bracket, MetricBar, MetricPanel, MetricsFigure};
pub use muscle_correlations::{CorrelationBar, CorrelationFigure};
pub use muscle_profiles::{ProfileFigure, ProfilePanel};
pub use radar::{RadarFigure, RadarSeries};
pub use theme::Theme;

use crate::files::FileError;

/// Why a figure cannot be made.
#[derive(Debug, thiserror::Error)]
pub enum FigureError {
    #[error(transparent)]
    File(#[from] FileError),
    #[error("the figure has nothing to show")]
    Empty,
    #[error("the figure is no valid SVG: {what}")]
    InvalidSvg { what: String },
    #[error("a picture of {width} × {height} pixels cannot be made")]
    PictureSize { width: f64, height: f64 },
    #[error("cannot make a {format}: {what}")]
    Conversion { format: &'static str, what: String },
}

/// How wide a figure is printed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Width {
    /// One column of a journal, 85 mm.
    OneColumn,
    /// Both columns of a journal, 174 mm.
    TwoColumns,
}

impl Width {
    /// In points.
    #[must_use]
    pub fn points(self) -> f64 {
        let millimetres = match self {
            Self::OneColumn => 85.0,
            Self::TwoColumns => 174.0,
        };
        millimetres / 25.4 * 72.0
    }
}

/// What the vertical axis measures.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Performance {
    /// Solved steps / horizon, 0 to 1.
    SolvedFraction,
    /// The same divided by a baseline's, in percent.
    Relative,
}

impl Performance {
    fn label(self) -> &'static str {
        match self {
            Self::SolvedFraction => "Solved fraction",
            Self::Relative => "Relative performance (%)",
        }
    }

    /// The value of a perfect score, or of the baseline.
    fn whole(self) -> f64 {
        match self {
            Self::SolvedFraction => 1.0,
            Self::Relative => 100.0,
        }
    }
}

/// What the bands and error bars show; named in the figure.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Uncertainty {
    /// Mean ± its standard error.
    StandardError,
    /// A bootstrap interval of the mean with this confidence, in (0, 1).
    Bootstrap { confidence: f64 },
    /// None is drawn, because none is known.
    Unknown,
}

impl Uncertainty {
    fn label(self) -> String {
        match self {
            Self::StandardError => "± s.e.m.".to_owned(),
            Self::Unknown => "without interval".to_owned(),
            Self::Bootstrap { confidence } => {
                format!("{}% bootstrap interval", canvas::decimal(100.0 * confidence, 1))
            }
        }
    }
}

/// Where the numbers come from; the last line of every figure.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Provenance {
    /// Physics engine and version, e.g. `MuJoCo 2.3.7`.
    pub physics: String,
    /// Name of the policy.
    pub policy: String,
}

impl Provenance {
    /// The same of another policy.
    #[must_use]
    pub fn of_policy(&self, policy: &str) -> Self {
        Self { physics: self.physics.clone(), policy: policy.to_owned() }
    }

    /// As a sentence of a footer.
    #[must_use]
    pub fn label(&self) -> String {
        format!("Policy: {}. Physics: {}.", self.policy, self.physics)
    }
}

/// "n = 100", or "n = 20–100" if it differs.
fn count_label(counts: impl Iterator<Item = usize> + Clone) -> String {
    let low = counts.clone().min().unwrap_or(0);
    let high = counts.max().unwrap_or(0);
    if low == high { format!("n = {low}") } else { format!("n = {low}–{high}") }
}
