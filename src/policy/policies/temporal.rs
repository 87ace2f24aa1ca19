//! Plays the transformer that attends over time: windows, normaliser, network, and the moments it looks back at.
//!
//! Of the last observations of the episode every `interval`-th counts as a moment, the newest always; of the `n` moments
//! there are, `⌊n · share⌋ + 1` are looked at, drawn without replacement, the newest always (`spec/policy.md` §2.3). The
//! draw comes from the newest window's own bytes, so a body's actions depend on nothing but what it has seen. The
//! published caller keeps moments of earlier episodes, which the attention mask then hides; here an episode starts
//! without any.

use std::sync::Arc;

use crate::policy::PolicyError;
use crate::policy::checkpoint::contents::Declared;
use crate::policy::history::History;
use crate::policy::interface::{Actor, ObservationVariant, Policy, TaskInterface};
use crate::policy::network::temporal::{TemporalTransformer, TemporalWorkspace};
use crate::policy::network::transformer::TaskConstants;
use crate::policy::normaliser::SignatureNormaliser;
use crate::policy::speech::{Descriptions, Speech};

/// Moments that the paper's model looks back at.
const PUBLISHED_MOMENTS: usize = 96;
/// Share of them it looks at.
const PUBLISHED_SHARE: f64 = 0.5;
/// Far more observations than an episode has.
const MOST_OBSERVATIONS: usize = 10_000;

/// How much of the past is looked at.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Recall {
    /// Moments, the newest included.
    pub moments: usize,
    /// Steps from one moment to the next.
    pub interval: usize,
    /// Share of the moments that is looked at, more than 0 and at most 1.
    pub share: f64,
}

impl Recall {
    /// What a run declares, the published values where it is silent.
    pub fn declared(declared: &Declared) -> Result<Self, PolicyError> {
        let recall = Self {
            moments: declared.moments.unwrap_or(PUBLISHED_MOMENTS),
            interval: declared.moment_interval.unwrap_or(1),
            share: declared.kept_share.unwrap_or(PUBLISHED_SHARE),
        };
        let Self { moments, interval, share } = recall;
        let observations = moments.checked_mul(interval);
        let usable = (1..=MOST_OBSERVATIONS).contains(&observations.unwrap_or(0));
        if usable && share > 0.0 && share <= 1.0 {
            return Ok(recall);
        }
        let what = format!("looking back at {share} of {moments} moments, {interval} steps apart");
        Err(PolicyError::Unsupported { what })
    }

    /// What [`Self::declared`] takes from the published model because no file says it.
    #[must_use]
    pub fn assumptions(declared: &Declared) -> Vec<String> {
        let mut assumptions = Vec::new();
        let mut assume = |is_known: bool, what: &str| {
            if !is_known {
                assumptions.push(format!("no file says {what} is assumed"));
            }
        };
        let moments = format!("how far the policy looks back; {PUBLISHED_MOMENTS} moments");
        assume(declared.moments.is_some(), &moments);
        assume(declared.moment_interval.is_some(), "how far its moments are apart; 1 step");
        let share = format!("which share of them it looks at; {PUBLISHED_SHARE}");
        assume(declared.kept_share.is_some(), &share);
        assumptions
    }

    /// Observations from the oldest moment to the newest.
    fn span(&self) -> usize {
        (self.moments - 1) * self.interval + 1
    }

    /// How many of `available` moments are looked at.
    fn kept(&self, available: usize) -> usize {
        available.min((available as f64 * self.share).floor() as usize + 1)
    }
}

/// A transformer over time with the normaliser it was trained with.
#[derive(Debug, Clone)]
pub struct TemporalPolicy {
    network: Arc<TemporalTransformer>,
    speech: Speech,
    recall: Recall,
}

impl TemporalPolicy {
    pub(in crate::policy) fn new(
        network: TemporalTransformer,
        speech: Speech,
        recall: Recall,
    ) -> Self {
        Self { network: Arc::new(network), speech, recall }
    }
}

impl Policy for TemporalPolicy {
    fn variant(&self) -> ObservationVariant {
        ObservationVariant::Muscle
    }

    fn bind(&self, task: &TaskInterface, slots: usize) -> Result<Box<dyn Actor>, PolicyError> {
        let Descriptions { sensors, muscles } = self.speech.describe(task)?;
        let constants = self.network.base().prepare(&task.task, &sensors, &muscles, false)?;
        let lags = self.network.sizes().lags;
        let token_count = task.muscle_observation_length;
        let span = self.recall.span();
        Ok(Box::new(TemporalActor {
            normaliser: self.speech.normaliser(&task.observation_words),
            history: History::new(slots, token_count, lags),
            windows: vec![0.0; token_count * lags],
            moment_length: token_count * self.network.sizes().width,
            pasts: vec![Past::default(); slots],
            moments: Vec::with_capacity(self.recall.moments),
            span,
            recall: self.recall,
            muscle_count: task.muscle_count,
            workspace: self.network.workspace(&constants, self.recall.moments),
            constants,
            network: Arc::clone(&self.network),
        }))
    }

    fn warnings(&self, task: &TaskInterface) -> Vec<String> {
        self.speech.warnings(task)
    }

    fn trained_tasks(&self) -> &[String] {
        self.speech.trained_tasks()
    }
}

/// What one body has seen in its episode.
#[derive(Debug, Clone, Default)]
struct Past {
    /// Observations so far.
    steps: usize,
    /// Encoded observations, a ring of as many as can still be looked at.
    ring: Vec<f32>,
}

struct TemporalActor {
    network: Arc<TemporalTransformer>,
    constants: TaskConstants,
    normaliser: SignatureNormaliser,
    history: History,
    /// Normalised windows of the body that acts.
    windows: Vec<f32>,
    /// Numbers that one observation leaves behind.
    moment_length: usize,
    pasts: Vec<Past>,
    /// The moments looked at, by where they begin in the ring.
    moments: Vec<usize>,
    span: usize,
    recall: Recall,
    workspace: TemporalWorkspace,
    muscle_count: usize,
}

impl TemporalActor {
    /// Takes in an observation and decodes its action.
    fn act_one(&mut self, slot: usize, observation: &[f32], means: &mut [f32]) {
        self.normaliser.apply(self.history.push(slot, observation), &mut self.windows);
        let Past { steps, ring } = &mut self.pasts[slot];
        let now = *steps;
        *steps += 1;
        let place = |step: usize| {
            let start = step % self.span * self.moment_length;
            start..start + self.moment_length
        };
        // The ring grows with the episode until it is full; after that it never allocates again.
        let needed = place(now).end;
        if ring.len() < needed {
            ring.resize(needed, 0.0);
        }
        let moment = &mut ring[place(now)];
        let (network, constants) = (&self.network, &self.constants);
        network.encode_moment(constants, &self.windows, now, moment, &mut self.workspace);

        let available = (now / self.recall.interval + 1).min(self.recall.moments);
        let kept = self.recall.kept(available);
        draw(&self.windows, now, available, kept, &mut self.moments);
        for moment in &mut self.moments {
            *moment = place(now - *moment * self.recall.interval).start;
        }
        let moments = (ring.as_slice(), self.moments.as_slice());
        network.action_means(constants, moments, now, means, &mut self.workspace);
    }
}

impl Actor for TemporalActor {
    fn reset(&mut self, slot: usize) {
        self.history.clear(slot);
        self.pasts[slot].steps = 0;
    }

    fn act(
        &mut self,
        slots: &[usize],
        observations: &[f32],
        action_means: &mut [f32],
        mut standard_deviations: Option<&mut [f32]>,
    ) {
        let sensors = self.windows.len() / self.network.sizes().lags;
        for (row, &slot) in slots.iter().enumerate() {
            let newest = &observations[row * sensors..(row + 1) * sensors];
            let muscles = row * self.muscle_count..(row + 1) * self.muscle_count;
            self.act_one(slot, newest, &mut action_means[muscles.clone()]);
            if let Some(deviations) = &mut standard_deviations {
                self.network.standard_deviations(&self.workspace, &mut deviations[muscles]);
            }
        }
    }

    fn clips_actions(&self) -> bool {
        false
    }
}

/// Draws `kept` of the moments `0..available` before now, 0 always among them, and lists them from oldest to newest.
fn draw(windows: &[f32], now: usize, available: usize, kept: usize, order: &mut Vec<usize>) {
    order.clear();
    order.extend(0..available);
    if kept < available {
        let mut hasher = blake3::Hasher::new();
        hasher.update(&(now as u64).to_le_bytes());
        windows.iter().for_each(|x| {
            hasher.update(&x.to_le_bytes());
        });
        let mut stream = hasher.finalize_xof();
        // The first `kept` places of a shuffle whose place 0 is taken. 64 bits leave no bias worth the name.
        for place in 1..kept {
            let mut bytes = [0; 8];
            stream.fill(&mut bytes);
            let choices = (available - place) as u64;
            order.swap(place, place + (u64::from_le_bytes(bytes) % choices) as usize);
        }
        order.truncate(kept);
    }
    order.sort_unstable_by(|a, b| b.cmp(a));
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_draw_keeps_the_newest_and_repeats_none() {
        let mut counts = [0; 20];
        for seed in 0..400 {
            let mut order = Vec::new();
            draw(&[seed as f32], 7, 20, 11, &mut order);
            assert_eq!((order.len(), order.last()), (11, Some(&0)));
            assert!(order.windows(2).all(|pair| pair[0] > pair[1]), "{order:?}");
            order.iter().for_each(|&back| counts[back] += 1);
        }
        // Ten of the other nineteen: 210 of 400 each, standard deviation 10.
        assert!(counts[1..].iter().all(|&n| (160..260).contains(&n)), "{counts:?}");
    }

    #[test]
    fn half_of_the_moments_and_one_are_looked_at() {
        let recall = Recall::declared(&Declared::default()).unwrap();
        assert_eq!([1, 2, 3, 96].map(|n| recall.kept(n)), [1, 2, 2, 49]);
        let all = Recall { share: 1.0, ..recall };
        assert_eq!([1, 2, 96].map(|n| all.kept(n)), [1, 2, 96]);
        assert_eq!(recall.span(), 96);
        let absurd = Declared { moments: Some(usize::MAX), ..Declared::default() };
        assert!(Recall::declared(&absurd).is_err());
        assert_eq!(Recall::assumptions(&Declared::default()).len(), 3);
    }
}
