//! Which tasks belong together in tables and figures, and in which order they stand.
//!
//! Names are the code names of the tasks. Note `baoding_p2_overlap` is the paper's *hard* and `baoding_p2` its
//! *harder*. The average over all tasks has equal weight for each task and is not the mean of the families.

/// Families of the summary table, in its order, each with its tasks.
pub const FAMILIES: [(&str, &[&str]); 6] = [
    (
        "finger_reach",
        &[
            "hand_index_reach",
            "hand_little_reach",
            "hand_middle_reach",
            "hand_ring_reach",
            "hand_thumb_reach",
        ],
    ),
    ("elbow_pose", &["elbow_pose"]),
    ("baoding", &["baoding_p1_cw", "baoding_p1_ccw", "baoding_p2", "baoding_p2_overlap"]),
    ("reorient", &["reorient", "pen"]),
    ("object_relocation", &["relocate"]),
    ("walk_to_point", &["kinesis"]),
];

/// All tasks in the order of the table's columns.
pub const TABLE_TASKS: [&str; 14] = [
    "hand_index_reach",
    "hand_little_reach",
    "hand_middle_reach",
    "hand_ring_reach",
    "hand_thumb_reach",
    "elbow_pose",
    "baoding_p1_cw",
    "baoding_p1_ccw",
    "baoding_p2",
    "baoding_p2_overlap",
    "reorient",
    "pen",
    "relocate",
    "kinesis",
];

/// The eleven tasks of the hand model, alphabetically.
pub const HAND_TASKS: [&str; 11] = [
    "baoding_p1_ccw",
    "baoding_p1_cw",
    "baoding_p2",
    "baoding_p2_overlap",
    "hand_index_reach",
    "hand_little_reach",
    "hand_middle_reach",
    "hand_ring_reach",
    "hand_thumb_reach",
    "pen",
    "reorient",
];

/// Methods in the order of the table's rows: name in the result folders, name in print.
pub const METHODS: [(&str, &str); 10] = [
    ("arnold", "Arnold"),
    ("mt_sac", "MT-SAC"),
    ("mt_ppo", "MT-PPO"),
    ("ppo_t", "MT-PPO+T"),
    ("ppo_t_sv", "MT-PPO+T+SV"),
    ("bc", "BC"),
    ("obc_task_sv", "OBC + Task-SV"),
    ("obc_wo_obs_norm", "OBC w/o Obs.Norm"),
    ("obc_ppo", "OBC-PPO"),
    ("obc", "OBC"),
];

/// The family of a task.
#[must_use]
pub fn family_of(task: &str) -> Option<&'static str> {
    FAMILIES.iter().find(|(_, tasks)| tasks.contains(&task)).map(|(family, _)| *family)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_task_of_the_table_has_exactly_one_family() {
        let grouped: Vec<&str> =
            FAMILIES.iter().flat_map(|(_, tasks)| tasks.iter().copied()).collect();
        assert_eq!(grouped, TABLE_TASKS);
        assert_eq!(family_of("pen"), Some("reorient"));
        assert_eq!(family_of("juggling"), None);
    }

    #[test]
    fn hand_tasks_are_the_table_without_elbow_arm_and_leg() {
        let mut hand: Vec<&str> = TABLE_TASKS
            .into_iter()
            .filter(|task| !matches!(*task, "elbow_pose" | "relocate" | "kinesis"))
            .collect();
        hand.sort_unstable();
        assert_eq!(hand, HAND_TASKS);
    }
}
