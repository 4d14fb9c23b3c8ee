//! Bodies in and out: bounded in bytes, in time and all together.

use std::collections::VecDeque;
use std::convert::Infallible;
use std::pin::Pin;
use std::sync::Arc;
use std::task::{Context, Poll};

use axum::body::Body;
use bytemuck::Pod;
use bytes::Bytes;
use http_body::{Body as _, Frame, SizeHint};
use http_body_util::BodyExt;
use tokio::sync::{OwnedSemaphorePermit, Semaphore};

use super::limits::Limits;
use super::refusal::Refusal;
use crate::error::Error;

/// What a share of the memory for bodies is counted in, bytes.
const UNIT_BYTES: usize = 1024;

/// The memory for bodies under way.
pub(super) fn memory(limits: &Limits) -> Arc<Semaphore> {
    Arc::new(Semaphore::new(limits.body_bytes.div_ceil(UNIT_BYTES)))
}

/// A body that has arrived as values of one type, with its share of the memory. The share is kept
/// until the answer has left.
#[derive(Debug)]
pub(super) struct Received<T> {
    /// The last one is padded with zeros if the body ends inside it.
    pub(super) values: Vec<T>,
    pub(super) bytes: usize,
    pub(super) share: Share,
}

/// The largest body of a kind, and what it is for.
#[derive(Debug, Clone)]
pub(super) struct Most {
    pub(super) bytes: usize,
    pub(super) what: String,
}

impl Most {
    /// A body of as many points as there may be.
    pub(super) fn points(bytes: usize, max_points: usize) -> Self {
        Self { bytes, what: format!("{max_points} points (server.max_points)") }
    }
}

/// A part of the memory for bodies, given back when it is dropped.
#[derive(Debug)]
pub(super) struct Share {
    memory: Arc<Semaphore>,
    held: Option<OwnedSemaphorePermit>,
    bytes: usize,
}

impl Share {
    pub(super) fn new(memory: &Arc<Semaphore>) -> Self {
        Self { memory: memory.clone(), held: None, bytes: 0 }
    }

    /// What it holds.
    pub(super) fn bytes(&self) -> usize {
        self.bytes
    }

    /// Makes room for `bytes` in all, or refuses: whoever waited would hold what others wait for.
    pub(super) fn grow(&mut self, bytes: usize) -> Result<(), Refusal> {
        let units = bytes.div_ceil(UNIT_BYTES) - self.bytes.div_ceil(UNIT_BYTES);
        let more = u32::try_from(units)
            .ok()
            .and_then(|units| self.memory.clone().try_acquire_many_owned(units).ok());
        let Some(more) = more else {
            return Err(Refusal::from(Error::ResourceExhausted {
                what: "bodies under way".into(),
                limit: format!("{bytes} bytes do not fit beside the others"),
            }));
        };
        match &mut self.held {
            Some(held) => held.merge(more),
            None => self.held = Some(more),
        }
        self.bytes = bytes;
        Ok(())
    }
}

impl Share {
    /// A share of so many bytes, once there is room. Only for who holds nothing that others wait for.
    pub(super) async fn wait(memory: &Arc<Semaphore>, bytes: usize) -> Result<Self, Refusal> {
        let units = u32::try_from(bytes.div_ceil(UNIT_BYTES)).unwrap_or(u32::MAX);
        let held = memory.clone().acquire_many_owned(units).await;
        let held = held.map_err(|_| Error::Unavailable("the server is stopping".into()))?;
        Ok(Self { memory: memory.clone(), held: Some(held), bytes })
    }
}

/// Reads a body of at most so many bytes straight into the memory of its values, so that they are
/// aligned and copied once.
pub(super) async fn receive<T: Pod>(
    body: Body,
    most: Most,
    limits: &Limits,
    memory: &Arc<Semaphore>,
) -> Result<Received<T>, Refusal> {
    let filled = fill(body, most, Share::new(memory));
    tokio::time::timeout(limits.body_time, filled).await.unwrap_or_else(|_| {
        Err(Refusal::too_slow(format!("did not arrive within {:?}", limits.body_time)))
    })
}

async fn fill<T: Pod>(
    mut body: Body,
    Most { bytes: most, what }: Most,
    mut share: Share,
) -> Result<Received<T>, Refusal> {
    let too_large =
        |bytes: u64| Refusal::too_large(format!("{bytes} bytes; the limit is {most}, for {what}"));
    let expected = body.size_hint().lower();
    if expected > most as u64 {
        return Err(too_large(expected));
    }
    share.grow(expected as usize)?;
    let mut values = vec![T::zeroed(); (expected as usize).div_ceil(size_of::<T>())];
    let mut bytes = 0;
    while let Some(frame) = body.frame().await {
        let frame = frame.map_err(|error| Error::invalid("body", error.to_string()))?;
        let Ok(data) = frame.into_data() else { continue };
        let end = bytes + data.len();
        if end > most {
            return Err(too_large(end as u64));
        }
        if end > values.len() * size_of::<T>() {
            // Of unknown length: grows by doubling.
            let room = end.max((2 * bytes).min(most));
            share.grow(room)?;
            values.resize(room.div_ceil(size_of::<T>()), T::zeroed());
        }
        bytemuck::cast_slice_mut(&mut values)[bytes..end].copy_from_slice(&data);
        bytes = end;
    }
    values.truncate(bytes.div_ceil(size_of::<T>()));
    Ok(Received { values, bytes, share })
}

/// An answer in parts that are sent as they are.
pub(super) struct Parts {
    parts: VecDeque<Bytes>,
    _share: Share,
}

impl Parts {
    pub(super) fn new(parts: Vec<Bytes>, share: Share) -> Self {
        Self { parts: parts.into(), _share: share }
    }
}

impl http_body::Body for Parts {
    type Data = Bytes;
    type Error = Infallible;

    fn poll_frame(
        mut self: Pin<&mut Self>,
        _context: &mut Context<'_>,
    ) -> Poll<Option<Result<Frame<Bytes>, Infallible>>> {
        Poll::Ready(self.parts.pop_front().map(|part| Ok(Frame::data(part))))
    }

    fn is_end_stream(&self) -> bool {
        self.parts.is_empty()
    }

    fn size_hint(&self) -> SizeHint {
        SizeHint::with_exact(self.parts.iter().map(|part| part.len() as u64).sum())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn parts(bytes: &'static [&'static [u8]]) -> Body {
        let share = Share::new(&Arc::new(Semaphore::new(0)));
        let parts = bytes.iter().map(|part| Bytes::from_static(part)).collect();
        // Hides its length, as a chunked body does.
        Body::new(Parts::new(parts, share).map_frame(|frame| frame).boxed_unsync())
    }

    fn limits() -> Limits {
        Limits { body_bytes: 4096, ..Limits::new(100, 100) }
    }

    fn most() -> Most {
        Most::points(100, 8)
    }

    #[tokio::test]
    async fn values_arrive_whole_however_they_are_cut() {
        let (limits, memory) = (limits(), Arc::new(Semaphore::new(4)));
        let body = parts(&[&[1, 0, 0], &[0], &[], &[2, 0, 0, 0, 3], &[9]]);
        let received = receive::<u32>(body, most(), &limits, &memory).await.expect("small");
        assert_eq!((received.bytes, &received.values[..]), (10, &[1, 2, 0x0903][..]));
        assert_eq!(memory.available_permits(), 3);
        drop(received);
        assert_eq!(memory.available_permits(), 4);
        let none = receive::<u32>(Body::empty(), most(), &limits, &memory).await.expect("empty");
        assert!(none.values.is_empty());
    }

    #[tokio::test]
    async fn what_does_not_fit_is_refused_with_its_limit() {
        let (limits, memory) = (limits(), Arc::new(Semaphore::new(1)));
        for body in [parts(&[&[0; 60], &[0; 60]]), Body::from(vec![0; 101])] {
            let refusal =
                receive::<u8>(body, most(), &limits, &memory).await.expect_err("too large");
            assert!(format!("{refusal:?}").contains("the limit is 100"), "{refusal:?}");
        }
        let first = receive::<u8>(Body::from(vec![0; 80]), most(), &limits, &memory).await;
        let second = receive::<u8>(Body::from(vec![0; 80]), most(), &limits, &memory).await;
        let refusal = second.expect_err("no memory left");
        assert!(format!("{refusal:?}").contains("RESOURCE_EXHAUSTED"), "{refusal:?}");
        drop(first);
        assert!(receive::<u8>(Body::from(vec![0; 80]), most(), &limits, &memory).await.is_ok());
    }

    #[tokio::test]
    async fn a_body_that_does_not_come_is_given_up() {
        let limits = Limits { body_time: std::time::Duration::from_millis(1), ..limits() };
        let silent = http_body_util::StreamBody::new(tokio_stream::pending::<
            Result<Frame<Bytes>, Infallible>,
        >());
        let memory = Arc::new(Semaphore::new(1));
        let refusal = receive::<u8>(Body::new(silent), most(), &limits, &memory).await;
        assert!(format!("{:?}", refusal.expect_err("silent")).contains("1ms"));
    }
}
