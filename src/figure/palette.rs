//! The paper's colours.

/// Task-specific subspaces.
pub const BLUE: &str = "#4C72B0";
/// Pooled subspaces.
pub const RED: &str = "#C44E52";
/// Subspaces of the experts.
pub const VIOLET: &str = "#8172B3";
/// Text and axes.
pub const BLACK: &str = "#1A1A1A";
/// What stands back: reference lines, footers.
pub const GREY: &str = "#757575";
/// Paper.
pub const WHITE: &str = "#FFFFFF";
