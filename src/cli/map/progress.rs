//! What is shown while mapping: a bar on a terminal; elsewhere a line on stdout every tenth of the
//! way, so that an error is the first line on stderr.

use std::io::IsTerminal;
use std::time::Instant;

use indicatif::{ProgressBar, ProgressStyle};

use crate::map::Mapper;

/// Progress over a known number of frames.
pub(super) struct Progress {
    bar: Option<ProgressBar>,
    start: Instant,
    done: usize,
    total: usize,
}

impl Progress {
    pub(super) fn new(total: usize) -> Self {
        let bar = std::io::stderr().is_terminal().then(|| {
            let bar = ProgressBar::new(total as u64);
            let style =
                ProgressStyle::with_template("{bar:30} {pos}/{len} frames  {eta} left  {msg}");
            // The template is fixed; should it ever be wrong, the plain bar does.
            bar.with_style(style.unwrap_or_else(|_| ProgressStyle::default_bar()))
        });
        Self { bar, start: Instant::now(), done: 0, total }
    }

    /// One frame is done.
    pub(super) fn step(&mut self, mapper: &Mapper) {
        let tenth = |done: usize| done * 10 / self.total;
        let crossed = tenth(self.done + 1) > tenth(self.done);
        self.done += 1;
        if self.bar.is_none() && !crossed {
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
    pub(super) fn finish(&self) {
        if let Some(bar) = &self.bar {
            bar.finish_and_clear();
        }
    }
}
