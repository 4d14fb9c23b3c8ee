//! ROS 2 on the session: one node, whose topics are where zenoh-bridge-ros2dds or rmw_zenoh has them.

use std::sync::Mutex;
use std::sync::atomic::{AtomicI64, AtomicUsize, Ordering::Relaxed};
use std::time::{SystemTime, UNIX_EPOCH};

use zenoh::Wait;
use zenoh::liveliness::LivelinessToken;
use zenoh::pubsub::Publisher;
use zenoh::qos::{CongestionControl, Priority};
use zenoh::query::{Query, Queryable};
use zenoh::sample::Sample;
use zenoh_ext::{AdvancedSubscriber, AdvancedSubscriberBuilderExt, HistoryConfig};

use super::{Bus, bus_error};
use crate::config::Bridge;
use crate::error::{Error, Result};
use crate::wire::ros2::{
    ANY_HASH, Attachment, Endpoint, GID_BYTES, NO_HASH, Role, Token, Type, bridge_key,
    bridge_token, gid_of, rmw_key, rmw_node_token, rmw_token,
};

/// What `ros2 node list` calls us.
const NODE: &str = "orenx";

/// Our node. Its tokens end with it.
pub struct RobotNode {
    bus: Bus,
    bridge: Bridge,
    endpoints: AtomicUsize,
    tokens: Mutex<Vec<LivelinessToken>>,
}

/// A topic that is listened to, until dropped.
pub struct TopicSubscriber {
    _subscriber: AdvancedSubscriber<()>,
}

/// A service that we answer, until dropped.
pub struct RobotService {
    _queryable: Queryable<()>,
}

/// One request of a service.
pub struct ServiceRequest {
    query: Query,
}

/// A topic that we say something on.
pub struct TopicPublisher {
    publisher: Publisher<'static>,
    /// What rmw_zenoh knows the publisher by; the bridge needs none.
    gid: Option<[u8; GID_BYTES]>,
    count: AtomicI64,
}

impl RobotNode {
    /// Joins the robots behind a bridge.
    pub async fn join(bus: &Bus, bridge: &Bridge) -> Result<Self> {
        let node = Self {
            bus: bus.clone(),
            bridge: bridge.clone(),
            endpoints: AtomicUsize::new(1),
            tokens: Mutex::default(),
        };
        if let Bridge::Rmw { domain, .. } = bridge {
            let session = bus.id();
            let token = Token { domain: *domain, session: &session, node: NODE };
            node.declare(rmw_node_token(&token)).await?;
        }
        Ok(node)
    }

    /// Listens to a topic; what its publishers keep for latecomers is heard too. `callback` is on a
    /// thread of the network, and must not wait.
    pub async fn subscribe(
        &self,
        topic: &str,
        kind: Type,
        callback: impl Fn(Sample) + Send + Sync + 'static,
    ) -> Result<TopicSubscriber> {
        let key = match &self.bridge {
            // Without a token: the bridge opens the topic for whoever listens, with the qualities of
            // the robot's own publishers; a token would demand ours of them.
            Bridge::Dds { namespace } => bridge_key(namespace, topic)?,
            Bridge::Rmw { domain, .. } => {
                self.announce(Role::Subscriber, topic, kind).await?;
                rmw_key(*domain, topic, &kind, ANY_HASH)?
            }
        };
        let subscriber = self
            .bus
            .session()
            .declare_subscriber(&key)
            .history(HistoryConfig::default().detect_late_publishers())
            .callback(callback)
            .await;
        let subscriber = subscriber.map_err(|e| bus_error(&key, &e))?;
        Ok(TopicSubscriber { _subscriber: subscriber })
    }

    /// Says something on a topic.
    pub async fn publish(&self, topic: &str, kind: Type) -> Result<TopicPublisher> {
        let token = self.announce(Role::Publisher, topic, kind).await?;
        let (key, gid) = match &self.bridge {
            Bridge::Dds { namespace } => (bridge_key(namespace, topic)?, None),
            Bridge::Rmw { domain, .. } => {
                (rmw_key(*domain, topic, &kind, self.hash(&kind))?, Some(gid_of(&token)))
            }
        };
        let publisher = self
            .bus
            .session()
            .declare_publisher(key.clone())
            .congestion_control(CongestionControl::Drop)
            .priority(Priority::DataLow)
            .await;
        let publisher = publisher.map_err(|e| bus_error(&key, &e))?;
        Ok(TopicPublisher { publisher, gid, count: AtomicI64::new(1) })
    }

    /// Answers a service. `callback` is on a thread of the network, and must not wait.
    pub async fn serve(
        &self,
        name: &str,
        kind: Type,
        callback: impl Fn(ServiceRequest) + Send + Sync + 'static,
    ) -> Result<RobotService> {
        let key = match &self.bridge {
            Bridge::Dds { namespace } => bridge_key(namespace, name)?,
            Bridge::Rmw { domain, .. } => rmw_key(*domain, name, &kind, ANY_HASH)?,
        };
        let queryable = self
            .bus
            .session()
            .declare_queryable(&key)
            // Clients ask those who know everything of their key.
            .complete(true)
            .callback(move |query| callback(ServiceRequest { query }))
            .await;
        let queryable = queryable.map_err(|e| bus_error(&key, &e))?;
        // Last: who sees it may ask.
        self.announce(Role::Server, name, kind).await?;
        Ok(RobotService { _queryable: queryable })
    }

    /// Declares the token of an endpoint.
    async fn announce(&self, role: Role, topic: &str, kind: Type) -> Result<String> {
        let session = self.bus.id();
        let token = match &self.bridge {
            Bridge::Dds { namespace } => {
                bridge_token(&session, role, &bridge_key(namespace, topic)?, &kind)
            }
            Bridge::Rmw { domain, .. } => {
                let token = Token { domain: *domain, session: &session, node: NODE };
                let endpoint = Endpoint { role, topic, kind, hash: self.hash(&kind) };
                rmw_token(&token, self.endpoints.fetch_add(1, Relaxed), &endpoint)?
            }
        };
        self.declare(token.clone()).await?;
        Ok(token)
    }

    async fn declare(&self, token: String) -> Result<()> {
        let declared = self.bus.session().liveliness().declare_token(&token).await;
        let declared = declared.map_err(|e| bus_error(&token, &e))?;
        let poisoned = |_| Error::Internal("the tokens of ROS 2 are lost".into());
        self.tokens.lock().map_err(poisoned)?.push(declared);
        Ok(())
    }

    fn hash(&self, kind: &Type) -> &'static str {
        match self.bridge {
            Bridge::Rmw { has_hashes: false, .. } => NO_HASH,
            _ => kind.hash,
        }
    }
}

impl ServiceRequest {
    /// What is asked.
    pub fn payload(&self) -> Vec<u8> {
        self.query.payload().map(|payload| payload.to_bytes().into_owned()).unwrap_or_default()
    }

    /// Answers it, on a thread that may wait. A client of rmw_zenoh knows its answer by the number and
    /// the id that came with the request.
    pub fn answer(&self, payload: Vec<u8>) {
        let reply = self.query.reply(self.query.key_expr().clone(), payload);
        let asked = self.query.attachment().map(|bytes| Attachment::from_bytes(&bytes.to_bytes()));
        let reply = match asked {
            Some(Ok(asked)) => {
                let attachment = Attachment { source_stamp_ns: now_ns(), ..asked };
                reply.attachment(attachment.to_bytes().to_vec())
            }
            // The bridge keeps account of its own.
            _ => reply,
        };
        if let Err(error) = reply.wait() {
            tracing::debug!("{}: {error}", self.query.key_expr());
        }
    }
}

fn now_ns() -> i64 {
    let now = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default();
    i64::try_from(now.as_nanos()).unwrap_or(i64::MAX)
}

impl TopicPublisher {
    /// Whether anybody listens.
    pub async fn is_heard(&self) -> bool {
        self.publisher.matching_status().await.is_ok_and(|status| status.matching())
    }

    /// Says it; a line that is full loses it.
    pub async fn put(&self, payload: Vec<u8>) {
        let put = self.publisher.put(payload);
        let put = match self.gid {
            None => put,
            Some(gid) => {
                let attachment = Attachment {
                    sequence_number: self.count.fetch_add(1, Relaxed),
                    source_stamp_ns: now_ns(),
                    gid,
                };
                put.attachment(attachment.to_bytes().to_vec())
            }
        };
        if let Err(error) = put.await {
            tracing::debug!("{}: {error}", self.publisher.key_expr());
        }
    }
}
