//! The same networks in `PyTorch`, timed by a script that the program carries, where Python and `torch` are installed.

use std::collections::BTreeMap;
use std::process::{Command, Stdio};

use serde::Deserialize;

use super::forward::{Body, Network};

/// The script; prints one JSON document.
const SCRIPT: &str = include_str!("../../../scripts/peers/transformer.py");
/// Exit code by which the script says that `torch` is not installed.
const NO_TORCH: i32 = 3;

/// Why the peer could not be timed.
#[derive(Debug, thiserror::Error)]
pub enum PeerError {
    /// No such Python.
    #[error("`{python}` does not start: {source}")]
    Start {
        /// What was tried.
        python: String,
        /// Why.
        source: std::io::Error,
    },
    /// Python has no `torch`.
    #[error("`{python}` has no `torch`")]
    NoTorch {
        /// Which Python.
        python: String,
    },
    /// The script failed.
    #[error("the PyTorch script failed: {message}")]
    Failed {
        /// The end of what it said.
        message: String,
    },
}

/// What the script found.
#[derive(Debug, Clone, Deserialize)]
pub struct Peer {
    /// Version of `PyTorch`.
    pub version: String,
    /// One per network, body and batch.
    pub rows: Vec<PeerRow>,
}

/// One timed forward pass.
#[derive(Debug, Clone, Deserialize)]
pub struct PeerRow {
    /// Network.
    pub network: String,
    /// Body.
    pub body: String,
    /// Observations per call.
    pub batch: usize,
    /// Time per observation of every way of writing it, ms.
    pub milliseconds: BTreeMap<String, f64>,
}

impl PeerRow {
    /// Time per observation as the published code is written, ms.
    #[must_use]
    pub fn published(&self) -> Option<f64> {
        self.milliseconds.get("published").copied()
    }

    /// The fastest way and its time per observation, ms.
    #[must_use]
    pub fn best(&self) -> Option<(&str, f64)> {
        let times = self.milliseconds.iter().map(|(way, &time)| (way.as_str(), time));
        times.min_by(|(_, a), (_, b)| a.total_cmp(b))
    }
}

/// Times `networks` on `bodies` on so many threads, spending `seconds` on each combination.
pub fn measure(
    python: &str,
    networks: &[Network],
    bodies: &[Body],
    batches: &[usize],
    threads: usize,
    seconds: f64,
) -> Result<Peer, PeerError> {
    let question = serde_json::json!({
        "networks": networks.iter().map(|network| serde_json::json!({
            "name": network.name,
            "width": network.sizes.width,
            "layers": network.sizes.encoder_layers,
            "heads": network.sizes.heads,
            "feed_forward": network.sizes.feed_forward,
            "lags": network.sizes.lags,
            "vocabulary": network.sizes.vocabulary,
        })).collect::<Vec<_>>(),
        "bodies": bodies.iter().map(|body| serde_json::json!({
            "name": body.name, "sensors": body.sensors, "muscles": body.muscles,
        })).collect::<Vec<_>>(),
        "batches": batches,
        "threads": threads,
        "seconds": seconds,
    });
    let output = Command::new(python)
        .args(["-c", SCRIPT, &question.to_string()])
        .stdin(Stdio::null())
        .output()
        .map_err(|source| PeerError::Start { python: python.to_owned(), source })?;
    if output.status.code() == Some(NO_TORCH) {
        return Err(PeerError::NoTorch { python: python.to_owned() });
    }
    let failed = |message: String| PeerError::Failed { message };
    if !output.status.success() {
        let said = String::from_utf8_lossy(&output.stderr);
        let last = said.lines().rev().find(|line| !line.trim().is_empty());
        return Err(failed(last.unwrap_or("it said nothing").to_owned()));
    }
    serde_json::from_slice(&output.stdout).map_err(|error| failed(error.to_string()))
}
