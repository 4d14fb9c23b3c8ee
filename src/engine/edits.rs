//! Changes by hand on their way to the mapper thread, and what became of them.

use std::collections::VecDeque;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::task::{Context, Poll, Waker};

use crate::error::{Error, Result};
use crate::map::{Edit, Edited};

/// Edits that may wait; each keeps the thread busy by itself.
const MAX_WAITING: usize = 16;

/// An edit that waits for its turn.
pub(super) struct Wish {
    pub(super) edit: Edit,
    /// The number of the last frame that comes before it.
    after: u64,
    answer: Answer,
}

impl Wish {
    /// Tells who wished. A wish that is dropped without a word has failed.
    pub(super) fn answer(self, outcome: Result<Edited>) {
        self.answer.set(outcome);
    }
}

impl Drop for Wish {
    fn drop(&mut self) {
        self.answer.set(Err(Error::Internal("the mapper failed before this edit was done".into())));
    }
}

/// Where the outcome of an edit is left.
#[derive(Clone, Default)]
pub(super) struct Answer(Arc<Mutex<Slot>>);

#[derive(Default)]
struct Slot {
    outcome: Option<Result<Edited>>,
    is_set: bool,
    waker: Option<Waker>,
}

impl Answer {
    fn slot(&self) -> MutexGuard<'_, Slot> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// The first outcome stays.
    fn set(&self, outcome: Result<Edited>) {
        let mut slot = self.slot();
        if !std::mem::replace(&mut slot.is_set, true) {
            slot.outcome = Some(outcome);
            if let Some(waker) = slot.waker.take() {
                waker.wake();
            }
        }
    }

    /// The outcome, once.
    pub(super) fn poll(&self, context: &Context<'_>) -> Poll<Result<Edited>> {
        let mut slot = self.slot();
        if let Some(outcome) = slot.outcome.take() {
            return Poll::Ready(outcome);
        }
        slot.waker = Some(context.waker().clone());
        Poll::Pending
    }
}

/// Edits in the order in which they were wished for.
#[derive(Default)]
pub(super) struct Edits(VecDeque<Wish>);

impl Edits {
    /// Takes an edit that comes after the frame `after`.
    pub(super) fn push(&mut self, edit: Edit, after: u64) -> Result<Answer> {
        if self.0.len() >= MAX_WAITING {
            return Err(Error::ResourceExhausted {
                what: "edits that wait".into(),
                limit: format!("the limit is {MAX_WAITING}"),
            });
        }
        let answer = Answer::default();
        self.0.push_back(Wish { edit, after, answer: answer.clone() });
        Ok(answer)
    }

    /// The first one, if no frame that came before it waits; `oldest` is the first that waits.
    pub(super) fn due(&mut self, oldest: Option<u64>) -> Option<Wish> {
        let is_due = self.0.front().is_some_and(|wish| oldest.is_none_or(|n| n > wish.after));
        if is_due { self.0.pop_front() } else { None }
    }

    /// Gives all of them up.
    pub(super) fn refuse(&mut self, why: impl Fn() -> Error) {
        self.0.drain(..).for_each(|wish| wish.answer(Err(why())));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::map::Clear;

    fn edit(robot: &str) -> Edit {
        Edit::Clear(Clear { robot_id: Some(robot.into()), ..Clear::default() })
    }

    fn heard(answer: &Answer) -> Option<Result<Edited>> {
        match answer.poll(&Context::from_waker(Waker::noop())) {
            Poll::Ready(outcome) => Some(outcome),
            Poll::Pending => None,
        }
    }

    #[test]
    fn an_edit_waits_for_the_frames_before_it_and_is_answered_once() {
        let mut edits = Edits::default();
        let answers = [3, 5].map(|after| edits.push(edit("a"), after).expect("room"));
        assert!(edits.due(Some(3)).is_none(), "the third frame still waits");
        let wish = edits.due(Some(4)).expect("its turn");
        assert!(edits.due(Some(4)).is_none() && heard(&answers[0]).is_none());
        wish.answer(Ok(Edited { epoch: 7, ..Edited::default() }));
        let edited = heard(&answers[0]).expect("answered").expect("done");
        assert_eq!(edited.epoch, 7);
        assert!(heard(&answers[0]).is_none(), "once");
        drop(edits.due(None).expect("nothing waits"));
        let failed = heard(&answers[1]).expect("answered").expect_err("lost");
        assert!(failed.to_string().contains("the mapper failed"), "{failed}");
    }

    #[test]
    fn edits_are_bounded_and_can_be_given_up() {
        let mut edits = Edits::default();
        let answers: Vec<Answer> =
            (0..MAX_WAITING).map(|_| edits.push(edit("a"), 0).expect("room")).collect();
        let error = edits.push(edit("a"), 0).err().expect("no room").to_string();
        assert_eq!(error, "edits that wait: the limit is 16");
        edits.refuse(|| Error::FailedPrecondition("emptied".into()));
        for answer in &answers {
            let error = heard(answer).expect("answered").expect_err("given up");
            assert_eq!(error.to_string(), "emptied");
        }
        assert!(edits.push(edit("a"), 0).is_ok());
    }
}
