//! A viewer that runs: found or started, and told what happens.
//!
//! Sending waits when the viewer is slow, so it belongs on a thread of its own; see `experiment/watching`.

use std::str::FromStr;
use std::time::Duration;

use re_sdk::SpawnOptions;
use re_sdk::external::re_uri::ProxyUri;
use re_sdk::log::LogMsg;
use re_sdk::sink::{GrpcSink, LogSink};

use crate::units::Seconds;

use super::heat::Map;
use super::script::{Act, Take};
use super::store::{SceneError, Store};
use super::{Frame, Signal, Stage, blueprint, heat, stage};

/// Where the viewer is.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Connection {
    /// The one on this machine, started if there is none: the program `rerun`, or the one named.
    Spawn { program: Option<String> },
    /// One that listens somewhere: `rerun+http://HOST:PORT/proxy`.
    Connect { url: String },
}

/// How long the end waits until everything has arrived.
const PATIENCE: Duration = Duration::from_secs(30);

/// A viewer that listens.
pub struct Viewer {
    sink: GrpcSink,
    url: String,
}

impl std::fmt::Debug for Viewer {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "the viewer at `{}`", self.url)
    }
}

impl Viewer {
    /// Finds or starts a viewer.
    pub fn open(connection: &Connection) -> Result<Self, SceneError> {
        let url = match connection {
            Connection::Connect { url } => url.clone(),
            Connection::Spawn { program } => {
                let options = SpawnOptions {
                    executable_path: program.clone(),
                    hide_welcome_screen: true,
                    detach_process: true,
                    wait_for_bind: true,
                    ..SpawnOptions::default()
                };
                let program = options.executable_path();
                let started = re_sdk::spawn(&options).map_err(|error| {
                    let source = std::io::Error::other(error.to_string());
                    SceneError::Spawn { program, source }
                })?;
                format!("rerun+http://127.0.0.1:{}/proxy", started.port)
            }
        };
        let uri = ProxyUri::from_str(&url)
            .map_err(|error| SceneError::Address { url: url.clone(), what: error.to_string() })?;
        Ok(Self { sink: GrpcSink::new(uri), url })
    }

    /// Shows a whole act.
    pub fn show(&self, act: &Act, arrange: bool) -> Result<(), SceneError> {
        if arrange {
            self.send(blueprint::messages(act)?);
        }
        self.send(act.messages()?);
        Ok(())
    }

    /// Where it listens.
    #[must_use]
    pub fn url(&self) -> &str {
        &self.url
    }

    fn send(&self, messages: Vec<LogMsg>) {
        for message in messages {
            self.sink.send(message);
        }
    }

    /// Waits until everything was taken.
    pub fn finish(&self) -> Result<(), SceneError> {
        self.sink
            .flush_blocking(PATIENCE)
            .map_err(|error| SceneError::Lost { url: self.url.clone(), what: error.to_string() })
    }
}

/// An episode that is told while it happens.
pub struct Broadcast {
    act: Act,
    store: Option<Store>,
    /// Activations so far, by step: the heat map.
    known: Vec<Vec<f32>>,
    /// Whether there are some that were not sent.
    is_painted: bool,
    /// For every signal the frames of its values.
    told: Vec<Vec<usize>>,
}

impl Broadcast {
    /// An episode of `task` by the policy `label`.
    #[must_use]
    pub fn new(task: &str, episode: u64, label: &str, stage: Stage) -> Self {
        let take = Take { label: label.to_owned(), stage, ..Take::default() };
        let act = Act {
            task: task.to_owned(),
            episode,
            interval: 1.0,
            takes: vec![take],
            ..Act::default()
        };
        let (known, told) = (Vec::new(), Vec::new());
        Self { act, store: None, known, is_painted: false, told }
    }

    /// Played under a condition, such as a number of components.
    #[must_use]
    pub fn under(mut self, condition: &str) -> Self {
        condition.clone_into(&mut self.act.condition);
        self
    }

    /// With the control step and the length of an episode that nothing ends.
    #[must_use]
    pub fn at(mut self, interval: Seconds, horizon: usize) -> Self {
        self.act.interval = interval;
        self.act.horizon = horizon;
        self
    }

    /// With `signals`, which have no values yet.
    #[must_use]
    pub fn with(mut self, signals: Vec<Signal>) -> Self {
        self.told = vec![Vec::new(); signals.len()];
        self.act.takes[0].signals = signals;
        self
    }

    /// Tells the viewer what does not change, and arranges its views if asked to.
    pub fn open(&mut self, viewer: &Viewer, run: &str, arrange: bool) -> Result<(), SceneError> {
        if arrange {
            viewer.send(blueprint::messages(&self.act)?);
        }
        let (title, take) = (self.act.title(), &self.act.takes[0]);
        let rows = heat::rows_in_words(&take.stage.muscles);
        let label = &take.label;
        self.act.notes =
            format!("# {title}\n\n* policy: {label}\n* watched while it was played\n* {rows}\n");
        let take = &self.act.takes[0];
        let mut store = self.act.open(run)?;
        stage::set(&mut store, &take.path(), &take.stage)?;
        self.map().name_rows(&mut store, &take.path(), &take.stage.muscles)?;
        for signal in &take.signals {
            signal.introduce(&mut store, &take.path())?;
        }
        viewer.send(store.take());
        self.store = Some(store);
        Ok(())
    }

    fn map(&self) -> Map {
        Map::new(self.act.takes[0].stage.muscles.len(), self.act.length(), 1)
    }

    /// Keeps a frame until the next letter.
    pub fn add(&mut self, frame: Frame) {
        self.act.takes[0].frames.push(frame);
    }

    /// Keeps the activations at a step, whether it is shown or not, for the heat map.
    pub fn paint(&mut self, step: usize, activation: &[f32]) {
        if self.known.len() <= step {
            self.known.resize(step + 1, Vec::new());
        }
        self.known[step] = activation.to_vec();
        self.is_painted = true;
    }

    /// Keeps the values of the signal `name` at a step until the next letter, also of a step that was not shown or is long
    /// past. A signal that is not there is not told.
    pub fn tell(&mut self, name: &str, step: usize, values: impl IntoIterator<Item = f64>) {
        let mut signals = self.act.takes[0].signals.iter_mut().zip(&mut self.told);
        if let Some((signal, steps)) = signals.find(|(signal, _)| signal.name == name) {
            signal.values.extend(values);
            steps.push(step);
        }
    }

    /// Sends what was kept.
    pub fn send(&mut self, viewer: &Viewer) -> Result<(), SceneError> {
        let map = self.map();
        let Some(store) = &mut self.store else { return Ok(()) };
        let interval = self.act.interval;
        let take = &mut self.act.takes[0];
        let frames = std::mem::take(&mut take.frames);
        let path = take.path();
        for (signal, steps) in take.signals.iter_mut().zip(&mut self.told) {
            signal.show_at(store, &path, steps, interval)?;
            signal.values.clear();
            steps.clear();
        }
        if std::mem::take(&mut self.is_painted) {
            map.show(store, &path, self.known.iter().map(Vec::as_slice))?;
        }
        if !frames.is_empty() {
            stage::show(store, &path, &take.stage, &frames, interval)?;
            let steps: Vec<usize> = frames.iter().map(|frame| frame.step).collect();
            map.point(store, &path, &steps, interval)?;
        }
        viewer.send(store.take());
        Ok(())
    }
}
