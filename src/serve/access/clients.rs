//! What each client may take: requests by a bucket that fills with time, streams by places.

use std::net::{IpAddr, Ipv6Addr};
use std::num::NonZeroU32;
use std::sync::atomic::{AtomicU64, Ordering::Relaxed};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

use governor::clock::{Clock, DefaultClock};
use governor::{DefaultDirectRateLimiter, Quota};
use rustc_hash::FxHashMap;
use tokio::sync::{OwnedSemaphorePermit, Semaphore};

use crate::config::LimitSettings;
use crate::error::Error;

/// Addresses that are told apart. At the bound those give way that have nothing under way and have not
/// asked for a while; if there are none, the rest share one client.
const MAX_ADDRESSES: usize = 4096;
const FORGOTTEN_AFTER: Duration = Duration::from_secs(60);
/// When a client may ask for another stream: nobody knows when one of its own ends.
const STREAM_RETRY: Duration = Duration::from_secs(1);

/// Somebody who asks, told by a key or by an address.
pub(super) struct Client {
    /// In logs and messages.
    pub(super) name: Arc<str>,
    limits: LimitSettings,
    /// `None`: no limit.
    rate: Option<DefaultDirectRateLimiter>,
    streams: Arc<Semaphore>,
    /// Requests that passed.
    pub(super) requests: AtomicU64,
}

impl Client {
    pub(super) fn new(name: &str, limits: LimitSettings) -> Self {
        let a_second = NonZeroU32::new(limits.requests_per_s);
        let burst = NonZeroU32::new(limits.burst);
        let rate = a_second.zip(burst).map(|(rate, burst)| {
            DefaultDirectRateLimiter::direct(Quota::per_second(rate).allow_burst(burst))
        });
        let places = match limits.streams {
            0 => Semaphore::MAX_PERMITS,
            streams => streams as usize,
        };
        let streams = Arc::new(Semaphore::new(places));
        Self { name: name.into(), limits, rate, streams, requests: AtomicU64::new(0) }
    }

    /// Takes a request out of the bucket.
    pub(super) fn ask(&self) -> Result<(), Error> {
        let Some(Err(early)) = self.rate.as_ref().map(DefaultDirectRateLimiter::check) else {
            self.requests.fetch_add(1, Relaxed);
            return Ok(());
        };
        let LimitSettings { requests_per_s, burst, .. } = self.limits;
        Err(Error::Limited {
            what: format!("requests of '{}'", self.name),
            limit: format!("the limit is {requests_per_s} a second, {burst} at once"),
            retry_after: early.wait_time_from(DefaultClock::default().now()),
        })
    }

    /// Takes a place of a stream, until the permit is dropped.
    pub(super) fn stream(&self) -> Result<OwnedSemaphorePermit, Error> {
        self.streams.clone().try_acquire_owned().map_err(|_| Error::Limited {
            what: format!("streams of '{}'", self.name),
            limit: format!("the limit is {} at a time", self.limits.streams),
            retry_after: STREAM_RETRY,
        })
    }

    fn is_streaming(&self) -> bool {
        self.limits.streams > 0 && self.streams.available_permits() < self.limits.streams as usize
    }
}

/// Those who are known by their addresses alone.
pub(super) struct Addresses {
    limits: LimitSettings,
    known: Mutex<FxHashMap<IpAddr, (Arc<Client>, Instant)>>,
    others: Arc<Client>,
}

impl Addresses {
    pub(super) fn new(limits: LimitSettings) -> Self {
        let others = Arc::new(Client::new("other addresses", limits));
        Self { limits, known: Mutex::default(), others }
    }

    /// The client at an address, or, where there is none, that of all others.
    pub(super) fn client(&self, address: Option<IpAddr>) -> Arc<Client> {
        let Some(address) = address.map(household) else { return self.others.clone() };
        let now = Instant::now();
        let mut known = self.known.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some((client, seen)) = known.get_mut(&address) {
            *seen = now;
            return client.clone();
        }
        if known.len() >= MAX_ADDRESSES {
            known.retain(|_, (client, seen)| {
                client.is_streaming() || now.duration_since(*seen) < FORGOTTEN_AFTER
            });
        }
        if known.len() >= MAX_ADDRESSES {
            return self.others.clone();
        }
        let client = Arc::new(Client::new(&address.to_string(), self.limits));
        known.insert(address, (client.clone(), now));
        client
    }
}

/// Whom an address stands for: of IPv6, one household has 2⁶⁴ of them.
fn household(address: IpAddr) -> IpAddr {
    match address.to_canonical() {
        IpAddr::V6(v6) => IpAddr::V6(Ipv6Addr::from_bits(v6.to_bits() & !u128::from(u64::MAX))),
        v4 => v4,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const LIMITS: LimitSettings = LimitSettings { requests_per_s: 1, burst: 3, streams: 2 };

    #[test]
    fn a_burst_passes_and_the_next_one_is_told_when_to_come_back() {
        let client = Client::new("ada", LIMITS);
        for _ in 0..3 {
            client.ask().expect("within the burst");
        }
        let error = client.ask().expect_err("beyond");
        assert!(error.to_string().contains("'ada'") && error.to_string().contains("1 a second"));
        let wait = error.retry_after().expect("when");
        assert!(wait > Duration::ZERO && wait <= Duration::from_secs(1), "{wait:?}");
        assert_eq!(client.requests.load(Relaxed), 3);
        let free = Client::new("free", LimitSettings { requests_per_s: 0, burst: 0, streams: 0 });
        for _ in 0..1000 {
            free.ask().expect("no limit");
        }
        let held: Vec<_> = (0..1000).map(|_| free.stream().expect("no limit")).collect();
        assert!(!free.is_streaming());
        drop(held);
    }

    #[test]
    fn a_stream_gives_its_place_back() {
        let client = Client::new("ada", LIMITS);
        let first = client.stream().expect("a place");
        let second = client.stream().expect("another");
        assert!(client.stream().expect_err("no third").to_string().contains("2 at a time"));
        drop(first);
        drop(client.stream().expect("free again"));
        assert!(client.is_streaming());
        drop(second);
        assert!(!client.is_streaming());
    }

    #[test]
    fn addresses_are_told_apart_up_to_a_bound() {
        let addresses = Addresses::new(LIMITS);
        let client = |n: u32| addresses.client(Some(IpAddr::V4(n.to_be_bytes().into())));
        let first = client(0);
        assert!(Arc::ptr_eq(&first, &client(0)) && !Arc::ptr_eq(&first, &client(1)));
        let of_one_house = ["2001:db8::1", "2001:db8::2:3"].map(|a| a.parse().expect("an address"));
        let [a, b] = of_one_house.map(|a| addresses.client(Some(a)));
        assert!(Arc::ptr_eq(&a, &b));
        for n in 0..MAX_ADDRESSES as u32 {
            client(n);
        }
        let [late, later] = [1 << 20, 1 << 21].map(client);
        assert!(Arc::ptr_eq(&late, &later), "they share what is left");
        assert_eq!(addresses.known.lock().expect("sound").len(), MAX_ADDRESSES);
    }
}
