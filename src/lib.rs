//! # arnold-analyze
//!
//! How does a muscle-driven policy control the body, and how human is it?
//!
//! The rooms, and the one direction in which they use each other:
//!
//! ```text
//! cli → experiment → sim → policy
//!                  → analysis, record, figure
//! cli → assets
//! train → policy
//! everything → units, files, npz, random, zip_directory
//! ```
//!
//! * [`analysis`]: mathematics. Matrices in, numbers out.
//! * [`policy`]: from a checkpoint on disk to an action, without executing anything in the file.
//! * `sim`: `MuJoCo`, the bodies, the tasks and the one rollout loop. The only room with `unsafe`.
//! * [`record`]: tables on disk. `figure`: figures as SVG, PDF and PNG.
//! * `experiment`: plans, seeds, provenance, and the sweeps made of them.
//! * [`assets`]: what the program may not carry and fetches: `MuJoCo` libraries, `MyoSuite` models.
//! * [`train`]: losses, gradients and the optimiser; what is trained is what [`policy`] reads.
//! * [`cli`]: the front desk.
//!
//! # Squeezing an action into a subspace
//!
//! ```
//! use arnold_analyze::analysis::subspace::{Covariance, Projection, principal_components};
//!
//! let mut covariance = Covariance::new(2);
//! covariance.push_rows(&[0.0_f32, 0.0, 1.0, 1.0, 2.0, 2.0])?; // both muscles always together
//! let first = Projection::new(&principal_components(&covariance)?, 1)?;
//! let mut action = [2.0_f32, 1.0];
//! first.apply(&mut action, &mut vec![0.0; first.scratch_length()]);
//! assert!(action.iter().all(|a| (a - 1.5).abs() < 1e-6));
//! # Ok::<(), arnold_analyze::analysis::subspace::SubspaceError>(())
//! ```
//!
//! # Reading a policy
//!
//! ```no_run
//! let loaded = arnold_analyze::policy::open("phase1_final.zip".as_ref(), None)?;
//! println!("{}: {:?}, wants {:?}", loaded.name, loaded.format, loaded.policy.variant());
//! # Ok::<(), arnold_analyze::policy::PolicyError>(())
//! ```
//!
//! # Playing it
//!
//! ```no_run
//! use std::path::Path;
//! use std::sync::Arc;
//!
//! use arnold_analyze::assets::{Cache, PhysicsVersion};
//! use arnold_analyze::experiment::evaluation::evaluate_task;
//! use arnold_analyze::sim::bodies::Bodies;
//! use arnold_analyze::sim::engine::Library;
//! use arnold_analyze::sim::rollout::{ActionMode, Channels, Machine, RolloutPlan};
//! use arnold_analyze::sim::tasks::{self, RewardConfiguration};
//!
//! # fn main() -> Result<(), Box<dyn std::error::Error>> {
//! let (cache, version) = (Cache::locate(), PhysicsVersion::V2_3_7);
//! let library = Library::open(version, &cache.physics_library(version)?)?;
//! let bodies = Arc::new(Bodies::new(library, &cache.myosuite()?, Path::new("data")));
//! let machine = Machine { bodies, threads: 2, batch: 16 };
//! let loaded = arnold_analyze::policy::open("phase1_final.zip".as_ref(), None)?;
//! let plan = RolloutPlan {
//!     task: tasks::find("baoding_p1_ccw")?,
//!     policy: loaded.policy.as_ref(),
//!     mode: ActionMode::Deterministic,
//!     action_noise: 0.1,
//!     projections: &[],
//!     channels: Channels::Counts,
//!     rewards: RewardConfiguration::Sparse,
//! };
//! let evaluation = evaluate_task(&machine, &plan, 100, 0, &|_| ())?;
//! println!("{:?}", evaluation.solved_fraction());
//! # Ok(())
//! # }
//! ```

pub mod analysis;
pub mod assets;
pub mod cli;
#[cfg(feature = "play")]
pub mod experiment;
#[cfg(feature = "figures")]
pub mod figure;
pub mod files;
pub mod npz;
pub mod policy;
pub mod random;
pub mod record;
#[cfg(feature = "sim")]
pub mod sim;
pub mod train;
pub mod units;
pub mod zip_directory;
