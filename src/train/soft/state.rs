//! A run on disk: `state.npz`, as every run has it, and beside it the replay buffer of the same step.
//!
//! The buffer is written first, under a name with its step count, then the state that names it, and the older buffer is removed
//! last. So whenever the program is killed, the state finds the buffer that belongs to it.

use std::path::{Path, PathBuf};

use super::replay_file;
use super::trainer::{ADAM, SoftTrainer};
use crate::files;
use crate::npz::{ArrayError, Arrays, Elements, write_npz};
use crate::train::TrainError;
use crate::train::adam::Adam;
use crate::train::checkpoints::{
    Members, OPTIMISER, PARAMETER, add, add_tensors, broken, tensors_under, whole_numbers,
};

/// What the names of the targets begin with.
const TARGET: &str = "target.";
/// Bytes that a number of a state takes while it is read: eight, and four more of the array that is read just now.
const BYTES_OF_NUMBER: u64 = 12;
/// Bytes for everything in a state but networks.
const REST_OF_STATE: u64 = 64 << 20;
/// What the name of a buffer begins and ends with.
const BUFFER: [&str; 2] = ["replay_", ".bin"];

impl SoftTrainer {
    pub(super) fn write_state(&self, path: &Path) -> Result<(), TrainError> {
        let mut members = Members::new();
        let updates = self.optimisers.actor.steps() as i64;
        let counters = [self.iteration as i64, self.steps as i64, updates];
        add(&mut members, "counters", vec![3], Elements::I64(counters.to_vec()));
        for (parameters, adam) in [
            (&self.network.actor, &self.optimisers.actor),
            (&self.network.critics, &self.optimisers.critics),
            (&self.temperature, &self.optimisers.temperature),
        ] {
            add_tensors(&mut members, "", parameters.tensors_of(parameters.numbers(), PARAMETER));
            add_tensors(&mut members, OPTIMISER, adam.tensors(parameters));
        }
        add_tensors(&mut members, "", self.network.target_tensors(TARGET));
        self.collector.write_state(&mut members);
        let buffer = buffer_beside(path, self.steps);
        replay_file::write(&buffer, &self.replay)?;
        write_npz(path, &members)?;
        remove_other_buffers(&buffer)
    }

    pub(super) fn read_state(&mut self, path: &Path) -> Result<(), TrainError> {
        let arrays = self.open_arrays(path)?;
        let counters = whole_numbers(&arrays, "counters")?;
        let &[iteration, steps, updates] = counters.as_slice() else {
            return Err(broken("counters"));
        };
        let parameters = tensors_under(&arrays, PARAMETER);
        let remembered = tensors_under(&arrays, OPTIMISER);
        for (own, adam) in [
            (&mut self.network.actor, &mut self.optimisers.actor),
            (&mut self.network.critics, &mut self.optimisers.critics),
            (&mut self.temperature, &mut self.optimisers.temperature),
        ] {
            own.read(&parameters)?;
            *adam = Adam::restore(ADAM, own, updates, &remembered)?;
        }
        self.network.read_targets(&tensors_under(&arrays, TARGET), "")?;
        self.collector.read_state(&arrays)?;
        let buffer = buffer_beside(path, steps);
        self.replay.clear();
        replay_file::read(&buffer, &mut self.replay)?;
        (self.iteration, self.steps) = (iteration as usize, steps);
        remove_other_buffers(&buffer)
    }

    /// The arrays of a state, which may be as large as these networks make it: what they are, what three optimisers remember
    /// twice, and targets.
    fn open_arrays(&self, path: &Path) -> Result<Arrays, TrainError> {
        let [actor, critics] =
            [&self.network.actor, &self.network.critics].map(|own| own.numbers().len() as u64);
        let limit = REST_OF_STATE + BYTES_OF_NUMBER * (3 * actor + 4 * critics);
        let bytes = files::read_bounded(path, limit)?;
        let in_file =
            |fault| ArrayError::InFile { fault: Box::new(fault), path: path.to_path_buf() };
        Ok(Arrays::parse(&bytes, limit, |_| true).map_err(in_file)?)
    }
}

fn buffer_beside(state: &Path, steps: u64) -> PathBuf {
    let [start, end] = BUFFER;
    state.with_file_name(format!("{start}{steps}{end}"))
}

/// Removes the buffers beside `own`, which belong to states that are no more.
fn remove_other_buffers(own: &Path) -> Result<(), TrainError> {
    let [start, end] = BUFFER;
    let Some(folder) = own.parent() else { return Ok(()) };
    for path in files::list(folder)? {
        let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
        let steps = name.strip_prefix(start).and_then(|rest| rest.strip_suffix(end));
        let is_buffer = steps.is_some_and(|steps| steps.parse::<u64>().is_ok());
        if is_buffer && path.file_name() != own.file_name() {
            files::remove(&path)?;
        }
    }
    Ok(())
}
