//! Smoothness of many episodes on one core, beside the same with NumPy and SciPy (`scripts/peers/smoothness.py`) in the
//! same run, where the Python named by `$PYTHON` (else `python3`) has both; the two must find the same means.

use std::hint::black_box;
use std::process::{Command, Stdio};
use std::time::Instant;

use arnold_analyze::analysis::signal::Rows;
use arnold_analyze::analysis::smoothness::{
    DimensionlessJerk, SpectralArcLength, VelocityPeaks, joint_space_speed,
};
use arnold_analyze::analysis::stats::mean;
use arnold_analyze::analysis::undefined::Undefined;
use serde_json::Value;

/// Episodes, steps and joints of the smoothness comparison: the eleven hand tasks with a hundred episodes each.
const EPISODES: usize = 1_100;
const STEPS: usize = 100;
const JOINTS: usize = 23;

/// SPARC, LDLJ and NVP of every episode; once if `quick`, else the fastest of ten runs.
pub(crate) fn run(quick: bool) {
    let runs = if quick { 1 } else { 10 };
    let recorded: Vec<Vec<f64>> = (0..EPISODES).map(angles).collect();
    let episodes: Vec<Rows<'_>> = recorded
        .iter()
        .map(|angles| Rows::new(angles, JOINTS).expect("the angles are finite"))
        .collect();
    let mut arc = SpectralArcLength::new(Default::default()).expect("the defaults are valid");
    let mut jerk = DimensionlessJerk::new(Default::default()).expect("the defaults are valid");
    let mut peaks = VelocityPeaks::new(Default::default()).expect("the defaults are valid");
    let mut speed = Vec::new();
    let ours = [
        measure("sparc", runs, &episodes, |angles| {
            joint_space_speed(angles, &mut speed);
            arc.of(&speed)
        }),
        measure("ldlj", runs, &episodes, |angles| {
            Undefined::Skip.mean(jerk.per_joint(angles).iter().copied())
        }),
        measure("nvp", runs, &episodes, |angles| {
            Undefined::Skip.mean(peaks.per_joint(angles).iter().copied())
        }),
    ];
    let total: f64 = ours.iter().map(|own| own.seconds).sum();
    println!("{EPISODES} episodes x {JOINTS} joints, SPARC, LDLJ and NVP: {:.3} ms", 1e3 * total);
    match peer(runs.min(3)) {
        Ok(peer) => compare(&ours, &peer),
        Err(why) => println!("  not compared with SciPy: {why}"),
    }
}

/// What a metric took over all episodes, and its mean.
struct Measured {
    name: &'static str,
    seconds: f64,
    mean: f64,
}

fn measure(
    name: &'static str,
    runs: usize,
    episodes: &[Rows<'_>],
    mut metric: impl FnMut(&Rows<'_>) -> Option<f64>,
) -> Measured {
    let mut values = vec![0.0; episodes.len()];
    let mut seconds = f64::INFINITY;
    for _ in 0..runs {
        let start = Instant::now();
        for (value, episode) in values.iter_mut().zip(black_box(episodes)) {
            *value = metric(episode).unwrap_or(f64::NAN);
        }
        seconds = seconds.min(start.elapsed().as_secs_f64());
    }
    Measured { name, seconds, mean: mean(&values).unwrap_or(f64::NAN) }
}

/// Joint angles of an episode, rad: the formula of the script.
fn angles(episode: usize) -> Vec<f64> {
    let angle = |step: usize, joint: usize| {
        let (t, j) = (step as f64, joint as f64);
        let slow = (0.05 * t * (1 + joint % 5) as f64 + 0.1 * episode as f64 + j).sin();
        slow + 0.05 * (1.7 * t + j * (1 + episode % 7) as f64).sin()
    };
    (0..STEPS).flat_map(|step| (0..JOINTS).map(move |joint| angle(step, joint))).collect()
}

/// What the script prints, or why it did not; the fastest of `runs` runs.
fn peer(runs: usize) -> Result<Value, String> {
    let python = std::env::var("PYTHON").unwrap_or_else(|_| "python3".to_owned());
    let script = concat!(env!("CARGO_MANIFEST_DIR"), "/scripts/peers/smoothness.py");
    let sizes = [EPISODES, STEPS, JOINTS, runs].map(|size| size.to_string());
    let output = Command::new(&python)
        .arg(script)
        .args(sizes)
        .stdin(Stdio::null())
        .output()
        .map_err(|error| format!("`{python}`: {error}"))?;
    if !output.status.success() {
        let message = String::from_utf8_lossy(&output.stderr);
        return Err(message.lines().last().unwrap_or("it said nothing").to_owned());
    }
    serde_json::from_slice(&output.stdout).map_err(|error| error.to_string())
}

/// Prints the ratios; the means of both must agree, or the times are of different things.
fn compare(ours: &[Measured], peer: &Value) {
    let of = |kind: &str, name: &str| peer[kind][name].as_f64().unwrap_or(f64::NAN);
    println!("  {} takes:", peer["versions"].as_str().unwrap_or("the peer"));
    let (mut own, mut theirs) = (0.0, 0.0);
    for Measured { name, seconds, mean } in ours {
        let (peer_seconds, peer_mean) = (of("seconds", name), of("means", name));
        assert!((mean - peer_mean).abs() <= 1e-8 * peer_mean.abs(), "{name}: {mean}, {peer_mean}");
        own += seconds;
        theirs += peer_seconds;
        let ratio = peer_seconds / seconds;
        println!(
            "  {name}: {:.3} ms, {ratio:.1} times our {:.3} ms",
            1e3 * peer_seconds,
            1e3 * seconds
        );
    }
    println!("  together: {:.3} ms, {:.1} times ours", 1e3 * theirs, theirs / own);
}
