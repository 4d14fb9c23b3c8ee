//! Questions over Zenoh: `<prefix>/<map>/q/<verb>`, each answered by one reply or one error.

use std::sync::Arc;
use std::time::Duration;

use prost::Message;
use tokio::runtime::Handle;
use tokio::sync::{OwnedSemaphorePermit, Semaphore};
use tonic::Code;
use zenoh::Wait;
use zenoh::bytes::ZBytes;
use zenoh::query::{Query, Queryable};

use super::Tally;
use super::verbs::{Answer, answer, request_of};
use super::watches::Watches;
use crate::bus::{Bus, Slices, bus_error, check_encoding, encoding_of};
use crate::error::{Error, Result};
use crate::service::Service;
use crate::wire::{Codes, MAX_MESSAGE_BYTES, refusal_to_wire};

/// In the selector of a question: how long it may take.
const TIMEOUT: &str = "timeout_ms";
/// Memory of all questions that are worked on, KiB: four of the largest.
const MEMORY_KIB: usize = 4 * (MAX_MESSAGE_BYTES >> 10);
/// How long answers under way may take on the way down.
const LAST_ANSWERS: Duration = Duration::from_secs(2);

/// Answers questions until it is closed.
pub(super) struct Questions {
    queryable: Queryable<()>,
    desk: Arc<Desk>,
}

struct Desk {
    service: Arc<Service>,
    tally: Arc<Tally>,
    bus: Bus,
    map_id: String,
    watches: Watches,
    places: Arc<Semaphore>,
    /// In KiB.
    memory: Arc<Semaphore>,
    runtime: Handle,
}

/// What a question takes of the bounds.
struct Room {
    _place: OwnedSemaphorePermit,
    _memory: OwnedSemaphorePermit,
}

impl Questions {
    /// Answers every verb about one map. Called within a runtime.
    pub(super) async fn declare(
        bus: &Bus,
        service: &Arc<Service>,
        map_id: &str,
        tally: &Arc<Tally>,
    ) -> Result<Self> {
        let desk = Arc::new(Desk {
            service: service.clone(),
            tally: tally.clone(),
            bus: bus.clone(),
            map_id: map_id.into(),
            watches: Watches::new(bus, map_id),
            places: Arc::new(Semaphore::new(bus.config().max_queries)),
            memory: Arc::new(Semaphore::new(MEMORY_KIB)),
            runtime: Handle::current(),
        });
        let callback = {
            let desk = desk.clone();
            move |query| desk.take(query)
        };
        let key = bus.keys().questions(map_id);
        let queryable = bus.session().declare_queryable(&key).complete(true).callback(callback);
        let queryable = queryable.await.map_err(|e| bus_error(&key, &e))?;
        Ok(Self { queryable, desk })
    }

    /// Takes no more questions, and waits a little for the answers that are under way.
    pub(super) async fn close(self) {
        let Self { queryable, desk } = self;
        if let Err(error) = queryable.undeclare().await {
            tracing::debug!("questions over Zenoh: {error}");
        }
        let all = desk.bus.config().max_queries as u32;
        if tokio::time::timeout(LAST_ANSWERS, desk.places.acquire_many(all)).await.is_err() {
            tracing::debug!("some answers were not ready within {LAST_ANSWERS:?}");
        }
        desk.watches.close(LAST_ANSWERS).await;
    }
}

impl Desk {
    /// A question, on a thread of the network, which must not work on it.
    fn take(self: &Arc<Self>, query: Query) {
        match self.room_for(&query) {
            Ok(room) => {
                self.runtime.spawn(self.clone().serve(query, room));
            }
            Err(error) => self.say(&query, Err(error)),
        }
    }

    /// A place and memory, until the question is answered.
    fn room_for(&self, query: &Query) -> Result<Room> {
        let exhausted =
            |limit: String| Error::ResourceExhausted { what: "questions over Zenoh".into(), limit };
        let most = self.bus.config().max_queries;
        let place =
            self.places.clone().try_acquire_owned().map_err(|_| {
                exhausted(format!("{most} are worked on already (zenoh.max_queries)"))
            })?;
        let size_kib = query.payload().map_or(0, |payload| payload.len() >> 10);
        let size_kib = u32::try_from(size_kib.min(MEMORY_KIB)).unwrap_or(u32::MAX);
        let memory = self.memory.clone().try_acquire_many_owned(size_kib).map_err(|_| {
            exhausted(format!("those that are worked on take all of {MEMORY_KIB} KiB"))
        })?;
        Ok(Room { _place: place, _memory: memory })
    }

    async fn serve(self: Arc<Self>, query: Query, room: Room) {
        let answered = self.answer(&query).await;
        // Sending waits where the line is full, and so goes to a thread that may.
        let sending = tokio::task::spawn_blocking(move || {
            self.say(&query, answered);
            drop(room);
        });
        if sending.await.is_err() {
            tracing::error!("sending an answer over Zenoh failed");
        }
    }

    async fn answer(&self, query: &Query) -> Result<Answer> {
        let verb = self.verb(query);
        let allowed = self.time_allowed(query)?;
        let empty = ZBytes::default();
        let payload = query.payload().unwrap_or(&empty);
        if payload.len() > MAX_MESSAGE_BYTES {
            let problem = format!("{} bytes; the limit is {MAX_MESSAGE_BYTES}", payload.len());
            return Err(Error::invalid("message", problem));
        }
        if let (Some(encoding), Some(request)) = (query.encoding(), request_of(verb)) {
            check_encoding(encoding, request)?;
        }
        let answering = async {
            match self.watches.begin(&self.service, verb, Slices::of(payload)).await {
                Some(begun) => begun,
                None => answer(&self.service, &self.map_id, verb, Slices::of(payload)).await,
            }
        };
        let late = |_| Error::DeadlineExceeded(format!("no answer within {allowed:?}"));
        tokio::time::timeout(allowed, answering).await.map_err(late)?
    }

    /// The last chunk of the key.
    fn verb<'a>(&self, query: &'a Query) -> &'a str {
        query.key_expr().as_str().rsplit('/').next().unwrap_or_default()
    }

    fn time_allowed(&self, query: &Query) -> Result<Duration> {
        let Some(text) = query.parameters().get(TIMEOUT) else {
            return Ok(self.bus.config().query_timeout);
        };
        match text.parse() {
            Ok(ms @ 1..=3_600_000) => Ok(Duration::from_millis(ms)),
            _ => Err(Error::invalid(TIMEOUT, "must be a whole number within 1..=3600000")),
        }
    }

    /// Counts and sends.
    fn say(&self, query: &Query, answered: Result<Answer>) {
        let verb = self.verb(query);
        let code = answered.as_ref().map_or_else(|e| Codes::of(e.status()).grpc, |_| Code::Ok);
        self.tally.count(verb, i32::from(code) as usize);
        let said = match answered {
            Ok(Answer { message, bytes }) => {
                let key = self.bus.keys().question(&self.map_id, verb);
                query.reply(key, bytes).encoding(encoding_of(message)).wait()
            }
            Err(error) => {
                let refusal = refusal_to_wire(&error).encode_to_vec();
                query.reply_err(refusal).encoding(encoding_of("QueryError")).wait()
            }
        };
        if let Err(error) = said {
            tracing::debug!("an answer to {verb} over Zenoh: {error}");
        }
    }
}
