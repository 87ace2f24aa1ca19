//! Reading the addresses and lengths of a model's and a body's arrays, once per body, through each version's own
//! declarations.

use std::ffi::{c_char, c_int};

/// Numbers per actuator in the tables of gains and biases: `mjNGAIN` and `mjNBIAS` of both versions.
pub(super) const ACTUATOR_PARAMETERS: usize = 10;

/// An array inside `MuJoCo`'s memory. Its address stays the same for the life of its owner.
#[derive(Debug, Clone, Copy)]
pub(super) struct Span<T> {
    pub(super) start: *mut T,
    pub(super) length: usize,
}

impl<T> Span<T> {
    /// An array of `count` rows of `width`; sizes in the declarations are `int` or 64-bit, by version.
    pub(super) fn new<N: TryInto<usize>>(start: *mut T, count: N, width: usize) -> Self {
        let length = count.try_into().unwrap_or(0) * width;
        if start.is_null() { Self { start, length: 0 } } else { Self { start, length } }
    }
}

/// Where a kind of element keeps its names: for each element the offset into the name buffer.
#[derive(Debug, Clone, Copy)]
pub(super) struct NameTable {
    pub(super) offsets: Span<c_int>,
}

/// Arrays of a compiled model.
#[derive(Debug, Clone, Copy)]
pub(super) struct ModelFields {
    pub(super) timestep: *mut f64,
    pub(super) disable_flags: *mut c_int,
    pub(super) qpos0: Span<f64>,
    pub(super) key_qpos: Span<f64>,
    pub(super) joint_range: Span<f64>,
    pub(super) joint_type: Span<c_int>,
    pub(super) joint_qpos_address: Span<c_int>,
    pub(super) joint_qvel_address: Span<c_int>,
    pub(super) muscle_gain: Span<f64>,
    pub(super) muscle_bias: Span<f64>,
    pub(super) muscle_length_range: Span<f64>,
    pub(super) muscle_acceleration: Span<f64>,
    pub(super) site_pos: Span<f64>,
    pub(super) body_pos: Span<f64>,
    pub(super) body_quat: Span<f64>,
    pub(super) body_mass: Span<f64>,
    pub(super) geom_pos: Span<f64>,
    pub(super) geom_quat: Span<f64>,
    pub(super) geom_size: Span<f64>,
    pub(super) geom_friction: Span<f64>,
    pub(super) geom_rbound: Span<f64>,
    pub(super) geom_aabb: Span<f64>,
    pub(super) geom_type: Span<c_int>,
    pub(super) geom_body: Span<c_int>,
    pub(super) names: Span<c_char>,
    pub(super) joint_names: NameTable,
    pub(super) body_names: NameTable,
    pub(super) geom_names: NameTable,
    pub(super) site_names: NameTable,
    pub(super) actuator_names: NameTable,
}

/// Arrays of a body's state.
#[derive(Debug, Clone, Copy)]
pub(super) struct DataFields {
    pub(super) time: *mut f64,
    pub(super) contact_count: *const c_int,
    /// Warning counters: `warning_count` records, the counter of each at `warning_stride` ints.
    pub(super) warnings: *const c_int,
    pub(super) warning_count: usize,
    pub(super) warning_stride: usize,
    pub(super) qpos: Span<f64>,
    pub(super) qvel: Span<f64>,
    pub(super) act: Span<f64>,
    pub(super) ctrl: Span<f64>,
    pub(super) qacc: Span<f64>,
    pub(super) qacc_warmstart: Span<f64>,
    pub(super) mocap_pos: Span<f64>,
    pub(super) mocap_quat: Span<f64>,
    pub(super) actuator_length: Span<f64>,
    pub(super) actuator_velocity: Span<f64>,
    pub(super) actuator_force: Span<f64>,
    pub(super) sensordata: Span<f64>,
    pub(super) xpos: Span<f64>,
    pub(super) xquat: Span<f64>,
    pub(super) xmat: Span<f64>,
    pub(super) site_xpos: Span<f64>,
    pub(super) site_xmat: Span<f64>,
}

macro_rules! capture {
    ($module:ident, $bindings:path) => {
        pub(super) mod $module {
            use super::{ACTUATOR_PARAMETERS, DataFields, ModelFields, NameTable, Span};
            use $bindings as declared;

            /// # Safety
            /// `model` must point to a valid model of this version.
            pub(in super::super) unsafe fn model(model: *mut declared::mjModel) -> ModelFields {
                // SAFETY: the caller vouches for the pointer; `m` is only read.
                let m = unsafe { &mut *model };
                let names = |offsets, count| NameTable { offsets: Span::new(offsets, count, 1) };
                ModelFields {
                    timestep: &raw mut m.opt.timestep,
                    disable_flags: &raw mut m.opt.disableflags,
                    qpos0: Span::new(m.qpos0, m.nq, 1),
                    key_qpos: Span::new(m.key_qpos, m.nkey, usize::try_from(m.nq).unwrap_or(0)),
                    joint_range: Span::new(m.jnt_range, m.njnt, 2),
                    joint_type: Span::new(m.jnt_type, m.njnt, 1),
                    joint_qpos_address: Span::new(m.jnt_qposadr, m.njnt, 1),
                    joint_qvel_address: Span::new(m.jnt_dofadr, m.njnt, 1),
                    muscle_gain: Span::new(m.actuator_gainprm, m.nu, ACTUATOR_PARAMETERS),
                    muscle_bias: Span::new(m.actuator_biasprm, m.nu, ACTUATOR_PARAMETERS),
                    muscle_length_range: Span::new(m.actuator_lengthrange, m.nu, 2),
                    muscle_acceleration: Span::new(m.actuator_acc0, m.nu, 1),
                    site_pos: Span::new(m.site_pos, m.nsite, 3),
                    body_pos: Span::new(m.body_pos, m.nbody, 3),
                    body_quat: Span::new(m.body_quat, m.nbody, 4),
                    body_mass: Span::new(m.body_mass, m.nbody, 1),
                    geom_pos: Span::new(m.geom_pos, m.ngeom, 3),
                    geom_quat: Span::new(m.geom_quat, m.ngeom, 4),
                    geom_size: Span::new(m.geom_size, m.ngeom, 3),
                    geom_friction: Span::new(m.geom_friction, m.ngeom, 3),
                    geom_rbound: Span::new(m.geom_rbound, m.ngeom, 1),
                    geom_aabb: Span::new(m.geom_aabb, m.ngeom, 6),
                    geom_type: Span::new(m.geom_type, m.ngeom, 1),
                    geom_body: Span::new(m.geom_bodyid, m.ngeom, 1),
                    names: Span::new(m.names, m.nnames, 1),
                    joint_names: names(m.name_jntadr, m.njnt),
                    body_names: names(m.name_bodyadr, m.nbody),
                    geom_names: names(m.name_geomadr, m.ngeom),
                    site_names: names(m.name_siteadr, m.nsite),
                    actuator_names: names(m.name_actuatoradr, m.nu),
                }
            }

            /// # Safety
            /// `data` must point to a valid state of this version, made for `model`.
            pub(in super::super) unsafe fn data(
                model: *mut declared::mjModel,
                data: *mut declared::mjData,
            ) -> DataFields {
                // SAFETY: the caller vouches for both pointers; they are only read.
                let (m, d) = unsafe { (&*model, &mut *data) };
                DataFields {
                    time: &raw mut d.time,
                    contact_count: &raw const d.ncon,
                    warnings: &raw const d.warning[0].number,
                    warning_count: d.warning.len(),
                    warning_stride: size_of::<declared::mjWarningStat>() / size_of::<i32>(),
                    qpos: Span::new(d.qpos, m.nq, 1),
                    qvel: Span::new(d.qvel, m.nv, 1),
                    act: Span::new(d.act, m.na, 1),
                    ctrl: Span::new(d.ctrl, m.nu, 1),
                    qacc: Span::new(d.qacc, m.nv, 1),
                    qacc_warmstart: Span::new(d.qacc_warmstart, m.nv, 1),
                    mocap_pos: Span::new(d.mocap_pos, m.nmocap, 3),
                    mocap_quat: Span::new(d.mocap_quat, m.nmocap, 4),
                    // Sized `nout` in 3.17, which is `nu` for the muscle models; never read beyond `nu`.
                    actuator_length: Span::new(d.actuator_length, m.nu, 1),
                    actuator_velocity: Span::new(d.actuator_velocity, m.nu, 1),
                    actuator_force: Span::new(d.actuator_force, m.nu, 1),
                    sensordata: Span::new(d.sensordata, m.nsensordata, 1),
                    xpos: Span::new(d.xpos, m.nbody, 3),
                    xquat: Span::new(d.xquat, m.nbody, 4),
                    xmat: Span::new(d.xmat, m.nbody, 9),
                    site_xpos: Span::new(d.site_xpos, m.nsite, 3),
                    site_xmat: Span::new(d.site_xmat, m.nsite, 9),
                }
            }
        }
    };
}

capture!(v2_3_7, super::super::bindings_2_3_7);
capture!(v3_17_0, super::super::bindings_3_17_0);
