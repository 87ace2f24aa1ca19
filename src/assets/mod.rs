//! What the program may not carry and fetches instead: physics libraries and models.
//!
//! Three parts, each one Python wheel fetched by package name and version with the user's own `pip`:
//!
//! | part | wheel | what is taken out of it |
//! |---|---|---|
//! | physics 2.3.7 | `mujoco==2.3.7` | the shared library, the licence |
//! | physics 3.17.0 | `mujoco==3.17.0` | the shared library, the licence |
//! | models | `MyoSuite==2.2.0` | elbow, hand, arm and leg models with their meshes; the baseline policies |
//!
//! What is inside is believed only when it has the SHA-256 committed in [`part`]. Parts live in a cache folder, one
//! folder each, and appear there whole: unpacked beside their place, then renamed. Every use hashes the files again, so
//! a library or model that changed on disk is an error, never a wrong number.
//!
//! Published data sets are not packages: [`data`] fetches them into the user's data folder. The program's own small
//! policies it carries: [`Cache::shipped`].

pub mod cache;
pub mod data;
mod error;
mod install;
mod lock;
pub mod part;
mod physics_version;
pub mod pip;
pub mod platform;
mod receipt;
mod shipped;
mod wheel;

pub use cache::Cache;
pub use error::AssetError;
pub use install::{Event, Source};
pub use part::Part;
pub use physics_version::{PhysicsVersion, UnknownPhysics};
pub use platform::Platform;
pub use receipt::Receipt;
pub use shipped::{CARRIED, CARRIED_EXPERTS};

/// The command that mends everything a missing or damaged part can cause.
pub const SETUP_COMMAND: &str = "arnold-analyze setup";

/// Makes sure that `parts` are in the user's cache, fetching what is not; `observe` is told what happens.
pub fn ensure(parts: &[Part], observe: &mut dyn FnMut(Event)) -> Result<(), AssetError> {
    Cache::locate().ensure(parts, &Source::Pip, observe)
}
