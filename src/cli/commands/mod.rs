//! One file per command, each with its arguments and `run`.

#[cfg(feature = "play")]
pub mod csi;
pub mod doctor;
#[cfg(feature = "play")]
pub mod evaluate;
pub mod inspect;
#[cfg(feature = "play")]
pub mod rollout;
pub mod setup;
#[cfg(feature = "play")]
pub mod tasks;
#[cfg(feature = "play")]
pub mod verify;
