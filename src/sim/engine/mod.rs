//! `MuJoCo` behind one small interface, in two versions.
//!
//! Both official shared libraries are opened at run time. Their functions have the same signatures in both versions;
//! their structures do not have the same layout, so [`capture`] reads the addresses of the arrays we need once, when a
//! body is built, and everything after that is version-free and costs a pointer. Enum numbers differ between versions
//! and are not used, but for the few that are the same in both: things are found by name.

mod appearance;
mod bindings_2_3_7;
mod bindings_3_17_0;
mod capture;
mod library;
mod simulation;

pub use appearance::{Appearance, Contact, Mesh, Shape, ShapeKind, Site};
pub use library::{EngineError, Library};
pub use simulation::{Names, Simulation};
