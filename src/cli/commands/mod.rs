//! One file per command, each with its arguments and `run`.

#[cfg(feature = "play")]
pub mod bench;
pub mod convert;
mod convert_policy;
#[cfg(feature = "play")]
pub mod csi;
#[cfg(feature = "view")]
mod csi_scene;
#[cfg(feature = "play")]
pub mod curves;
mod data_sets;
pub mod doctor;
#[cfg(feature = "play")]
pub mod emg;
#[cfg(feature = "play")]
pub mod evaluate;
#[cfg(feature = "play")]
pub mod evaluate_benchmarks;
#[cfg(feature = "play")]
pub mod factors;
#[cfg(feature = "play")]
pub mod figures;
#[cfg(feature = "play")]
pub mod gather;
pub mod inspect;
#[cfg(feature = "play")]
mod inspect_fit;
mod inspect_recording;
#[cfg(feature = "play")]
pub mod kinematics;
#[cfg(feature = "play")]
pub mod plan;
#[cfg(feature = "play")]
pub mod report;
#[cfg(feature = "play")]
pub mod rollout;
pub mod setup;
#[cfg(feature = "play")]
pub mod smoothness;
#[cfg(feature = "play")]
pub mod stats;
#[cfg(feature = "play")]
pub mod status;
#[cfg(feature = "play")]
pub mod subspaces;
#[cfg(feature = "play")]
pub mod synergies;
#[cfg(feature = "play")]
pub mod tasks;
#[cfg(feature = "play")]
pub mod train;
#[cfg(feature = "play")]
mod train_csi;
#[cfg(feature = "play")]
mod train_many;
#[cfg(feature = "play")]
pub mod verify;
#[cfg(feature = "view")]
pub mod view;
#[cfg(feature = "play")]
mod walking;
#[cfg(feature = "play")]
pub mod work;
