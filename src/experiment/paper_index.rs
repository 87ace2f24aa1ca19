//! Every figure and table of the paper that shows numbers, and what it is made from (`spec/analysis.md` §14).
//!
//! Schematic drawings and tables of settings are not in here.

use super::benchmarks::PrintedTable;

/// One figure or table.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct IndexEntry {
    /// What the paper calls it.
    pub id: &'static str,
    /// Name of its files.
    pub stem: &'static str,
    pub shows: &'static str,
    /// The command whose finished run holds it, and the name of the file in there.
    pub command: &'static str,
    pub file: &'static str,
    /// Of several recipes of a command, the one that is meant, and a part of the name of one of its lines.
    pub recipe: Option<(&'static str, &'static str)>,
    /// What it can be drawn from if there is no such run.
    pub published: Option<Published>,
    /// The command that makes the run.
    pub make: &'static str,
}

/// Data that are published, from which figures are drawn without playing.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Published {
    Radar,
    Bars,
    Table(PrintedTable),
    /// Solved fractions of the experts.
    Experts,
    /// Curves of control-subspace inactivation: the mean over tasks.
    MeanCurves,
    /// The same per task.
    PcaCurves,
    NmfCurves,
    ExpertCurves,
}

const READ: &str = "arnold-analyze setup --arnold benchmarks && arnold-analyze evaluate --benchmarks \
                    data/final_benchmarks";
const READ_EXTRA: &str = "arnold-analyze setup --arnold extra_results && arnold-analyze evaluate --benchmarks \
                          data/final_benchmarks data/final_benchmarks_extra";
const CSI: &str = "arnold-analyze csi --policy arnold --task hand";
const SUBSPACES: &str = "arnold-analyze subspaces --recording NAME=DIR…";

const fn entry(
    id: &'static str,
    stem: &'static str,
    shows: &'static str,
    (command, file): (&'static str, &'static str),
    make: &'static str,
) -> IndexEntry {
    IndexEntry { id, stem, shows, command, file, recipe: None, published: None, make }
}

impl IndexEntry {
    const fn or(self, published: Published) -> Self {
        Self { published: Some(published), ..self }
    }

    const fn recipe(self, recipe: &'static str, line: &'static str) -> Self {
        Self { recipe: Some((recipe, line)), ..self }
    }
}

/// In the order of the paper.
pub const INDEX: [IndexEntry; 33] = [
    entry("Fig. 3B", "fig3b_radar", "performance per task, radar", ("evaluate", "radar"), READ)
        .or(Published::Radar),
    entry("Fig. 3C", "fig3c_bars", "performance per task, bars", ("evaluate", "relative_performance"), READ)
        .or(Published::Bars),
    entry("Table 1", "table1_families", "performance by family", ("evaluate", "families"), READ)
        .or(Published::Table(PrintedTable::Families)),
    entry("Fig. 4A", "fig4a_smoothness", "smoothness", ("smoothness", "smoothness"),
        "arnold-analyze smoothness --recording Expert=DIR Single=DIR OBC=DIR"),
    entry("Fig. 4B", "fig4b_correlations", "muscle activity and human EMG", ("emg", "correlations"),
        "arnold-analyze emg --recording Arnold=FILE OBC=FILE Kinesis=FILE"),
    entry("Fig. 4C", "fig4c_profiles", "muscle activity over the gait cycle", ("emg", "profiles"),
        "arnold-analyze emg --recording Arnold=FILE OBC=FILE Kinesis=FILE"),
    entry("Fig. 4D–E", "fig4de_factors", "factors of the leg muscles", ("factors", "factors"),
        "arnold-analyze factors --recording Arnold=FILE"),
    entry("Fig. 4F–H", "fig4fgh_dimensionality", "dimensionality of the hand", ("kinematics", "baoding_p1_ccw"),
        "arnold-analyze kinematics --recording Expert=DIR OBC=DIR Arnold=DIR"),
    entry("Fig. 5", "fig5_transfer", "learning with and without pretraining", ("curves", "curves"),
        "arnold-analyze curves --recipe transfer --run pretrained:pen=DIR --run scratch:pen=DIR …")
        .recipe("transfer", ""),
    entry("Fig. 6A–B", "fig6ab_csi", "performance against components, mean", ("", ""), CSI)
        .or(Published::MeanCurves),
    entry("Fig. 6C–D", "fig6cd_tasks", "subspaces across tasks", ("subspaces", "across_tasks"), SUBSPACES),
    entry("Fig. 6E–F", "fig6ef_policies", "subspaces across policies", ("subspaces", "across_policies"), SUBSPACES),
    entry("Fig. 6G", "fig6g_capacity", "performance against network size", ("evaluate", "capacity_summary"), READ),
    entry("Fig. 6J", "fig6j_csi_finetuning", "fine-tuning in a subspace", ("evaluate", "csi_finetuning"), READ_EXTRA),
    entry("Fig. S2", "figs2_multi_task", "learning of the baselines", ("curves", "curves"),
        "arnold-analyze curves --recipe multi-task --run mt_ppo:all=FILE.csv --run mt_sac:all=FILE.csv …")
        .recipe("multi-task", "mt_"),
    entry("Fig. S3B", "figs3b_ppo_ablation", "rewards alone, with parts left out",
        ("evaluate", "ppo_ablation"), READ_EXTRA),
    entry("Fig. S5", "figs5_vocabulary", "a vocabulary per task", ("evaluate", "vocabulary"), READ),
    entry("Fig. S6", "figs6_rl_finetuning", "fine-tuning by reinforcement", ("curves", "curves"),
        "arnold-analyze curves --recipe rl-finetuning --run obc:pen=DIR …")
        .recipe("rl-finetuning", ""),
    entry("Fig. S7", "figs7_csi_tasks", "performance and variance per task, PCA", ("", ""), CSI)
        .or(Published::PcaCurves),
    entry("Fig. S8", "figs8_csi_tasks_nmf", "the same, NMF", ("", ""), "arnold-analyze synergies --recording NAME=DIR…")
        .or(Published::NmfCurves),
    entry("Fig. S9", "figs9_csi_experts", "components of Arnold and of experts", ("", ""), CSI)
        .or(Published::ExpertCurves),
    entry("Fig. S10", "figs10_capacity", "network size, all tasks", ("evaluate", "capacity"), READ),
    entry("Fig. S11", "figs11_csi_finetuning", "fine-tuning in a subspace, all tasks", ("evaluate", "csi_finetuning"),
        READ_EXTRA),
    entry("Fig. S12", "figs12_history", "learning with other histories", ("curves", "curves"),
        "arnold-analyze curves --recipe multi-task --run original-random:all=FILE.csv …")
        .recipe("multi-task", "original"),
    entry("Fig. S12", "figs12_history_bars", "returns with other histories", ("evaluate", "history"),
        "arnold-analyze evaluate --benchmarks HISTORIES.json"),
    entry("Fig. S14", "figs14_csi_learning", "learning in a subspace", ("curves", "curves"),
        "arnold-analyze curves --recipe csi-finetuning --run 20:pen=DIR …")
        .recipe("csi-finetuning", ""),
    entry("Fig. S15", "figs15_single_task", "imitation of one expert", ("curves", "curves"),
        "arnold-analyze curves --recipe single-task --run obc:pen=DIR …")
        .recipe("single-task", ""),
    entry("Table S", "tables_per_task", "performance per task", ("evaluate", "per_task"), READ)
        .or(Published::Table(PrintedTable::Tasks)),
    entry("Table S", "tables_expert_tests", "Arnold against each expert", ("evaluate", "expert_improvement"), READ)
        .or(Published::Table(PrintedTable::Improvements)),
    entry("Table S", "tables_method_tests", "Arnold against each method", ("evaluate", "significance"), READ)
        .or(Published::Table(PrintedTable::Tests)),
    entry("Table S", "tables_smoothness_tests", "tests of smoothness", ("smoothness", "comparisons"),
        "arnold-analyze smoothness --recording Expert=DIR Single=DIR OBC=DIR"),
    entry("Test 4B", "tables_emg_tests", "tests of muscle activity", ("emg", "comparisons"),
        "arnold-analyze emg --recording Arnold=FILE OBC=FILE Kinesis=FILE"),
    entry("Experts", "experts", "solved fraction of the experts", ("evaluate", "experts"),
        "arnold-analyze evaluate --benchmarks data/final_benchmarks/expert_policies")
        .or(Published::Experts),
];

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn no_two_entries_write_the_same_file_and_all_say_what_makes_them() {
        let stems: std::collections::BTreeSet<&str> = INDEX.iter().map(|e| e.stem).collect();
        assert_eq!(stems.len(), INDEX.len());
        for entry in INDEX {
            assert!(entry.make.starts_with("arnold-analyze "), "{}", entry.id);
            assert!(!entry.command.is_empty() || entry.published.is_some(), "{}", entry.id);
        }
    }
}
