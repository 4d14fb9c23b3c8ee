//! Who gets in: keys and what they are good for, and how much each client may take. Both protocols pass
//! the same gate.

mod clients;
mod keys;
mod layer;
mod refusals;
mod rules;

use std::net::IpAddr;
use std::sync::atomic::Ordering::Relaxed;
use std::sync::{Arc, PoisonError, RwLock};

use tokio::sync::OwnedSemaphorePermit;
use tonic::codegen::http::{HeaderMap, header};

use self::clients::{Addresses, Client};
use self::keys::KeyRing;
use self::rules::OTHER;
use crate::config::{AccessConfig, KeyConfig, LimitSettings, Role};
use crate::error::{Error, Result};

pub(super) use self::layer::Admission;
pub(super) use self::refusals::{Refusals, Transport, Why};
pub(super) use self::rules::{Needs, RULES, Rule, place};

/// The header of a key; the other is `authorization: Bearer KEY`.
pub(super) const KEY_HEADER: &str = "api-key";

/// The gate of one server.
pub(super) struct Gate {
    /// Empty: nobody has to say who they are.
    keys: Vec<KeyConfig>,
    ring: RwLock<Arc<KeyRing>>,
    /// Those with keys, in the same order.
    clients: Vec<Arc<Client>>,
    addresses: Addresses,
    pub(super) refusals: Refusals,
}

/// What comes to the gate.
pub(super) struct Asked<'a> {
    pub(super) transport: Transport,
    /// The row of the table; `None` where there is no such path at all.
    pub(super) rule: Option<&'a Rule>,
    pub(super) headers: &'a HeaderMap,
    pub(super) peer: Option<IpAddr>,
}

/// Who got in.
#[derive(Debug)]
pub(super) struct Admitted {
    /// The name of the key, or an address.
    pub(super) client: Arc<str>,
    /// To be held as long as the answer goes on.
    pub(super) place: Option<OwnedSemaphorePermit>,
}

impl Gate {
    /// Reads the keys.
    pub(super) fn new(access: &AccessConfig) -> Result<Self> {
        let AccessConfig { keys, limits, .. } = access;
        let client = |key: &KeyConfig| Arc::new(Client::new(&key.name, *limits));
        Ok(Self {
            ring: RwLock::new(Arc::new(KeyRing::read(keys)?)),
            clients: keys.iter().map(client).collect(),
            keys: keys.clone(),
            addresses: Addresses::new(*limits),
            refusals: Refusals::default(),
        })
    }

    /// A gate that is open to everyone, within the usual limits.
    pub(super) fn open() -> Self {
        Self {
            keys: Vec::new(),
            ring: RwLock::new(Arc::new(KeyRing::none())),
            clients: Vec::new(),
            addresses: Addresses::new(LimitSettings::default()),
            refusals: Refusals::default(),
        }
    }

    /// Reads the keys again; whether one changed. If one cannot be read, all stay as they are.
    pub(super) fn renew(&self) -> Result<bool> {
        let fresh = KeyRing::read(&self.keys)?;
        let mut ring = self.ring.write().unwrap_or_else(PoisonError::into_inner);
        let is_new = **ring != fresh;
        *ring = Arc::new(fresh);
        Ok(is_new)
    }

    /// Lets a call in, or says why not. Only what needs nothing and streams nothing passes uncounted:
    /// probes answer when nothing else does.
    pub(super) fn admit(&self, asked: &Asked) -> Result<Admitted> {
        // A path that is none may be asked for by whoever has a key: the answer is that it is none.
        let (needs, is_stream) =
            asked.rule.map_or((Needs::AnyKey, false), |rule| (rule.needs, rule.is_stream));
        let client = match needs {
            Needs::Nothing => self.addresses.client(asked.peer),
            _ => self.client(asked, needs)?,
        };
        let place = match is_stream {
            true => Some(client.stream().inspect_err(|_| self.count(asked, Why::Streams))?),
            false => None,
        };
        Ok(Admitted { client: client.name.clone(), place })
    }

    /// How many requests of each key passed.
    pub(super) fn requests(&self) -> impl Iterator<Item = (&str, u64)> {
        self.clients.iter().map(|client| (&*client.name, client.requests.load(Relaxed)))
    }

    fn count(&self, asked: &Asked, why: Why) {
        self.refusals.count(asked.transport, why);
    }

    /// Who asks, if they may.
    fn client(&self, asked: &Asked, needs: Needs) -> Result<Arc<Client>> {
        let ask = |client: &Client| client.ask().inspect_err(|_| self.count(asked, Why::Requests));
        if self.keys.is_empty() {
            let client = self.addresses.client(asked.peer);
            ask(&client)?;
            return Ok(client);
        }
        let (client, role) = match self.known(asked.headers) {
            Ok(known) => known,
            Err((why, problem)) => {
                // Guesses are bounded as requests are.
                ask(&self.addresses.client(asked.peer))?;
                self.count(asked, why);
                return Err(problem);
            }
        };
        ask(client)?;
        if !needs.is_met_by(role) {
            self.count(asked, Why::Role);
            let (name, role, needs) = (&client.name, role.name(), needs.name());
            return Err(Error::PermissionDenied(format!(
                "this needs a key of the role {needs}; '{name}' has {role}"
            )));
        }
        Ok(client.clone())
    }

    /// Whose key is in the headers.
    fn known(
        &self,
        headers: &HeaderMap,
    ) -> std::result::Result<(&Arc<Client>, Role), (Why, Error)> {
        let key = key_of(headers).ok_or_else(|| {
            let problem = format!(
                "this server needs a key, in the header `{KEY_HEADER}: KEY` or `authorization: Bearer KEY`"
            );
            (Why::NoKey, Error::Unauthenticated(problem))
        })?;
        let ring = self.ring.read().unwrap_or_else(PoisonError::into_inner).clone();
        let known =
            ring.find(key).and_then(|at| Some((self.clients.get(at)?, self.keys.get(at)?.role)));
        known.ok_or_else(|| {
            (Why::UnknownKey, Error::Unauthenticated("the key is none of this server's".into()))
        })
    }
}

/// The key in a request's headers.
fn key_of(headers: &HeaderMap) -> Option<&[u8]> {
    if let Some(key) = headers.get(KEY_HEADER) {
        return Some(key.as_bytes());
    }
    let (scheme, key) = headers.get(header::AUTHORIZATION)?.to_str().ok()?.split_once(' ')?;
    scheme.eq_ignore_ascii_case("bearer").then(|| key.trim().as_bytes())
}

/// The row of a call, or that of what nobody gave one.
pub(super) fn rule(method: &str, path: &str) -> &'static Rule {
    place(method, path).and_then(|at| RULES.get(at)).unwrap_or(&OTHER)
}

#[cfg(test)]
mod tests;
