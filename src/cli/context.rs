//! Global options, handed to every command.

use std::io::IsTerminal;
use std::path::PathBuf;

use super::args::GlobalArguments;
#[cfg(feature = "play")]
use super::args::ThemeName;
#[cfg(feature = "play")]
use super::sweep::Assignment;
#[cfg(feature = "play")]
use crate::figure::Theme;

/// How a command ended when it did not fail.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Outcome {
    /// Everything asked for was done: exit code 0.
    Done,
    /// Done, but something was skipped and named: exit code 3.
    SomethingSkipped,
}

/// What every command knows about how it was called.
#[derive(Debug, Clone)]
pub struct Context {
    /// Folder of published data sets and policies.
    pub data: PathBuf,
    /// Print one JSON document instead of tables.
    pub json: bool,
    /// Print no progress.
    pub quiet: bool,
    /// 0, 1 or 2.
    pub verbosity: u8,
    /// Whether stderr is a terminal, i.e. whether a bar may be drawn.
    pub interactive: bool,
    /// What was typed: the command and its options.
    pub words: Vec<String>,
    /// Colours of figures.
    #[cfg(feature = "play")]
    pub theme: Theme,
    /// Which part of a sweep is to be done; `None`: all of it, at once.
    #[cfg(feature = "play")]
    pub assignment: Option<Assignment>,
}

impl Context {
    /// Reads the global options once.
    #[must_use]
    pub fn new(arguments: &GlobalArguments, words: Vec<String>) -> Self {
        Self {
            data: arguments.data.clone(),
            json: arguments.json,
            quiet: arguments.quiet,
            verbosity: arguments.verbose,
            interactive: std::io::stderr().is_terminal(),
            words,
            #[cfg(feature = "play")]
            theme: match arguments.theme {
                ThemeName::Light => Theme::Light,
                ThemeName::Dark => Theme::Dark,
            },
            #[cfg(feature = "play")]
            assignment: None,
        }
    }

    /// A line for the person at the terminal, on stderr unless `--quiet`.
    pub fn say(&self, message: &str) {
        if !self.quiet {
            eprintln!("{message}");
        }
    }
}
