//! The tasks this program can play, by name, with the constants of `spec/tasks.md` §1.1–1.2.

use crate::sim::engine::{EngineError, Simulation};

use super::baoding::{Baoding, Variant};
use super::die_reorient::DieReorient;
use super::elbow_pose::ElbowPose;
use super::finger_reach::{Finger, FingerReach};
use super::pen_reorient::PenReorient;
use super::relocate::Relocate;
use super::walk::Walk;
use super::{Direction, Task};

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
}

fn suggestion(closest: Option<&'static str>) -> String {
    closest.map(|name| format!("; did you mean `{name}`?")).unwrap_or_default()
}

/// A task's constants.
#[derive(Debug, Clone, Copy)]
pub struct Definition {
    /// Code name.
    pub name: &'static str,
    /// Name in the paper.
    pub paper_name: &'static str,
    /// What the body has to do, in one line.
    pub summary: &'static str,
    /// Identifier of the published environment.
    pub environment: &'static str,
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
    /// When a step counts as solved, in words.
    pub solved_when: &'static str,
    family: Family,
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

#[derive(Debug, Clone, Copy)]
enum Family {
    ElbowPose,
    FingerReach(Finger),
    Baoding(Variant),
    PenReorient,
    DieReorient,
    Relocate,
    Walk,
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
            Family::ElbowPose => Box::new(ElbowPose::new(simulation, dt)),
            Family::FingerReach(finger) => Box::new(FingerReach::new(simulation, dt, finger)?),
            Family::PenReorient => Box::new(PenReorient::new(simulation, dt)?),
            Family::DieReorient => Box::new(DieReorient::new(simulation, dt)?),
            Family::Relocate => Box::new(Relocate::new(simulation, dt)?),
            Family::Walk => Box::new(Walk::new(simulation, dt, self.horizon)?),
            Family::Baoding(variant) => {
                Box::new(Baoding::new(simulation, dt, self.horizon, variant)?)
            }
        })
    }
}

const fn finger_reach(
    name: &'static str,
    paper_name: &'static str,
    environment: &'static str,
    finger: Finger,
) -> Definition {
    Definition {
        name,
        paper_name,
        summary: "bring a fingertip to a random point and keep it there",
        environment,
        body: "hand",
        source: Source::MyoSuite,
        model: "envs/myo/assets/hand/myohand_pose.xml",
        stepping: Stepping::Split,
        timestep: 0.002,
        substeps: 10,
        horizon: 100,
        solved_when: "fingertip within 12.5 mm of the target",
        family: Family::FingerReach(finger),
    }
}

const fn baoding(
    name: &'static str,
    paper_name: &'static str,
    environment: &'static str,
    variant: Variant,
) -> Definition {
    Definition {
        name,
        paper_name,
        summary: "roll two balls around each other in the palm",
        environment,
        body: "hand",
        source: Source::MyoSuite,
        model: "envs/myo/assets/hand/myohand_baoding.xml",
        stepping: Stepping::Split,
        timestep: 0.0025,
        substeps: 10,
        horizon: 200,
        solved_when: "both balls within 15 mm of their targets",
        family: Family::Baoding(variant),
    }
}

/// All tasks, in the order of the paper's per-task table.
pub const ALL: &[Definition] = &[
    finger_reach("hand_index_reach", "Index reach", "MuscleHandIndexReachRandom-v0", Finger::INDEX),
    finger_reach(
        "hand_little_reach",
        "Little reach",
        "MuscleHandLittleReachRandom-v0",
        Finger::LITTLE,
    ),
    finger_reach(
        "hand_middle_reach",
        "Middle reach",
        "MuscleHandMiddleReachRandom-v0",
        Finger::MIDDLE,
    ),
    finger_reach("hand_ring_reach", "Ring reach", "MuscleHandRingReachRandom-v0", Finger::RING),
    finger_reach("hand_thumb_reach", "Thumb reach", "MuscleHandThumbReachRandom-v0", Finger::THUMB),
    Definition {
        name: "elbow_pose",
        paper_name: "Elbow pose",
        summary: "hold the elbow at a random angle",
        environment: "MuscleElbowPoseRandom-v0",
        body: "elbow",
        source: Source::MyoSuite,
        model: "envs/myo/assets/elbow/myoelbow_1dof6muscles.xml",
        stepping: Stepping::Split,
        timestep: 0.002,
        substeps: 10,
        horizon: 100,
        solved_when: "elbow within 0.175 rad of the target",
        family: Family::ElbowPose,
    },
    baoding("baoding_p1_cw", "Baoding CW", "MuscleBaodingP1-v1", Variant::p1(Direction::Clockwise)),
    baoding(
        "baoding_p1_ccw",
        "Baoding CCW",
        "MuscleBaodingP1-v1",
        Variant::p1(Direction::CounterClockwise),
    ),
    baoding("baoding_p2", "Baoding harder", "MuscleBaodingP2-v1", Variant::p2(false)),
    baoding("baoding_p2_overlap", "Baoding hard", "MuscleBaodingP2Overlap-v1", Variant::p2(true)),
    Definition {
        name: "reorient",
        paper_name: "Die reorient",
        summary: "turn a die in the hand to a random orientation",
        environment: "MuscleDieReorientP0-v0",
        body: "hand",
        source: Source::MyoSuite,
        model: "envs/myo/assets/hand/myohand_die.xml",
        stepping: Stepping::Split,
        timestep: 0.002,
        substeps: 5,
        horizon: 150,
        solved_when: "Euler angles within 0.262 rad, die not dropped",
        family: Family::DieReorient,
    },
    Definition {
        name: "pen",
        paper_name: "Pen reorient",
        summary: "turn a pen in the hand to a random direction",
        environment: "MusclePenTwirl-v0",
        body: "hand",
        source: Source::MyoSuite,
        model: "envs/myo/assets/hand/myohand_pen.xml",
        stepping: Stepping::Split,
        timestep: 0.002,
        substeps: 5,
        horizon: 100,
        solved_when: "cosine of the angle above 0.95, pen not dropped",
        family: Family::PenReorient,
    },
    Definition {
        name: "relocate",
        paper_name: "Object relocation",
        summary: "pick an object up and carry it into a box",
        environment: "MuscleRelocate-v0",
        body: "arm",
        source: Source::MyoSuite,
        model: "envs/myo/assets/arm/myoarm_relocate.xml",
        stepping: Stepping::Split,
        timestep: 0.002,
        substeps: 5,
        horizon: 150,
        solved_when: "object within 0.1 m of the goal, hand within 0.5 m of it",
        family: Family::Relocate,
    },
    Definition {
        name: "kinesis",
        paper_name: "Walk to point",
        summary: "walk to a random point and stay there",
        environment: "MuscleKinesis-v0",
        body: "legs",
        source: Source::Data,
        model: "kinesis/xml/myolegs_onlylegs.xml",
        stepping: Stepping::Whole,
        timestep: 1.0 / 150.0,
        substeps: 5,
        horizon: 150,
        solved_when: "root within 0.1 m of the goal in the plane",
        family: Family::Walk,
    },
];

/// The task called `name`.
pub fn find(name: &str) -> Result<&'static Definition, TaskError> {
    ALL.iter().find(|task| task.name == name).ok_or_else(|| {
        let closest = ALL
            .iter()
            .map(|task| (edit_distance(task.name, name), task.name))
            .min()
            // More than half the letters wrong is another word, not a slip.
            .filter(|(distance, _)| 2 * distance <= name.chars().count());
        TaskError::Unknown { name: name.to_owned(), closest: closest.map(|(_, name)| name) }
    })
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
        for task in ALL {
            assert_eq!(find(task.name).unwrap().paper_name, task.paper_name);
        }
    }

    #[test]
    fn a_misspelt_name_gets_a_suggestion() {
        let message = find("elbow_poze").unwrap_err().to_string();
        assert_eq!(message, "there is no task called `elbow_poze`; did you mean `elbow_pose`?");
        assert!(!find("zzz").unwrap_err().to_string().contains("mean"));
    }
}
