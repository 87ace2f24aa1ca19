//! The other side of watching: takes what happened out of the channel, poses puppets, and tells the viewer.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;
use std::sync::mpsc::{Receiver, RecvTimeoutError};
use std::time::{Duration, Instant, SystemTime};

use crate::record::names;
use crate::record::scene::{Broadcast, Scale, SceneError, Signal, Viewer};
use crate::sim::bodies::Bodies;
use crate::sim::engine::{EngineError, Names};
use crate::sim::puppet::Puppet;
use crate::sim::recording::ChannelNames;
use crate::units::Seconds;

use super::gait::Walked;
use super::signals::{gait_phase, with_units};
use super::staging::Staging;
use super::told::Told;
use super::watching::{Moment, News, Seat, Title};

/// Frames are sent together once per this time.
const BETWEEN_LETTERS: Duration = Duration::from_millis(200);
/// What is shown live and has no channel of its own in a recording: the action with its noise, before any projection.
const CHOSEN: &str = "action_before";

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
                Ok(News::Begins { seat, title }) => {
                    // A body that cannot be made cannot play either, which the other side says.
                    if let Ok(show) = self.begin(&title)? {
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
                Ok(News::Ends { seat, told }) => {
                    if let Some(mut show) = self.shows.remove(&seat) {
                        show.tell(&told);
                        show.tell_gait(true);
                        show.broadcast.send(&self.viewer)?;
                    }
                    false
                }
                Err(RecvTimeoutError::Timeout) => false,
                Err(RecvTimeoutError::Disconnected) => true,
            };
            if ended || sent.elapsed() >= BETWEEN_LETTERS {
                for show in self.shows.values_mut() {
                    show.tell_gait(ended);
                    show.broadcast.send(&self.viewer)?;
                }
                sent = Instant::now();
            }
            if ended {
                return self.viewer.finish();
            }
        }
    }

    fn begin(&mut self, title: &Title) -> Result<Result<Show, EngineError>, SceneError> {
        let task = title.task;
        let puppet = self.bodies.body(task.source, task.model).and_then(|body| {
            let mut puppet = Puppet::new(&body)?;
            puppet.pose(&title.state);
            let joints = title.names.joints.iter();
            let places = joints
                .map(|joint| Ok(body.joint_qpos_address(body.find(Names::Joint, &joint.name)?)))
                .collect::<Result<Vec<usize>, EngineError>>()?;
            Ok((puppet, places))
        });
        let (puppet, joints) = match puppet {
            Ok(found) => found,
            Err(error) => return Ok(Err(error)),
        };
        let (mut staging, stage) = Staging::new(puppet, &title.aim);
        let condition = match title.components {
            Some(1) => "1 component".to_owned(),
            Some(components) => format!("{components} components"),
            None => String::new(),
        };
        let mut broadcast = Broadcast::new(task.name, title.episode as u64, &self.policy, stage)
            .under(&condition)
            .at(task.control_interval(), task.horizon)
            .with(signals(&title.names));
        let is_new = self.arranged.insert(task.name);
        broadcast.open(&self.viewer, &self.run, is_new)?;
        let start = staging.frame(0, false, &title.aim.targets);
        broadcast.paint(0, &start.activation);
        broadcast.add(start);
        let interval = task.control_interval();
        let mut show =
            Show { staging, broadcast, joints, interval, walked: Walked::default(), told: 0 };
        let positions = show.staging.puppet_mut().body().qpos().to_vec();
        show.tell_joints(0, &positions);
        show.walk(&title.walked);
        Ok(Ok(show))
    }
}

/// An episode on the stage.
struct Show {
    staging: Staging,
    broadcast: Broadcast,
    /// Places of the shown joints among the body's positions.
    joints: Vec<usize>,
    interval: Seconds,
    /// What was felt so far.
    walked: Walked,
    /// Steps whose gait phases were told.
    told: usize,
}

impl Show {
    fn add(&mut self, moment: &Moment) {
        self.staging.puppet_mut().pose(&moment.state);
        self.broadcast.add(self.staging.frame(moment.step, moment.solved, &moment.targets));
        self.tell(&moment.told);
    }

    /// Tells the numbers of steps, of which there may be more than are shown.
    fn tell(&mut self, told: &Told) {
        let wide = |&value: &f32| f64::from(value);
        for (place, &step) in told.steps.iter().enumerate() {
            let activation = told.row(&told.activation, place);
            self.broadcast.paint(step, activation);
            self.broadcast.tell(names::ACTIVATION, step, activation.iter().map(wide));
            let chosen = told.row(&told.chosen, place);
            self.broadcast.tell(CHOSEN, step, chosen.iter().map(wide));
            let action = told.row(&told.action, place);
            self.broadcast.tell(names::ACTION, step, action.iter().map(wide));
            self.tell_joints(step, told.row(&told.positions, place));
            let components = told.row(&told.reward_components, place);
            self.broadcast.tell(names::REWARD_COMPONENT, step, components.iter().copied());
            self.broadcast.tell(names::REWARD, step, [told.reward[place]]);
            let solved = f64::from(u8::from(told.solved[place]));
            self.broadcast.tell(names::SOLVED, step, [solved]);
        }
        self.walk(&told.walked);
    }

    fn tell_joints(&mut self, step: usize, positions: &[f64]) {
        let joints = self.joints.iter().map(|&place| positions[place]);
        self.broadcast.tell(names::JOINT, step, joints);
    }

    /// Takes in what was felt at the next steps.
    fn walk(&mut self, walked: &Walked) {
        let touches = walked.contacts.chunks_exact(names::FEET.len());
        let speeds = walked.velocity.chunks_exact(names::HEADING_AXES.len());
        for (later, (touch, speed)) in touches.zip(speeds).enumerate() {
            let step = self.walked.len() + later;
            self.broadcast.tell(names::FOOT_CONTACT, step, touch.iter().copied());
            self.broadcast.tell(names::ROOT_VELOCITY, step, speed.iter().copied());
        }
        self.walked.append(walked);
    }

    /// Tells the gait phases that are certain by now; at the end all of them.
    fn tell_gait(&mut self, ends: bool) {
        if self.walked.is_empty() {
            return;
        }
        let Some(phases) = self.walked.phases(self.interval) else { return };
        let until = if ends { self.walked.len() } else { phases.settled };
        for step in self.told..until {
            let both = [phases.right[step], phases.left[step]];
            self.broadcast.tell(&gait_phase().name, step, both);
        }
        self.told = self.told.max(until);
    }
}

/// What is shown live.
fn signals(columns: &ChannelNames) -> Vec<Signal> {
    let signal = |name: &str, title: &str, elements: &[String]| Signal {
        name: name.to_owned(),
        title: title.to_owned(),
        elements: elements.to_vec(),
        after_step: true,
        ..Signal::default()
    };
    let ChannelNames { muscles, joints, reward_components, walking } = columns;
    let angles: Vec<String> = joints.iter().map(|joint| joint.name.clone()).collect();
    let units = [("rad", false), ("m", true)];
    let units = units.iter().filter(|(_, slides)| joints.iter().any(|j| j.slides == *slides));
    let units: Vec<&str> = units.map(|(unit, _)| *unit).collect();
    let mut signals = vec![
        Signal { scale: Scale::Share, ..signal(names::ACTIVATION, "Muscle activation", muscles) },
        signal(CHOSEN, "Action before projection", muscles),
        signal(names::ACTION, "Action sent to the body", muscles),
        signal(names::JOINT, &with_units("Joint angles", &units), &angles),
    ];
    if *walking {
        let feet = names::FEET.map(str::to_owned);
        let axes = names::HEADING_AXES.map(str::to_owned);
        signals.extend([
            signal(names::FOOT_CONTACT, "Touch forces (N)", &feet),
            gait_phase(),
            signal(names::ROOT_VELOCITY, "Velocity of the root (m/s)", &axes),
        ]);
    }
    signals.extend([
        signal(names::REWARD_COMPONENT, "Reward components", reward_components),
        signal(names::REWARD, "Reward", &[String::new()]),
        Signal { scale: Scale::Flag, ..signal(names::SOLVED, "Solved", &[String::new()]) },
    ]);
    signals
}
