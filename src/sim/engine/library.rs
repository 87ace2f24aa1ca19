//! Opening a `MuJoCo` library and the table of functions we call in it.

use std::ffi::{CStr, c_char, c_int, c_void};
use std::path::{Path, PathBuf};
use std::sync::Arc;

use crate::assets::PhysicsVersion;

use super::appearance::{self, Looks, Traces};
use super::bindings_2_3_7 as v2;
use super::bindings_3_17_0 as v3;
use super::capture::{self, DataFields, ModelFields};

/// Why physics is not available.
#[derive(Debug, thiserror::Error)]
pub enum EngineError {
    /// The shared library cannot be opened or lacks a function.
    #[error("cannot use the MuJoCo library `{path}`: {source}")]
    Library {
        /// The library's file.
        path: PathBuf,
        /// What the loader said.
        source: libloading::Error,
    },
    /// The library is another version than its name says.
    #[error("expected MuJoCo {expected}, the library says version number {found}: `{path}`")]
    WrongVersion {
        /// The version asked for.
        expected: PhysicsVersion,
        /// What `mj_version` returned.
        found: i32,
        /// The library's file.
        path: PathBuf,
    },
    /// The model does not compile.
    #[error("cannot compile the model: {message} in `{path}`")]
    Model {
        /// What `MuJoCo` said.
        message: String,
        /// The model's file.
        path: PathBuf,
    },
    /// There is no such model file.
    #[error("the model is not installed: there is no `{path}`")]
    NoModel {
        /// The model's file.
        path: PathBuf,
    },
    /// `MuJoCo` could not take the memory for a body.
    #[error("MuJoCo ran out of memory")]
    OutOfMemory,
    /// The model has no element of that name.
    #[error("the model has no {kind} called `{name}`")]
    NoSuchElement {
        /// `joint`, `site`, `body`, `geom`, `actuator`.
        kind: &'static str,
        /// The name that was looked for.
        name: String,
    },
    /// The model compiles, and is not the body a task was made for.
    #[error("the model does not fit the task: {what}, in `{path}`")]
    WrongModel {
        /// What the task needs, and what the model has.
        what: String,
        /// The model's file.
        path: PathBuf,
    },
}

/// `MuJoCo` functions by address; `Model` and `Data` are opaque here.
pub(super) struct Functions {
    pub(super) load_xml:
        unsafe extern "C" fn(*const c_char, *const c_void, *mut c_char, c_int) -> *mut c_void,
    pub(super) copy_model: unsafe extern "C" fn(*mut c_void, *const c_void) -> *mut c_void,
    pub(super) delete_model: unsafe extern "C" fn(*mut c_void),
    pub(super) make_data: unsafe extern "C" fn(*const c_void) -> *mut c_void,
    pub(super) delete_data: unsafe extern "C" fn(*mut c_void),
    pub(super) reset_data: unsafe extern "C" fn(*const c_void, *mut c_void),
    pub(super) forward: unsafe extern "C" fn(*const c_void, *mut c_void),
    pub(super) forward_skip: unsafe extern "C" fn(*const c_void, *mut c_void, c_int, c_int),
    pub(super) normalize_quaternions: unsafe extern "C" fn(*const c_void, *mut f64),
    pub(super) kinematics: unsafe extern "C" fn(*const c_void, *mut c_void),
    pub(super) step: unsafe extern "C" fn(*const c_void, *mut c_void),
    pub(super) step1: unsafe extern "C" fn(*const c_void, *mut c_void),
    pub(super) step2: unsafe extern "C" fn(*const c_void, *mut c_void),
    pub(super) object_velocity:
        unsafe extern "C" fn(*const c_void, *const c_void, c_int, c_int, *mut f64, c_int),
    pub(super) contact_force: unsafe extern "C" fn(*const c_void, *const c_void, c_int, *mut f64),
}

/// An opened `MuJoCo` library. Shared by every body that lives in it; stays open as long as one of them does.
pub struct Library {
    pub(super) functions: Functions,
    version: PhysicsVersion,
    // Dropped last: the functions above point into it.
    _handle: libloading::Library,
}

impl std::fmt::Debug for Library {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "MuJoCo {}", self.version)
    }
}

impl Library {
    /// Opens the library file of `version` at `path`, checks that it is that version and routes its messages.
    pub fn open(version: PhysicsVersion, path: &Path) -> Result<Arc<Self>, EngineError> {
        let fail = |source| EngineError::Library { path: path.to_path_buf(), source };
        // SAFETY: the official library has no constructors with side effects on this process; its hash was verified
        // when it was installed.
        let handle = unsafe { libloading::Library::new(path) }.map_err(fail)?;
        // SAFETY: `int mj_version(void)` in both versions.
        let found = unsafe {
            let mj_version =
                handle.get::<unsafe extern "C" fn() -> c_int>(b"mj_version\0").map_err(fail)?;
            mj_version()
        };
        let expected = match version {
            PhysicsVersion::V2_3_7 => 237,
            PhysicsVersion::V3_17_0 => 3_017_000,
        };
        if found != expected {
            let path = path.to_path_buf();
            return Err(EngineError::WrongVersion { expected: version, found, path });
        }
        // SAFETY: the signatures are those of the headers of both versions, with structures as opaque pointers; the two
        // handlers are plain function pointer variables, set once per opened library to the same functions.
        let functions = unsafe {
            macro_rules! symbol {
                ($name:literal) => {
                    *handle.get(concat!($name, "\0").as_bytes()).map_err(fail)?
                };
            }
            type Handler = Option<unsafe extern "C" fn(*const c_char)>;
            let on_warning: *mut Handler = symbol!("mju_user_warning");
            let on_error: *mut Handler = symbol!("mju_user_error");
            on_warning.write(Some(ignore_warning));
            on_error.write(Some(stop_on_error));
            Functions {
                load_xml: symbol!("mj_loadXML"),
                copy_model: symbol!("mj_copyModel"),
                delete_model: symbol!("mj_deleteModel"),
                make_data: symbol!("mj_makeData"),
                delete_data: symbol!("mj_deleteData"),
                reset_data: symbol!("mj_resetData"),
                forward: symbol!("mj_forward"),
                forward_skip: symbol!("mj_forwardSkip"),
                normalize_quaternions: symbol!("mj_normalizeQuat"),
                kinematics: symbol!("mj_kinematics"),
                step: symbol!("mj_step"),
                step1: symbol!("mj_step1"),
                step2: symbol!("mj_step2"),
                object_velocity: symbol!("mj_objectVelocity"),
                contact_force: symbol!("mj_contactForce"),
            }
        };
        Ok(Arc::new(Self { functions, version, _handle: handle }))
    }

    /// Which physics this is.
    #[must_use]
    pub fn version(&self) -> PhysicsVersion {
        self.version
    }

    /// Addresses of a model's arrays.
    ///
    /// # Safety
    /// `model` must be a valid model of this library.
    pub(super) unsafe fn model_fields(&self, model: *mut c_void) -> ModelFields {
        // SAFETY: the pointer is a model of this library, and each version is read through its own declarations.
        unsafe {
            match self.version {
                PhysicsVersion::V2_3_7 => capture::v2_3_7::model(model.cast::<v2::mjModel>()),
                PhysicsVersion::V3_17_0 => capture::v3_17_0::model(model.cast::<v3::mjModel>()),
            }
        }
    }

    /// Addresses of a body's state arrays.
    ///
    /// # Safety
    /// `model` and `data` must be valid, belong together and be of this library.
    pub(super) unsafe fn data_fields(&self, model: *mut c_void, data: *mut c_void) -> DataFields {
        // SAFETY: as above.
        unsafe {
            match self.version {
                PhysicsVersion::V2_3_7 => capture::v2_3_7::data(model.cast(), data.cast()),
                PhysicsVersion::V3_17_0 => capture::v3_17_0::data(model.cast(), data.cast()),
            }
        }
    }

    /// Addresses of the arrays of a model that its looks depend on.
    ///
    /// # Safety
    /// `model` must be a valid model of this library.
    pub(super) unsafe fn looks(&self, model: *mut c_void) -> Looks {
        // SAFETY: as above.
        unsafe {
            match self.version {
                PhysicsVersion::V2_3_7 => appearance::v2_3_7::looks(model.cast()),
                PhysicsVersion::V3_17_0 => appearance::v3_17_0::looks(model.cast()),
            }
        }
    }

    /// Where a body's state keeps its tendons and contacts.
    ///
    /// # Safety
    /// `model` and `data` must be valid, belong together and be of this library.
    pub(super) unsafe fn traces(&self, model: *mut c_void, data: *mut c_void) -> Traces {
        // SAFETY: as above.
        unsafe {
            match self.version {
                PhysicsVersion::V2_3_7 => appearance::v2_3_7::traces(model.cast(), data.cast()),
                PhysicsVersion::V3_17_0 => appearance::v3_17_0::traces(model.cast(), data.cast()),
            }
        }
    }
}

/// Warnings are counted in the state and handled there; the default handler would write a log file into the current
/// folder.
unsafe extern "C" fn ignore_warning(_message: *const c_char) {}

/// `MuJoCo` cannot go on after an error (it would call `exit` itself), and there is no way back through its frames.
unsafe extern "C" fn stop_on_error(message: *const c_char) {
    // SAFETY: MuJoCo passes a NUL-terminated string.
    let message = unsafe { CStr::from_ptr(message) };
    eprintln!("error: MuJoCo stopped: {}", message.to_string_lossy());
    std::process::abort();
}
