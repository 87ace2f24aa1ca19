//! The networks, inference only, in single precision.
//!
//! * [`transformer`]: the muscle transformer, made of `layers`, `attention`, `layer_norm`.
//! * `lstm`, `mlp`: what the single-task experts are made of.
//! * `linear`, `elementwise`, `weights`: what all of them are made of.

mod attention;
mod elementwise;
mod layer_norm;
mod layers;
pub(super) mod linear;
pub(super) mod lstm;
pub(super) mod mlp;
pub mod transformer;
pub(super) mod weights;

pub use layers::Sizes;
