//! `bench`: how fast this machine plays, against its own limits.

use std::path::Path;
use std::sync::Arc;
use std::time::Duration;

use anyhow::Context as _;
use clap::{Args, Subcommand};
use serde_json::json;

use crate::assets::{Cache, Part, PhysicsVersion};
use crate::cli::context::{Context, Outcome};
use crate::cli::laboratory::{available, open_library};
use crate::cli::render::{self, Align, Hinted};
use crate::experiment::throughput::forward::{self, BODIES, Body, Ceiling, NETWORKS, Network};
use crate::experiment::throughput::peer::{self, Peer, PeerError};
use crate::experiment::throughput::whole_loop;
use crate::sim::bodies::Bodies;
use crate::sim::rollout::Machine;
use crate::sim::tasks;

/// Arguments of `bench`.
#[derive(Debug, Args)]
pub struct BenchArguments {
    #[command(subcommand)]
    what: What,
    /// Spend a tenth of a second on each measurement instead of two seconds
    #[arg(long, global = true)]
    quick: bool,
}

/// What to measure.
#[derive(Debug, Subcommand)]
enum What {
    /// The transformer's forward pass, as a share of this machine's matrix product
    Policy {
        /// Networks: `full`, `m`, `s`, `xs`
        #[arg(long, value_name = "NAME", num_args = 1.., value_delimiter = ',', value_parser = network, default_value = "full,xs")]
        network: Vec<Network>,
        /// Bodies: `hand`, `arm`, `legs`
        #[arg(long, value_name = "NAME", num_args = 1.., value_delimiter = ',', value_parser = body, default_value = "hand,legs")]
        body: Vec<Body>,
        /// Observations per call
        #[arg(long, value_name = "N", num_args = 1.., value_delimiter = ',', default_value = "1,16,64", value_parser = clap::value_parser!(u16).range(1..=1024))]
        batch: Vec<u16>,
        #[command(flatten)]
        beside: Beside,
    },
    /// A whole rollout of the full-size transformer beside its parts, two threads beside one, and planned beside not
    Loop {
        /// Tasks
        #[arg(long, value_name = "NAME", num_args = 1.., value_delimiter = ',', default_value = "hand_index_reach,baoding_p1_ccw")]
        task: Vec<String>,
        /// Network: `full`, `m`, `s` or `xs`
        #[arg(long, value_name = "NAME", value_parser = network, default_value = "full")]
        network: Network,
        /// Episodes per task
        #[arg(long, value_name = "N", default_value = "32", value_parser = clap::value_parser!(u16).range(2..))]
        episodes: u16,
        /// Bodies per thread
        #[arg(long, value_name = "N", default_value = "1", value_parser = clap::value_parser!(u16).range(1..))]
        batch: u16,
        /// `MuJoCo` version
        #[arg(long, value_name = "VERSION", default_value = "2.3.7")]
        physics: PhysicsVersion,
        #[command(flatten)]
        beside: Beside,
    },
}

/// Whether the same is timed elsewhere.
#[derive(Debug, Args)]
struct Beside {
    /// Time the same networks in PyTorch as well
    #[arg(long)]
    peer: bool,
    /// Python that has `torch`
    #[arg(long, value_name = "FILE", default_value = "python3")]
    python: String,
}

impl Beside {
    fn python(&self) -> Option<&str> {
        self.peer.then_some(self.python.as_str())
    }
}

fn network(name: &str) -> Result<Network, String> {
    let found = NETWORKS.iter().find(|network| network.name == name);
    found.copied().ok_or_else(|| "expected `full`, `m`, `s` or `xs`".to_owned())
}

fn body(name: &str) -> Result<Body, String> {
    let found = BODIES.iter().find(|body| body.name == name);
    found.copied().ok_or_else(|| "expected `hand`, `arm` or `legs`".to_owned())
}

/// Runs the command.
pub fn run(context: &Context, arguments: &BenchArguments) -> anyhow::Result<Outcome> {
    let budget = Duration::from_millis(if arguments.quick { 100 } else { 2000 });
    match &arguments.what {
        What::Policy { network, body, batch, beside } => {
            let batches: Vec<usize> = batch.iter().map(|&batch| usize::from(batch)).collect();
            policy(context, network, body, &batches, beside.python(), budget)
        }
        What::Loop { task, network, episodes, batch, physics, beside } => {
            let machine = machine(context, *physics, usize::from(*batch))?;
            let episodes = usize::from(*episodes);
            whole_loops(context, &machine, task, network, episodes, beside.python(), budget)
        }
    }
}

const PEER_NOTE: &str = ", one thread. As published: its modules, with masks, words looked up in every call.\n\
    At its best: the fastest of that, its modules without either, and fused attention by hand.\n";

fn policy(
    context: &Context,
    networks: &[Network],
    bodies: &[Body],
    batches: &[usize],
    python: Option<&str>,
    budget: Duration,
) -> anyhow::Result<Outcome> {
    let ceiling = Ceiling::measure(budget);
    let mut rows = Vec::new();
    for network in networks {
        for body in bodies {
            for &batch in batches {
                rows.push(forward::measure(network, body, batch, budget)?);
            }
        }
    }
    let peer = timed_peer(context, python, networks, bodies, batches, 1, budget)?;
    let of_peer = |row: &forward::ForwardRow| {
        peer.as_ref().and_then(|Peer { rows, .. }| {
            let same = |other: &&peer::PeerRow| {
                (&*other.network, &*other.body, other.batch) == (row.network, row.body, row.batch)
            };
            rows.iter().find(same)
        })
    };
    if context.json {
        let entries: Vec<_> = rows
            .iter()
            .map(|row| {
                let mut entry = json!(row);
                entry["share_of_ceiling"] = json!(row.gigaflops / ceiling.best());
                if let Some(other) = of_peer(row) {
                    entry["pytorch_milliseconds"] = json!(other.milliseconds);
                }
                entry
            })
            .collect();
        render::print_json(&json!({
            "ceiling_gigaflops": ceiling.best(),
            "pytorch": peer.as_ref().map(|peer| &peer.version),
            "forward": entries,
        }))?;
        return Ok(Outcome::Done);
    }
    let rates: Vec<String> =
        ceiling.rates.iter().map(|(size, rate)| format!("{rate:.0} at {size}")).collect();
    let mut text = format!(
        "Square matrix product, f32, one core, GFLOP/s: {}\nCeiling: {:.0}\n\n",
        rates.join(", "),
        ceiling.best()
    );
    let mut columns = vec![
        ("network", Align::Left),
        ("body", Align::Left),
        ("batch", Align::Right),
        ("ms", Align::Right),
        ("GFLOP/s", Align::Right),
        ("of ceiling", Align::Right),
    ];
    if peer.is_some() {
        columns.extend([
            ("PyTorch as published, ms", Align::Right),
            ("faster by", Align::Right),
            ("at its best, ms", Align::Right),
            ("faster by", Align::Right),
        ]);
    }
    let lines: Vec<Vec<String>> = rows
        .iter()
        .map(|row| {
            let mut line = vec![
                row.network.to_owned(),
                row.body.to_owned(),
                row.batch.to_string(),
                format!("{:.3}", row.milliseconds),
                format!("{:.1}", row.gigaflops),
                format!("{:.0} %", 100.0 * row.gigaflops / ceiling.best()),
            ];
            if let Some(other) = of_peer(row) {
                for time in [other.published(), other.best().map(|(_, time)| time)] {
                    line.push(time.map_or_else(String::new, |time| format!("{time:.3}")));
                    let ratio = |time: f64| format!("{:.2} ×", time / row.milliseconds);
                    line.push(time.map_or_else(String::new, ratio));
                }
            }
            line
        })
        .collect();
    text += &render::table(&columns, &lines);
    text += "\nms: time of one observation on one thread. The rate counts matrix products only.\n";
    if let Some(Peer { version, .. }) = &peer {
        text.extend(["PyTorch ", version, PEER_NOTE]);
    }
    render::print_text(&text)?;
    Ok(Outcome::Done)
}

/// The same in `PyTorch`, where it is wanted.
fn timed_peer(
    context: &Context,
    python: Option<&str>,
    networks: &[Network],
    bodies: &[Body],
    batches: &[usize],
    threads: usize,
    budget: Duration,
) -> anyhow::Result<Option<Peer>> {
    let Some(python) = python else { return Ok(None) };
    context.say("Timing PyTorch …");
    let seconds = budget.as_secs_f64();
    let peer = peer::measure(python, networks, bodies, batches, threads, seconds);
    Ok(Some(peer.map_err(|error| hinted(&error))?))
}

fn hinted(error: &PeerError) -> anyhow::Error {
    let hint = match error {
        PeerError::Start { .. } => "name a Python with `--python FILE`, or leave `--peer` out",
        PeerError::NoTorch { .. } => {
            "install it (`pip install torch`), name another Python with `--python FILE`, or leave \
             `--peer` out"
        }
        PeerError::Failed { .. } => "leave `--peer` out to measure this program alone",
    };
    Hinted::new(error.to_string(), hint)
}

fn machine(context: &Context, physics: PhysicsVersion, batch: usize) -> anyhow::Result<Machine> {
    let cache = Cache::locate();
    let models = available(context, &cache, Part::MyoSuite, Cache::myosuite)?;
    let library = open_library(context, &cache, physics)?;
    let bodies = Arc::new(Bodies::new(library, &models, Path::new(&context.data)));
    Ok(Machine { bodies, threads: 1, batch })
}

fn whole_loops(
    context: &Context,
    machine: &Machine,
    names: &[String],
    network: &Network,
    episodes: usize,
    python: Option<&str>,
    budget: Duration,
) -> anyhow::Result<Outcome> {
    let policy = forward::made_up_policy(&network.sizes)?;
    let mut rows = Vec::new();
    for name in names {
        let task = tasks::find(name).context("`tasks` lists them")?;
        rows.push(whole_loop::measure(machine, &policy, task, episodes, budget)?);
    }
    let bodies: Vec<Body> = rows.iter().map(|row| row.body).collect();
    let peer = timed_peer(context, python, &[*network], &bodies, &[1], 2, budget)?;
    // The published loop plays one environment in one process, and waits for its network in every step.
    let published = |row: &whole_loop::LoopRow| {
        let same = |other: &&peer::PeerRow| other.body == row.body.name;
        peer.as_ref().and_then(|peer| peer.rows.iter().find(same)?.published())
    };
    if context.json {
        let entries: Vec<_> = rows
            .iter()
            .map(|row| {
                let mut entry = json!(row);
                entry["overhead"] = json!(row.overhead());
                entry["steps_per_second_of_two_threads"] = json!(row.rate());
                if let Some(time) = published(row) {
                    entry["published_forward_milliseconds"] = json!(time);
                    entry["faster_than_published_by_at_least"] = json!(row.rate() * time / 1e3);
                }
                entry
            })
            .collect();
        render::print_json(&json!({"network": network.name, "loops": entries}))?;
        return Ok(Outcome::Done);
    }
    let mut columns = vec![
        ("task", Align::Left),
        ("steps", Align::Right),
        ("loop, ms", Align::Right),
        ("physics, ms", Align::Right),
        ("forward, ms", Align::Right),
        ("loop / parts", Align::Right),
        ("two threads", Align::Right),
        ("sweep / loop", Align::Right),
        ("Parquet, ms", Align::Right),
        ("MCAP, ms", Align::Right),
    ];
    if peer.is_some() {
        columns.extend([("published forward, ms", Align::Right), ("faster by", Align::Right)]);
    }
    let written = |time: Option<f64>| time.map_or_else(|| "–".to_owned(), |t| format!("{t:.3}"));
    let lines: Vec<Vec<String>> = rows
        .iter()
        .map(|row| {
            let mut line = vec![
                row.task.to_owned(),
                row.steps.to_string(),
                format!("{:.3}", row.loop_milliseconds),
                format!("{:.3}", row.physics_milliseconds),
                format!("{:.3}", row.forward_milliseconds),
                format!("{:.3}", row.overhead()),
                format!("{:.2} ×", row.two_threads),
                format!("{:.3}", row.sweep),
                written(row.parquet_milliseconds),
                written(row.mcap_milliseconds),
            ];
            if let Some(time) = published(row) {
                line.push(format!("{time:.3}"));
                line.push(format!("{:.2} ×", row.rate() * time / 1e3));
            }
            line
        })
        .collect();
    let text = render::table(&columns, &lines);
    let note = peer.map_or_else(String::new, |Peer { version, .. }| {
        format!(
            "Published forward: PyTorch {version} as the published code calls it, one observation on two threads. Its loop \
             takes that long and physics as well; two threads of ours are faster by at least so much.\n"
        )
    });
    render::print_text(&format!(
        "{text}\nTimes are per control step on one thread, {} network. Sweep: planned, entered into a ledger and \
         gathered. Parquet, MCAP: all that was recorded of a step, written.\n{note}",
        network.name
    ))?;
    Ok(Outcome::Done)
}
