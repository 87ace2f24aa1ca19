//! Watching episodes while they are played, without holding them up.
//!
//! The threads that play only copy the state of a body into a channel of bounded length; where it is full, the frame is
//! dropped and counted. One more thread takes the frames out, poses puppets of its own and tells the viewer, as slowly as
//! it must. Of all the bodies that play at once only a few have a seat on the stage, and none is shown more often than a
//! viewer can draw.

use std::collections::BTreeMap;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use crate::record::scene::{SceneError, Viewer};
use crate::sim::bodies::Bodies;
use crate::sim::environment::Environment;
use crate::sim::puppet::Snapshot;
use crate::sim::rollout::EpisodeSpec;
use crate::sim::tasks::Definition;
use crate::sim::watching::{Stepped, Watcher};

use super::stagehand::Stagehand;

/// Bodies that are shown at once.
const SEATS: usize = 2;
/// Frames that may wait for the viewer.
const WAITING: usize = 256;
/// Time between two frames of one body that are shown.
const BETWEEN_FRAMES: Duration = Duration::from_millis(16);
/// How long the end waits for the viewer.
const PATIENCE: Duration = Duration::from_secs(30);

/// How much was seen.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Seen {
    pub episodes: usize,
    /// Frames that reached the viewer's thread.
    pub shown: usize,
    /// Frames that were due and found it busy.
    pub dropped: usize,
    /// Steps between two frames.
    pub passed_over: usize,
}

/// Everyone who plays is watched through this.
pub struct Audience {
    /// Taken away at the end, which tells the other thread to end.
    news: Mutex<Option<SyncSender<News>>>,
    seats: Mutex<Seats>,
    counts: Arc<Counts>,
    thread: Mutex<Option<JoinHandle<Result<(), SceneError>>>>,
    finished: Mutex<Receiver<()>>,
}

#[derive(Debug, Default)]
struct Counts {
    episodes: AtomicUsize,
    shown: AtomicUsize,
    dropped: AtomicUsize,
    passed_over: AtomicUsize,
}

#[derive(Default)]
struct Seats {
    /// When each was last shown.
    taken: BTreeMap<Seat, Instant>,
    /// Episodes whose end found the channel full: nobody sits down before it is told, so that puppets do not pile up.
    untold: Vec<Seat>,
}

/// Which episode of which list.
pub(super) type Seat = (usize, usize);

/// What goes to the other thread.
pub(super) enum News {
    Begins { seat: Seat, title: Title, state: Box<Snapshot> },
    Frame { seat: Seat, moment: Box<Moment> },
    Ends { seat: Seat },
}

/// What an episode is called.
pub(super) struct Title {
    pub(super) task: &'static Definition,
    pub(super) episode: usize,
    pub(super) components: Vec<&'static str>,
}

/// A step as it happened.
pub(super) struct Moment {
    pub(super) step: usize,
    pub(super) state: Snapshot,
    pub(super) chosen: Vec<f32>,
    pub(super) action: Vec<f32>,
    pub(super) reward: Vec<f64>,
    pub(super) touch: Vec<f64>,
    pub(super) solved: bool,
}

impl Audience {
    /// An audience that looks at puppets of `bodies` through `viewer`.
    #[must_use]
    pub fn new(viewer: Viewer, bodies: Arc<Bodies>, policy: &str) -> Self {
        let (news, read) = sync_channel(WAITING);
        let (done, finished) = sync_channel(1);
        let counts = Arc::new(Counts::default());
        let mut stagehand = Stagehand::new(viewer, bodies, policy);
        let thread = std::thread::spawn(move || {
            let result = stagehand.work(&read);
            // Nobody listens any more once the end has lost its patience.
            let _nobody = done.try_send(());
            result
        });
        Self {
            news: Mutex::new(Some(news)),
            seats: Mutex::default(),
            counts,
            thread: Mutex::new(Some(thread)),
            finished: Mutex::new(finished),
        }
    }

    /// Waits until the viewer has everything, but not for ever; how much was seen.
    pub fn finish(&self) -> Result<Seen, SceneError> {
        drop(locked(&self.news).take());
        let arrived = locked(&self.finished).recv_timeout(PATIENCE).is_ok();
        if let Some(thread) = locked(&self.thread).take().filter(|_| arrived) {
            thread.join().unwrap_or(Ok(()))?;
        }
        let count = |count: &AtomicUsize| count.load(Ordering::Relaxed);
        Ok(Seen {
            episodes: count(&self.counts.episodes),
            shown: count(&self.counts.shown),
            dropped: count(&self.counts.dropped),
            passed_over: count(&self.counts.passed_over),
        })
    }

    /// Sends without waiting; whether it was taken.
    fn send(&self, news: News) -> bool {
        // The lock is held for the time of putting a pointer into a list.
        locked(&self.news).as_ref().is_some_and(|sender| sender.try_send(news).is_ok())
    }
}

impl Watcher for Audience {
    fn begins(&self, job: usize, index: usize, spec: &EpisodeSpec, environment: &Environment) {
        let seat = (job, index);
        let mut seats = locked(&self.seats);
        seats.untold.retain(|&seat| !self.send(News::Ends { seat }));
        if seats.taken.len() + seats.untold.len() >= SEATS {
            return;
        }
        let title = Title {
            task: environment.definition(),
            episode: spec.episode,
            components: environment.task().components().to_vec(),
        };
        let state = Box::new(Snapshot::of(environment.simulation()));
        if self.send(News::Begins { seat, title, state }) {
            seats.taken.insert(seat, Instant::now());
            self.counts.episodes.fetch_add(1, Ordering::Relaxed);
        }
    }

    fn stepped(&self, job: usize, index: usize, environment: &Environment, stepped: &Stepped<'_>) {
        let seat = (job, index);
        let mut seats = locked(&self.seats);
        let Some(last) = seats.taken.get_mut(&seat) else { return };
        let (now, ends) = (Instant::now(), stepped.outcome.ended());
        let due = ends || now.duration_since(*last) >= BETWEEN_FRAMES;
        if due {
            *last = now;
        }
        if ends {
            seats.taken.remove(&seat);
        }
        drop(seats);
        if !due {
            self.counts.passed_over.fetch_add(1, Ordering::Relaxed);
            return;
        }
        let moment = Box::new(Moment {
            step: stepped.step,
            state: Snapshot::of(environment.simulation()),
            chosen: stepped.chosen.to_vec(),
            action: stepped.action.to_vec(),
            reward: environment.components().to_vec(),
            touch: environment.block("feet_contact_force").unwrap_or_default().to_vec(),
            solved: stepped.outcome.solved,
        });
        let taken = self.send(News::Frame { seat, moment });
        let count = if taken { &self.counts.shown } else { &self.counts.dropped };
        count.fetch_add(1, Ordering::Relaxed);
        if ends && !self.send(News::Ends { seat }) {
            locked(&self.seats).untold.push(seat);
        }
    }
}

fn locked<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}
