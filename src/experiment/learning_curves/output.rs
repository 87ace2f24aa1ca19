//! Curves as tables, as a document and as a figure.

use serde_json::{Value, json};

use crate::analysis::curves::{Band, Smoothing};
use crate::figure::palette::{BLUE, RED, method_colours};
use crate::figure::{LineGridFigure, LinePanel, LineSeries};
use crate::record::{Column, RecordError, Table};

use super::{LearningCurves, Logs, Metric, Recipe, SeedCurve, Series};

impl Recipe {
    /// Its name, as asked for.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Portable(_) => "portable",
            Self::Transfer => "transfer",
            Self::SingleTask => "single-task",
            Self::RlFinetuning => "rl-finetuning",
            Self::MultiTask => "multi-task",
            Self::CsiFinetuning => "csi-finetuning",
        }
    }

    /// Whether bands are the standard error over seeds. The paper draws these figures from single seeds; its two others
    /// show the standard deviation.
    fn shows_standard_error(self) -> bool {
        !matches!(self, Self::Portable(_) | Self::MultiTask)
    }

    /// Half the height of the band at each of its steps.
    fn spread(self, band: &Band) -> Vec<f64> {
        if self.shows_standard_error() {
            (0..band.steps.len()).map(|place| band.standard_error(place)).collect()
        } else {
            band.standard_deviation.clone()
        }
    }

    /// How it smooths, for the caption.
    fn smoothing(self) -> String {
        match self {
            Self::Portable(Smoothing::None) => "Not smoothed".to_owned(),
            Self::Portable(Smoothing::Trailing(window)) => {
                format!("Trailing mean of {window} points")
            }
            Self::Portable(Smoothing::SavitzkyGolay(window)) => {
                format!("Savitzky–Golay over {window} points, order 2")
            }
            Self::Transfer | Self::SingleTask => "Trailing mean of 5 points".to_owned(),
            Self::RlFinetuning | Self::CsiFinetuning => {
                "Savitzky–Golay over 101 points, order 2".to_owned()
            }
            Self::MultiTask => "Running mean of 20 points".to_owned(),
        }
    }
}

impl LearningCurves {
    /// One row per panel, line, seed and drawn point.
    pub fn curve_table(&self) -> Result<Table, RecordError> {
        let mut columns: [Vec<String>; 3] = Default::default();
        let mut numbers: [Vec<f64>; 4] = Default::default();
        for panel in &self.panels {
            for series in &panel.series {
                for seed in &series.seeds {
                    for (step, value) in seed.drawn.steps().iter().zip(seed.drawn.values()) {
                        columns[0].push(panel.title.clone());
                        columns[1].push(series.name.clone());
                        columns[2].push(seed.seed.clone());
                        let logged = logged_at(seed, *step);
                        let smoothed = value / series.factor;
                        let relative = if self.relative { *value } else { f64::NAN };
                        let row = [*step, logged, smoothed, relative];
                        numbers.iter_mut().zip(row).for_each(|(column, x)| column.push(x));
                    }
                }
            }
        }
        let [panel, series, seed] = columns;
        let [step, raw, smoothed, relative] = numbers;
        Table::new(vec![
            Column::unitless("panel", panel),
            Column::unitless("series", series),
            Column::unitless("seed", seed),
            Column::new("step", "environment steps", step),
            Column::unitless("value_raw", raw),
            Column::unitless("value_smoothed", smoothed),
            Column::new("value_relative_pct", "%", relative),
        ])
    }

    /// One row per panel, line and point of its band.
    pub fn band_table(&self) -> Result<Table, RecordError> {
        let rows = || {
            let series = self.panels.iter().flat_map(|p| p.series.iter().map(move |s| (p, s)));
            series.filter_map(|(panel, series)| Some((panel, series, series.band.as_ref()?)))
        };
        let points = || rows().flat_map(|(p, s, b)| (0..b.steps.len()).map(move |i| (p, s, b, i)));
        Table::new(vec![
            Column::unitless("panel", points().map(|(p, ..)| p.title.clone()).collect::<Vec<_>>()),
            Column::unitless(
                "series",
                points().map(|(_, s, ..)| s.name.clone()).collect::<Vec<_>>(),
            ),
            Column::new(
                "step",
                "environment steps",
                points().map(|(_, _, b, i)| b.steps[i]).collect::<Vec<_>>(),
            ),
            Column::unitless("mean", points().map(|(_, _, b, i)| b.mean[i]).collect::<Vec<_>>()),
            Column::unitless(
                "sd",
                points().map(|(_, _, b, i)| b.standard_deviation[i]).collect::<Vec<_>>(),
            ),
            Column::unitless(
                "sem",
                points().map(|(_, _, b, i)| b.standard_error(i)).collect::<Vec<_>>(),
            ),
            Column::unitless(
                "n_seeds",
                points().map(|(_, _, b, i)| b.count[i] as i64).collect::<Vec<_>>(),
            ),
        ])
    }

    /// Where every line ends, for people.
    #[must_use]
    pub fn document(&self, logs: &Logs) -> Value {
        let lines: Vec<Value> = self
            .panels
            .iter()
            .flat_map(|panel| panel.series.iter().map(move |series| (panel, series)))
            .map(|(panel, series)| {
                let ends: Vec<f64> = series
                    .seeds
                    .iter()
                    .filter_map(|seed| seed.drawn.values().last().copied())
                    .filter(|value| value.is_finite())
                    .collect();
                let mean = ends.iter().sum::<f64>() / ends.len() as f64;
                let steps = |curve: &SeedCurve| curve.drawn.steps().last().copied();
                let last = series.seeds.iter().filter_map(steps).fold(f64::NAN, f64::max);
                json!({
                    "panel": panel.title,
                    "series": series.name,
                    "seeds": series.seeds.len(),
                    "points": series.seeds.iter().map(|s| s.logged.len()).sum::<usize>(),
                    "last_step": Some(last).filter(|x| x.is_finite()),
                    "last_value": Some(mean).filter(|x| x.is_finite()),
                })
            })
            .collect();
        json!({
            "recipe": self.recipe.name(),
            "smoothing": self.recipe.smoothing(),
            "relative": self.relative,
            "lines": lines,
            "damaged": logs.damaged,
        })
    }

    /// The figure: a panel per task.
    #[must_use]
    pub fn figure(&self) -> LineGridFigure {
        let mut names: Vec<&str> =
            self.panels.iter().flat_map(|p| &p.series).map(|s| s.name.as_str()).collect();
        let mut seen = std::collections::BTreeSet::new();
        names.retain(|name| seen.insert(*name));
        let colours = self.colours(&names);
        let colour = |name: &str| {
            let place = names.iter().position(|known| *known == name);
            place.map_or(BLUE, |place| colours[place])
        };
        let line = |series: &Series| {
            let million = |(x, y): (&f64, &f64)| (x / 1e6, *y);
            let of_seed = |seed: &SeedCurve| -> Vec<(f64, f64)> {
                seed.drawn.steps().iter().zip(seed.drawn.values()).map(million).collect()
            };
            let (mean, spread, seeds) = match &series.band {
                Some(band) => (
                    band.steps.iter().zip(&band.mean).map(million).collect(),
                    self.recipe.spread(band),
                    series.seeds.iter().map(of_seed).collect(),
                ),
                None => (series.seeds.first().map(of_seed).unwrap_or_default(), vec![], vec![]),
            };
            let (name, colour) = (series.name.clone(), colour(&series.name));
            LineSeries { name, colour, mean, spread, seeds, dotted: false }
        };
        let panels = self.panels.iter().map(|panel| LinePanel {
            title: panel.title.clone(),
            series: panel.series.iter().map(line).collect(),
        });
        let (x_end, y_end) = match self.recipe {
            Recipe::Transfer => ((self.last_step() > 2e6).then_some(2.0), Some(120.0)),
            Recipe::RlFinetuning => (Some(68.0), None),
            _ => (None, None),
        };
        let seeds = self.panels.iter().flat_map(|p| &p.series).map(|s| s.seeds.len());
        LineGridFigure {
            panels: panels.collect(),
            across: "Training steps (millions)".to_owned(),
            upwards: self.measure().to_owned(),
            x_end,
            y_end: y_end.filter(|_| self.relative),
            own_x: matches!(self.recipe, Recipe::SingleTask | Recipe::Portable(_)),
            line: self.relative.then_some((100.0, "Expert")),
            mark: (self.recipe == Recipe::CsiFinetuning).then_some(5.0),
            caption: self.caption(seeds),
        }
    }

    fn last_step(&self) -> f64 {
        let seeds = self.panels.iter().flat_map(|panel| &panel.series).flat_map(|s| &s.seeds);
        seeds.filter_map(|seed| seed.drawn.steps().last().copied()).fold(0.0, f64::max)
    }

    fn measure(&self) -> &'static str {
        if self.relative { "Relative performance (%)" } else { "As logged" }
    }

    fn caption(&self, seeds: impl Iterator<Item = usize> + Clone) -> String {
        let (low, high) = (seeds.clone().min().unwrap_or(0), seeds.max().unwrap_or(0));
        let seeds = if low == high { format!("{low}") } else { format!("{low}–{high}") };
        let band = match (high, self.recipe.shows_standard_error()) {
            (0 | 1, _) => "One seed",
            (_, true) => "Mean over seeds ± s.e.m.; thin: seeds",
            (_, false) => "Mean over seeds ± s.d.; thin: seeds",
        };
        let smoothing = self.recipe.smoothing();
        format!("{band}; n = {seeds}. {smoothing}. Read from logs of training, not played.")
    }

    fn colours(&self, names: &[&str]) -> Vec<&'static str> {
        match (self.recipe, names.len()) {
            (Recipe::Transfer, 2) => vec![BLUE, RED],
            (Recipe::MultiTask, _) => {
                let known: Vec<String> =
                    names.iter().map(|name| name.to_lowercase().replace('-', "_")).collect();
                let own = method_colours(&known.iter().map(String::as_str).collect::<Vec<_>>());
                // In this figure the paper gives the two baselines other colours than elsewhere.
                let paper = |name: &str| match name {
                    "mt_ppo" => Some(RED),
                    "mt_sac" => Some(BLUE),
                    _ => None,
                };
                known.iter().zip(own).map(|(name, own)| paper(name).unwrap_or(own)).collect()
            }
            _ => method_colours(names),
        }
    }
}

/// The value logged at a step; NaN for a point that was added or averaged.
fn logged_at(seed: &SeedCurve, step: f64) -> f64 {
    let place = seed.logged.steps().binary_search_by(|other| other.total_cmp(&step));
    place.map_or(f64::NAN, |place| seed.logged.values()[place])
}

impl Logs {
    /// Everything that was logged as a portable table.
    pub fn table(&self) -> Result<Table, RecordError> {
        let mut texts: [Vec<String>; 6] = Default::default();
        let (mut steps, mut values) = (Vec::new(), Vec::new());
        for logged in &self.curves {
            let metric = match logged.metric {
                Metric::SolvedFraction => "solved_fraction",
                Metric::Reward => "reward",
            };
            let joined = crate::analysis::curves::merge_resumed(&logged.pieces);
            for (step, value) in joined.steps().iter().zip(joined.values()) {
                let row =
                    [&logged.panel, &logged.method, &logged.seed, &logged.task, &logged.stage];
                texts.iter_mut().zip(row).for_each(|(column, text)| column.push(text.clone()));
                texts[5].push(metric.to_owned());
                steps.push(*step);
                values.push(*value);
            }
        }
        let [panel, method, seed, task, stage, metric] = texts;
        Table::new(vec![
            Column::unitless("panel", panel),
            Column::unitless("method", method),
            Column::unitless("seed", seed),
            Column::unitless("task", task),
            Column::unitless("stage", stage),
            Column::new("step", "environment steps", steps),
            Column::unitless("value", values),
            Column::unitless("metric", metric),
        ])
    }
}
