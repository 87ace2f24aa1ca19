//! One file per command, each with its arguments and `run`.

#[cfg(feature = "play")]
pub mod bench;
pub mod convert;
mod convert_policy;
#[cfg(feature = "play")]
pub mod csi;
mod data_sets;
pub mod doctor;
#[cfg(feature = "play")]
pub mod emg;
#[cfg(feature = "play")]
pub mod evaluate;
#[cfg(feature = "play")]
pub mod factors;
pub mod inspect;
#[cfg(feature = "play")]
mod inspect_fit;
mod inspect_recording;
#[cfg(feature = "play")]
pub mod kinematics;
#[cfg(feature = "play")]
pub mod rollout;
pub mod setup;
#[cfg(feature = "play")]
pub mod smoothness;
#[cfg(feature = "play")]
pub mod tasks;
#[cfg(feature = "play")]
pub mod verify;
#[cfg(feature = "play")]
mod walking;
