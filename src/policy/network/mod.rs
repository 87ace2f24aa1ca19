//! The networks, inference only, in single precision.
//!
//! * [`transformer`]: the muscle transformer, made of `words`, `layers`, `attention`, `layer_norm`.
//! * [`temporal`]: its successor that attends over time, too.
//! * `lstm`, `mlp`, `activation`: what the single-task experts are made of.
//! * `linear`, `product`, `elementwise`, `weights`: what all of them are made of.

mod activation;
mod attention;
pub(crate) mod elementwise;
mod layer_norm;
mod layers;
pub(super) mod linear;
pub(super) mod lstm;
pub(super) mod mlp;
mod product;
pub mod temporal;
pub mod transformer;
pub(super) mod weights;
mod words;

pub use layers::Sizes;
