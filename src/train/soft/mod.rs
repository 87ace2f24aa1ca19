//! Runs that learn from all they remember, by a soft actor-critic (`spec/training.md` §5.10).
//!
//! * [`recipe`]: its constants.
//! * [`replay`]: the last steps of every environment; [`replay_file`]: the same on disk.
//! * [`trainer`]: play a stretch, then as many updates as it had transitions, and again.
//! * [`state`]: a run on disk.

pub mod recipe;
mod replay;
mod replay_file;
mod state;
pub mod trainer;
