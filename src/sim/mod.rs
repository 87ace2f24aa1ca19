//! The body: physics behind one small interface, the tasks, and the rollout loop. The only room that may be `unsafe`.
//!
//! The life of one step: [`tasks::Task::before_step`] → excitation from the action ([`muscles`]) → physics ([`engine`]) →
//! [`tasks::Task::observe`] → [`tasks::Task::judge`] → time limit; all of it in [`environment`]. [`rollout`] plays whole
//! episodes of a policy on many bodies at once.

pub mod bodies;
#[expect(unsafe_code, reason = "the one place where MuJoCo's C interface is called")]
pub mod engine;
pub mod environment;
pub mod layout;
pub mod muscles;
pub mod puppet;
pub mod recording;
pub mod rollout;
pub mod rotation;
pub mod tasks;
pub mod watching;

pub use crate::random;
