//! The other side of watching: takes what happened out of the channel, poses puppets, and tells the viewer.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;
use std::sync::mpsc::{Receiver, RecvTimeoutError};
use std::time::{Duration, Instant, SystemTime};

use crate::record::scene::{Broadcast, SceneError, Signal, Viewer};
use crate::sim::bodies::Bodies;
use crate::sim::engine::EngineError;
use crate::sim::puppet::{Puppet, Snapshot};

use super::staging::Staging;
use super::watching::{Moment, News, Seat, Title};

/// Frames are sent together once per this time.
const BETWEEN_LETTERS: Duration = Duration::from_millis(200);

/// Whoever moves the puppets.
pub(super) struct Stagehand {
    viewer: Viewer,
    bodies: Arc<Bodies>,
    policy: String,
    shows: BTreeMap<Seat, Show>,
    /// Tasks whose views are arranged.
    arranged: BTreeSet<&'static str>,
    /// Tells this run's recordings from those of other runs in the same viewer.
    run: String,
}

/// An episode on the stage.
struct Show {
    staging: Staging,
    broadcast: Broadcast,
}

impl Stagehand {
    pub(super) fn new(viewer: Viewer, bodies: Arc<Bodies>, policy: &str) -> Self {
        let since = SystemTime::now().duration_since(SystemTime::UNIX_EPOCH).unwrap_or_default();
        Self {
            viewer,
            bodies,
            policy: policy.to_owned(),
            shows: BTreeMap::new(),
            arranged: BTreeSet::new(),
            run: format!("{} {}", std::process::id(), since.as_nanos()),
        }
    }

    /// Works until nobody sends any more and everything has arrived.
    pub(super) fn work(&mut self, news: &Receiver<News>) -> Result<(), SceneError> {
        let mut sent = Instant::now();
        loop {
            let ended = match news.recv_timeout(BETWEEN_LETTERS) {
                Ok(News::Begins { seat, title, state }) => {
                    // A body that cannot be made cannot play either, which the other side says.
                    if let Ok(show) = self.begin(&title, &state)? {
                        self.shows.insert(seat, show);
                    }
                    false
                }
                Ok(News::Frame { seat, moment }) => {
                    if let Some(show) = self.shows.get_mut(&seat) {
                        show.add(&moment);
                    }
                    false
                }
                Ok(News::Ends { seat }) => {
                    if let Some(mut show) = self.shows.remove(&seat) {
                        show.broadcast.send(&self.viewer)?;
                    }
                    false
                }
                Err(RecvTimeoutError::Timeout) => false,
                Err(RecvTimeoutError::Disconnected) => true,
            };
            if ended || sent.elapsed() >= BETWEEN_LETTERS {
                for show in self.shows.values_mut() {
                    show.broadcast.send(&self.viewer)?;
                }
                sent = Instant::now();
            }
            if ended {
                return self.viewer.finish();
            }
        }
    }

    fn begin(
        &mut self,
        title: &Title,
        state: &Snapshot,
    ) -> Result<Result<Show, EngineError>, SceneError> {
        let task = title.task;
        let puppet = self.bodies.body(task.source, task.model).and_then(|body| {
            let mut puppet = Puppet::new(&body)?;
            puppet.pose(state);
            Ok(puppet)
        });
        let puppet = match puppet {
            Ok(puppet) => puppet,
            Err(error) => return Ok(Err(error)),
        };
        let (mut staging, stage) = Staging::new(puppet);
        let signals = signals(&stage.muscles, &title.components, staging.has_feet());
        let mut broadcast = Broadcast::new(task.name, title.episode as u64, &self.policy, stage)
            .at(task.control_interval(), task.horizon)
            .with(signals);
        let is_new = self.arranged.insert(task.name);
        broadcast.open(&self.viewer, &self.run, is_new)?;
        broadcast.add(staging.frame(0, false), Vec::new());
        Ok(Ok(Show { staging, broadcast }))
    }
}

impl Show {
    fn add(&mut self, moment: &Moment) {
        self.staging.puppet_mut().pose(&moment.state);
        let frame = self.staging.frame(moment.step, moment.solved);
        let wide = |values: &[f32]| values.iter().map(|&value| f64::from(value)).collect();
        let mut values: Vec<Vec<f64>> = vec![
            wide(&frame.activation),
            wide(&moment.chosen),
            wide(&moment.action),
            moment.reward.clone(),
            vec![f64::from(u8::from(moment.solved))],
        ];
        if self.staging.has_feet() {
            values.push(moment.touch.clone());
        }
        self.broadcast.add(frame, values);
    }
}

/// What is shown live, in the order of [`Show::add`].
fn signals(muscles: &[String], components: &[&str], feet: bool) -> Vec<Signal> {
    let signal = |name: &str, title: &str, elements: Vec<String>| Signal {
        name: name.to_owned(),
        title: title.to_owned(),
        elements,
        after_step: true,
        values: Vec::new(),
    };
    let components = components.iter().map(|&name| name.to_owned()).collect();
    let mut signals = vec![
        signal("activation", "Muscle activation", muscles.to_vec()),
        signal("action_before", "Action before projection", muscles.to_vec()),
        signal("action", "Action sent to the body", muscles.to_vec()),
        signal("reward_component", "Reward components", components),
        signal("solved", "Solved", vec![String::new()]),
    ];
    if feet {
        let feet = crate::record::names::FEET.iter().map(|&foot| foot.to_owned()).collect();
        signals.push(signal("foot_contact", "Touch forces (N)", feet));
    }
    signals
}
