//! Walking muscle activity against human EMG: the ceiling that people set, and how near policies come to it
//! (`spec/analysis.md` §3).

use crate::analysis::emg::{
    self, BicepsFemoris, ChannelFault, ComparisonRow, Correlations, CycleProfile, CycleRow,
    EmgError, HumanProfiles, PairwiseCorrelations, Side,
};
use crate::analysis::factor;
use crate::analysis::stats::{Divisor, standard_error};
use crate::analysis::undefined::Undefined;

use super::emg_subjects::Subjects;
use super::walking::{Walk, WalkError, WalkOptions};

/// Policy name of the human reference in tables.
pub const HUMAN: &str = "Human";

/// What people are among themselves.
#[derive(Debug, Clone, PartialEq)]
pub struct Ceiling {
    /// Each person against the mean of the others.
    pub leave_one_out: Correlations,
    pub pairwise: PairwiseCorrelations,
    /// Dead and flat channels.
    pub faults: Vec<ChannelFault>,
    /// Muscles that have one in anybody.
    pub faulty: Vec<usize>,
}

impl Ceiling {
    /// The ceiling of `people`, of whom there must be two.
    pub fn of(people: &HumanProfiles) -> Result<Self, EmgError> {
        let faults = emg::channel_faults(people);
        Ok(Self {
            leave_one_out: emg::leave_one_out(people)?,
            pairwise: emg::pairwise(people)?,
            faulty: emg::faulty_muscles(&faults),
            faults,
        })
    }
}

/// How policies are compared with people.
#[derive(Debug, Clone, PartialEq)]
pub struct EmgOptions {
    /// Leg of the simulation; people were recorded on one.
    pub side: Side,
    pub biceps_femoris: BicepsFemoris,
    pub walk: WalkOptions,
    pub undefined: Undefined,
    /// Whether a policy without a cycle is a result rather than an error.
    pub allow_empty: bool,
}

/// The profiles of a policy that walked.
#[derive(Debug, Clone, PartialEq)]
pub struct Activity {
    /// Points × nine muscles.
    pub profile: CycleProfile,
    pub correlations: Correlations,
    /// Mean correlation with the profile delayed by 0, 1, … points.
    pub timing: Vec<Option<f64>>,
}

/// One policy.
#[derive(Debug, Clone, PartialEq)]
pub struct PolicyActivity {
    pub policy: String,
    pub detected: usize,
    pub retained: usize,
    pub cycles: Vec<CycleRow>,
    /// `None`: it had no cycle to average, which was allowed.
    pub activity: Option<Activity>,
    /// The fourteen muscles of the right leg for `factors`, if it has cycles and the muscles are there.
    pub factors: Option<CycleProfile>,
    pub warnings: Vec<String>,
}

/// Compares one walk with `people`.
pub fn compare(
    people: &HumanProfiles,
    walk: &Walk,
    options: &EmgOptions,
) -> Result<PolicyActivity, WalkError> {
    let cycles = walk.segment(options.side, &options.walk.gait)?;
    let muscles = emg::model_muscles(options.side, options.biceps_femoris);
    let mut warnings = Vec::new();
    if walk.repeats_itself() {
        warnings.push(format!(
            "all {} episodes of `{}` are the same: they count as one, and no average hides it",
            walk.episode_count(),
            walk.policy
        ));
    }
    if cycles.unfiltered {
        warnings.push("the cut-off is too high for this rate: nothing was filtered".to_owned());
    }
    let activity = match walk.profile(&cycles, &muscles, &options.walk) {
        Ok(profile) => {
            let fault = |fault| WalkError::Emg { fault, policy: walk.policy.clone() };
            let rows = profile.rows().map_err(fault)?;
            let correlations = emg::correlate(people, &rows).map_err(fault)?;
            let timing = emg::timing(people, &rows, options.undefined).map_err(fault)?;
            Some(Activity { profile, correlations, timing })
        }
        Err(WalkError::Emg { fault: EmgError::NoCycle { detected }, policy })
            if options.allow_empty =>
        {
            warnings.push(format!("no gait cycle of `{policy}` was kept of {detected} detected"));
            None
        }
        Err(error) => return Err(error),
    };
    let factors = walk.segment(Side::Right, &options.walk.gait).ok().and_then(|cycles| {
        let compartments = factor::compartments(Side::Right);
        walk.profile(&cycles, &compartments, &options.walk).ok()
    });
    Ok(PolicyActivity {
        policy: walk.policy.clone(),
        detected: cycles.detected(),
        retained: cycles.retained(),
        cycles: walk.cycle_rows(&cycles),
        activity,
        factors,
        warnings,
    })
}

/// Everything that was found.
#[derive(Debug, Clone)]
pub struct EmgResult {
    pub subjects: Subjects,
    pub ceiling: Ceiling,
    pub policies: Vec<PolicyActivity>,
    pub comparisons: Vec<ComparisonRow>,
    pub options: EmgOptions,
}

impl EmgResult {
    /// Compares all `walks` with `subjects`, and with each other.
    pub fn of(subjects: Subjects, walks: &[Walk], options: EmgOptions) -> Result<Self, WalkError> {
        let of_people = |fault| WalkError::Emg { fault, policy: HUMAN.to_owned() };
        let ceiling = Ceiling::of(&subjects.people).map_err(of_people)?;
        let policies = walks
            .iter()
            .map(|walk| compare(&subjects.people, walk, &options))
            .collect::<Result<Vec<_>, _>>()?;
        let means: Vec<(String, Vec<Option<f64>>)> = policies
            .iter()
            .filter_map(|policy| {
                let activity = policy.activity.as_ref()?;
                let means = activity.correlations.row_means(&[], options.undefined);
                Some((policy.policy.clone(), means))
            })
            .collect();
        let comparisons = emg::comparisons(&means).map_err(of_people)?;
        Ok(Self { subjects, ceiling, policies, comparisons, options })
    }

    /// The policies that walked, with the reference first.
    pub fn named_correlations(&self) -> impl Iterator<Item = (&str, &Correlations)> {
        let policies = self.policies.iter();
        let walked =
            policies.filter_map(|p| Some((p.policy.as_str(), &p.activity.as_ref()?.correlations)));
        [(HUMAN, &self.ceiling.leave_one_out)].into_iter().chain(walked)
    }
}

/// Mean over people and its standard error (divisor n − 1).
pub(super) fn mean_and_error(
    means: &[Option<f64>],
    undefined: Undefined,
) -> (Option<f64>, Option<f64>) {
    let mean = undefined.mean(means.iter().copied());
    let defined: Vec<f64> = means.iter().flatten().copied().collect();
    (mean, mean.and_then(|_| standard_error(&defined, Divisor::CountMinusOne)))
}
