//! Tasks beside the paper's fourteen: several fingers at once, `MyoSuite`'s own environments, for which it publishes
//! policies, and walking towards a goal that stays ahead.

use std::sync::LazyLock;

use super::Rules;
use super::finger_reach::{Fingers, NEAR};
use super::joint_pose::Pose;
use super::published::WALK;
use super::registry::{Definition, Family, Source, Stepping};
use super::walk::Goal;

/// How the name of a choice of fingers begins: `hand_reach:thumb+index`.
pub(super) const CHOSEN_FINGERS: &str = "hand_reach:";

/// What all reaches, with the hand's pose, have in common.
const HAND: Definition = Definition {
    name: "hand_reach",
    paper_name: "Hand reach",
    summary: "bring all five fingertips to random points and keep them there",
    environment: None,
    body: "hand",
    source: Source::MyoSuite,
    model: "envs/myo/assets/hand/myohand_pose.xml",
    stepping: Stepping::Split,
    timestep: 0.002,
    substeps: 10,
    horizon: 100,
    solved_when: "tips within 62.5 mm",
    family: Family::FingerReach(Fingers::ALL, Rules::Arnold),
};

const AHEAD: Definition = Definition {
    name: "kinesis_forward",
    paper_name: "Walk forward",
    summary: "walk to the point 2 m ahead of the start",
    environment: None,
    family: Family::Walk(Goal::AheadOfStart),
    ..WALK
};

/// The tasks beside the paper's that are listed. Reaches of two to four fingers are found by name only.
pub const EXTRA: &[Definition] = &[
    HAND,
    Definition {
        name: "hand_pose",
        paper_name: "Hand pose",
        summary: "bring all joints of the hand to a random pose and hold it",
        environment: Some("myoHandPoseRandom-v0"),
        solved_when: "joints within 0.7 rad",
        family: Family::JointPose(Pose::HAND, Rules::MyoSuite),
        ..HAND
    },
    Definition {
        name: "myosuite_elbow_pose",
        paper_name: "MyoSuite elbow pose",
        summary: "hold the elbow at a random angle, with MyoSuite's rewards",
        environment: Some("myoElbowPose1D6MRandom-v0"),
        body: "elbow",
        model: "envs/myo/assets/elbow/myoelbow_1dof6muscles.xml",
        solved_when: "elbow within 0.175 rad",
        family: Family::JointPose(Pose::ELBOW, Rules::MyoSuite),
        ..HAND
    },
    Definition {
        name: "myosuite_hand_reach",
        paper_name: "MyoSuite hand reach",
        summary: "bring all five fingertips to random points, never straying far",
        environment: Some("myoHandReachRandom-v0"),
        family: Family::FingerReach(Fingers::ALL, Rules::MyoSuite),
        ..HAND
    },
    Definition {
        name: "myosuite_pen_twirl",
        paper_name: "MyoSuite pen twirl",
        summary: "turn a pen in the hand to a random direction, with MyoSuite's rewards",
        environment: Some("myoHandPenTwirlRandom-v0"),
        model: "envs/myo/assets/hand/myohand_pen.xml",
        substeps: 5,
        horizon: 50,
        solved_when: "cosine above 0.95",
        family: Family::PenReorient(Rules::MyoSuite),
        ..HAND
    },
    AHEAD,
    Definition {
        name: "kinesis_moving_goal",
        paper_name: "Walk on",
        summary: "walk towards a point that stays 2 m ahead",
        solved_when: "never",
        family: Family::Walk(Goal::KeptAhead),
        ..AHEAD
    },
];

/// Reaches of two to four fingers, `hand_thumb_index_reach` and so on: made once, from the fingers' names.
pub(super) static FINGER_SUBSETS: LazyLock<Vec<Definition>> = LazyLock::new(|| {
    let chosen = (1..Fingers::ALL.0).map(Fingers);
    chosen.filter(|fingers| fingers.count() > 1).map(reach_of).collect()
});

/// Its texts live as long as the program, like those of all other tasks.
fn reach_of(fingers: Fingers) -> Definition {
    let names: Vec<&str> = fingers.each().map(|finger| finger.name).collect();
    let listed = names.join(", ");
    let mut paper_name = format!("{listed} reach");
    paper_name[..1].make_ascii_uppercase();
    let distance = 1000.0 * NEAR * fingers.count() as f64;
    Definition {
        name: format!("hand_{}_reach", names.join("_")).leak(),
        paper_name: paper_name.leak(),
        summary: format!("bring the fingertips of {listed} to random points").leak(),
        solved_when: format!("tips within {distance} mm").leak(),
        family: Family::FingerReach(fingers, Rules::Arnold),
        ..HAND
    }
}
