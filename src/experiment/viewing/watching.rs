//! Watching episodes while they are played, without holding them up.
//!
//! The threads that play only copy the state of a body into a channel of bounded length (see `usher`). One more thread takes
//! the frames out, poses puppets of its own and tells the viewer, as slowly as it must.

use std::sync::mpsc::{Receiver, sync_channel};
use std::sync::{Arc, Mutex};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use crate::record::scene::{SceneError, Viewer};
use crate::sim::bodies::Bodies;
use crate::sim::environment::Environment;
use crate::sim::puppet::Snapshot;
use crate::sim::recording::{ChannelNames, names_of};
use crate::sim::rollout::EpisodeSpec;
use crate::sim::tasks::{Definition, Target};
use crate::sim::watching::{Stepped, Watcher};

use super::gait::Walked;
use super::stagehand::Stagehand;
use super::staging::Aim;
use super::told::Told;
use super::usher::{Usher, locked};

/// Frames that may wait for the viewer.
const WAITING: usize = 256;
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
    usher: Usher,
    thread: Mutex<Option<JoinHandle<Result<(), SceneError>>>>,
    finished: Mutex<Receiver<()>>,
}

/// Which episode of which list.
pub(super) type Seat = (usize, usize);

/// What goes to the other thread.
pub(super) enum News {
    Begins {
        seat: Seat,
        title: Box<Title>,
    },
    Frame {
        seat: Seat,
        moment: Box<Moment>,
    },
    /// `told` is what no frame brought along.
    Ends {
        seat: Seat,
        told: Box<Told>,
    },
}

/// An episode as it begins.
pub(super) struct Title {
    pub(super) task: &'static Definition,
    pub(super) episode: usize,
    /// Components that the policy is confined to.
    pub(super) components: Option<usize>,
    pub(super) names: ChannelNames,
    pub(super) state: Snapshot,
    pub(super) aim: Aim,
    pub(super) walked: Walked,
}

/// A step as it happened.
pub(super) struct Moment {
    pub(super) step: usize,
    pub(super) state: Snapshot,
    pub(super) solved: bool,
    pub(super) targets: Vec<Target>,
    /// This step and those since the frame before.
    pub(super) told: Told,
}

impl Audience {
    /// An audience that looks at puppets of `bodies` through `viewer`.
    #[must_use]
    pub fn new(viewer: Viewer, bodies: Arc<Bodies>, policy: &str) -> Self {
        let (news, read) = sync_channel(WAITING);
        let (done, finished) = sync_channel(1);
        let mut stagehand = Stagehand::new(viewer, bodies, policy);
        let thread = std::thread::spawn(move || {
            let result = stagehand.work(&read);
            // Nobody listens any more once the end has lost its patience.
            let _nobody = done.try_send(());
            result
        });
        Self {
            usher: Usher::new(news),
            thread: Mutex::new(Some(thread)),
            finished: Mutex::new(finished),
        }
    }

    /// Waits until the viewer has everything, but not for ever; how much was seen.
    pub fn finish(&self) -> Result<Seen, SceneError> {
        self.usher.close();
        let arrived = locked(&self.finished).recv_timeout(PATIENCE).is_ok();
        if let Some(thread) = locked(&self.thread).take().filter(|_| arrived) {
            thread.join().unwrap_or(Ok(()))?;
        }
        Ok(self.usher.seen())
    }
}

impl Watcher for Audience {
    fn begins(
        &self,
        job: usize,
        index: usize,
        spec: &EpisodeSpec,
        components: Option<usize>,
        environment: &Environment,
    ) {
        self.usher.begins((job, index), Instant::now(), || {
            let mut walked = Walked::default();
            walked.feel(environment);
            Title {
                task: environment.definition(),
                episode: spec.episode,
                components,
                names: names_of(environment),
                state: Snapshot::of(environment.simulation()),
                aim: Aim::of(environment),
                walked,
            }
        });
    }

    fn stepped(&self, job: usize, index: usize, environment: &Environment, stepped: &Stepped<'_>) {
        let take_in = |told: &mut Told| told.take_in(environment, stepped);
        let ends = stepped.outcome.ended();
        self.usher.stepped((job, index), Instant::now(), ends, take_in, |told| Moment {
            step: stepped.step,
            state: Snapshot::of(environment.simulation()),
            solved: stepped.outcome.solved,
            targets: environment.task().targets(),
            told,
        });
    }
}
