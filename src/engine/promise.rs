//! An answer that is yet to come: kept once by the thread that works it out, awaited by one task.

use std::future::poll_fn;
use std::sync::{Arc, Mutex, PoisonError};
use std::task::{Poll, Waker};

use super::handle::stopping;
use crate::error::Result;

/// Whoever has it owes an answer. Dropping it says that the thread is stopping.
pub(super) struct Promise<T>(Arc<Mutex<Slot<T>>>);

/// Where the answer comes.
pub(super) struct Awaited<T>(Arc<Mutex<Slot<T>>>);

struct Slot<T> {
    answer: Option<Result<T>>,
    waker: Option<Waker>,
}

/// Both ends.
pub(super) fn promise<T>() -> (Promise<T>, Awaited<T>) {
    let slot = Arc::new(Mutex::new(Slot { answer: None, waker: None }));
    (Promise(slot.clone()), Awaited(slot))
}

impl<T> Promise<T> {
    pub(super) fn keep(self, answer: Result<T>) {
        self.fill(answer);
    }

    /// The first answer counts.
    fn fill(&self, answer: Result<T>) {
        let mut slot = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        slot.answer.get_or_insert(answer);
        if let Some(waker) = slot.waker.take() {
            waker.wake();
        }
    }
}

impl<T> Drop for Promise<T> {
    fn drop(&mut self) {
        self.fill(Err(stopping()));
    }
}

impl<T> Awaited<T> {
    pub(super) async fn answer(self) -> Result<T> {
        poll_fn(|context| {
            let mut slot = self.0.lock().unwrap_or_else(PoisonError::into_inner);
            match slot.answer.take() {
                Some(answer) => Poll::Ready(answer),
                None => {
                    slot.waker = Some(context.waker().clone());
                    Poll::Pending
                }
            }
        })
        .await
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[tokio::test]
    async fn an_answer_comes_and_one_that_never_comes_is_an_error() {
        let (kept, awaited) = promise();
        let waiting = tokio::spawn(awaited.answer());
        tokio::task::yield_now().await;
        kept.keep(Ok(7));
        assert_eq!(waiting.await.expect("no panic").expect("kept"), 7);
        let (broken, awaited) = promise::<u32>();
        drop(broken);
        let error = awaited.answer().await.expect_err("nobody is left").to_string();
        assert_eq!(error, "the server is stopping");
    }
}
