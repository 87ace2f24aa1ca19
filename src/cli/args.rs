//! Every clap type and value parser. Nothing below the commands ever sees these.

use std::path::PathBuf;

#[cfg(feature = "play")]
use clap::ValueEnum;
use clap::{Args, Parser, Subcommand};

use super::commands;

/// How does a muscle-driven policy control the body, and how human is it?
#[derive(Debug, Parser)]
#[command(name = "arnold-analyze", version, about, propagate_version = true, max_term_width = 100)]
pub struct Arguments {
    #[command(flatten)]
    pub global: GlobalArguments,
    #[command(subcommand)]
    pub command: Command,
}

/// Options every command shares.
#[derive(Debug, Clone, Args)]
#[command(next_help_heading = "Everywhere")]
pub struct GlobalArguments {
    /// Folder of published data sets and policies
    #[arg(long, global = true, value_name = "DIR", env = "ARNOLD_DATA", default_value = "data")]
    pub data: PathBuf,
    /// Print one JSON document on stdout instead of tables
    #[arg(long, global = true)]
    pub json: bool,
    /// Print no progress
    #[arg(long, short, global = true)]
    pub quiet: bool,
    /// Say more; twice: say everything
    #[arg(long, short, global = true, action = clap::ArgAction::Count)]
    pub verbose: u8,
    /// Colours of figures: `light` for print; `dark` draws those of a run once more, for slides, in its folder `dark`
    #[cfg(feature = "play")]
    #[arg(long, global = true, value_enum, default_value_t = ThemeName::Light)]
    pub theme: ThemeName,
}

/// What figures are for.
#[cfg(feature = "play")]
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum ThemeName {
    Light,
    Dark,
}

/// What to do.
#[derive(Debug, Subcommand)]
pub enum Command {
    /// Fetch what the tool may not carry: MuJoCo libraries and MyoSuite models, or published data sets
    Setup(commands::setup::SetupArguments),
    /// Show what is installed, what is missing and the command that mends it
    Doctor(commands::doctor::DoctorArguments),
    /// Show what is inside a checkpoint or a recording, without running anything in it
    Inspect(commands::inspect::InspectArguments),
    /// Write a policy as safetensors and JSON, or a recording in another format: Parquet, MCAP, upstream's HDF5
    Convert(commands::convert::ConvertArguments),
    #[cfg(feature = "play")]
    /// List the tasks, or show what one of them observes, rewards and counts as solved
    Tasks(commands::tasks::TasksArguments),
    #[cfg(feature = "play")]
    /// Play episodes and record every step
    Rollout(commands::rollout::RolloutArguments),
    #[cfg(feature = "play")]
    /// Measure how much of its time a policy solves its tasks
    Evaluate(commands::evaluate::EvaluateArguments),
    #[cfg(feature = "play")]
    /// Control-subspace inactivation: performance against the number of muscle components
    Csi(commands::csi::CsiArguments),
    #[cfg(feature = "play")]
    /// Count the dimensions in which joints move, beside those of a human hand
    Kinematics(commands::kinematics::KinematicsArguments),
    #[cfg(feature = "play")]
    /// Measure how smooth movements are, and compare policies
    Smoothness(commands::smoothness::SmoothnessArguments),
    #[cfg(feature = "play")]
    /// Take muscle activity apart into principal components and synergies, per task and pooled
    Synergies(Box<commands::synergies::SynergiesArguments>),
    #[cfg(feature = "play")]
    /// Compare the action subspaces of tasks and of policies: variance and angle that differ
    Subspaces(Box<commands::subspaces::SubspacesArguments>),
    #[cfg(feature = "play")]
    /// Compare muscle activity of walking with human EMG, and people with each other
    Emg(Box<commands::emg::EmgArguments>),
    #[cfg(feature = "play")]
    /// Factors of the leg muscles over the gait cycle, after Ivanenko et al. 2004
    Factors(Box<commands::factors::FactorsArguments>),
    #[cfg(feature = "play")]
    /// Learning curves from event files and tables: joined, smoothed, averaged, drawn
    Curves(Box<commands::curves::CurvesArguments>),
    #[cfg(feature = "play")]
    /// Gather every figure and table of the paper: from finished runs, from published data, or say what is missing
    Figures(commands::figures::FiguresArguments),
    #[cfg(feature = "play")]
    /// Write finished runs as one HTML page: figures, tables, manifest, and the command that makes them again
    Report(commands::report::ReportArguments),
    #[cfg(feature = "play")]
    /// The paper's tests on any tidy table: signed rank, rank sum, t, bootstrap, with corrections
    Stats(Box<commands::stats::StatsArguments>),
    #[cfg(feature = "play")]
    /// List the episodes of another command, for many to work on; with scripts for a cluster if wanted
    Plan(commands::plan::PlanArguments),
    #[cfg(feature = "play")]
    /// Play a part of what was planned, or all that is missing
    Work(commands::work::WorkArguments),
    #[cfg(feature = "play")]
    /// Show how far a planned or stopped command is
    Status(commands::status::StatusArguments),
    #[cfg(feature = "play")]
    /// Make the results of what was planned, once all of it is played
    Gather(commands::gather::GatherArguments),
    #[cfg(feature = "play")]
    /// Train a policy: from rewards, in resumable runs
    Train(Box<commands::train::TrainArguments>),
    #[cfg(feature = "view")]
    /// Look at recorded episodes in the viewer Rerun: muscles, body and signals, policies side by side
    View(Box<commands::view::ViewArguments>),
    #[cfg(feature = "play")]
    /// Check this machine against recorded episodes and policy outputs of the published code
    Verify(commands::verify::VerifyArguments),
    #[cfg(feature = "play")]
    /// Measure how fast this machine plays, against its own limits
    Bench(commands::bench::BenchArguments),
}

#[cfg(feature = "play")]
impl Command {
    /// Whether the command may play episodes, so that it can be planned.
    #[must_use]
    pub fn plays(&self) -> bool {
        #[cfg(feature = "view")]
        if matches!(self, Self::View(_)) {
            return false;
        }
        !matches!(
            self,
            Self::Setup(_)
                | Self::Doctor(_)
                | Self::Inspect(_)
                | Self::Convert(_)
                | Self::Tasks(_)
                | Self::Verify(_)
                | Self::Bench(_)
                | Self::Report(_)
                | Self::Plan(_)
                | Self::Work(_)
                | Self::Status(_)
                | Self::Gather(_)
        )
    }
}
