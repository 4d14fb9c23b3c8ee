//! A frame that is in the map, until its sender has the last word: that readers see it and, where there
//! is a journal, whether a crash would lose it.

use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use super::verdict::{Ticket, Verdict};
use crate::error::Error;

/// Held by who shows the map to readers and by who brings the frame to the disk; the later of the two
/// settles it.
#[derive(Clone)]
pub(super) struct Receipt(Arc<Mutex<State>>);

struct State {
    ticket: Option<Ticket>,
    /// The epoch in which readers see it.
    seen: Option<u64>,
    /// What the disk said: done, or why not.
    disk: Option<Result<(), Arc<str>>>,
}

impl Receipt {
    /// The receipt of a frame that no disk is waited for.
    pub(super) fn unkept(ticket: Ticket) -> Self {
        Self::new(ticket, Some(Ok(())))
    }

    /// The receipt of a frame that is on its way to the disk.
    pub(super) fn kept(ticket: Ticket) -> Self {
        Self::new(ticket, None)
    }

    /// The receipt of a frame that will not come to the disk, and why.
    pub(super) fn lapsed(ticket: Ticket, reason: Arc<str>) -> Self {
        Self::new(ticket, Some(Err(reason)))
    }

    fn new(ticket: Ticket, disk: Option<Result<(), Arc<str>>>) -> Self {
        Self(Arc::new(Mutex::new(State { ticket: Some(ticket), seen: None, disk })))
    }

    /// Readers see it from this epoch on.
    pub(super) fn seen(&self, epoch: u64) {
        let mut state = self.state();
        state.seen = Some(epoch);
        if let Some(ticket) = &mut state.ticket {
            ticket.visible();
        }
        state.settle();
    }

    /// It is on the disk, or will not be.
    pub(super) fn on_disk(&self, outcome: Result<(), Arc<str>>) {
        let mut state = self.state();
        if let (Ok(()), Some(ticket)) = (&outcome, &mut state.ticket) {
            ticket.durable();
        }
        state.disk = Some(outcome);
        state.settle();
    }

    /// The mapper failed before readers saw it.
    pub(super) fn fail(&self, error: Error) {
        let ticket = self.state().ticket.take();
        if let Some(ticket) = ticket {
            ticket.settle(Verdict::Rejected(error));
        }
    }

    fn state(&self) -> MutexGuard<'_, State> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl State {
    fn settle(&mut self) {
        if let (Some(epoch), Some(disk)) = (self.seen, &self.disk) {
            let lapse = disk.as_ref().err().cloned();
            if let Some(ticket) = self.ticket.take() {
                ticket.settle(Verdict::Integrated { epoch, lapse });
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::engine::{FrameSink, Queue};

    #[derive(Clone, Default)]
    struct Told(Arc<Mutex<Vec<String>>>);

    impl FrameSink for Told {
        fn accepted(&mut self, _queue: Queue) {}

        fn visible(&mut self) {
            self.0.lock().expect("not poisoned").push("visible".into());
        }

        fn durable(&mut self) {
            self.0.lock().expect("not poisoned").push("durable".into());
        }

        fn settle(self: Box<Self>, verdict: Verdict) {
            self.0.lock().expect("not poisoned").push(format!("{verdict:?}"));
        }
    }

    #[test]
    fn the_last_word_comes_last_and_once() {
        type Case = (fn(Ticket) -> Receipt, fn(&Receipt), &'static [&'static str]);
        let cases: [Case; 5] = [
            (Receipt::unkept, |r| r.seen(7), &["visible", "Integrated { epoch: 7, lapse: None }"]),
            (
                Receipt::kept,
                |r| (r.seen(7), r.on_disk(Ok(()))).1,
                &["visible", "durable", "Integrated { epoch: 7, lapse: None }"],
            ),
            (
                Receipt::kept,
                |r| (r.on_disk(Ok(())), r.seen(7)).1,
                &["durable", "visible", "Integrated { epoch: 7, lapse: None }"],
            ),
            (
                Receipt::kept,
                |r| (r.on_disk(Err("full".into())), r.seen(7)).1,
                &["visible", "Integrated { epoch: 7, lapse: Some(\"full\") }"],
            ),
            (
                Receipt::kept,
                |r| (r.fail(Error::Internal("x".into())), r.on_disk(Ok(())), r.seen(7)).2,
                &["Rejected(Internal(\"x\"))"],
            ),
        ];
        for (make, act, expected) in cases {
            let told = Told::default();
            act(&make(Ticket::new(Box::new(told.clone()))));
            assert_eq!(*told.0.lock().expect("not poisoned"), expected);
        }
    }
}
