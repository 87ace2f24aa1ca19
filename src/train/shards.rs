//! A minibatch in parts whose number and order have nothing to do with threads.
//!
//! Floating-point sums depend on their order. So a minibatch is always cut into the same shards; each is summed on its own,
//! by whichever thread is free, and the shards' sums are added one after the other in their order. A thread that is done
//! early waits for its turn; shards are alike, so it hardly ever does. Memory: one row per thread and one for the sum.

use std::ops::Range;
use std::sync::{Condvar, Mutex, PoisonError};

/// Shards of a minibatch, at most.
const SHARDS: usize = 16;

/// Rows that a product of dense layers needs to be worth its while.
const SMALLEST_DENSE: usize = 16;
/// The same for networks of many parameters: there the sums of a shard are most of the work, not its products.
const SMALLEST_DENSE_OF_MANY: usize = 64;
/// Parameters from which on they are.
const MANY_PARAMETERS: usize = 1 << 20;

/// Fewest samples in a shard of dense layers with so many parameters.
#[must_use]
pub fn smallest_of_dense(parameters: usize) -> usize {
    if parameters < MANY_PARAMETERS { SMALLEST_DENSE } else { SMALLEST_DENSE_OF_MANY }
}

/// What a shard shows beside its derivatives, added up in the order of shards.
pub trait Sum: Default + Send {
    fn add(&mut self, other: &Self);
}

/// The samples of each shard, for a minibatch of `samples` cut into parts of at least `smallest`.
#[must_use]
pub fn shards(samples: usize, smallest: usize) -> Vec<Range<usize>> {
    let length = samples.div_ceil(SHARDS).max(smallest).max(1);
    (0..samples).step_by(length).map(|start| start..(start + length).min(samples)).collect()
}

/// What has been added up, and how many shards it holds.
struct Total<'a, L> {
    row: &'a mut [f32],
    losses: L,
    next: usize,
    /// A thread has panicked: its shard will never come, and nobody may wait for it.
    abandoned: bool,
}

/// Tells the other threads when its own unwinds.
struct Watch<'a, 'b, L> {
    sum: &'a Mutex<Total<'b, L>>,
    turn: &'a Condvar,
}

impl<L> Drop for Watch<'_, '_, L> {
    fn drop(&mut self) {
        if std::thread::panicking() {
            self.sum.lock().unwrap_or_else(PoisonError::into_inner).abandoned = true;
            self.turn.notify_all();
        }
    }
}

/// Adds up what `work` sums for every shard. `work` gets memory that `memory` made for its thread, a shard, and a row of
/// zeros as long as `sum`, which it adds to.
pub fn sum_over_shards<M, L: Sum>(
    shards: &[Range<usize>],
    threads: usize,
    sum: &mut [f32],
    memory: impl Fn() -> M + Sync,
    work: impl Fn(&mut M, Range<usize>, &mut [f32]) -> L + Sync,
) -> L {
    sum.fill(0.0);
    let length = sum.len();
    let shared = Mutex::new(Total { row: sum, losses: L::default(), next: 0, abandoned: false });
    let turn = Condvar::new();
    let next = std::sync::atomic::AtomicUsize::new(0);
    let run = || {
        let _watch = Watch { sum: &shared, turn: &turn };
        let mut memory = memory();
        let mut row = vec![0.0; length];
        loop {
            let index = next.fetch_add(1, std::sync::atomic::Ordering::Relaxed);
            let Some(shard) = shards.get(index) else { break };
            row.fill(0.0);
            let losses = work(&mut memory, shard.clone(), &mut row);
            let guard = shared.lock().unwrap_or_else(PoisonError::into_inner);
            let mut guard = turn
                .wait_while(guard, |sum| sum.next != index && !sum.abandoned)
                .unwrap_or_else(PoisonError::into_inner);
            guard.row.iter_mut().zip(&row).for_each(|(sum, x)| *sum += x);
            guard.losses.add(&losses);
            guard.next += 1;
            turn.notify_all();
        }
    };
    let threads = threads.clamp(1, shards.len().max(1));
    std::thread::scope(|scope| {
        for _ in 1..threads {
            scope.spawn(run);
        }
        run();
    });
    shared.into_inner().unwrap_or_else(PoisonError::into_inner).losses
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::train::Losses;

    #[test]
    fn shards_cover_every_sample_once_and_are_not_too_small() {
        for samples in [0, 1, 15, 16, 17, 128, 130, 2048] {
            for smallest in [1, 16] {
                let shards = shards(samples, smallest);
                assert!(shards.len() <= SHARDS);
                let all: Vec<usize> = shards.iter().cloned().flatten().collect();
                assert!(all.iter().copied().eq(0..samples));
                assert!(shards.iter().rev().skip(1).all(|shard| shard.len() >= smallest));
            }
        }
    }

    #[test]
    fn sums_are_the_same_for_any_number_of_threads() {
        let numbers: Vec<f32> = (0..4000).map(|i| (i as f32 * 0.7).sin()).collect();
        let sum = |threads| {
            let mut sum = [0.0];
            let work = |(): &mut (), shard: Range<usize>, row: &mut [f32]| {
                shard.for_each(|i| row[0] += numbers[i]);
                Losses { total: 0.1, ..Losses::default() }
            };
            let losses = sum_over_shards(&shards(numbers.len(), 1), threads, &mut sum, || (), work);
            (sum[0].to_bits(), losses.total.to_bits())
        };
        let one = sum(1);
        assert!([2, 3, 40].into_iter().all(|threads| sum(threads) == one));
    }

    #[test]
    fn a_panic_in_one_shard_ends_all_threads() {
        let work = |(): &mut (), shard: Range<usize>, _: &mut [f32]| {
            assert!(shard.start != 3, "as it should");
            Losses::default()
        };
        let run = || sum_over_shards(&shards(16, 1), 4, &mut [0.0], || (), work);
        assert!(std::panic::catch_unwind(run).is_err());
    }
}
