//! Showing a body without touching it: a second body of the same model is put into the state of the first.
//!
//! A [`Snapshot`] copies the little that a step leaves behind, which costs a rollout microseconds. A [`Puppet`] computes the
//! rest from it with `mj_forward`: poses, tendons along their wrapped paths, muscle forces, contacts. So what is seen belongs
//! to one moment also where a task leaves tendons or contacts of the physics step before, and whoever looks may be slow.

use std::ffi::c_int;

use super::engine::{EngineError, Simulation};

/// The state of a body, and what tasks edit in its model.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Snapshot {
    qpos: Vec<f64>,
    qvel: Vec<f64>,
    activation: Vec<f64>,
    excitation: Vec<f64>,
    mocap_pos: Vec<f64>,
    mocap_quat: Vec<f64>,
    site_pos: Vec<f64>,
    body_pos: Vec<f64>,
    body_quat: Vec<f64>,
    geom_pos: Vec<f64>,
    geom_quat: Vec<f64>,
    geom_size: Vec<f64>,
    geom_reach: Vec<f64>,
    geom_box: Vec<f64>,
    geom_type: Vec<c_int>,
}

impl Snapshot {
    /// The state of `body` now.
    #[must_use]
    pub fn of(body: &Simulation) -> Self {
        let mut snapshot = Self::default();
        snapshot.take(body);
        snapshot
    }

    /// The same, without new memory from the second time on.
    pub fn take(&mut self, body: &Simulation) {
        for (into, from) in [
            (&mut self.qpos, body.qpos()),
            (&mut self.qvel, body.qvel()),
            (&mut self.activation, body.activation()),
            (&mut self.excitation, body.excitation()),
            (&mut self.mocap_pos, body.mocap_pos()),
            (&mut self.mocap_quat, body.mocap_quat()),
            (&mut self.site_pos, body.model_site_pos()),
            (&mut self.body_pos, body.model_body_pos()),
            (&mut self.body_quat, body.model_body_quat()),
            (&mut self.geom_pos, body.model_geom_pos()),
            (&mut self.geom_quat, body.model_geom_quat()),
            (&mut self.geom_size, body.model_geom_size()),
            (&mut self.geom_reach, body.model_geom_rbound()),
            (&mut self.geom_box, body.model_geom_aabb()),
        ] {
            into.clear();
            into.extend_from_slice(from);
        }
        self.geom_type.clear();
        self.geom_type.extend_from_slice(body.model_geom_type());
    }
}

/// A body that is only looked at.
#[derive(Debug)]
pub struct Puppet {
    body: Simulation,
}

impl Puppet {
    /// A puppet of the same model as `body`.
    pub fn new(body: &Simulation) -> Result<Self, EngineError> {
        Ok(Self { body: body.duplicate()? })
    }

    /// The puppet, to be asked what it looks like.
    #[must_use]
    pub fn body(&self) -> &Simulation {
        &self.body
    }

    /// Takes the pose of `snapshot`, which must be of the same model.
    pub fn pose(&mut self, snapshot: &Snapshot) {
        let body = &mut self.body;
        body.qpos_mut().copy_from_slice(&snapshot.qpos);
        body.qvel_mut().copy_from_slice(&snapshot.qvel);
        body.activation_mut().copy_from_slice(&snapshot.activation);
        body.excitation_mut().copy_from_slice(&snapshot.excitation);
        body.mocap_pos_mut().copy_from_slice(&snapshot.mocap_pos);
        body.mocap_quat_mut().copy_from_slice(&snapshot.mocap_quat);
        body.model_site_pos_mut().copy_from_slice(&snapshot.site_pos);
        body.model_body_pos_mut().copy_from_slice(&snapshot.body_pos);
        body.model_body_quat_mut().copy_from_slice(&snapshot.body_quat);
        body.model_geom_pos_mut().copy_from_slice(&snapshot.geom_pos);
        body.model_geom_quat_mut().copy_from_slice(&snapshot.geom_quat);
        body.model_geom_size_mut().copy_from_slice(&snapshot.geom_size);
        body.model_geom_rbound_mut().copy_from_slice(&snapshot.geom_reach);
        body.model_geom_aabb_mut().copy_from_slice(&snapshot.geom_box);
        body.model_geom_type_mut().copy_from_slice(&snapshot.geom_type);
        body.forward();
    }

    /// Lets `change` edit positions and activations, and takes that pose, at rest.
    pub fn bend(&mut self, change: impl FnOnce(&mut [f64], &mut [f64])) {
        let mut qpos = self.body.qpos().to_vec();
        change(&mut qpos, self.body.activation_mut());
        self.body.qpos_mut().copy_from_slice(&qpos);
        self.body.qvel_mut().fill(0.0);
        self.body.forward();
    }
}
