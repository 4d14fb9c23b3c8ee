//! What is shown while mapping: a bar on a terminal; elsewhere a line on stdout every tenth of the
//! way, so that an error is the first line on stderr.

use std::io::IsTerminal;
use std::time::Instant;

use indicatif::{ProgressBar, ProgressStyle};

use crate::map::Mapper;

/// Progress over a known number of frames.
pub(in crate::cli) struct Progress {
    bar: Option<ProgressBar>,
    /// Whether there are lines where there is no bar.
    lines: bool,
    start: Instant,
    done: usize,
    total: usize,
}

impl Progress {
    pub(in crate::cli) fn new(total: usize) -> Self {
        let bar = std::io::stderr().is_terminal().then(|| {
            let bar = ProgressBar::new(total as u64);
            let style =
                ProgressStyle::with_template("{bar:30} {pos}/{len} frames  {eta} left  {msg}");
            // The template is fixed; should it ever be wrong, the plain bar does.
            bar.with_style(style.unwrap_or_else(|_| ProgressStyle::default_bar()))
        });
        Self { bar, lines: true, start: Instant::now(), done: 0, total }
    }

    /// A bar on a terminal, nothing elsewhere: for commands whose lines are their results.
    pub(in crate::cli) fn on_terminals_only(total: usize) -> Self {
        Self { lines: false, ..Self::new(total) }
    }

    /// One frame is done.
    pub(in crate::cli) fn step(&mut self, mapper: &Mapper) {
        let tenth = |done: usize| done * 10 / self.total;
        let crossed = tenth(self.done + 1) > tenth(self.done);
        self.done += 1;
        if self.bar.is_none() && !(crossed && self.lines) {
            return;
        }
        let stats = mapper.stats();
        let rate = self.done as f64 / self.start.elapsed().as_secs_f64().max(1e-9);
        let message = format!(
            "{rate:.1} frames/s  epoch {}  {:.1} MB",
            stats.epoch,
            stats.map_bytes as f64 / 1e6
        );
        match &self.bar {
            Some(bar) => {
                bar.set_message(message);
                bar.inc(1);
            }
            None => println!("{}/{} frames  {message}", self.done, self.total),
        }
    }

    /// Clears the bar.
    pub(in crate::cli) fn finish(&self) {
        if let Some(bar) = &self.bar {
            bar.finish_and_clear();
        }
    }
}
