//! The fourteen tasks of the paper, with the constants of `spec/tasks.md` §1.1–1.2.

use super::baoding::Variant;
use super::finger_reach::Fingers;
use super::joint_pose::Pose;
use super::registry::{Definition, Family, Source, Stepping};
use super::walk::Goal;
use super::{Direction, Rules};

const fn finger_reach(
    name: &'static str,
    paper_name: &'static str,
    environment: &'static str,
    fingers: Fingers,
) -> Definition {
    Definition {
        name,
        paper_name,
        summary: "bring a fingertip to a random point and keep it there",
        environment: Some(environment),
        body: "hand",
        source: Source::MyoSuite,
        model: "envs/myo/assets/hand/myohand_pose.xml",
        stepping: Stepping::Split,
        timestep: 0.002,
        substeps: 10,
        horizon: 100,
        solved_when: "fingertip within 12.5 mm",
        family: Family::FingerReach(fingers, Rules::Arnold),
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
        environment: Some(environment),
        body: "hand",
        source: Source::MyoSuite,
        model: "envs/myo/assets/hand/myohand_baoding.xml",
        stepping: Stepping::Split,
        timestep: 0.0025,
        substeps: 10,
        horizon: 200,
        solved_when: "both balls within 15 mm",
        family: Family::Baoding(variant),
    }
}

/// Walking to a random point.
pub(super) const WALK: Definition = Definition {
    name: "kinesis",
    paper_name: "Walk to point",
    summary: "walk to a random point and stay there",
    environment: Some("MuscleKinesis-v0"),
    body: "legs",
    source: Source::Data,
    model: "kinesis/xml/myolegs_onlylegs.xml",
    stepping: Stepping::Whole,
    timestep: 1.0 / 150.0,
    substeps: 5,
    horizon: 150,
    solved_when: "root within 0.1 m",
    family: Family::Walk(Goal::Random),
};

/// The paper's tasks, in the order of its per-task table.
pub const ALL: &[Definition] = &[
    finger_reach(
        "hand_index_reach",
        "Index reach",
        "MuscleHandIndexReachRandom-v0",
        Fingers::INDEX,
    ),
    finger_reach(
        "hand_little_reach",
        "Little reach",
        "MuscleHandLittleReachRandom-v0",
        Fingers::LITTLE,
    ),
    finger_reach(
        "hand_middle_reach",
        "Middle reach",
        "MuscleHandMiddleReachRandom-v0",
        Fingers::MIDDLE,
    ),
    finger_reach("hand_ring_reach", "Ring reach", "MuscleHandRingReachRandom-v0", Fingers::RING),
    finger_reach(
        "hand_thumb_reach",
        "Thumb reach",
        "MuscleHandThumbReachRandom-v0",
        Fingers::THUMB,
    ),
    Definition {
        name: "elbow_pose",
        paper_name: "Elbow pose",
        summary: "hold the elbow at a random angle",
        environment: Some("MuscleElbowPoseRandom-v0"),
        body: "elbow",
        source: Source::MyoSuite,
        model: "envs/myo/assets/elbow/myoelbow_1dof6muscles.xml",
        stepping: Stepping::Split,
        timestep: 0.002,
        substeps: 10,
        horizon: 100,
        solved_when: "elbow within 0.175 rad",
        family: Family::JointPose(Pose::ELBOW, Rules::Arnold),
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
        environment: Some("MuscleDieReorientP0-v0"),
        body: "hand",
        source: Source::MyoSuite,
        model: "envs/myo/assets/hand/myohand_die.xml",
        stepping: Stepping::Split,
        timestep: 0.002,
        substeps: 5,
        horizon: 150,
        solved_when: "turned within 0.262 rad",
        family: Family::DieReorient,
    },
    Definition {
        name: "pen",
        paper_name: "Pen reorient",
        summary: "turn a pen in the hand to a random direction",
        environment: Some("MusclePenTwirl-v0"),
        body: "hand",
        source: Source::MyoSuite,
        model: "envs/myo/assets/hand/myohand_pen.xml",
        stepping: Stepping::Split,
        timestep: 0.002,
        substeps: 5,
        horizon: 100,
        solved_when: "cosine above 0.95",
        family: Family::PenReorient(Rules::Arnold),
    },
    Definition {
        name: "relocate",
        paper_name: "Object relocation",
        summary: "pick an object up and carry it into a box",
        environment: Some("MuscleRelocate-v0"),
        body: "arm",
        source: Source::MyoSuite,
        model: "envs/myo/assets/arm/myoarm_relocate.xml",
        stepping: Stepping::Split,
        timestep: 0.002,
        substeps: 5,
        horizon: 150,
        solved_when: "object within 0.1 m",
        family: Family::Relocate,
    },
    WALK,
];
