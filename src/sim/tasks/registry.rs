//! The tasks this program can play, by name: the paper's ([`ALL`]) and others ([`EXTRA`]).

use crate::sim::engine::{EngineError, Simulation};

use super::baoding::{Baoding, Variant};
use super::die_reorient::DieReorient;
pub use super::extra::EXTRA;
use super::extra::{CHOSEN_FINGERS, FINGER_SUBSETS};
use super::finger_reach::{FINGERS, FingerReach, Fingers};
use super::joint_pose::{JointPose, Pose};
use super::pen_reorient::PenReorient;
pub use super::published::ALL;
use super::relocate::Relocate;
use super::walk::{Goal, Walk};
use super::{Rules, Task};

/// Why a task is not available.
#[derive(Debug, thiserror::Error)]
pub enum TaskError {
    /// No task has that name.
    #[error("there is no task called `{name}`{}", suggestion(*.closest))]
    Unknown {
        /// The name that was asked for.
        name: String,
        /// A task whose name is close to it.
        closest: Option<&'static str>,
    },
    /// A choice of fingers names something else.
    #[error("`{word}` in `{name}` is not a finger; choose among {}", finger_names())]
    NotAFinger {
        /// The word.
        word: String,
        /// The name that was asked for.
        name: String,
    },
}

fn finger_names() -> String {
    FINGERS.map(|finger| finger.name).join(", ")
}

fn suggestion(closest: Option<&'static str>) -> String {
    closest.map(|name| format!("; did you mean `{name}`?")).unwrap_or_default()
}

/// A task's constants.
#[derive(Debug, Clone, Copy)]
pub struct Definition {
    /// Code name.
    pub name: &'static str,
    /// Name in the paper, or in its style.
    pub paper_name: &'static str,
    /// What the body has to do, in one line.
    pub summary: &'static str,
    /// Identifier of the published environment, if one has exactly these rules.
    pub environment: Option<&'static str>,
    /// The body.
    pub body: &'static str,
    /// Where the model comes from.
    pub source: Source,
    /// Model file below that.
    pub model: &'static str,
    /// How a control step is made of physics steps.
    pub stepping: Stepping,
    /// Length of a physics step, s.
    pub timestep: f64,
    /// Physics steps per control step.
    pub substeps: usize,
    /// Control steps of a full episode.
    pub horizon: usize,
    /// When a step counts as solved, in a few words; [`Task::thresholds`] says it in full.
    pub solved_when: &'static str,
    pub(super) family: Family,
}

/// Where a model file comes from.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Source {
    /// The `MyoSuite` package, which `setup` fetches.
    MyoSuite,
    /// The data folder, into which published archives are unpacked.
    Data,
}

/// How a control step is made of physics steps (`spec/tasks.md` §1.4, §2.7).
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Stepping {
    /// Second half, whole steps, first half; then everything is computed for the state reached.
    Split,
    /// Whole steps; then positions only, so that forces and sensors lag behind by one physics step.
    Whole,
}

#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Family {
    JointPose(Pose, Rules),
    FingerReach(Fingers, Rules),
    Baoding(Variant),
    PenReorient(Rules),
    DieReorient,
    Relocate,
    Walk(Goal),
}

impl Definition {
    /// Time between two actions, s.
    #[must_use]
    pub fn control_interval(&self) -> f64 {
        self.timestep * self.substeps as f64
    }

    /// The task on a body whose model is [`Definition::model`].
    pub fn build(&self, simulation: &Simulation) -> Result<Box<dyn Task>, EngineError> {
        let dt = self.control_interval();
        Ok(match self.family {
            Family::JointPose(pose, rules) => {
                Box::new(JointPose::new(simulation, dt, pose, rules)?)
            }
            Family::FingerReach(fingers, rules) => {
                Box::new(FingerReach::new(simulation, dt, fingers, rules)?)
            }
            Family::PenReorient(rules) => Box::new(PenReorient::new(simulation, dt, rules)?),
            Family::DieReorient => Box::new(DieReorient::new(simulation, dt)?),
            Family::Relocate => Box::new(Relocate::new(simulation, dt)?),
            Family::Walk(goal) => Box::new(Walk::new(simulation, dt, self.horizon, goal)?),
            Family::Baoding(variant) => {
                Box::new(Baoding::new(simulation, dt, self.horizon, variant)?)
            }
        })
    }
}

/// Every task that is listed: the paper's, then the others.
pub fn every() -> impl Iterator<Item = &'static Definition> {
    ALL.iter().chain(EXTRA)
}

/// The task called `name`. Any choice of fingers is called `hand_reach:<finger>+<finger>…`, in any order.
pub fn find(name: &str) -> Result<&'static Definition, TaskError> {
    if let Some(fingers) = name.strip_prefix(CHOSEN_FINGERS) {
        return reach_of(fingers, name);
    }
    every().chain(&*FINGER_SUBSETS).find(|task| task.name == name).ok_or_else(|| {
        let closest = every()
            .map(|task| (edit_distance(task.name, name), task.name))
            .min()
            // More than half the letters wrong is another word, not a slip.
            .filter(|(distance, _)| 2 * distance <= name.chars().count());
        TaskError::Unknown { name: name.to_owned(), closest: closest.map(|(_, name)| name) }
    })
}

/// The reach of the fingers in `words`, which are joined by plus signs.
fn reach_of(words: &str, name: &str) -> Result<&'static Definition, TaskError> {
    let mut chosen = 0;
    for word in words.split('+') {
        let finger = FINGERS.iter().position(|finger| finger.name == word);
        let not_a_finger =
            || TaskError::NotAFinger { word: word.to_owned(), name: name.to_owned() };
        chosen |= 1 << finger.ok_or_else(not_a_finger)?;
    }
    let reaches = Family::FingerReach(Fingers(chosen), Rules::Arnold);
    let mut tasks = every().chain(&*FINGER_SUBSETS);
    tasks
        .find(|task| task.family == reaches)
        .ok_or_else(|| TaskError::Unknown { name: name.to_owned(), closest: None })
}

/// Levenshtein distance between two names.
fn edit_distance(a: &str, b: &str) -> usize {
    let b: Vec<char> = b.chars().collect();
    let mut row: Vec<usize> = (0..=b.len()).collect();
    for (i, x) in a.chars().enumerate() {
        let mut diagonal = row[0];
        row[0] = i + 1;
        for (j, &y) in b.iter().enumerate() {
            let substitution = diagonal + usize::from(x != y);
            diagonal = row[j + 1];
            row[j + 1] = substitution.min(row[j] + 1).min(diagonal + 1);
        }
    }
    row[b.len()]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_unique_and_found() {
        let tasks: Vec<_> = every().chain(&*FINGER_SUBSETS).collect();
        assert_eq!(tasks.len(), 14 + EXTRA.len() + 25);
        for task in tasks {
            assert_eq!(find(task.name).unwrap().paper_name, task.paper_name);
        }
    }

    #[test]
    fn every_choice_of_fingers_is_a_task_of_its_own() {
        let mut names = std::collections::BTreeSet::new();
        for chosen in 1..32 {
            let fingers: Vec<&str> = Fingers(chosen).each().map(|finger| finger.name).collect();
            let name = format!("hand_reach:{}", fingers.join("+"));
            let task = find(&name).unwrap();
            assert_eq!(task.family, Family::FingerReach(Fingers(chosen), Rules::Arnold), "{name}");
            // The name it goes by afterwards can be typed as well, and can be a file's.
            assert_eq!(find(task.name).unwrap().family, task.family, "{name}");
            assert!(task.name.bytes().all(|b| b.is_ascii_lowercase() || b == b'_'), "{name}");
            names.insert(task.name);
        }
        assert_eq!(names.len(), 31);
        assert_eq!(find("hand_reach:thumb").unwrap().name, "hand_thumb_reach");
        assert_eq!(find("hand_reach:index+thumb").unwrap().name, "hand_thumb_index_reach");
        let every_finger = "hand_reach:little+ring+middle+index+thumb";
        assert_eq!(find(every_finger).unwrap().name, "hand_reach");
    }

    #[test]
    fn what_is_not_a_finger_is_named() {
        for (name, word) in
            [("hand_reach:thumb+toe", "toe"), ("hand_reach:", ""), ("hand_reach:+", "")]
        {
            let message = find(name).unwrap_err().to_string();
            assert!(message.starts_with(&format!("`{word}` in `{name}`")), "{message}");
            assert!(message.ends_with("thumb, index, middle, ring, little"), "{message}");
        }
    }

    #[test]
    fn a_misspelt_name_gets_a_suggestion() {
        let message = find("elbow_poze").unwrap_err().to_string();
        assert_eq!(message, "there is no task called `elbow_poze`; did you mean `elbow_pose`?");
        assert!(!find("zzz").unwrap_err().to_string().contains("mean"));
    }
}
