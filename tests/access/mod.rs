//! Who gets in: keys and their roles, certificates, and how much one client may take; over both protocols
//! of a whole server.

mod certificates;
mod keys;
mod limits;
mod operation;
mod process;
mod tls;

use orenx::client::{Client, Credentials, HttpClient};
use orenx::config::{KeySettings, Role, Secret, Settings};
use orenx::error::{Error, Result};
use orenx::map::Fields;
use orenx::service::DEFAULT_MAP;

/// The key of a role, as it is in the settings.
fn key(role: Role) -> String {
    format!("{}-0123456789abcdef", role.name())
}

/// A key of each role.
fn with_keys(settings: &mut Settings) {
    for role in [Role::Ingest, Role::Read, Role::Admin] {
        settings.auth.keys.push(KeySettings {
            name: role.name().into(),
            role,
            key: Some(Secret::new(key(role))),
            key_file: None,
            key_env: None,
        });
    }
}

fn showing(key: &str) -> Credentials {
    Credentials { key: Some(Secret::new(key)), ..Credentials::default() }
}

/// What the server says to a small question.
async fn ask(client: &Client) -> Result<()> {
    let points = [glam::Vec3::ONE];
    client.query_points(DEFAULT_MAP, &points, Fields::ALL, 0).await.map(drop)
}

/// The class of an outcome.
fn class(outcome: Result<()>) -> &'static str {
    match outcome {
        Ok(()) => "done",
        Err(Error::Unauthenticated(_)) => "who?",
        Err(Error::PermissionDenied(_)) => "may not",
        Err(Error::ResourceExhausted { .. }) => "too much",
        Err(_) => "else",
    }
}

/// The number on a line of the metrics.
async fn metric(client: &HttpClient, sample: &str) -> f64 {
    let page = String::from_utf8(client.get("/metrics").await.unwrap().to_vec()).unwrap();
    let value = page.lines().find_map(|line| line.strip_prefix(sample)?.strip_prefix(' '));
    value.unwrap_or_else(|| panic!("no {sample}")).parse().unwrap()
}

/// How often somebody was refused.
async fn refused(client: &HttpClient, transport: &str, reason: &str) -> f64 {
    let labels = format!("{{transport=\"{transport}\",reason=\"{reason}\"}}");
    metric(client, &format!("orenx_refused_total{labels}")).await
}
