//! Who is watched, and the channel on which the watched are told about: nobody who plays ever waits for it.
//!
//! Of all the bodies that play at once only a few have a seat on the stage, and none is shown more often than a viewer can
//! draw. Where the channel is full, a frame is dropped and counted, and its numbers go along with the next; the end of an
//! episode is kept and told later.

use std::collections::BTreeMap;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::mpsc::{SyncSender, TrySendError};
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use super::told::Told;
use super::watching::{Moment, News, Seat, Seen, Title};

/// Bodies that are shown at once.
const SEATS: usize = 2;
/// Time between two frames of one body that are shown.
const BETWEEN_FRAMES: Duration = Duration::from_millis(16);

/// Gives out the seats.
pub(super) struct Usher {
    /// Taken away at the end, which tells the other thread to end.
    news: Mutex<Option<SyncSender<News>>>,
    seats: Mutex<Seats>,
    episodes: AtomicUsize,
    shown: AtomicUsize,
    dropped: AtomicUsize,
    passed_over: AtomicUsize,
}

#[derive(Default)]
struct Seats {
    taken: BTreeMap<Seat, Sitting>,
    /// Ends of episodes that found the channel full: nobody sits down before they are told, so that puppets do not pile up.
    untold: Vec<News>,
}

struct Sitting {
    last_shown: Instant,
    /// The steps since the last frame that was taken.
    told: Told,
}

impl Usher {
    pub(super) fn new(news: SyncSender<News>) -> Self {
        Self {
            news: Mutex::new(Some(news)),
            seats: Mutex::default(),
            episodes: AtomicUsize::default(),
            shown: AtomicUsize::default(),
            dropped: AtomicUsize::default(),
            passed_over: AtomicUsize::default(),
        }
    }

    /// Gives `seat` to the episode that `title` tells of, if one is free.
    pub(super) fn begins(&self, seat: Seat, now: Instant, title: impl FnOnce() -> Title) {
        let mut seats = locked(&self.seats);
        let untold = std::mem::take(&mut seats.untold);
        seats.untold = untold.into_iter().filter_map(|end| self.send(end).err()).collect();
        if seats.taken.len() + seats.untold.len() >= SEATS {
            return;
        }
        let title = Box::new(title());
        if self.send(News::Begins { seat, title }).is_ok() {
            seats.taken.insert(seat, Sitting { last_shown: now, told: Told::default() });
            count(&self.episodes);
        }
    }

    /// A step of whoever has `seat` was made: `take_in` its numbers, and show a frame if one is due, which it is at the end
    /// in any case.
    pub(super) fn stepped(
        &self,
        seat: Seat,
        now: Instant,
        ends: bool,
        take_in: impl FnOnce(&mut Told),
        moment: impl FnOnce(Told) -> Moment,
    ) {
        let mut seats = locked(&self.seats);
        let Some(sitting) = seats.taken.get_mut(&seat) else { return };
        take_in(&mut sitting.told);
        let due = ends || now.duration_since(sitting.last_shown) >= BETWEEN_FRAMES;
        if !due {
            count(&self.passed_over);
            return;
        }
        sitting.last_shown = now;
        let told = std::mem::take(&mut sitting.told);
        if ends {
            seats.taken.remove(&seat);
        }
        drop(seats);
        let mut left = Box::<Told>::default();
        match self.send(News::Frame { seat, moment: Box::new(moment(told)) }) {
            Ok(()) => count(&self.shown),
            Err(refused) => {
                count(&self.dropped);
                // Its numbers go along with the next frame, or the end. Nobody else steps this body meanwhile.
                if let News::Frame { moment, .. } = refused {
                    match locked(&self.seats).taken.get_mut(&seat) {
                        Some(sitting) => sitting.told = moment.told,
                        None => *left = moment.told,
                    }
                }
            }
        }
        if ends && let Err(end) = self.send(News::Ends { seat, told: left }) {
            locked(&self.seats).untold.push(end);
        }
    }

    /// No more news.
    pub(super) fn close(&self) {
        drop(locked(&self.news).take());
    }

    /// How much was seen so far.
    pub(super) fn seen(&self) -> Seen {
        Seen {
            episodes: self.episodes.load(Ordering::Relaxed),
            shown: self.shown.load(Ordering::Relaxed),
            dropped: self.dropped.load(Ordering::Relaxed),
            passed_over: self.passed_over.load(Ordering::Relaxed),
        }
    }

    /// Sends without waiting, or gives back what was not taken.
    fn send(&self, news: News) -> Result<(), News> {
        // The lock is held for the time of putting a pointer into a list.
        match locked(&self.news).as_ref() {
            Some(sender) => sender.try_send(news).map_err(|error| match error {
                TrySendError::Full(news) | TrySendError::Disconnected(news) => news,
            }),
            None => Err(news),
        }
    }
}

fn count(counter: &AtomicUsize) {
    counter.fetch_add(1, Ordering::Relaxed);
}

pub(super) fn locked<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

#[cfg(test)]
mod tests {
    use std::sync::mpsc::{Receiver, sync_channel};

    use super::*;
    use crate::experiment::viewing::gait::Walked;
    use crate::experiment::viewing::staging::Aim;
    use crate::sim::puppet::Snapshot;
    use crate::sim::recording::ChannelNames;
    use crate::sim::tasks;

    const ROOM: usize = 4;

    fn title() -> Title {
        let (muscles, joints, reward_components) = Default::default();
        Title {
            task: tasks::find("kinesis").unwrap(),
            episode: 0,
            components: None,
            names: ChannelNames { muscles, joints, reward_components, walking: true },
            state: Snapshot::default(),
            aim: Aim::default(),
            walked: Walked::default(),
        }
    }

    /// Makes the step `number` of the episode in `seat`, late enough to be shown.
    fn step(usher: &Usher, start: Instant, seat: Seat, number: usize, ends: bool) {
        let now = start + BETWEEN_FRAMES * number as u32;
        let take_in = |told: &mut Told| told.steps.push(number);
        usher.stepped(seat, now, ends, take_in, |told| Moment {
            step: number,
            state: Snapshot::default(),
            solved: false,
            targets: Vec::new(),
            told,
        });
    }

    /// What a viewer that wakes up at last finds: a beginning, frames and an end, each with the number of its episode.
    fn told(news: &Receiver<News>) -> Vec<(&'static str, usize)> {
        let letter = |news| match news {
            News::Begins { seat, .. } => ("begins", seat.1),
            News::Frame { seat, .. } => ("frame", seat.1),
            News::Ends { seat, .. } => ("ends", seat.1),
        };
        news.try_iter().map(letter).collect()
    }

    #[test]
    fn a_viewer_that_takes_nothing_holds_nobody_up_and_hears_of_the_end_when_it_wakes() {
        let (sender, news) = sync_channel(ROOM);
        let (done, finished) = sync_channel(1);
        let start = Instant::now();
        // On a thread of its own, so that waiting fails the test instead of stopping it.
        std::thread::spawn(move || {
            let usher = Usher::new(sender);
            usher.begins((0, 0), start, title);
            (1..100).for_each(|number| step(&usher, start, (0, 0), number, false));
            step(&usher, start, (0, 0), 100, true);
            done.send(usher).unwrap();
        });
        let usher = finished.recv_timeout(Duration::from_mins(1)).unwrap();
        // One place of the channel went to the beginning; of 100 frames the others had three.
        assert_eq!(usher.seen(), Seen { episodes: 1, shown: 3, dropped: 97, passed_over: 0 });
        usher.begins((0, 1), start, title);
        assert_eq!(usher.seen().episodes, 1, "nobody sits down while an end is not told");
        assert_eq!(told(&news), [("begins", 0), ("frame", 0), ("frame", 0), ("frame", 0)]);
        usher.begins((0, 2), start, title);
        let Ok(News::Ends { told: left, .. }) = news.try_recv() else { panic!("no end") };
        assert!(left.steps.iter().copied().eq(4..=100), "{:?}", left.steps);
        assert_eq!(told(&news), [("begins", 2)]);
        usher.close();
        assert!(news.recv().is_err(), "the end of everything needs no room");
    }

    #[test]
    fn the_numbers_of_frames_that_were_dropped_or_passed_over_come_with_the_next() {
        let (sender, news) = sync_channel(1);
        let (usher, start) = (Usher::new(sender), Instant::now());
        usher.begins((0, 7), start, title);
        (1..6).for_each(|number| step(&usher, start, (0, 7), number, false));
        assert_eq!(told(&news), [("begins", 7)]);
        let too_soon = start + BETWEEN_FRAMES * 5 + BETWEEN_FRAMES / 2;
        let take_in = |told: &mut Told| told.steps.push(6);
        usher.stepped((0, 7), too_soon, false, take_in, |_| unreachable!("it is not due"));
        step(&usher, start, (0, 7), 7, false);
        let Ok(News::Frame { moment, .. }) = news.try_recv() else { panic!("no frame") };
        assert_eq!(moment.told.steps, [1, 2, 3, 4, 5, 6, 7]);
        assert_eq!(usher.seen(), Seen { episodes: 1, shown: 1, dropped: 5, passed_over: 1 });
    }

    #[test]
    fn two_are_watched_and_the_others_are_not() {
        let (sender, news) = sync_channel(ROOM);
        let (usher, start) = (Usher::new(sender), Instant::now());
        (0..3).for_each(|episode| usher.begins((0, episode), start, title));
        step(&usher, start, (0, 2), 1, false);
        assert_eq!(told(&news), [("begins", 0), ("begins", 1)]);
        step(&usher, start, (0, 0), 1, true);
        usher.begins((0, 3), start, title);
        assert_eq!(told(&news), [("frame", 0), ("ends", 0), ("begins", 3)]);
    }
}
