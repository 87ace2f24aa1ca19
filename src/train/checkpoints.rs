//! A run on disk, so that it goes on after a kill as if nothing had happened.
//!
//! `state.npz` holds everything: parameters, what the optimiser remembers, statistics of observations and rewards, and for
//! every environment the number of its episode with the actions so far, which [`super::body`] plays again. It is written at
//! the end of an iteration, in one step; streams of random numbers need no state, because every iteration and every episode
//! has its own.

use std::collections::BTreeMap;
use std::path::Path;

use super::TrainError;
use super::adam::{Adam, AdamSettings};
use super::body::FinishedEpisode;
use super::collector::Collector;
use super::reward_normaliser::Returns;
use super::trainer::Trainer;
use crate::npz::{Array, Arrays, Elements, Member, write_npz};
use crate::policy::checkpoint::contents::{Tensor, TensorMap};

/// What the names of the optimiser's tensors begin with.
pub(super) const OPTIMISER: &str = "optimiser.";
/// What the names of parameters begin with.
pub(super) const PARAMETER: &str = "parameter.";

/// Arrays of a state by their names.
pub(super) type Members = BTreeMap<String, Member>;

pub(super) fn add(members: &mut Members, name: &str, shape: Vec<usize>, elements: Elements) {
    members.insert(name.to_owned(), Member::Numbers(Array { shape, elements }));
}

/// Adds tensors, their names behind `prefix`.
pub(super) fn add_tensors(members: &mut Members, prefix: &str, tensors: TensorMap) {
    for (name, tensor) in tensors {
        add(members, &format!("{prefix}{name}"), tensor.shape, Elements::F32(tensor.data));
    }
}

impl Trainer {
    /// Writes the run as it is.
    pub(super) fn write_state(&self, path: &Path) -> Result<(), TrainError> {
        let mut members = Members::new();
        let counters = [self.iteration as i64, self.steps as i64, self.adam.steps() as i64];
        add(&mut members, "counters", vec![3], Elements::I64(counters.to_vec()));
        let parameters = self.network.parameters();
        add_tensors(&mut members, "", parameters.tensors_of(parameters.numbers(), PARAMETER));
        add_tensors(&mut members, OPTIMISER, self.adam.tensors(parameters));
        self.collector.write_state(&mut members);
        Ok(write_npz(path, &members)?)
    }

    /// Goes on from what [`Self::write_state`] wrote.
    pub(super) fn read_state(&mut self, path: &Path) -> Result<(), TrainError> {
        let arrays = Arrays::open(path)?;
        let counters = whole_numbers(&arrays, "counters")?;
        let &[iteration, steps, updates] = counters.as_slice() else {
            return Err(broken("counters"));
        };
        if steps < self.plan.first_step() {
            return Err(broken("counters"));
        }
        let tensors = |prefix: &str| tensors_under(&arrays, prefix);
        self.network.parameters_mut().read(&tensors(PARAMETER))?;
        self.adam = Adam::restore(
            AdamSettings::default(),
            self.network.parameters(),
            updates,
            &tensors(OPTIMISER),
        )?;
        self.collector.read_state(&arrays)?;
        (self.iteration, self.steps) = (iteration as usize, steps);
        Ok(())
    }
}

impl Collector {
    /// Adds statistics, and every environment's episode.
    pub(super) fn write_state(&self, members: &mut Members) {
        let [mean, variance, count] = self.scales.observations.numbers();
        for (name, numbers) in [
            ("observation_mean", mean),
            ("observation_variance", variance),
            ("observation_count", count),
            ("returns", self.scales.rewards.returns().to_vec()),
            ("recent_rewards", self.recent.iter().map(|episode| episode.reward).collect()),
        ] {
            add(members, name, vec![numbers.len()], Elements::F64(numbers));
        }
        let statistics = self.scales.rewards.statistics();
        let numbers = statistics.iter().flat_map(|s| [s.mean, s.variance, s.count]).collect();
        add(members, "return_statistics", vec![statistics.len(), 3], Elements::F64(numbers));
        let lengths = self.recent.iter().map(|episode| episode.steps as i64).collect();
        add(members, "recent_steps", vec![self.recent.len()], Elements::I64(lengths));
        let episodes = self.bodies.iter().map(|body| body.episode as i64).collect();
        add(members, "episodes", vec![self.bodies.len()], Elements::I64(episodes));
        for (seat, body) in self.bodies.iter().enumerate() {
            let shape = vec![body.executed.len() / body.muscles(), body.muscles()];
            let elements = Elements::F32(body.executed.clone());
            add(members, &format!("executed.{seat}"), shape, elements);
        }
    }

    /// Goes on from what [`Self::write_state`] added.
    pub(super) fn read_state(&mut self, arrays: &Arrays) -> Result<(), TrainError> {
        let numbers = |name: &str| Ok::<_, TrainError>(arrays.get(name)?.to_f64());
        self.scales.observations.restore([
            numbers("observation_mean")?,
            numbers("observation_variance")?,
            numbers("observation_count")?,
        ])?;
        let returns = |row: &[f64]| Returns { mean: row[0], variance: row[1], count: row[2] };
        let statistics = numbers("return_statistics")?;
        let statistics = statistics.as_chunks::<3>().0.iter().map(|row| returns(row)).collect();
        self.scales.rewards.restore(statistics, numbers("returns")?)?;
        let lengths = whole_numbers(arrays, "recent_steps")?;
        let recent = numbers("recent_rewards")?.into_iter().zip(lengths);
        let episode = |(reward, steps)| FinishedEpisode { reward, steps: steps as usize };
        self.recent = recent.map(episode).collect();
        let episodes = whole_numbers(arrays, "episodes")?;
        if episodes.len() != self.bodies.len() {
            return Err(broken("episodes"));
        }
        for (seat, (body, episode)) in self.bodies.iter_mut().zip(episodes).enumerate() {
            let executed = arrays.get(&format!("executed.{seat}"))?;
            if executed.shape.get(1) != Some(&body.muscles()) {
                return Err(broken("actions"));
            }
            body.replay(episode as usize, &executed.to_f32());
        }
        self.look();
        Ok(())
    }
}

pub(super) fn broken(what: &str) -> TrainError {
    TrainError::State { what: what.to_owned() }
}

/// The arrays whose names begin with `prefix`, by the rest of their names.
pub(super) fn tensors_under(arrays: &Arrays, prefix: &str) -> TensorMap {
    let with = arrays.0.iter().filter_map(|(name, array)| {
        let name = name.strip_prefix(prefix)?.to_owned();
        Some((name, Tensor { shape: array.shape.clone(), data: array.to_f32() }))
    });
    with.collect()
}

pub(super) fn whole_numbers(arrays: &Arrays, name: &str) -> Result<Vec<u64>, TrainError> {
    match &arrays.get(name)?.elements {
        Elements::I64(numbers) => {
            numbers.iter().map(|&n| u64::try_from(n).map_err(|_| broken(name))).collect()
        }
        _ => Err(broken(name)),
    }
}
