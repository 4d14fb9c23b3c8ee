//! How many were refused, and why.

use std::sync::atomic::{AtomicU64, Ordering::Relaxed};

/// What somebody speaks.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(in crate::serve) enum Transport {
    Grpc,
    Http,
}

impl Transport {
    const ALL: [Self; 2] = [Self::Grpc, Self::Http];

    pub(in crate::serve) fn name(self) -> &'static str {
        match self {
            Self::Grpc => "grpc",
            Self::Http => "http",
        }
    }
}

/// Why somebody did not get in.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(in crate::serve) enum Why {
    /// There was no key.
    NoKey,
    /// The key is nobody's.
    UnknownKey,
    /// The key is of another role.
    Role,
    /// Too many requests a second.
    Requests,
    /// Too many streams at a time.
    Streams,
    /// The connection did not become one of TLS: no TLS at all, a certificate that is not accepted, or
    /// none, or no end of it in time.
    Tls,
    /// The connection said nothing that was understood in time.
    Silent,
}

impl Why {
    const ALL: [Self; 7] = [
        Self::NoKey,
        Self::UnknownKey,
        Self::Role,
        Self::Requests,
        Self::Streams,
        Self::Tls,
        Self::Silent,
    ];

    /// As the metrics spell it.
    fn name(self) -> &'static str {
        match self {
            Self::NoKey => "no_key",
            Self::UnknownKey => "unknown_key",
            Self::Role => "role",
            Self::Requests => "requests",
            Self::Streams => "streams",
            Self::Tls => "tls",
            Self::Silent => "silent",
        }
    }
}

/// The counters.
#[derive(Debug, Default)]
pub(in crate::serve) struct Refusals([[AtomicU64; Why::ALL.len()]; Transport::ALL.len()]);

impl Refusals {
    pub(in crate::serve) fn count(&self, transport: Transport, why: Why) {
        self.0[transport as usize][why as usize].fetch_add(1, Relaxed);
    }

    /// Every counter with its transport and reason, those that are still 0 included.
    pub(in crate::serve) fn read(
        &self,
    ) -> impl Iterator<Item = (&'static str, &'static str, u64)> + '_ {
        Transport::ALL.into_iter().flat_map(move |transport| {
            let count = move |why: Why| self.0[transport as usize][why as usize].load(Relaxed);
            Why::ALL.into_iter().map(move |why| (transport.name(), why.name(), count(why)))
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_has_a_counter_of_its_own() {
        let refusals = Refusals::default();
        for transport in Transport::ALL {
            for why in Why::ALL {
                refusals.count(transport, why);
            }
        }
        refusals.count(Transport::Http, Why::Role);
        for (transport, why, count) in refusals.read() {
            let expected = if (transport, why) == ("http", "role") { 2 } else { 1 };
            assert_eq!(count, expected, "{transport} {why}");
        }
    }
}
