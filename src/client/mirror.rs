//! A map in this process that follows a server's: questions cost what they cost there, and no way to
//! it and back.

use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use tokio::sync::oneshot;
use tonic::Streaming;

use super::{Client, Credentials};
use crate::error::{Error, Result};
use crate::map::{Copying, MapView, Part};
use crate::wire::v1::mirror_client::MirrorClient;
use crate::wire::v1::mirror_message::Message;
use crate::wire::{
    MAX_MESSAGE_BYTES, Subscription, error_from_status, head_from_wire, subscription_to_wire, v1,
};

/// The pause before a server that was lost is looked for again, at first and at most.
const FIRST_PAUSE: Duration = Duration::from_millis(100);
const LONGEST_PAUSE: Duration = Duration::from_secs(2);

/// Follows a map on a thread of its own. A server that was lost is looked for until it is there again,
/// and the last view stays meanwhile. No runtime is needed to use it.
///
/// ```no_run
/// # use orenx::{client::Mirror, map::Fields};
/// # fn main() -> orenx::error::Result<()> {
/// let mirror = Mirror::open("grpc://127.0.0.1:7610", "default")?;
/// let view = mirror.view();
/// let answers = view.query(&[glam::Vec3::ZERO], Fields::ALL);
/// println!("{} m at epoch {}", answers.distance[0], view.epoch());
/// # Ok(())
/// # }
/// ```
pub struct Mirror {
    shared: Arc<Shared>,
    first: Arc<MapView>,
    stop: Option<oneshot::Sender<()>>,
    thread: Option<JoinHandle<()>>,
}

/// How a mirror is.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct MirrorState {
    /// Whether the server tells of new views.
    pub is_connected: bool,
    /// How often it began anew with the whole map, the first time included.
    pub starts: u64,
    /// Why it is not connected.
    pub problem: Option<String>,
}

#[derive(Default)]
struct Shared {
    inner: Mutex<Inner>,
    bell: Condvar,
}

#[derive(Default)]
struct Inner {
    view: Option<Arc<MapView>>,
    state: MirrorState,
    failure: Option<Error>,
}

impl Mirror {
    /// Follows a whole map of a server, as in `grpc://127.0.0.1:7610`; returns with its first view.
    pub fn open(url: &str, map_id: &str) -> Result<Self> {
        Self::follow(url, Subscription::whole(map_id))
    }

    /// Follows what is asked for; returns with the first view.
    pub fn follow(url: &str, asked: Subscription) -> Result<Self> {
        Self::follow_with(url, asked, Credentials::default())
    }

    /// The same, with what a server asks for.
    pub fn follow_with(url: &str, asked: Subscription, credentials: Credentials) -> Result<Self> {
        let runtime = tokio::runtime::Builder::new_current_thread()
            .enable_all()
            .build()
            .map_err(|e| Error::Internal(format!("cannot start a runtime: {e}")))?;
        let shared = Arc::<Shared>::default();
        let (stop, stopped) = oneshot::channel();
        let (followed, url) = (shared.clone(), url.to_owned());
        let thread = std::thread::Builder::new()
            .name("orenx-mirror".into())
            .spawn(move || {
                runtime.block_on(async {
                    tokio::select! {
                        _ = stopped => {}
                        () = followed.follow(&url, &asked, &credentials) => {}
                    }
                });
            })
            .map_err(|e| Error::Internal(format!("a mirror's thread did not start: {e}")))?;
        // Dropping `stop` ends the thread.
        let first = shared.first_view()?;
        Ok(Self { shared, first, stop: Some(stop), thread: Some(thread) })
    }

    /// The newest view that is here whole.
    pub fn view(&self) -> Arc<MapView> {
        self.shared.inner().view.clone().unwrap_or_else(|| self.first.clone())
    }

    /// A view of `epoch` or a later one; `None` if none has come within `patience`.
    pub fn view_since(&self, epoch: u64, patience: Duration) -> Option<Arc<MapView>> {
        let until = Instant::now() + patience;
        let mut inner = self.shared.inner();
        loop {
            if let Some(view) = inner.view.as_ref().filter(|view| view.epoch() >= epoch) {
                return Some(view.clone());
            }
            let left = until.checked_duration_since(Instant::now())?;
            let waited = self.shared.bell.wait_timeout(inner, left);
            inner = waited.unwrap_or_else(PoisonError::into_inner).0;
        }
    }

    /// How it is.
    pub fn state(&self) -> MirrorState {
        self.shared.inner().state.clone()
    }
}

impl Drop for Mirror {
    fn drop(&mut self) {
        drop(self.stop.take());
        if let Some(thread) = self.thread.take()
            && thread.join().is_err()
        {
            tracing::error!("a mirror's thread failed");
        }
    }
}

impl Shared {
    fn inner(&self) -> MutexGuard<'_, Inner> {
        self.inner.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Waits for the first view or the first failure.
    fn first_view(&self) -> Result<Arc<MapView>> {
        let mut inner = self.inner();
        loop {
            if let Some(view) = &inner.view {
                return Ok(view.clone());
            }
            if let Some(failure) = inner.failure.take() {
                return Err(failure);
            }
            inner = self.bell.wait(inner).unwrap_or_else(PoisonError::into_inner);
        }
    }

    async fn follow(&self, url: &str, asked: &Subscription, credentials: &Credentials) {
        let mut pause = FIRST_PAUSE;
        loop {
            let starts = self.inner().state.starts;
            let Err(error) = self.follow_once(url, asked, credentials).await;
            if self.lose(error) > starts {
                pause = FIRST_PAUSE;
            }
            tokio::time::sleep(pause).await;
            pause = (2 * pause).min(LONGEST_PAUSE);
        }
    }

    /// Says why the server does not tell any more; how often it began.
    fn lose(&self, error: Error) -> u64 {
        let mut inner = self.inner();
        if inner.state.is_connected {
            tracing::warn!(%error, "a mirror lost its server");
        }
        inner.state.is_connected = false;
        inner.state.problem = Some(error.to_string());
        inner.failure = Some(error);
        self.bell.notify_all();
        inner.state.starts
    }

    /// Follows until something goes wrong.
    async fn follow_once(
        &self,
        url: &str,
        asked: &Subscription,
        credentials: &Credentials,
    ) -> Result<Never> {
        let mut messages = Client::connect_with(url, credentials).await?.subscribe(asked).await?;
        let mut copying: Option<Copying> = None;
        let mut told: Option<Arc<MapView>> = None;
        loop {
            let message = messages.message().await.map_err(|status| error_from_status(&status))?;
            let Some(message) = message.and_then(|message| message.message) else {
                return Err(Error::Unavailable("the server ended the mirror".into()));
            };
            match (message, &mut copying) {
                (Message::Head(head), None) => {
                    let head = head_from_wire(head, told.as_ref().map(|view| view.config()))?;
                    copying = Some(Copying::start(head, told.as_deref())?);
                }
                (Message::Part(part), Some(copying)) => copying.take(&Part::try_from(part)?)?,
                (Message::End(_), Some(_)) => {
                    if let Some(copying) = copying.take() {
                        let view = Arc::new(copying.finish()?);
                        self.show(view.clone(), told.is_none());
                        told = Some(view);
                    }
                }
                _ => return Err(Error::corrupt("mirror", "messages came in a wrong order")),
            }
        }
    }

    fn show(&self, view: Arc<MapView>, begins: bool) {
        let mut inner = self.inner();
        let old = inner.view.replace(view);
        inner.state.is_connected = true;
        inner.state.problem = None;
        inner.state.starts += u64::from(begins);
        drop(inner);
        self.bell.notify_all();
        drop(old);
    }
}

/// What is never returned.
enum Never {}

impl Client {
    /// The views of a map, as messages.
    async fn subscribe(&self, asked: &Subscription) -> Result<Streaming<v1::MirrorMessage>> {
        let messages = MirrorClient::new(self.channel.clone())
            .max_decoding_message_size(MAX_MESSAGE_BYTES)
            .subscribe(subscription_to_wire(asked))
            .await
            .map_err(|status| error_from_status(&status))?;
        Ok(messages.into_inner())
    }
}
