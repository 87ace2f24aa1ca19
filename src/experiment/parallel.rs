//! Independent pieces of work on several threads, their results in order.

use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Mutex, PoisonError};

/// What `work` makes of 0 … `count` − 1, in that order, on up to `threads` threads. If some fail, the error is that of the
/// first of them, whatever thread was faster.
pub(super) fn in_order<T: Send, E: Send>(
    threads: usize,
    count: usize,
    work: &(dyn Fn(usize) -> Result<T, E> + Sync),
) -> Result<Vec<T>, E> {
    let next = AtomicUsize::new(0);
    let finished = Mutex::new(Vec::with_capacity(count));
    let run = || {
        loop {
            let index = next.fetch_add(1, Ordering::Relaxed);
            if index >= count {
                return;
            }
            let made = work(index);
            finished.lock().unwrap_or_else(PoisonError::into_inner).push((index, made));
        }
    };
    std::thread::scope(|scope| {
        for _ in 0..threads.clamp(1, count.max(1)) {
            scope.spawn(run);
        }
    });
    let mut finished = finished.into_inner().unwrap_or_else(PoisonError::into_inner);
    finished.sort_unstable_by_key(|(index, _)| *index);
    finished.into_iter().map(|(_, made)| made).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn results_come_in_order_and_the_first_error_counts() {
        for threads in [0, 1, 3, 99] {
            let squares = in_order(threads, 20, &|i| Ok::<_, ()>(i * i)).unwrap();
            assert!(squares.into_iter().eq((0..20).map(|i| i * i)));
            let odd = in_order(threads, 20, &|i| if i % 2 == 1 { Err(i) } else { Ok(i) });
            assert_eq!(odd, Err(1));
        }
        assert_eq!(in_order(4, 0, &|_| Ok::<(), ()>(())), Ok(Vec::new()));
    }
}
