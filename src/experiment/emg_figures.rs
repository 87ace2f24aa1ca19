//! The two figures of the comparison with people: correlations as bars, profiles of four muscles as traces.

use crate::analysis::emg::{HUMAN_CHANNELS, muscle_trace, relative_to_maximum};
use crate::figure::{
    CorrelationBar, CorrelationFigure, ProfileFigure, ProfilePanel,
    palette::{self, PEOPLE as HUMAN_COLOUR},
};

use super::emg::{EmgResult, HUMAN, PolicyActivity, mean_and_error};

/// Channels of the paper's traces: Soleus, both heads of Gastrocnemius, Biceps Femoris.
const TRACED: [usize; 4] = [0, 1, 2, 5];
/// Corrected p below which two policies differ.
const SIGNIFICANT: f64 = 0.05;

impl EmgResult {
    /// Mean correlation of the reference and every policy that walked.
    #[must_use]
    pub fn correlation_figure(&self) -> CorrelationFigure {
        let names: Vec<&str> = self.named_correlations().map(|(name, _)| name).collect();
        let colours = palette::policy_colours(&names[1..]);
        let colours = [HUMAN_COLOUR].into_iter().chain(colours);
        let bar = |((name, found), colour): ((&str, _), &'static str)| {
            let found: &crate::analysis::emg::Correlations = found;
            let means = found.row_means(&[], self.options.undefined);
            let (mean, error) = mean_and_error(&means, self.options.undefined);
            CorrelationBar {
                name: name.to_owned(),
                colour,
                people: means.into_iter().map(|mean| mean.unwrap_or(f64::NAN)).collect(),
                mean: mean.unwrap_or(f64::NAN),
                standard_error: error.unwrap_or(f64::NAN),
            }
        };
        let place = |name: &str| names.iter().position(|known| *known == name);
        let differs = |p: Option<f64>| p.is_some_and(|p| p < SIGNIFICANT);
        let different = self.comparisons.iter().filter(|row| differs(row.p_bonferroni));
        CorrelationFigure {
            bars: self.named_correlations().zip(colours).map(bar).collect(),
            different: different.filter_map(|row| place(&row.a).zip(place(&row.b))).collect(),
            footer: format!(
                "Mean over nine muscles, ± s.e.m.; each dot one of {}. {HUMAN}: each person against the mean of the \
                 others. {}",
                self.people(),
                self.warning()
            ),
        }
    }

    /// Traces of four muscles.
    #[must_use]
    pub fn profile_figure(&self) -> ProfileFigure {
        let walked: Vec<&PolicyActivity> =
            self.policies.iter().filter(|policy| policy.activity.is_some()).collect();
        let names: Vec<&str> = walked.iter().map(|policy| policy.policy.as_str()).collect();
        let panel = |channel: usize| {
            let people = muscle_trace(&self.subjects.people, channel);
            let profile = |policy: &&PolicyActivity| {
                let profile = policy.activity.iter().map(|activity| &activity.profile);
                let values =
                    profile.flat_map(|p| p.mean.iter().skip(channel).step_by(p.muscle_count));
                relative_to_maximum(&values.copied().collect::<Vec<_>>()).values
            };
            ProfilePanel {
                muscle: HUMAN_CHANNELS[channel].to_owned(),
                people: people.subjects.into_iter().map(|trace| trace.values).collect(),
                mean: people.mean.values,
                policies: walked.iter().map(profile).collect(),
            }
        };
        let names_policy_colours = names.iter().map(|name| (*name).to_owned());
        ProfileFigure {
            panels: TRACED.map(panel).into(),
            policies: names_policy_colours.zip(palette::policy_colours(&names)).collect(),
            footer: format!(
                "Each trace divided by its own maximum; {}. {}",
                self.people(),
                self.warning()
            ),
        }
    }

    fn people(&self) -> String {
        let subjects = &self.subjects;
        format!("{} people who walked at {} km/h", subjects.people.subjects().len(), subjects.speed)
    }

    fn warning(&self) -> &'static str {
        if self.subjects.synthetic {
            "THE PEOPLE ARE INVENTED: this says nothing about humans."
        } else {
            ""
        }
    }
}
