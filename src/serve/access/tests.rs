//! Keys, roles and limits at the gate itself.

use std::net::Ipv4Addr;

use tonic::codegen::http::{HeaderName, HeaderValue};

use super::*;
use crate::config::{ServerConfig, Settings};

const READ: &str = "read-0123456789abcdef";
const ADMIN: &str = "admin-0123456789abcdef";

fn gate(more: &str) -> Gate {
    let key = |name: &str, key: &str| {
        format!("[[auth.keys]]\nname = \"{name}\"\nrole = \"{name}\"\nkey = \"{key}\"\n")
    };
    let text = key("read", READ) + &key("admin", ADMIN) + more;
    let settings = Settings::parse(&text, "test").expect("parses");
    Gate::new(&ServerConfig::from_settings(&settings).expect("good").0.access).expect("keys")
}

fn ask(gate: &Gate, rule: Option<&Rule>, header: Option<(&'static str, &str)>) -> Result<Admitted> {
    let header = header.map(|(name, value)| {
        (HeaderName::from_static(name), HeaderValue::from_str(value).expect("a header"))
    });
    let headers: HeaderMap = header.into_iter().collect();
    let peer = Some(IpAddr::V4(Ipv4Addr::LOCALHOST));
    gate.admit(&Asked { transport: Transport::Http, rule, headers: &headers, peer })
}

fn refused(gate: &Gate, why: &str) -> u64 {
    let found = gate.refusals.read().find(|(transport, of, _)| (*transport, *of) == ("http", why));
    found.expect("a counter").2
}

#[test]
fn a_key_opens_what_its_role_is_for() {
    let gate = gate("");
    let (points, reset) =
        (rule("POST", "/v1/maps/{map}/query/points"), rule("POST", "/v1/maps/{map}/reset"));
    let bearer = format!("bearer {READ}");
    for header in [("api-key", READ), ("authorization", &bearer)] {
        assert_eq!(&*ask(&gate, Some(points), Some(header)).expect("may").client, "read");
        let error = ask(&gate, Some(reset), Some(header)).expect_err("may not");
        assert!(matches!(error, Error::PermissionDenied(_)), "{error}");
        assert!(!error.to_string().contains(READ), "{error}");
    }
    ask(&gate, Some(reset), Some(("api-key", ADMIN))).expect("may");
    ask(&gate, None, Some(("api-key", READ))).expect("is told that there is no such path");
    let basic = format!("basic {READ}");
    for header in [None, Some(("authorization", READ)), Some(("authorization", basic.as_str()))] {
        let error = ask(&gate, Some(points), header).expect_err("no key");
        assert!(matches!(error, Error::Unauthenticated(_)), "{error}");
        ask(&gate, None, header).expect_err("not even that");
    }
    ask(&gate, Some(points), Some(("api-key", "wrong"))).expect_err("no key of ours");
    assert_eq!([refused(&gate, "role"), refused(&gate, "no_key")], [2, 6]);
    assert_eq!(refused(&gate, "unknown_key"), 1);
    ask(&gate, Some(rule("GET", "/healthz")), None).expect("a probe");
    let missing = rule("POST", "/orenx.v1.Maps/Explode");
    ask(&gate, Some(missing), Some(("api-key", READ))).expect_err("for administrators");
}

#[test]
fn limits_are_those_of_each_key_and_of_who_guesses() {
    let gate = gate("[limits]\nrequests_per_s = 1\nburst = 2\nstreams = 1\n");
    let points = Some(rule("POST", "/orenx.v1.Query/QueryPoints"));
    for (key, burst) in [(READ, 2), (ADMIN, 2), ("wrong-0123456789", 2)] {
        for _ in 0..burst {
            assert!(!matches!(
                ask(&gate, points, Some(("api-key", key))),
                Err(Error::Limited { .. })
            ));
        }
        let error = ask(&gate, points, Some(("api-key", key))).expect_err("too often");
        assert!(error.retry_after().is_some(), "{error}");
    }
    assert_eq!([refused(&gate, "requests"), refused(&gate, "unknown_key")], [3, 2]);
    for _ in 0..10 {
        ask(&gate, Some(rule("GET", "/readyz")), None).expect("probes always answer");
    }
    let watch = Some(rule("POST", "/grpc.health.v1.Health/Watch"));
    let held = ask(&gate, watch, None).expect("a stream");
    ask(&gate, watch, None).expect_err("a second one");
    drop(held);
    ask(&gate, watch, None).expect("the place is free again");
    assert_eq!(refused(&gate, "streams"), 1);
}

#[test]
fn a_key_that_changes_in_its_file_is_another() {
    let file = tempfile::NamedTempFile::new().expect("a file");
    std::fs::write(file.path(), READ).expect("written");
    let text = format!(
        "[[auth.keys]]\nname = \"a\"\nrole = \"read\"\nkey_file = \"{}\"\n",
        file.path().display()
    );
    let settings = Settings::parse(&text, "test").expect("parses");
    let config = ServerConfig::from_settings(&settings).expect("good").0;
    let gate = Gate::new(&config.access).expect("a key");
    let points = Some(rule("POST", "/orenx.v1.Query/QueryPoints"));
    assert!(!gate.renew().expect("as before"));
    std::fs::write(file.path(), ADMIN).expect("written");
    assert!(gate.renew().expect("another"));
    ask(&gate, points, Some(("api-key", READ))).expect_err("the old one");
    ask(&gate, points, Some(("api-key", ADMIN))).expect("the new one");
    std::fs::write(file.path(), "").expect("written");
    gate.renew().expect_err("no key");
    ask(&gate, points, Some(("api-key", ADMIN))).expect("it stays");
}
