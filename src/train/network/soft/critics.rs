//! The two critics over the rows of a shard. They see state and action side by side.

use std::ops::Range;

use super::actor::ActorMemory;
use super::{Judge, SoftActorCritic, SoftLosses, Transitions};
use crate::train::network::dense::StackMemory;

/// One thread's memory for a shard.
pub(super) struct CriticMemory {
    /// States and actions.
    x: Vec<f32>,
    hidden: [StackMemory; 2],
    values: [Vec<f32>; 2],
    slopes: Vec<f32>,
    latent_slopes: Vec<f32>,
    /// The smaller judgement, or what a next state is worth.
    pub(super) worth: Vec<f32>,
    /// Derivatives of the smaller judgement by the action.
    pub(super) action_slopes: Vec<f32>,
    other_slopes: Vec<f32>,
}

/// The rows `shard` of a matrix.
pub(super) fn rows_of<'a>(matrix: &'a [f32], shard: &Range<usize>, width: usize) -> &'a [f32] {
    &matrix[shard.start * width..shard.end * width]
}

impl SoftActorCritic {
    pub(super) fn critic_memory(&self, rows: usize) -> CriticMemory {
        let (seen, actions) = (self.settings.input.width(), self.settings.actions);
        let [first, second] = &self.judges;
        CriticMemory {
            x: vec![0.0; rows * (seen + actions)],
            hidden: [first.hidden.memory(rows), second.hidden.memory(rows)],
            values: [vec![0.0; rows], vec![0.0; rows]],
            slopes: vec![0.0; rows],
            latent_slopes: vec![0.0; rows * first.head.inputs],
            worth: vec![0.0; rows],
            action_slopes: vec![0.0; rows * actions],
            other_slopes: vec![0.0; rows * actions],
        }
    }

    /// Both judgements of `actions` in `states`, by the critics or, with `targets`, by their targets.
    fn judge(&self, states: &[f32], actions: &[f32], targets: bool, memory: &mut CriticMemory) {
        let (seen, width) = (self.settings.input.width(), self.settings.actions);
        let rows = actions.len() / width;
        let sides = states.chunks_exact(seen).zip(actions.chunks_exact(width));
        for (row, (state, action)) in memory.x.chunks_exact_mut(seen + width).zip(sides) {
            row[..seen].copy_from_slice(state);
            row[seen..].copy_from_slice(action);
        }
        let numbers = if targets { &self.targets } else { self.critics.numbers() };
        let x = &memory.x[..rows * (seen + width)];
        for ((judge, hidden), values) in
            self.judges.iter().zip(&mut memory.hidden).zip(&mut memory.values)
        {
            let latent = judge.hidden.forward(numbers, x, rows, hidden);
            judge.head.forward(numbers, latent, &mut values[..rows]);
        }
    }

    /// The smaller judgement of each row, for the player.
    pub(super) fn worth<'a>(
        &self,
        states: &[f32],
        actions: &[f32],
        memory: &'a mut CriticMemory,
    ) -> &'a [f32] {
        let rows = actions.len() / self.settings.actions;
        self.judge(states, actions, false, memory);
        smaller(memory, rows);
        &memory.worth[..rows]
    }

    /// Adds the derivatives of the critics' loss for the rows `shard`.
    pub(super) fn pull_critics(
        &self,
        batch: &Transitions,
        shard: Range<usize>,
        temperature: f64,
        discount: f64,
        (actor, memory): (&mut ActorMemory, &mut CriticMemory),
        gradient: &mut [f32],
    ) -> SoftLosses {
        let (seen, width, rows) = (self.settings.input.width(), self.settings.actions, shard.len());
        let next_states = rows_of(&batch.next_states, &shard, seen);
        self.act(next_states, rows_of(&batch.next_noise, &shard, width), rows, actor);
        self.judge(next_states, &actor.actions[..rows * width], true, memory);
        smaller(memory, rows);
        for (row, sample) in shard.clone().enumerate() {
            let soft = f64::from(memory.worth[row]) - temperature * actor.log_probabilities[row];
            let later = discount * f64::from(batch.goes_on[sample]) * soft;
            memory.worth[row] = (f64::from(batch.rewards[sample]) + later) as f32;
        }
        let states = rows_of(&batch.states, &shard, seen);
        self.judge(states, rows_of(&batch.actions, &shard, width), false, memory);
        let share = 1.0 / batch.len() as f64;
        let numbers = self.critics.numbers();
        let CriticMemory { x, hidden, values, slopes, latent_slopes, worth, .. } = memory;
        let x = &x[..rows * (seen + width)];
        let mut losses = SoftLosses::default();
        for ((Judge { hidden: stack, head }, kept), values) in
            self.judges.iter().zip(hidden).zip(values)
        {
            for ((slope, &value), &wanted) in slopes.iter_mut().zip(&values[..rows]).zip(&*worth) {
                let error = f64::from(value) - f64::from(wanted);
                losses.critic += 0.5 * share * error * error;
                *slope = (share * error) as f32;
            }
            let slopes = &slopes[..rows];
            head.pull_weight(kept.latent(x, rows, stack), slopes, gradient);
            let latent_slopes = &mut latent_slopes[..rows * head.inputs];
            head.pull_input(numbers, slopes, latent_slopes);
            stack.backward(numbers, x, rows, latent_slopes, kept, gradient);
        }
        losses
    }

    /// Leaves the smaller judgement of each row in `worth`, and its derivatives by the action in `action_slopes`.
    pub(super) fn judge_and_pull(
        &self,
        states: &[f32],
        actions: &[f32],
        memory: &mut CriticMemory,
    ) {
        let (seen, width) = (self.settings.input.width(), self.settings.actions);
        let rows = actions.len() / width;
        self.judge(states, actions, false, memory);
        smaller(memory, rows);
        let numbers = self.critics.numbers();
        let CriticMemory { hidden, values, slopes, latent_slopes, .. } = memory;
        let (action_slopes, other_slopes) =
            (&mut memory.action_slopes[..rows * width], &mut memory.other_slopes[..rows * width]);
        action_slopes.fill(0.0);
        for (k, (Judge { hidden: stack, head }, kept)) in self.judges.iter().zip(hidden).enumerate()
        {
            let (own, other) = (&values[k], &values[1 - k]);
            for row in 0..rows {
                // Where both say the same, the first one counts.
                let is_smaller =
                    if k == 0 { own[row] <= other[row] } else { own[row] < other[row] };
                slopes[row] = if is_smaller { 1.0 } else { 0.0 };
            }
            let latent_slopes = &mut latent_slopes[..rows * head.inputs];
            head.pull_input(numbers, &slopes[..rows], latent_slopes);
            let first = stack.first_slopes(numbers, rows, latent_slopes, kept);
            stack.layers[0].pull_columns(numbers, first, seen..seen + width, other_slopes);
            action_slopes.iter_mut().zip(&*other_slopes).for_each(|(a, b)| *a += b);
        }
    }
}

/// Writes the smaller of both judgements of each row.
fn smaller(memory: &mut CriticMemory, rows: usize) {
    let [first, second] = &memory.values;
    for ((worth, &a), &b) in memory.worth[..rows].iter_mut().zip(first).zip(second) {
        // A NaN is kept, and found where the gradient is looked at.
        *worth = if b < a { b } else { a };
    }
}
