//! One body: a compiled model, its state, and the few operations the tasks need.
//!
//! Every body owns its own copy of the model, because tasks edit it (target sites, ball masses). Edits are plain writes
//! to the compiled arrays; derived quantities stay as compiled, as in the published environments
//! (`spec/tasks.md` §1.2).

use std::ffi::{CStr, CString, c_char, c_int, c_void};
use std::path::Path;
use std::sync::Arc;

use super::appearance::{Looks, Traces};
use super::capture::{ACTUATOR_PARAMETERS, DataFields, ModelFields, NameTable, Span};
use super::library::{EngineError, Library};
use crate::policy::policies::muscle_model::{MuscleModel, MuscleParameters};

/// Object type number of a body for `mj_objectVelocity`: 1 in every version since 1.0.
const OBJECT_IS_BODY: c_int = 1;
/// The option bit that switches actuation off: bit 10 in both versions.
const DISABLE_ACTUATION: c_int = 1 << 10;
/// `mjSTAGE_VEL`, the stage up to which `mj_forwardSkip` skips: the same number in both versions.
const VELOCITY_STAGE: c_int = 2;

/// A model with its state.
pub struct Simulation {
    library: Arc<Library>,
    model: *mut c_void,
    data: *mut c_void,
    model_fields: ModelFields,
    fields: DataFields,
    model_path: Arc<Path>,
    /// As long as `qpos`.
    scratch: Vec<f64>,
}

// SAFETY: a body is used by one thread at a time (every method that touches memory other threads could see takes
// `&mut self` or reads memory owned by this body alone); MuJoCo keeps no thread-local state about it.
unsafe impl Send for Simulation {}

impl std::fmt::Debug for Simulation {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "body of `{}` in {:?}", self.model_path.display(), self.library)
    }
}

impl Drop for Simulation {
    fn drop(&mut self) {
        // SAFETY: both were made by this library, are owned by this body, and are not used afterwards.
        unsafe {
            (self.library.functions.delete_data)(self.data);
            (self.library.functions.delete_model)(self.model);
        }
    }
}

/// The kinds of named elements.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Names {
    /// Joints.
    Joint,
    /// Bodies.
    Body,
    /// Geometric shapes.
    Geom,
    /// Sites.
    Site,
    /// Actuators, i.e. muscles.
    Actuator,
}

impl Names {
    fn word(self) -> &'static str {
        match self {
            Self::Joint => "joint",
            Self::Body => "body",
            Self::Geom => "geom",
            Self::Site => "site",
            Self::Actuator => "actuator",
        }
    }
}

/// Accessors for arrays: `name -> field`, with the mutable twin where one is needed.
macro_rules! arrays {
    ($($(#[$doc:meta])* $owner:ident . $field:ident => $get:ident $(, $get_mut:ident)?;)*) => {
        $(
            $(#[$doc])*
            #[must_use]
            pub fn $get(&self) -> &[f64] {
                // SAFETY: the array belongs to this body and lives as long as it does.
                unsafe { slice(self.$owner.$field) }
            }
            $(
                /// The same, to be written.
                pub fn $get_mut(&mut self) -> &mut [f64] {
                    // SAFETY: as above, and `&mut self` makes the access exclusive.
                    unsafe { slice_mut(self.$owner.$field) }
                }
            )?
        )*
    };
}

impl Simulation {
    /// Compiles the model file `path` and makes a body of it.
    pub fn load(library: &Arc<Library>, path: &Path) -> Result<Self, EngineError> {
        let fail = |message: String| EngineError::Model { message, path: path.to_path_buf() };
        let file = CString::new(path.as_os_str().as_encoded_bytes())
            .map_err(|_| fail("its path contains a NUL byte".to_owned()))?;
        let mut message = [0 as c_char; 1000];
        // SAFETY: the path is NUL-terminated, the message buffer is as long as said, a null file system means the disk.
        let model = unsafe {
            (library.functions.load_xml)(
                file.as_ptr(),
                std::ptr::null(),
                message.as_mut_ptr(),
                message.len() as c_int,
            )
        };
        if model.is_null() {
            // SAFETY: MuJoCo NUL-terminates the message within the buffer, which started as zeros.
            let message = unsafe { CStr::from_ptr(message.as_ptr()) };
            return Err(fail(message.to_string_lossy().trim().to_owned()));
        }
        Self::of_model(library, model, path.into())
    }

    /// Another body of the same model, as compiled plus whatever edits this one carries.
    pub fn duplicate(&self) -> Result<Self, EngineError> {
        // SAFETY: a null destination asks for a new copy of a valid model.
        let model =
            unsafe { (self.library.functions.copy_model)(std::ptr::null_mut(), self.model) };
        if model.is_null() {
            return Err(EngineError::OutOfMemory);
        }
        Self::of_model(&self.library, model, self.model_path.clone())
    }

    fn of_model(
        library: &Arc<Library>,
        model: *mut c_void,
        model_path: Arc<Path>,
    ) -> Result<Self, EngineError> {
        // SAFETY: `model` is valid and owned here; the state is made for it.
        unsafe {
            let data = (library.functions.make_data)(model);
            if data.is_null() {
                (library.functions.delete_model)(model);
                return Err(EngineError::OutOfMemory);
            }
            let model_fields = library.model_fields(model);
            let fields = library.data_fields(model, data);
            let scratch = vec![0.0; fields.qpos.length];
            let library = library.clone();
            Ok(Self { library, model, data, model_fields, fields, model_path, scratch })
        }
    }

    /// The error of a task that needs another body than this: `what` it needs, and what this has.
    #[must_use]
    pub fn unfit(&self, what: String) -> EngineError {
        EngineError::WrongModel { what, path: self.model_path.to_path_buf() }
    }

    /// The library this body lives in.
    #[must_use]
    pub fn library(&self) -> &Arc<Library> {
        &self.library
    }

    arrays! {
        /// Positions at the model's reference configuration.
        model_fields.qpos0 => reference_qpos;
        /// Positions of the model's keyframes, one row per keyframe.
        model_fields.key_qpos => keyframes;
        /// Joint ranges, rows of (low, high), rad or m.
        model_fields.joint_range => joint_range;
        /// Generalised positions, rad or m.
        fields.qpos => qpos, qpos_mut;
        /// Generalised velocities, rad/s or m/s.
        fields.qvel => qvel, qvel_mut;
        /// Muscle activations, 0..1.
        fields.act => activation, activation_mut;
        /// Muscle excitations, 0..1.
        fields.ctrl => excitation, excitation_mut;
        /// Generalised accelerations.
        fields.qacc => qacc;
        /// Where the constraint solver starts.
        fields.qacc_warmstart => warm_start, warm_start_mut;
        /// Positions of mocap bodies, m.
        fields.mocap_pos => mocap_pos, mocap_pos_mut;
        /// Orientations of mocap bodies, quaternions (w, x, y, z).
        fields.mocap_quat => mocap_quat, mocap_quat_mut;
        /// Lengths of muscle-tendon units, m.
        fields.actuator_length => muscle_length;
        /// Lengthening velocities of muscle-tendon units, m/s.
        fields.actuator_velocity => muscle_velocity;
        /// Muscle forces, N, negative when pulling.
        fields.actuator_force => muscle_force;
        /// Sensor values.
        fields.sensordata => sensors;
        /// World positions of body origins, rows of 3, m.
        fields.xpos => body_positions;
        /// World orientations of bodies, rows of 4 (w, x, y, z).
        fields.xquat => body_orientations;
        /// World orientations of bodies, rows of 9, matrices in row-major order.
        fields.xmat => body_matrices;
        /// World positions of sites, rows of 3, m.
        fields.site_xpos => site_positions;
        /// World orientations of sites, rows of 9, matrices in row-major order.
        fields.site_xmat => site_matrices;
        /// Positions of sites in their body, rows of 3, m.
        model_fields.site_pos => model_site_pos, model_site_pos_mut;
        /// Positions of bodies in their parent, rows of 3, m.
        model_fields.body_pos => model_body_pos, model_body_pos_mut;
        /// Masses of bodies, kg.
        model_fields.body_mass => model_body_mass, model_body_mass_mut;
        /// Positions of shapes in their body, rows of 3, m.
        model_fields.geom_pos => model_geom_pos, model_geom_pos_mut;
        /// Orientations of shapes in their body, rows of 4 (w, x, y, z).
        model_fields.geom_quat => model_geom_quat, model_geom_quat_mut;
        /// Half sizes of shapes' bounding boxes behind their centres, rows of 6.
        model_fields.geom_aabb => model_geom_aabb, model_geom_aabb_mut;
        /// Radii of shapes' bounding spheres, m.
        model_fields.geom_rbound => model_geom_rbound, model_geom_rbound_mut;
        /// Sizes of shapes, rows of 3.
        model_fields.geom_size => model_geom_size, model_geom_size_mut;
        /// Friction of shapes, rows of 3 (sliding, torsional, rolling).
        model_fields.geom_friction => model_geom_friction, model_geom_friction_mut;
        /// Orientations of bodies in their parent, rows of 4 (w, x, y, z).
        model_fields.body_quat => model_body_quat, model_body_quat_mut;
    }

    /// How each muscle pulls, from the compiled model.
    #[must_use]
    pub fn muscle_models(&self) -> Vec<MuscleModel> {
        let m = &self.model_fields;
        // SAFETY: the arrays belong to this body's own model.
        let (gains, biases, ranges, accelerations) = unsafe {
            let (gains, biases) = (slice(m.muscle_gain), slice(m.muscle_bias));
            (gains, biases, slice(m.muscle_length_range), slice(m.muscle_acceleration))
        };
        let parameters = |row: &[f64; ACTUATOR_PARAMETERS]| {
            // The last of the ten is not one of a muscle.
            let [numbers @ .., _] = row;
            MuscleParameters::new(numbers)
        };
        let rows = gains.as_chunks().0.iter().zip(biases.as_chunks().0);
        rows.zip(ranges.as_chunks::<2>().0)
            .zip(accelerations)
            .map(|(((gain, bias), &length_range), &acceleration)| MuscleModel {
                gain: parameters(gain),
                bias: parameters(bias),
                length_range,
                acceleration,
            })
            .collect()
    }

    /// A floating-point array of the compiled model by `MuJoCo`'s own name, for replaying recorded models.
    pub fn model_array_mut(&mut self, name: &str) -> Option<&mut [f64]> {
        let m = &self.model_fields;
        let span = match name {
            "site_pos" => m.site_pos,
            "body_pos" => m.body_pos,
            "body_quat" => m.body_quat,
            "body_mass" => m.body_mass,
            "geom_pos" => m.geom_pos,
            "geom_quat" => m.geom_quat,
            "geom_size" => m.geom_size,
            "geom_friction" => m.geom_friction,
            "geom_rbound" => m.geom_rbound,
            "geom_aabb" => m.geom_aabb,
            _ => return None,
        };
        // SAFETY: the array belongs to this body, and `&mut self` makes the access exclusive.
        Some(unsafe { slice_mut(span) })
    }

    /// Shape types of the compiled model, one number of this physics version per shape.
    #[must_use]
    pub fn model_geom_type(&self) -> &[c_int] {
        // SAFETY: the array belongs to this body and lives as long as it does.
        unsafe { slice(self.model_fields.geom_type) }
    }

    /// The same, to be written.
    pub fn model_geom_type_mut(&mut self) -> &mut [c_int] {
        // SAFETY: as above.
        unsafe { slice_mut(self.model_fields.geom_type) }
    }

    /// Simulated time, s.
    #[must_use]
    pub fn time(&self) -> f64 {
        // SAFETY: the field belongs to this body.
        unsafe { *self.fields.time }
    }

    /// Sets the simulated time, s.
    pub fn set_time(&mut self, time: f64) {
        // SAFETY: as above, exclusively.
        unsafe { *self.fields.time = time }
    }

    /// Length of one physics step, s.
    #[must_use]
    pub fn timestep(&self) -> f64 {
        // SAFETY: the field belongs to this body's own model.
        unsafe { *self.model_fields.timestep }
    }

    /// Sets the length of one physics step, s.
    pub fn set_timestep(&mut self, timestep: f64) {
        // SAFETY: as above, exclusively.
        unsafe { *self.model_fields.timestep = timestep }
    }

    /// Number of contacts found in the last collision check.
    #[must_use]
    pub fn contact_count(&self) -> usize {
        // SAFETY: the field belongs to this body.
        usize::try_from(unsafe { *self.fields.contact_count }).unwrap_or(0)
    }

    /// Number of warnings since the last reset: bad positions, velocities, accelerations or controls, full buffers.
    #[must_use]
    pub fn warning_count(&self) -> u64 {
        (0..self.fields.warning_count)
            .map(|i| {
                // SAFETY: the counters are an array of `warning_count` records inside this body's state.
                let count = unsafe { *self.fields.warnings.add(i * self.fields.warning_stride) };
                u64::try_from(count).unwrap_or(0)
            })
            .sum()
    }

    /// Back to the reference configuration with everything cleared, the warm start included (`mj_resetData`).
    pub fn reset(&mut self) {
        // SAFETY: model and state are valid and belong together; the access is exclusive. The same holds below.
        unsafe { (self.library.functions.reset_data)(self.model, self.data) }
    }

    /// Everything that depends on the current state, accelerations included (`mj_forward`).
    pub fn forward(&mut self) {
        // SAFETY: see `reset`.
        unsafe { (self.library.functions.forward)(self.model, self.data) }
    }

    /// What [`Self::forward`] leaves when [`Self::step_first_half`] has just run and nothing was changed since, bit for
    /// bit: positions and velocities are known, only the accelerations are computed.
    ///
    /// Except that every look at the positions normalises their quaternions, and in 2.3.7 a second time can move a last
    /// bit. Then everything is computed again, as `mj_forward` does.
    pub fn forward_after_first_half(&mut self) {
        // SAFETY: the array belongs to this body, and nothing writes to it while it is compared.
        let positions = unsafe { slice(self.fields.qpos) };
        self.scratch.copy_from_slice(positions);
        // SAFETY: the scratch memory is as long as the positions of this model.
        unsafe {
            (self.library.functions.normalize_quaternions)(self.model, self.scratch.as_mut_ptr());
        }
        if self.scratch.iter().zip(positions).any(|(new, old)| new.to_bits() != old.to_bits()) {
            self.forward();
        } else {
            // SAFETY: see `reset`. The last argument asks for the sensors as well.
            unsafe {
                (self.library.functions.forward_skip)(self.model, self.data, VELOCITY_STAGE, 0);
            }
        }
    }

    /// `mj_forward` with the muscles switched off.
    pub fn forward_without_actuation(&mut self) {
        // SAFETY: see `reset`; the flags belong to this body's own model.
        unsafe {
            let flags = self.model_fields.disable_flags;
            let before = *flags;
            *flags = before | DISABLE_ACTUATION;
            (self.library.functions.forward)(self.model, self.data);
            *flags = before;
        }
    }

    /// Positions of bodies and sites only (`mj_kinematics`).
    pub fn kinematics(&mut self) {
        // SAFETY: see `reset`.
        unsafe { (self.library.functions.kinematics)(self.model, self.data) }
    }

    /// One physics step (`mj_step`).
    pub fn step(&mut self) {
        // SAFETY: see `reset`.
        unsafe { (self.library.functions.step)(self.model, self.data) }
    }

    /// The first half of a step: what depends on positions and velocities (`mj_step1`).
    pub fn step_first_half(&mut self) {
        // SAFETY: see `reset`.
        unsafe { (self.library.functions.step1)(self.model, self.data) }
    }

    /// The second half of a step: forces, accelerations, integration (`mj_step2`).
    pub fn step_second_half(&mut self) {
        // SAFETY: see `reset`.
        unsafe { (self.library.functions.step2)(self.model, self.data) }
    }

    /// Angular (rad/s) and linear (m/s) velocity of `body` about its centre of mass, along world axes.
    ///
    /// # Panics
    /// If there is no such body.
    #[must_use]
    pub fn body_velocity(&self, body: usize) -> [f64; 6] {
        let mut velocity = [0.0; 6];
        assert!(body < self.model_fields.body_names.offsets.length, "body {body} does not exist");
        // SAFETY: the body exists, the result has six elements, model and state are only read.
        unsafe {
            (self.library.functions.object_velocity)(
                self.model,
                self.data,
                OBJECT_IS_BODY,
                body as c_int,
                velocity.as_mut_ptr(),
                0,
            );
        }
        velocity
    }

    /// Force along the normal of contact `contact`, N; 0 where it does not push.
    ///
    /// # Panics
    /// If there is no such contact.
    #[must_use]
    pub(super) fn contact_force(&self, contact: usize) -> f64 {
        assert!(contact < self.contact_count(), "contact {contact} does not exist");
        let mut force = [0.0; 6];
        // SAFETY: the contact exists, the result has six elements, model and state are only read.
        unsafe {
            let contact_force = self.library.functions.contact_force;
            contact_force(self.model, self.data, contact as c_int, force.as_mut_ptr());
        }
        force[0]
    }

    pub(super) fn looks(&self) -> Looks {
        // SAFETY: this body's own model, in its own library.
        unsafe { self.library.looks(self.model) }
    }

    pub(super) fn traces(&self) -> Traces {
        // SAFETY: this body's own model and state, in their own library.
        unsafe { self.library.traces(self.model, self.data) }
    }

    /// Number of the element called `name`.
    pub fn find(&self, kind: Names, name: &str) -> Result<usize, EngineError> {
        self.names_of(kind)
            .iter()
            .position(|n| n == name)
            .ok_or_else(|| EngineError::NoSuchElement { kind: kind.word(), name: name.to_owned() })
    }

    /// Names of all elements of a kind, in the model's order; empty where one has none.
    #[must_use]
    pub fn names_of(&self, kind: Names) -> Vec<String> {
        let m = &self.model_fields;
        let NameTable { offsets } = match kind {
            Names::Joint => m.joint_names,
            Names::Body => m.body_names,
            Names::Geom => m.geom_names,
            Names::Site => m.site_names,
            Names::Actuator => m.actuator_names,
        };
        // SAFETY: both arrays belong to this body's model; `c_char` and `u8` have the same layout.
        let (offsets, buffer) = unsafe {
            let buffer = Span { start: m.names.start.cast::<u8>(), length: m.names.length };
            (slice(offsets), slice(buffer))
        };
        offsets
            .iter()
            .map(|&offset| {
                let tail = usize::try_from(offset).ok().and_then(|o| buffer.get(o..));
                let name = CStr::from_bytes_until_nul(tail.unwrap_or(b"\0")).unwrap_or(c"");
                name.to_string_lossy().into_owned()
            })
            .collect()
    }

    /// The shapes that belong to `body`.
    #[must_use]
    pub fn geoms_of(&self, body: usize) -> Vec<usize> {
        // SAFETY: the array belongs to this body's model.
        let owners = unsafe { slice(self.model_fields.geom_body) };
        let owned = |owner: &c_int| usize::try_from(*owner) == Ok(body);
        owners.iter().enumerate().filter(|(_, owner)| owned(owner)).map(|(geom, _)| geom).collect()
    }

    /// Index of joint `joint`'s first coordinate in `qpos`.
    #[must_use]
    pub fn joint_qpos_address(&self, joint: usize) -> usize {
        // SAFETY: the array belongs to this body's model.
        let addresses = unsafe { slice(self.model_fields.joint_qpos_address) };
        usize::try_from(addresses[joint]).unwrap_or(0)
    }

    /// Index of joint `joint`'s first velocity in `qvel`.
    #[must_use]
    pub fn joint_qvel_address(&self, joint: usize) -> usize {
        // SAFETY: the array belongs to this body's model.
        let addresses = unsafe { slice(self.model_fields.joint_qvel_address) };
        usize::try_from(addresses[joint]).unwrap_or(0)
    }

    /// Whether joint `joint` moves along an axis.
    #[must_use]
    pub fn joint_slides(&self, joint: usize) -> bool {
        /// The same number in both versions.
        const SLIDE: c_int = 2;
        // SAFETY: the array belongs to this body's model.
        let types = unsafe { slice(self.model_fields.joint_type) };
        types[joint] == SLIDE
    }
}

/// # Safety
/// The span must lie in live memory of the owner whose borrow gives `'a`.
pub(super) unsafe fn slice<'a, T: Copy>(span: Span<T>) -> &'a [T] {
    if span.length == 0 {
        return &[];
    }
    // SAFETY: the caller vouches for it.
    unsafe { std::slice::from_raw_parts(span.start, span.length) }
}

/// # Safety
/// As [`slice`], and nothing else may access it meanwhile.
unsafe fn slice_mut<'a, T: Copy>(span: Span<T>) -> &'a mut [T] {
    if span.length == 0 {
        return &mut [];
    }
    // SAFETY: the caller vouches for it.
    unsafe { std::slice::from_raw_parts_mut(span.start, span.length) }
}
