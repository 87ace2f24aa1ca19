//! Hostile checkpoints, by the layer they attack, and what they are built with.
//!
//! Every hostile file is a small good one with one thing wrong, so that an error can only come from that thing.

pub(crate) mod build;
#[macro_use]
mod case;

mod archives;
mod pickles;
mod statistics;
mod tensors;
