//! What the comparison with people leaves behind: tables with upstream's columns, `simulation.npz`, the result document.

use serde_json::{Value, json};

use crate::analysis::emg::{
    self, ChannelFault, CorrelationRow, Correlations, CycleProfile, CycleRow, Fault,
    HUMAN_CHANNELS, Side, SubjectRow,
};
use crate::analysis::factor;
use crate::record::profiles::{Profile, SimulationProfiles};
use crate::record::{Column, RecordError, Table};

use super::emg::{Activity, EmgOptions, EmgResult, PolicyActivity, mean_and_error};
use super::emg_subjects::Subjects;

impl EmgResult {
    /// `correlations`: policy, subject, muscle, r.
    pub fn correlation_table(&self) -> Result<Table, RecordError> {
        let people = &self.subjects.people;
        let rows: Vec<CorrelationRow> = self
            .named_correlations()
            .flat_map(|(policy, found)| emg::correlation_rows(policy, people, found))
            .collect();
        Table::new(vec![
            texts("policy", rows.iter().map(|row| row.policy.as_str())),
            whole("subject", rows.iter().map(|row| row.subject as usize)),
            texts("muscle", rows.iter().map(|row| row.muscle)),
            numbers("r", rows.iter().map(|row| row.r)),
        ])
    }

    /// `subject_means`: policy, subject, r; ours adds r without the muscles of dead and flat channels.
    pub fn subject_table(&self) -> Result<Table, RecordError> {
        let rows = |without: &[usize]| -> Vec<SubjectRow> {
            let (people, undefined) = (&self.subjects.people, self.options.undefined);
            self.named_correlations()
                .flat_map(|(policy, found)| {
                    emg::subject_rows(policy, people, found, without, undefined)
                })
                .collect()
        };
        let (all, without) = (rows(&[]), rows(&self.ceiling.faulty));
        Table::new(vec![
            texts("policy", all.iter().map(|row| row.policy.as_str())),
            whole("subject", all.iter().map(|row| row.subject as usize)),
            numbers("r", all.iter().map(|row| row.r)),
            numbers("r_without_faulty_muscles", without.iter().map(|row| row.r)),
        ])
    }

    /// `comparisons`: one row per pair of policies; ours adds the effect size.
    pub fn comparison_table(&self) -> Result<Table, RecordError> {
        let rows = &self.comparisons;
        Table::new(vec![
            texts("a", rows.iter().map(|row| row.a.as_str())),
            texts("b", rows.iter().map(|row| row.b.as_str())),
            whole("n_subjects", rows.iter().map(|row| row.n_subjects)),
            numbers("W", rows.iter().map(|row| row.w)),
            numbers("p_raw", rows.iter().map(|row| row.p_raw)),
            numbers("p_bonferroni", rows.iter().map(|row| row.p_bonferroni)),
            numbers("rank_biserial", rows.iter().map(|row| row.rank_biserial)),
        ])
    }

    /// `gait_cycles`: one row per detected cycle.
    pub fn cycle_table(&self) -> Result<Table, RecordError> {
        let rows: Vec<&CycleRow> = self.policies.iter().flat_map(|p| &p.cycles).collect();
        let rows = || rows.iter();
        Table::new(vec![
            texts("policy", rows().map(|row| row.policy.as_str())),
            whole("episode", rows().map(|row| row.episode)),
            whole("start", rows().map(|row| row.start)),
            whole("end", rows().map(|row| row.end)),
            Column::new("duration_s", "s", rows().map(|row| row.duration_s).collect::<Vec<_>>()),
            Column::new("mean_v", "m/s", rows().map(|row| row.mean_v).collect::<Vec<_>>()),
            Column::unitless("kept", rows().map(|row| row.kept).collect::<Vec<_>>()),
            texts("reason", rows().map(|row| row.reason)),
        ])
    }

    /// `simulation.npz`, and the counts of `simulation.json` under the same names.
    #[must_use]
    pub fn simulation(&self) -> (SimulationProfiles, Value) {
        let EmgOptions { side, biceps_femoris, .. } = self.options;
        let mut simulation = SimulationProfiles {
            emg_muscles: emg::model_muscles(side, biceps_femoris).to_vec(),
            factor_muscles: factor::FACTOR_MUSCLES.iter().map(|(name, _)| (*name).into()).collect(),
            profiles: std::collections::BTreeMap::new(),
        };
        let mut counts = serde_json::Map::new();
        for PolicyActivity { policy, activity, factors, .. } in &self.policies {
            if let Some(Activity { profile, .. }) = activity {
                // `_right` is upstream's name of the fourteen muscles.
                let name = match side {
                    Side::Left => format!("{policy}_left"),
                    Side::Right => format!("{policy}_right_emg"),
                };
                counts.insert(name.clone(), count(profile));
                let turned = turned(&profile.mean, HUMAN_CHANNELS.len());
                simulation.profiles.insert(name, turned);
            }
            let summed = factors.as_ref().and_then(|profile| {
                let sums = factor::sum_compartments(&profile.rows().ok()?).ok()?;
                Some((profile, turned(&sums, factor::FACTOR_MUSCLES.len())))
            });
            if let Some((profile, sums)) = summed {
                counts.insert(format!("{policy}_right"), count(profile));
                simulation.profiles.insert(format!("{policy}_right"), sums);
            }
        }
        (simulation, Value::Object(counts))
    }

    /// The result document.
    #[must_use]
    pub fn document(&self) -> Value {
        let Subjects { people, speed, synthetic, folder, left_out, .. } = &self.subjects;
        let fault = |fault: &ChannelFault| {
            let ChannelFault { subject, channel, fault, range } = *fault;
            let word = match fault {
                Fault::Dead => "dead",
                Fault::Flat => "flat",
            };
            json!({"subject": subject, "muscle": HUMAN_CHANNELS[channel], "fault": word, "range": range})
        };
        let policy = |policy: &PolicyActivity| {
            let mut entry = json!({
                "policy": policy.policy,
                "detected": policy.detected,
                "retained": policy.retained,
            });
            if let Some(activity) = &policy.activity {
                entry["correlation"] = self.correlation_document(&activity.correlations);
                entry["best_delay_percent"] = json!(best_delay(&activity.timing));
            }
            entry
        };
        json!({
            "people": {
                "synthetic": synthetic,
                "folder": folder,
                "speed_km_h": f64::from(speed.0) / 10.0,
                "subjects": people.subjects(),
                "left_out": left_out,
                "faults": self.ceiling.faults.iter().map(fault).collect::<Vec<_>>(),
                "faulty_muscles": self.ceiling.faulty.iter().map(|&m| HUMAN_CHANNELS[m]).collect::<Vec<_>>(),
                "leave_one_out": self.correlation_document(&self.ceiling.leave_one_out),
                "pairwise": self.correlation_document(&self.ceiling.pairwise.correlations),
            },
            "policies": self.policies.iter().map(policy).collect::<Vec<_>>(),
            "comparisons": self.comparisons,
            "warnings": self.policies.iter().flat_map(|p| &p.warnings).collect::<Vec<_>>(),
        })
    }

    fn correlation_document(&self, found: &Correlations) -> Value {
        let undefined = self.options.undefined;
        let (mean, sem) = mean_and_error(&found.row_means(&[], undefined), undefined);
        json!({
            "mean": mean,
            "sem": sem,
            "without_faulty_muscles": found.overall(&self.ceiling.faulty, undefined),
            "n": found.rows().len(),
            "muscles": found.channel_means(undefined),
        })
    }
}

/// The delay with the largest mean correlation, in percent of the cycle, −50 to 50.
fn best_delay(timing: &[Option<f64>]) -> Option<f64> {
    let points = timing.len();
    let defined = timing.iter().enumerate().filter_map(|(at, r)| Some((at, (*r)?)));
    let (best, _) = defined.max_by(|(_, a), (_, b)| a.total_cmp(b))?;
    let share = 100.0 * best as f64 / points as f64;
    Some(if 2 * best > points { share - 100.0 } else { share })
}

fn count(profile: &CycleProfile) -> Value {
    json!({"detected": profile.detected, "retained": profile.retained})
}

/// Points × muscles as muscles × points.
fn turned(values: &[f64], muscles: usize) -> Profile {
    let points = values.len() / muscles;
    let column = |muscle: usize| values.iter().copied().skip(muscle).step_by(muscles);
    Profile { muscles, points, values: (0..muscles).flat_map(column).collect() }
}

fn texts<'a>(name: &str, values: impl Iterator<Item = &'a str>) -> Column {
    Column::unitless(name, values.map(str::to_owned).collect::<Vec<_>>())
}

fn whole(name: &str, values: impl Iterator<Item = usize>) -> Column {
    Column::unitless(name, values.map(|value| value as i64).collect::<Vec<_>>())
}

fn numbers(name: &str, values: impl Iterator<Item = Option<f64>>) -> Column {
    Column::unitless(name, values.map(|x| x.unwrap_or(f64::NAN)).collect::<Vec<_>>())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_delay_beyond_half_the_cycle_is_an_advance() {
        let timing = |best: usize| -> Vec<Option<f64>> {
            (0..20).map(|at| (at != 3).then_some(if at == best { 0.9 } else { 0.1 })).collect()
        };
        assert_eq!(best_delay(&timing(0)), Some(0.0));
        assert_eq!(best_delay(&timing(2)), Some(10.0));
        assert_eq!(best_delay(&timing(19)), Some(-5.0));
        assert_eq!(best_delay(&[None, None]), None);
    }

    #[test]
    fn profiles_are_stored_muscle_by_muscle() {
        let stored = turned(&[1.0, 10.0, 2.0, 20.0, 3.0, 30.0], 2);
        assert_eq!((stored.muscles, stored.points), (2, 3));
        assert_eq!(stored.values, [1.0, 2.0, 3.0, 10.0, 20.0, 30.0]);
    }
}
