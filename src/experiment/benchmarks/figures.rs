//! The figures of performance: bars, radar, capacity, vocabulary, experts; from results, or from the printed tables.

use crate::analysis::performance::{
    DOTS, PublishedImprovement, PublishedMethod, TABLE_TASKS, evenly_spaced, percent_of,
};
use crate::analysis::stats::Summary;
use crate::figure::palette::{BLUE, RED, VIOLET, method_colours};
use crate::figure::{
    ChangeDot, ChangeFigure, GroupedBar, GroupedBarFigure, GroupedSeries, RadarFigure, RadarSeries,
    Width,
};

use super::tables::episode_error;
use super::{Capacity, MethodNumbers, Performance, Results, Vocabulary, label_of, task_label};

/// The methods of the bar figure, from left to right.
const BARS: [&str; 5] = ["bc", "obc_wo_obs_norm", "obc", "obc_ppo", "arnold"];
/// The methods of the radar, from back to front.
const RADAR: [&str; 3] = ["ppo_t_sv", "bc", "arnold"];
/// The transformer trained by rewards alone and the same without one of its normalisations, then the perceptron: names in
/// the result folders, labels, colours of the paper's figure.
const PPO: [(&str, &str, &str); 4] = [
    ("ppo_t_sv", "PPO", RED),
    ("ppo_wo_rew_norm", "PPO w/o reward norm.", "#55A868"),
    ("ppo_wo_obs_norm", "PPO w/o observation norm.", "#937860"),
    ("mt_ppo", "MT-PPO", "#7A68A8"),
];
/// The tasks of the capacity figure, in its order.
const CAPACITY_TASKS: [&str; 14] = [
    "hand_little_reach",
    "hand_index_reach",
    "hand_middle_reach",
    "hand_ring_reach",
    "hand_thumb_reach",
    "reorient",
    "pen",
    "baoding_p1_cw",
    "baoding_p1_ccw",
    "baoding_p2_overlap",
    "baoding_p2",
    "elbow_pose",
    "relocate",
    "kinesis",
];
/// More methods than this make no readable bars.
const MOST_METHODS: usize = 8;
const MEASURE: &str = "Relative performance (%)";
const READ: &str = "Read from result files, not played.";
const PRINTED: &str = "As printed in the paper's tables (arXiv:2508.18066).";
const EXPERT_LINE: Option<(f64, &str)> = Some((100.0, "Expert"));

impl Performance {
    /// Bars of relative performance per task with the average: the five methods of the paper's figure where at least two
    /// of them are there, else all. `None` without a method.
    #[must_use]
    pub fn bar_figure(&self, results: &Results) -> Option<GroupedBarFigure> {
        let methods = self.chosen(&BARS);
        let names: Vec<&str> = methods.iter().map(|method| method.name.as_str()).collect();
        let colours = method_colours(&names);
        let labels = methods.iter().map(|method| method.label.as_str());
        let drawn: Vec<_> =
            methods.iter().copied().zip(labels).zip(colours).map(|((m, l), c)| (m, l, c)).collect();
        self.bars_of(results, &drawn)
    }

    /// The same for the policies trained by rewards alone with one part of that left out; `None` without one of those.
    #[must_use]
    pub fn ppo_figure(&self, results: &Results) -> Option<GroupedBarFigure> {
        let method = |(name, label, colour)| Some((self.method(name)?, label, colour));
        let drawn: Vec<_> = PPO.into_iter().filter_map(method).collect();
        let is_ablated = drawn.iter().any(|(method, ..)| method.name.starts_with("ppo_wo_"));
        if is_ablated { self.bars_of(results, &drawn) } else { None }
    }

    /// Bars of methods, each with its label and colour.
    fn bars_of(
        &self,
        results: &Results,
        methods: &[(&MethodNumbers, &str, &'static str)],
    ) -> Option<GroupedBarFigure> {
        let series = methods.iter().map(|&(method, label, colour)| {
            let bars: Vec<GroupedBar> = (0..self.tasks.len())
                .map(|task| GroupedBar {
                    dots: self.episode_dots(results, method, task),
                    ..bar(method.relative.task_summary(task))
                })
                .collect();
            let all: Vec<usize> = (0..self.tasks.len()).collect();
            let average = (all.len() > 1).then(|| bar(method.relative.family_summary(&all)));
            GroupedSeries { name: label.to_owned(), colour, bars, average }
        });
        let series: Vec<GroupedSeries> = series.collect();
        let seeds = count(methods.iter().map(|(method, ..)| method.fractions.len()), "seed");
        (!series.is_empty()).then(|| GroupedBarFigure {
            groups: self.tasks.iter().map(|task| task_label(task)).collect(),
            series,
            measure: MEASURE.to_owned(),
            line: EXPERT_LINE,
            dots: "Episode",
            caption: format!(
                "Mean over seeds ± s.e.m., in percent of the expert; {seeds}. Dots: at most {DOTS} of all episodes.{} {READ}",
                self.metric.note(),
            ),
            width: Width::TwoColumns,
        })
    }

    /// Solved fractions of single episodes, pooled over seeds, in percent of the expert, at most a hundred of them.
    fn episode_dots(&self, results: &Results, method: &MethodNumbers, task: usize) -> Vec<f64> {
        let seeds = results.methods.get(&method.name).into_iter().flatten();
        let entries = seeds.filter_map(|seed| seed.tasks.get(&self.tasks[task]));
        let lists = entries.filter_map(|entry| entry.episode_solve_step_fracs.as_ref());
        let episodes: Vec<f64> = lists.flatten().copied().collect();
        let expert = self.experts[task];
        let chosen = evenly_spaced(episodes.len(), DOTS);
        let share = |place: usize| self.metric.of_episode(&self.tasks[task], episodes[place]);
        chosen.into_iter().map(|place| percent_of(expert, share(place))).collect()
    }

    /// The radar: the three methods of the paper's where at least one of them is there, else all. `None` for fewer than
    /// three tasks or no method.
    #[must_use]
    pub fn radar_figure(&self) -> Option<RadarFigure> {
        let methods = self.chosen(&RADAR);
        if self.tasks.len() < 3 || methods.is_empty() {
            return None;
        }
        // Alphabetically by code name.
        let mut order: Vec<usize> = (0..self.tasks.len()).collect();
        order.sort_by_key(|&task| &self.tasks[task]);
        let names: Vec<&str> = methods.iter().map(|method| method.name.as_str()).collect();
        let series = methods.iter().zip(method_colours(&names)).map(|(method, colour)| {
            let summaries = order.iter().map(|&task| method.relative.task_summary(task));
            let (mean, error) = summaries.map(ends).unzip();
            RadarSeries { name: method.label.clone(), colour, mean, error }
        });
        let seeds = count(methods.iter().map(|method| method.fractions.len()), "seed");
        Some(RadarFigure {
            tasks: order.iter().map(|&task| task_label(&self.tasks[task])).collect(),
            series: series.collect(),
            caption: format!(
                "Mean over seeds ± s.e.m., in percent of the expert; {seeds}.{} {READ}",
                self.metric.note(),
            ),
        })
    }

    /// The methods called `names` in their order, if at least two are there; else all.
    fn chosen(&self, names: &[&str]) -> Vec<&MethodNumbers> {
        let found: Vec<&MethodNumbers> =
            names.iter().filter_map(|name| self.method(name)).collect();
        if found.len() > 1 { found } else { self.methods.iter().take(MOST_METHODS).collect() }
    }
}

impl Capacity {
    /// Bars of all tasks, one colour per size.
    #[must_use]
    pub fn task_figure(&self) -> GroupedBarFigure {
        let is_there = |task: &&str| {
            self.sizes.iter().any(|(_, bars, _)| bars.iter().any(|bar| bar.task == **task))
        };
        let tasks: Vec<&str> = CAPACITY_TASKS.iter().copied().filter(is_there).collect();
        let series = self.sizes.iter().zip(size_colours()).map(|((size, bars, _), colour)| {
            let of_task = |task: &&str| {
                let bar = bars.iter().find(|bar| bar.task == **task);
                let (mean, error) = bar.map_or((f64::NAN, f64::NAN), |bar| (bar.relative, bar.sem));
                GroupedBar { mean, error, ..GroupedBar::default() }
            };
            GroupedSeries {
                name: format!("{} ({})", size.label, millions(size.parameters)),
                colour,
                bars: tasks.iter().map(of_task).collect(),
                average: None,
            }
        });
        let counts = self.sizes.iter().flat_map(|(_, bars, _)| bars.iter().map(|bar| bar.episodes));
        let episodes = count(counts, "episode");
        GroupedBarFigure {
            groups: tasks.iter().map(|task| task_label(task)).collect(),
            series: series.collect(),
            measure: MEASURE.to_owned(),
            line: EXPERT_LINE,
            dots: "Episode",
            caption: format!(
                "One run per size: mean over episodes ± s.e.m. over episodes, in percent of the expert; {episodes}. {READ}"
            ),
            width: Width::TwoColumns,
        }
    }

    /// One bar per size, over the hand's tasks.
    #[must_use]
    pub fn summary_figure(&self) -> GroupedBarFigure {
        let bars = self.sizes.iter().map(|(size, bars, summary)| {
            let hand = crate::analysis::performance::HAND_TASKS;
            let dots = bars.iter().filter(|bar| hand.contains(&bar.task.as_str()));
            GroupedBar {
                dots: dots.map(|bar| bar.relative).collect(),
                note: millions(size.parameters),
                ..bar(*summary)
            }
        });
        let tasks = count(self.sizes.iter().map(|(.., summary)| summary.count), "task");
        GroupedBarFigure {
            groups: self.sizes.iter().map(|(size, ..)| size.label.to_owned()).collect(),
            series: vec![GroupedSeries {
                name: "Mean over hand tasks".to_owned(),
                colour: BLUE,
                bars: bars.collect(),
                average: None,
            }],
            measure: MEASURE.to_owned(),
            line: EXPERT_LINE,
            dots: "Task",
            caption: format!(
                "Mean over the hand's tasks ± s.e.m. over tasks; {tasks}; one run per size. Above: parameters. {READ}"
            ),
            width: Width::OneColumn,
        }
    }
}

impl Vocabulary {
    /// The dot plot.
    #[must_use]
    pub fn figure(&self) -> ChangeFigure {
        let dot = |&task: &usize| ChangeDot {
            task: task_label(&self.tasks[task]),
            seeds: self.change.seeds.iter().map(|seed| seed[task]).collect(),
            mean: self.change.mean[task],
            deviation: self.change.standard_deviation[task],
        };
        let seeds = count([self.change.seeds.len()].into_iter(), "seed");
        ChangeFigure {
            tasks: self.change.order.iter().map(dot).collect(),
            colour: VIOLET,
            measure: format!("Change against {} (%)", self.reference),
            caption: format!(
                "{}: solved fraction in percent of the mean of {}, minus 100; {seeds}. {READ}",
                self.method, self.reference
            ),
        }
    }
}

/// Bars of the experts' solved fractions, with the printed ones.
#[must_use]
pub fn expert_figure(results: &Results) -> GroupedBarFigure {
    let bars = results.expert_entries().map(|(task, entry)| GroupedBar {
        mean: entry.avg_solved_step_frac.unwrap_or(f64::NAN),
        error: episode_error(entry).unwrap_or(f64::NAN),
        published: PublishedImprovement::find(task).map(|row| row.expert),
        ..GroupedBar::default()
    });
    let episodes =
        count(results.expert_entries().filter_map(|(_, entry)| entry.num_episodes), "episode");
    GroupedBarFigure {
        groups: results.tasks.iter().map(|task| task_label(task)).collect(),
        series: vec![GroupedSeries {
            name: "Expert".to_owned(),
            colour: method_colours(&["expert"])[0],
            bars: bars.collect(),
            average: None,
        }],
        measure: "Solved fraction".to_owned(),
        line: None,
        dots: "Episode",
        caption: format!("Mean over episodes ± s.e.m.; {episodes} per task. {READ}"),
        width: Width::TwoColumns,
    }
}

/// The paper's bars from its printed table.
#[must_use]
pub fn printed_ablation() -> GroupedBarFigure {
    let methods = printed(&BARS);
    let series = methods.iter().zip(method_colours(&BARS)).map(|(method, colour)| {
        let bar = |value: Option<(f64, f64)>| {
            let (mean, error) = value.unwrap_or((f64::NAN, f64::NAN));
            GroupedBar { mean, error, ..GroupedBar::default() }
        };
        GroupedSeries {
            name: label_of(method.name),
            colour,
            bars: TABLE_TASKS.iter().map(|task| bar(method.task(task))).collect(),
            average: Some(bar(method.family("avg"))),
        }
    });
    let seeds = count(methods.iter().map(|method| method.seeds), "seed");
    GroupedBarFigure {
        groups: TABLE_TASKS.iter().map(|task| task_label(task)).collect(),
        series: series.collect(),
        measure: MEASURE.to_owned(),
        line: EXPERT_LINE,
        dots: "Episode",
        caption: format!("Mean over seeds ± s.e.m., in percent of the expert; {seeds}. {PRINTED}"),
        width: Width::TwoColumns,
    }
}

/// The paper's radar from its printed table.
#[must_use]
pub fn printed_radar() -> RadarFigure {
    let mut tasks = TABLE_TASKS;
    tasks.sort_unstable();
    let methods = printed(&RADAR);
    let series = methods.iter().zip(method_colours(&RADAR)).map(|(method, colour)| {
        let values = tasks.iter().map(|task| method.task(task).unwrap_or((f64::NAN, f64::NAN)));
        let (mean, error) = values.unzip();
        RadarSeries { name: label_of(method.name), colour, mean, error }
    });
    let seeds = count(methods.iter().map(|method| method.seeds), "seed");
    RadarFigure {
        tasks: tasks.iter().map(|task| task_label(task)).collect(),
        series: series.collect(),
        caption: format!("Mean over seeds ± s.e.m., in percent of the expert; {seeds}. {PRINTED}"),
    }
}

/// The rows of the printed table in the order of `names`.
fn printed(names: &[&str]) -> Vec<&'static PublishedMethod> {
    names.iter().filter_map(|name| PublishedMethod::find(name)).collect()
}

fn bar(summary: Summary) -> GroupedBar {
    let (mean, error) = ends(summary);
    GroupedBar { mean, error, ..GroupedBar::default() }
}

fn ends(summary: Summary) -> (f64, f64) {
    (summary.mean.unwrap_or(f64::NAN), summary.standard_error.unwrap_or(f64::NAN))
}

fn size_colours() -> [&'static str; 4] {
    ["#64B5CD", "#4C92B0", "#3B6A94", "#2B4470"]
}

/// "4.45 M", "104 k".
fn millions(parameters: u32) -> String {
    let count = f64::from(parameters);
    if parameters >= 1_000_000 {
        format!("{:.2} M", count / 1e6)
    } else {
        format!("{:.0} k", count / 1e3)
    }
}

/// "n = 3–5 seeds".
pub(super) fn count(counts: impl Iterator<Item = usize> + Clone, unit: &str) -> String {
    let (low, high) = (counts.clone().min().unwrap_or(0), counts.max().unwrap_or(0));
    let ending = if high == 1 { "" } else { "s" };
    if low == high {
        format!("n = {low} {unit}{ending}")
    } else {
        format!("n = {low}–{high} {unit}{ending}")
    }
}
