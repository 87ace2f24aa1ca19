//! The blackboard: pure mathematics. Matrices in, numbers out. No files, clocks, threads or physics.

pub mod excitation;
pub mod performance;
pub mod stats;
pub mod subspace;
