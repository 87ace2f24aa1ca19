//! The front desk: the only room that knows clap, terminals, colours and exit codes.

pub mod args;
pub mod commands;
pub mod context;
pub mod default_policy;
pub mod explain;
#[cfg(feature = "play")]
pub mod finish;
#[cfg(feature = "play")]
pub mod laboratory;
#[cfg(feature = "play")]
pub mod movement;
#[cfg(feature = "play")]
mod policy_choice;
pub mod progress;
#[cfg(feature = "play")]
mod recorded;
pub mod render;
#[cfg(feature = "play")]
mod replay;
#[cfg(feature = "play")]
pub mod signals;
#[cfg(feature = "play")]
pub mod sweep;
#[cfg(feature = "view")]
pub mod viewing;

use std::ffi::OsString;
use std::process::ExitCode;

use clap::Parser;

use args::{Arguments, Command};
use context::{Context, Outcome};

/// Runs the program with `arguments` (the first is the program's name).
pub fn main(arguments: impl IntoIterator<Item = OsString>) -> ExitCode {
    let typed: Vec<OsString> = arguments.into_iter().collect();
    let words = typed.iter().skip(1).map(|word| word.to_string_lossy().into_owned()).collect();
    let arguments = match Arguments::try_parse_from(typed) {
        Ok(arguments) => arguments,
        Err(error) => return bad_arguments(&error),
    };
    let context = Context::new(&arguments.global, words);
    match dispatch(&context, arguments.command) {
        Ok(Outcome::Done) => ExitCode::SUCCESS,
        Ok(Outcome::SomethingSkipped) => ExitCode::from(3),
        Err(error) if render::is_closed_pipe(&error) => ExitCode::SUCCESS,
        Err(error) => {
            // The arguments of a command inside another one.
            if let Some(usage) = error.downcast_ref::<clap::Error>() {
                return bad_arguments(usage);
            }
            render::print_error(&error);
            ExitCode::from(1)
        }
    }
}

/// Help and version go to stdout with success, everything else to stderr with 2.
fn bad_arguments(error: &clap::Error) -> ExitCode {
    if error.use_stderr() {
        render::print_usage_error(error);
        return ExitCode::from(2);
    }
    let _closed_pipe = error.print();
    ExitCode::SUCCESS
}

fn dispatch(context: &Context, command: Command) -> anyhow::Result<Outcome> {
    match command {
        Command::Setup(args) => commands::setup::run(context, &args),
        Command::Doctor(args) => commands::doctor::run(context, &args),
        Command::Inspect(args) => commands::inspect::run(context, &args),
        Command::Convert(args) => commands::convert::run(context, &args),
        #[cfg(feature = "play")]
        Command::Tasks(args) => commands::tasks::run(context, &args),
        #[cfg(feature = "play")]
        Command::Rollout(args) => commands::rollout::run(context, &args),
        #[cfg(feature = "play")]
        Command::Evaluate(args) => commands::evaluate::run(context, &args),
        #[cfg(feature = "play")]
        Command::Csi(args) => commands::csi::run(context, &args),
        #[cfg(feature = "play")]
        Command::Kinematics(args) => commands::kinematics::run(context, &args),
        #[cfg(feature = "play")]
        Command::Smoothness(args) => commands::smoothness::run(context, &args),
        #[cfg(feature = "play")]
        Command::Synergies(args) => commands::synergies::run(context, &args),
        #[cfg(feature = "play")]
        Command::Subspaces(args) => commands::subspaces::run(context, &args),
        #[cfg(feature = "play")]
        Command::Emg(args) => commands::emg::run(context, &args),
        #[cfg(feature = "play")]
        Command::Factors(args) => commands::factors::run(context, &args),
        #[cfg(feature = "play")]
        Command::Curves(args) => commands::curves::run(context, &args),
        #[cfg(feature = "play")]
        Command::Figures(args) => commands::figures::run(context, &args),
        #[cfg(feature = "play")]
        Command::Report(args) => commands::report::run(context, &args),
        #[cfg(feature = "play")]
        Command::Stats(args) => commands::stats::run(context, &args),
        #[cfg(feature = "play")]
        Command::Plan(args) => commands::plan::run(context, &args),
        #[cfg(feature = "play")]
        Command::Work(args) => commands::work::run(context, &args),
        #[cfg(feature = "play")]
        Command::Status(args) => commands::status::run(context, &args),
        #[cfg(feature = "play")]
        Command::Gather(args) => commands::gather::run(context, &args),
        #[cfg(feature = "play")]
        Command::Train(args) => commands::train::run(context, &args),
        #[cfg(feature = "view")]
        Command::View(args) => commands::view::run(context, &args),
        #[cfg(feature = "play")]
        Command::Verify(args) => commands::verify::run(context, &args),
        #[cfg(feature = "play")]
        Command::Bench(args) => commands::bench::run(context, &args),
    }
}
