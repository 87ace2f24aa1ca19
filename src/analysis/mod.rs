//! The blackboard: pure mathematics. Matrices in, numbers out. No files, clocks, threads or physics.

pub mod curves;
pub mod emg;
pub mod excitation;
pub mod factor;
pub mod kinematics;
pub mod performance;
pub mod signal;
pub mod smoothness;
pub mod stats;
pub mod subspace;
pub mod undefined;
