//! The paper's colours.

/// Task-specific subspaces.
pub const BLUE: &str = "#4C72B0";
/// Pooled subspaces.
pub const RED: &str = "#C44E52";
/// Subspaces of the experts.
pub const VIOLET: &str = "#8172B3";
/// Text and axes.
pub const BLACK: &str = "#1A1A1A";
/// What stands back: reference lines, footers.
pub const GREY: &str = "#757575";
/// Paper.
pub const WHITE: &str = "#FFFFFF";
/// Policies by the names they are given in the paper, then what is left for others.
const POLICIES: [(&[&str], &str); 5] = [
    (&["expert"], "#9C9C9C"),
    (&["single", "obc_st", "obc-st"], "#9467BD"),
    (&["obc", "multi"], "#209688"),
    (&["arnold"], "#2580B8"),
    (&["kinesis"], "#54A24B"),
];
/// Walking people beside the policies.
pub const PEOPLE: &str = "#9C9C9C";
/// The human hand beside the policies.
pub const HUMAN: &str = "#BEADA1";

/// Methods of training by their names in the result folders.
const METHODS: [(&str, &str); 11] = [
    ("arnold", BLUE),
    ("obc", "#64B5CD"),
    ("obc_ppo", "#55A868"),
    ("obc_wo_obs_norm", "#937860"),
    ("bc", "#CCB974"),
    ("ppo_t_sv", RED),
    ("mt_ppo", "#7A68A8"),
    ("mt_sac", "#DA8BC3"),
    ("ppo_t", "#DD8452"),
    ("obc_task_sv", VIOLET),
    ("expert", "#9C9C9C"),
];
/// The line of a relative performance of 100 %.
pub const WHOLE: &str = "#3B8B4B";

/// A colour for each method: the paper's for a method of the paper's, and no colour twice while there are others.
#[must_use]
pub fn method_colours(names: &[&str]) -> Vec<&'static str> {
    let known = |name: &str| METHODS.iter().find(|(known, _)| *known == name).map(|(_, c)| *c);
    let mut given: Vec<Option<&'static str>> = names.iter().map(|name| known(name)).collect();
    for place in 0..given.len() {
        let free = METHODS.iter().map(|(_, colour)| *colour).find(|c| !given.contains(&Some(c)));
        given[place] = given[place].or(free).or(Some(GREY));
    }
    given.into_iter().flatten().collect()
}

/// A colour for each policy: the paper's for a name of the paper's, and no colour twice while there are others.
#[must_use]
pub fn policy_colours(names: &[&str]) -> Vec<&'static str> {
    const OTHERS: [&str; 4] = [BLUE, RED, VIOLET, GREY];
    let mut given: Vec<&'static str> = Vec::new();
    for name in names {
        let name = name.to_lowercase();
        let known = POLICIES.iter().find(|(words, _)| words.iter().any(|w| name.contains(w)));
        let own = known.map(|(_, colour)| *colour);
        let all = || own.into_iter().chain(OTHERS).chain(POLICIES.map(|(_, colour)| colour));
        let free = all().find(|colour| !given.contains(colour));
        given.push(free.or(own).unwrap_or(OTHERS[names.len() % OTHERS.len()]));
    }
    given
}

/// Colours for `count` groups that have none of their own, no colour twice while there are others.
#[must_use]
pub fn group_colours(count: usize) -> Vec<&'static str> {
    const ALL: [&str; 8] =
        [BLUE, RED, VIOLET, "#54A24B", "#DD8452", "#64B5CD", "#937860", "#8C8C8C"];
    ALL.into_iter().cycle().take(count).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn methods_of_the_paper_have_its_colours_and_others_what_is_left() {
        let found = method_colours(&["mine", "bc", "arnold", "yours"]);
        assert_eq!((found[1], found[2]), ("#CCB974", BLUE));
        assert_eq!(found.iter().collect::<std::collections::BTreeSet<_>>().len(), 4);
        assert_eq!(method_colours(&["?"; 30]).len(), 30);
    }

    #[test]
    fn policies_of_the_paper_have_its_colours_and_nobody_has_anothers() {
        let found = policy_colours(&["Expert", "Single-task OBC", "Multi-task OBC", "Arnold"]);
        assert_eq!(found, ["#9C9C9C", "#9467BD", "#209688", "#2580B8"]);
        let mut found = policy_colours(&["mine", "arnold", "arnold/seed_1", "other", "obc"]);
        found.sort_unstable();
        found.dedup();
        assert_eq!(found.len(), 5);
    }
}
