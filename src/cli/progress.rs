//! Progress of long work: a bar with rate and ETA on a terminal, one line every 30 s elsewhere.

use std::sync::Mutex;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::{Duration, Instant};

use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};

use super::context::Context;

const LINE_INTERVAL: Duration = Duration::from_secs(30);

/// A count of finished things out of a known number. Threads share it by reference.
#[derive(Debug)]
pub struct Progress {
    bar: Option<ProgressBar>,
    label: String,
    unit: &'static str,
    total: u64,
    done: AtomicU64,
    /// Done before this life of the program: no part of its rate.
    before: u64,
    start: Instant,
    last_line: Mutex<Instant>,
    quiet: bool,
}

impl Progress {
    /// Starts counting `total` things called `unit`.
    #[must_use]
    pub fn start(context: &Context, label: &str, unit: &'static str, total: u64) -> Self {
        Self::resume(context, label, unit, total, 0)
    }

    /// The same where `before` of them are done already.
    #[must_use]
    pub fn resume(
        context: &Context,
        label: &str,
        unit: &'static str,
        total: u64,
        before: u64,
    ) -> Self {
        let bar = (context.interactive && !context.quiet).then(|| {
            let bar =
                ProgressBar::with_draw_target(Some(total), ProgressDrawTarget::stderr_with_hz(8));
            let template =
                format!("{{msg}} {{wide_bar}} {{pos}}/{{len}} {unit}  {{per_sec}}  ETA {{eta}}");
            if let Ok(style) = ProgressStyle::with_template(&template) {
                bar.set_style(style.progress_chars("━╸─"));
            }
            bar.set_message(label.to_owned());
            bar.with_position(before)
        });
        let start = Instant::now();
        Self {
            bar,
            label: label.to_owned(),
            unit,
            total,
            done: AtomicU64::new(before),
            before,
            start,
            last_line: Mutex::new(start),
            quiet: context.quiet,
        }
    }

    /// Counts `count` more things as done.
    pub fn advance(&self, count: u64) {
        let done = self.done.fetch_add(count, Ordering::Relaxed) + count;
        if let Some(bar) = &self.bar {
            bar.set_position(done);
            if done >= self.total {
                bar.finish_and_clear();
            }
            return;
        }
        if self.quiet {
            return;
        }
        let Ok(mut last) = self.last_line.lock() else { return };
        if last.elapsed() >= LINE_INTERVAL {
            *last = Instant::now();
            let rate = (done - self.before) as f64 / self.start.elapsed().as_secs_f64();
            let left = self.total.saturating_sub(done) as f64 / rate.max(1e-9);
            eprintln!(
                "{}: {done}/{} {}, {rate:.1} per s, {} left",
                self.label,
                self.total,
                self.unit,
                duration(left)
            );
        }
    }

    /// Takes the bar away and returns the seconds that passed.
    pub fn finish(&self) -> f64 {
        if let Some(bar) = &self.bar {
            bar.finish_and_clear();
        }
        self.start.elapsed().as_secs_f64()
    }
}

/// A duration a person can read: `42 s`, `3 min 05 s`, `2 h 10 min`.
#[must_use]
pub fn duration(seconds: f64) -> String {
    let s = seconds.round().max(0.0) as u64;
    match s {
        0..60 => format!("{s} s"),
        60..3600 => format!("{} min {:02} s", s / 60, s % 60),
        _ => format!("{} h {:02} min", s / 3600, s % 3600 / 60),
    }
}
