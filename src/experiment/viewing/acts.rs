//! An act of what was recorded: one episode by one or several policies, or in several numbers of components.

use crate::record::Recording;
use crate::record::scene::{Act, Take, rows_in_words};
use crate::sim::bodies::Bodies;
use crate::sim::tasks;

use super::replay::{Means, ReplayError, replay};
use super::signals::signals;

/// An act of episode `number` of `task`, still without takes.
#[must_use]
pub fn act(task: &str, number: u64) -> Act {
    let notes = format!("# {task}, episode {number}\n");
    // What a file says of it may be anything.
    let horizon = tasks::every().find(|known| known.name == task).map_or(0, |known| known.horizon);
    Act { task: task.to_owned(), episode: number, interval: 1.0, horizon, notes, ..Act::default() }
}

/// Adds the take `label` from a recording, if that has the episode. `origin` says where it comes from.
pub fn add_take(
    act: &mut Act,
    label: &str,
    origin: &str,
    bodies: &Bodies,
    recording: &Recording,
) -> Result<(), ReplayError> {
    let number = act.episode;
    let Some(episode) = recording.episodes.iter().find(|e| e.facts.number == number) else {
        return Ok(());
    };
    let (stage, frames, means) = replay(bodies, recording, episode)?;
    let how = match means {
        Means::Played => "played again from its seed; the joints agree with the recorded ones",
        Means::Posed => "posed by its recorded joints; objects and targets do not move",
    };
    act.interval = recording.about.control_interval.unwrap_or(act.interval);
    let steps = episode.facts.length.to_string();
    let policy = recording.about.policy.as_str();
    act.notes.extend(["\n## ", label, "\n\n* policy: ", policy, "\n* ", &steps, " steps, ", how]);
    act.notes.extend(["\n* ", origin, "\n* ", &rows_in_words(&stage.muscles), "\n"]);
    let signals = signals(recording, episode);
    act.takes.push(Take { label: label.to_owned(), stage, frames, signals });
    Ok(())
}
