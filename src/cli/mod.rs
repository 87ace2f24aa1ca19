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
pub mod progress;
pub mod render;

use std::ffi::OsString;
use std::process::ExitCode;

use clap::Parser;

use args::{Arguments, Command};
use context::{Context, Outcome};

/// Runs the program with `arguments` (the first is the program's name).
pub fn main(arguments: impl IntoIterator<Item = OsString>) -> ExitCode {
    let arguments = match Arguments::try_parse_from(arguments) {
        Ok(arguments) => arguments,
        // Help and version go to stdout with success, everything else to stderr with 2.
        Err(error) if error.use_stderr() => {
            render::print_usage_error(&error);
            return ExitCode::from(2);
        }
        Err(help) => {
            let _closed_pipe = help.print();
            return ExitCode::SUCCESS;
        }
    };
    let context = Context::new(&arguments.global);
    match dispatch(&context, arguments.command) {
        Ok(Outcome::Done) => ExitCode::SUCCESS,
        Ok(Outcome::SomethingSkipped) => ExitCode::from(3),
        Err(error) if render::is_closed_pipe(&error) => ExitCode::SUCCESS,
        Err(error) => {
            render::print_error(&error);
            ExitCode::from(1)
        }
    }
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
        Command::Emg(args) => commands::emg::run(context, &args),
        #[cfg(feature = "play")]
        Command::Factors(args) => commands::factors::run(context, &args),
        #[cfg(feature = "play")]
        Command::Verify(args) => commands::verify::run(context, &args),
        #[cfg(feature = "play")]
        Command::Bench(args) => commands::bench::run(context, &args),
    }
}
