//! What a run remembers of its last steps: raw observations, actions and rewards, in single precision.
//!
//! An observation is stored once, though six windows hold it, twice over as state and as next state: windows are put together
//! when a transition is drawn. That is a twelfth of what whole states would take. Every environment has a ring of its own, so
//! that the step before lies beside, and its task is known.

use crate::random::Random;
use crate::train::TrainError;

/// Entries that a ring has at least, so that some of them can always be drawn.
const SMALLEST_RING: usize = 64;

/// What became of the step that an entry holds.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Mark {
    /// Nothing yet, or never: the episode's last observation.
    Open = 0,
    /// The episode went on, or only the time limit ended it.
    GoesOn = 1,
    /// The task ended the episode.
    Ends = 2,
}

/// The last steps of one environment. An entry is an observation, and what was done there if anything was.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Ring {
    pub(super) sensors: usize,
    /// Numbers of an action.
    pub(super) width: usize,
    capacity: usize,
    pub(super) observations: Vec<f32>,
    pub(super) actions: Vec<f32>,
    pub(super) rewards: Vec<f32>,
    /// Steps since the episode began.
    pub(super) ages: Vec<u32>,
    pub(super) marks: Vec<Mark>,
    /// Entries so far, those that were overwritten included.
    pub(super) count: u64,
}

/// One transition of the buffer.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Pick {
    pub(super) seat: usize,
    entry: u64,
}

/// The rings of all environments.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Replay {
    pub(super) rings: Vec<Ring>,
    lags: usize,
}

/// Bytes that a buffer of `buffer` steps takes when it is full, for environments with so many sensors each.
pub(super) fn bytes(buffer: usize, sensors: &[usize], width: usize) -> u64 {
    let capacity = (buffer / sensors.len().max(1)) as u64;
    let entry = |&sensors: &usize| 4 * (sensors + width + 2) as u64 + 1;
    sensors.iter().map(|sensors| capacity.saturating_mul(entry(sensors))).sum()
}

impl Replay {
    /// An empty buffer of `buffer` steps for environments with so many sensors each.
    pub(super) fn new(
        buffer: usize,
        sensors: &[usize],
        width: usize,
        lags: usize,
    ) -> Result<Self, TrainError> {
        let capacity = buffer / sensors.len().max(1);
        if capacity < SMALLEST_RING || u32::try_from(capacity).is_err() {
            let what = format!(
                "a buffer of {buffer} steps for {} environments; each must have between \
                 {SMALLEST_RING} and {}",
                sensors.len(),
                u32::MAX
            );
            return Err(TrainError::Plan { what });
        }
        let ring = |&sensors: &usize| Ring::new(sensors, width, capacity);
        let rings: Option<Vec<Ring>> = sensors.iter().map(ring).collect();
        let rings = rings.ok_or_else(|| {
            let bytes = bytes(buffer, sensors, width);
            let what = format!("there is no memory for a buffer of {buffer} steps, {bytes} bytes");
            TrainError::Plan { what }
        })?;
        Ok(Self { rings, lags })
    }

    /// Forgets everything.
    pub(super) fn clear(&mut self) {
        for ring in &mut self.rings {
            ring.observations.clear();
            ring.actions.clear();
            ring.rewards.clear();
            ring.ages.clear();
            ring.marks.clear();
            ring.count = 0;
        }
    }

    /// A transition, every environment as likely as every other. Some step must have been made by each.
    pub(super) fn pick(&self, random: &mut Random) -> Pick {
        let seat = random.index(self.rings.len() as u32) as usize;
        let ring = &self.rings[seat];
        loop {
            let entry = ring.oldest() + u64::from(random.index(ring.live() as u32));
            if ring.is_whole(entry, self.lags) {
                return Pick { seat, entry };
            }
        }
    }

    /// Writes the raw windows before the step, sensors × lags.
    pub(super) fn state(&self, pick: Pick, windows: &mut [f32]) {
        self.rings[pick.seat].windows(pick.entry, self.lags, windows);
    }

    /// Writes the raw windows after it.
    pub(super) fn next_state(&self, pick: Pick, windows: &mut [f32]) {
        self.rings[pick.seat].windows(pick.entry + 1, self.lags, windows);
    }

    pub(super) fn action(&self, pick: Pick) -> &[f32] {
        let ring = &self.rings[pick.seat];
        &ring.actions[ring.slot(pick.entry) * ring.width..][..ring.width]
    }

    /// The raw reward, and whether the task ended the episode.
    pub(super) fn outcome(&self, pick: Pick) -> (f32, bool) {
        let ring = &self.rings[pick.seat];
        let slot = ring.slot(pick.entry);
        (ring.rewards[slot], ring.marks[slot] == Mark::Ends)
    }
}

impl Ring {
    /// `None` if there is no memory.
    fn new(sensors: usize, width: usize, capacity: usize) -> Option<Self> {
        let numbers = |count: usize| {
            let mut numbers: Vec<f32> = Vec::new();
            numbers.try_reserve_exact(count.checked_mul(capacity)?).ok()?;
            Some(numbers)
        };
        let (mut ages, mut marks) = (Vec::new(), Vec::new());
        ages.try_reserve_exact(capacity).ok()?;
        marks.try_reserve_exact(capacity).ok()?;
        let (observations, actions, rewards) = (numbers(sensors)?, numbers(width)?, numbers(1)?);
        let count = 0;
        Some(Self { sensors, width, capacity, observations, actions, rewards, ages, marks, count })
    }

    /// Entries that are there.
    pub(super) fn live(&self) -> usize {
        self.marks.len()
    }

    /// Number of the oldest entry that is there.
    pub(super) fn oldest(&self) -> u64 {
        self.count - self.live() as u64
    }

    pub(super) fn capacity(&self) -> usize {
        self.capacity
    }

    /// Where an entry lies.
    pub(super) fn slot(&self, entry: u64) -> usize {
        (entry % self.capacity as u64) as usize
    }

    /// An episode begins with this observation.
    pub(super) fn begin(&mut self, observation: &[f32]) {
        self.push(observation, 0);
    }

    /// A step: what was done, what it brought, whether the task ended the episode by it, and what was seen then.
    pub(super) fn step(&mut self, action: &[f32], reward: f32, ends: bool, observation: &[f32]) {
        let newest = self.slot(self.count - 1);
        self.actions[newest * self.width..][..self.width].copy_from_slice(action);
        self.rewards[newest] = reward;
        self.marks[newest] = if ends { Mark::Ends } else { Mark::GoesOn };
        self.push(observation, self.ages[newest].saturating_add(1));
    }

    fn push(&mut self, observation: &[f32], age: u32) {
        let slot = self.slot(self.count);
        if self.live() < self.capacity {
            self.observations.extend_from_slice(observation);
            self.actions.resize(self.actions.len() + self.width, 0.0);
            self.rewards.push(0.0);
            self.ages.push(age);
            self.marks.push(Mark::Open);
        } else {
            self.observations[slot * self.sensors..][..self.sensors].copy_from_slice(observation);
            self.ages[slot] = age;
            self.marks[slot] = Mark::Open;
        }
        self.count += 1;
    }

    /// Whether an entry holds a step, and everything that its windows hold is still there.
    fn is_whole(&self, entry: u64, lags: usize) -> bool {
        let slot = self.slot(entry);
        let before = u64::from(self.ages[slot]).min(lags as u64 - 1);
        self.marks[slot] != Mark::Open && entry - self.oldest() >= before
    }

    /// The windows that end with an entry; zeros before the episode began.
    fn windows(&self, entry: u64, lags: usize, windows: &mut [f32]) {
        let age = u64::from(self.ages[self.slot(entry)]);
        for lag in 0..lags {
            let back = (lags - 1 - lag) as u64;
            let column = windows[lag..].iter_mut().step_by(lags);
            if back > age {
                column.for_each(|x| *x = 0.0);
            } else {
                let seen = &self.observations[self.slot(entry - back) * self.sensors..];
                column.zip(&seen[..self.sensors]).for_each(|(x, &seen)| *x = seen);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::policy::history::History;

    const LAGS: usize = 3;

    /// A number that tells environment, episode and step.
    fn seen(seat: usize, episode: usize, step: usize) -> [f32; 2] {
        let number = (seat * 10_000 + episode * 100 + step) as f32;
        [number, -number]
    }

    /// Plays episodes of `length` steps in two environments, and remembers every transition in full beside.
    fn played(buffer: usize, steps: usize, length: usize) -> (Replay, Vec<[Vec<f32>; 2]>) {
        let mut replay = Replay::new(buffer, &[2, 2], 1, LAGS).unwrap();
        let mut whole = Vec::new();
        for (seat, ring) in replay.rings.iter_mut().enumerate() {
            let (mut episode, mut step) = (0, 0);
            let mut history = History::new(1, 2, LAGS);
            ring.begin(&seen(seat, 0, 0));
            history.push(0, &seen(seat, 0, 0));
            for _ in 0..steps {
                let before = history.windows(0).to_vec();
                step += 1;
                let after = history.push(0, &seen(seat, episode, step)).to_vec();
                ring.step(&[step as f32], step as f32, step == length, &seen(seat, episode, step));
                whole.push([before, after]);
                if step == length {
                    (episode, step) = (episode + 1, 0);
                    history.clear(0);
                    history.push(0, &seen(seat, episode, 0));
                    ring.begin(&seen(seat, episode, 0));
                }
            }
        }
        (replay, whole)
    }

    #[test]
    fn what_is_drawn_are_the_windows_that_were_seen_however_often_the_ring_went_round() {
        for (steps, length) in [(5, 9), (50, 9), (500, 9), (300, 1), (300, 1000)] {
            let (replay, whole) = played(128, steps, length);
            let mut random = Random::new([3; 32]);
            let mut found = std::collections::BTreeSet::new();
            for _ in 0..3000 {
                let pick = replay.pick(&mut random);
                let (mut before, mut after) = (vec![9.0; 6], vec![9.0; 6]);
                replay.state(pick, &mut before);
                replay.next_state(pick, &mut after);
                let place = whole.iter().position(|[b, a]| *b == before && *a == after);
                let place = place.expect("a transition that happened");
                let step = place % steps % length + 1;
                assert_eq!(replay.action(pick), [step as f32]);
                assert_eq!(replay.outcome(pick), (step as f32, step == length));
                found.insert(place);
            }
            let oldest = found.iter().filter(|&&place| place < steps).min().unwrap();
            let kept = 64.min(steps + steps / length);
            assert!(steps - oldest <= kept, "{steps} steps, the oldest is {oldest}");
            assert!(found.contains(&(steps - 1)) && found.contains(&(2 * steps - 1)), "the newest");
        }
    }

    #[test]
    fn a_buffer_that_is_too_small_or_too_large_is_refused() {
        assert!(Replay::new(127, &[2, 2], 1, LAGS).is_err());
        assert!(Replay::new(usize::MAX, &[2, 2], 1, LAGS).is_err());
        let error = Replay::new(1 << 32, &[1 << 40], 1, LAGS).unwrap_err().to_string();
        assert!(error.contains("4294967296"), "{error}");
        assert_eq!(bytes(1000, &[10, 20], 5), 500 * (4 * 17 + 1 + 4 * 27 + 1));
    }
}
