//! Settings of who may ask what: keys and their roles, TLS, and how much one client may take.

use std::net::SocketAddr;
use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};

use super::Secret;
use crate::error::{Error, Result};

/// Keys of one server.
const MAX_KEYS: usize = 256;
/// The longest name of a key: it is a label of metrics.
const MAX_NAME_BYTES: usize = 64;
/// Characters of a key: fewer could be guessed, more do not fit in a header beside others.
const KEY_CHARACTERS: std::ops::RangeInclusive<usize> = 16..=512;
/// Origins of pages that may ask.
const MAX_ORIGINS: usize = 64;

/// What a key is good for.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Role {
    /// Sends frames, and sees which maps there are and how they are.
    Ingest,
    /// Asks anything and changes nothing.
    Read,
    /// Everything.
    Admin,
}

impl Role {
    /// As the settings spell it.
    pub fn name(self) -> &'static str {
        match self {
            Self::Ingest => "ingest",
            Self::Read => "read",
            Self::Admin => "admin",
        }
    }
}

/// `[auth]`.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct AuthSettings {
    pub keys: Vec<KeySettings>,
}

/// `[[auth.keys]]`: one of the last three says what the key is.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct KeySettings {
    pub name: String,
    pub role: Role,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub key: Option<Secret>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub key_file: Option<PathBuf>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub key_env: Option<String>,
}

/// `[tls]`: off, unless there is a certificate.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct TlsSettings {
    pub cert: PathBuf,
    pub key: PathBuf,
    pub client_ca: PathBuf,
}

/// `[limits]`: those of each client. 0: none.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct LimitSettings {
    pub requests_per_s: u32,
    pub burst: u32,
    pub streams: u32,
}

impl Default for LimitSettings {
    fn default() -> Self {
        Self { requests_per_s: 5000, burst: 10_000, streams: 256 }
    }
}

/// A key that is known by name, and where it is kept.
#[derive(Debug, Clone, PartialEq)]
pub struct KeyConfig {
    pub name: String,
    pub role: Role,
    pub source: KeySource,
}

/// Where a key is kept.
#[derive(Debug, Clone, PartialEq)]
pub enum KeySource {
    Given(Secret),
    File(PathBuf),
    Variable(String),
}

/// The files of TLS.
#[derive(Debug, Clone, PartialEq)]
pub struct TlsConfig {
    pub cert: PathBuf,
    pub key: PathBuf,
    /// Who signs the certificates of clients; `None`: clients need none.
    pub client_ca: Option<PathBuf>,
}

/// Checked settings of who may ask.
#[derive(Debug, Clone, PartialEq)]
pub struct AccessConfig {
    /// Empty: nobody has to say who they are.
    pub keys: Vec<KeyConfig>,
    pub tls: Option<TlsConfig>,
    pub limits: LimitSettings,
    /// Sites whose pages may ask, as in `https://maps.example`.
    pub origins: Vec<String>,
}

impl AccessConfig {
    pub(super) fn new(
        auth: &AuthSettings,
        tls: &TlsSettings,
        limits: LimitSettings,
        origins: &[String],
    ) -> Result<Self> {
        if auth.keys.len() > MAX_KEYS {
            return Err(Error::invalid("auth.keys", format!("at most {MAX_KEYS}")));
        }
        let keys: Vec<KeyConfig> = auth
            .keys
            .iter()
            .enumerate()
            .map(|(at, key)| checked(at, key))
            .collect::<Result<_>>()?;
        for (at, key) in keys.iter().enumerate() {
            if keys[..at].iter().any(|other| other.name == key.name) {
                let problem = format!("'{}' is the name of another key too", key.name);
                return Err(Error::invalid(format!("auth.keys[{at}].name"), problem));
            }
        }
        if limits.requests_per_s > 0 && limits.burst == 0 {
            let problem = "must be at least 1: without a burst no request passes";
            return Err(Error::invalid("limits.burst", problem));
        }
        Ok(Self { keys, tls: checked_tls(tls)?, limits, origins: checked_origins(origins)? })
    }

    /// Whether those who come from the network have to show who they are.
    pub fn is_guarded(&self) -> bool {
        let by_certificate = self.tls.as_ref().is_some_and(|tls| tls.client_ca.is_some());
        !self.keys.is_empty() || by_certificate
    }

    /// Refuses a port that the network reaches while nobody has to say who they are.
    pub(super) fn check_port(&self, key: &str, address: SocketAddr) -> Result<()> {
        if is_loopback(address) || self.is_guarded() {
            return Ok(());
        }
        let problem = format!(
            "{address} is open to the network, and nobody would have to say who they are: set keys \
             ([[auth.keys]]) or tls.client_ca, or, where something else keeps strangers out, \
             server.insecure_public = true"
        );
        Err(Error::invalid(format!("server.{key}"), problem))
    }
}

/// Whether only this machine reaches an address.
pub fn is_loopback(address: SocketAddr) -> bool {
    address.ip().to_canonical().is_loopback()
}

impl KeyConfig {
    /// The key, from where it is kept.
    pub fn read(&self) -> Result<Secret> {
        let field = || format!("auth.keys '{}'", self.name);
        let secret = match &self.source {
            KeySource::Given(secret) => secret.clone(),
            KeySource::File(path) => {
                let text = std::fs::read_to_string(path).map_err(|e| {
                    Error::invalid(
                        format!("{}.key_file", field()),
                        format!("{}: {e}", path.display()),
                    )
                })?;
                Secret::new(text.trim())
            }
            KeySource::Variable(name) => {
                let text = std::env::var(name).map_err(|e| {
                    Error::invalid(format!("{}.key_env", field()), format!("{name}: {e}"))
                })?;
                Secret::new(text.trim())
            }
        };
        check_key(&field(), &secret)?;
        Ok(secret)
    }
}

/// Refuses a key that could be guessed or does not fit into a header. Says nothing of what it is.
pub fn check_key(field: &str, secret: &Secret) -> Result<()> {
    let text = secret.reveal();
    if !KEY_CHARACTERS.contains(&text.len()) || !text.bytes().all(|b| b.is_ascii_graphic()) {
        let (low, high) = KEY_CHARACTERS.into_inner();
        let problem = format!(
            "a key has {low} to {high} letters, digits and signs of ASCII, without spaces, as \
             `openssl rand -hex 32` makes them"
        );
        return Err(Error::invalid(field, problem));
    }
    Ok(())
}

fn checked(at: usize, key: &KeySettings) -> Result<KeyConfig> {
    let field = |part: &str| format!("auth.keys[{at}].{part}");
    let KeySettings { name, role, key, key_file, key_env } = key;
    let is_plain = |c: char| c.is_ascii_alphanumeric() || "._-".contains(c);
    if name.is_empty() || name.len() > MAX_NAME_BYTES || !name.chars().all(is_plain) {
        let problem = format!("1 to {MAX_NAME_BYTES} letters, digits, '.', '_' and '-'");
        return Err(Error::invalid(field("name"), problem));
    }
    let source = match (key, key_file, key_env) {
        (Some(secret), None, None) => {
            check_key(&field("key"), secret)?;
            KeySource::Given(secret.clone())
        }
        (None, Some(path), None) => KeySource::File(path.clone()),
        (None, None, Some(name)) => KeySource::Variable(name.clone()),
        _ => {
            let problem = "one of key, key_file and key_env says what the key is";
            return Err(Error::invalid(field("key"), format!("{problem} ('{name}')")));
        }
    };
    Ok(KeyConfig { name: name.clone(), role: *role, source })
}

fn checked_tls(tls: &TlsSettings) -> Result<Option<TlsConfig>> {
    let given = |path: &Path| !path.as_os_str().is_empty();
    match (given(&tls.cert), given(&tls.key), given(&tls.client_ca)) {
        (false, false, false) => Ok(None),
        (true, true, with_ca) => Ok(Some(TlsConfig {
            cert: tls.cert.clone(),
            key: tls.key.clone(),
            client_ca: with_ca.then(|| tls.client_ca.clone()),
        })),
        (false, _, _) => {
            Err(Error::invalid("tls.cert", "is needed beside tls.key and tls.client_ca"))
        }
        (true, false, _) => Err(Error::invalid("tls.key", "is needed beside tls.cert")),
    }
}

fn checked_origins(origins: &[String]) -> Result<Vec<String>> {
    let field = "server.cors_origins";
    if origins.len() > MAX_ORIGINS {
        return Err(Error::invalid(field, format!("at most {MAX_ORIGINS}")));
    }
    for origin in origins {
        let site = origin.strip_prefix("https://").or_else(|| origin.strip_prefix("http://"));
        let is_site = site.is_some_and(|site| {
            !site.is_empty()
                && site.bytes().all(|b| b.is_ascii_graphic() && !b"/*?#@,".contains(&b))
        });
        if !is_site {
            let problem = format!("'{origin}' is no origin, as in https://maps.example:8443");
            return Err(Error::invalid(field, problem));
        }
    }
    Ok(origins.to_vec())
}

#[cfg(test)]
mod tests {
    use crate::config::{ServerConfig, Settings};

    const KEY: &str = "0123456789abcdef0123456789abcdef";

    fn check(text: &str) -> Result<ServerConfig, String> {
        let settings = Settings::parse(text, "test").map_err(|e| e.to_string())?;
        ServerConfig::from_settings(&settings).map(|(config, _)| config).map_err(|e| e.to_string())
    }

    fn key(name: &str, rest: &str) -> String {
        format!("[[auth.keys]]\nname = \"{name}\"\nrole = \"read\"\n{rest}\n")
    }

    #[test]
    fn keys_have_a_name_a_role_and_one_place() {
        let good = key("planner", &format!("key = \"{KEY}\"")) + &key("robot", "key_env = \"K\"");
        let config = check(&good).expect("good");
        assert_eq!(config.access.keys.len(), 2);
        assert!(!format!("{config:?}").contains(KEY), "never shown");
        for (text, part) in [
            (key("a b", &format!("key = \"{KEY}\"")), "auth.keys[0].name: "),
            (key("a", "key = \"short\""), "auth.keys[0].key: a key has 16 to 512"),
            (key("a", ""), "auth.keys[0].key: one of key, key_file and key_env"),
            (key("a", "key_file = \"f\"\nkey_env = \"K\""), "one of key, key_file and key_env"),
            (good.clone() + &key("robot", "key_env = \"L\""), "auth.keys[2].name: 'robot'"),
        ] {
            let error = check(&text).expect_err(part);
            assert!(error.contains(part) && !error.contains("short"), "{error}");
        }
    }

    /// Neither a typo nor a value of the wrong kind brings a key to a terminal or into a log.
    #[test]
    fn errors_of_settings_do_not_show_keys() {
        for text in [
            key("a", &format!("kye = \"{KEY}\"")),
            key("a", &format!("key = \"{KEY}")),
            key("a", "key = 1234567890123456789"),
            key("a", &format!("key = \"{KEY}\" \"{KEY}\"")),
            format!("[auth]\nkeys = [{{ name = \"a\", role = \"guest\", key = \"{KEY}\" }}]\n"),
        ] {
            let error = check(&text).expect_err("wrong");
            assert!(!error.contains("0123456789") && !error.contains("1234567890"), "{error}");
            assert!(error.contains("test") && error.contains("line "), "{error}");
        }
    }

    #[test]
    fn a_port_that_the_network_reaches_needs_a_guard() {
        let open = |key: &str| format!("[server]\n{key} = \"0.0.0.0:7610\"\n");
        for port in ["grpc", "http"] {
            let error = check(&open(port)).expect_err("open");
            for part in [&format!("server.{port}: "), "auth.keys", "client_ca", "insecure_public"] {
                assert!(error.contains(part), "{part} in {error}");
            }
            check(&(open(port) + "insecure_public = true\n")).expect("told to");
            check(&(open(port) + &key("a", "key_env = \"K\""))).expect("keys");
            let tls = "[tls]\ncert = \"c\"\nkey = \"k\"\n";
            check(&(open(port) + tls)).expect_err("TLS alone lets everyone in");
            check(&(open(port) + tls + "client_ca = \"a\"\n")).expect("certificates");
        }
        for here in ["127.0.0.1:0", "127.1.2.3:1", "[::1]:0", "[::ffff:127.0.0.1]:0"] {
            check(&format!("[server]\ngrpc = \"{here}\"\n")).expect(here);
        }
    }

    #[test]
    fn values_out_of_range_are_named() {
        for (text, field) in [
            ("[tls]\ncert = \"c\"\n", "tls.key"),
            ("[tls]\nkey = \"k\"\n", "tls.cert"),
            ("[tls]\nclient_ca = \"k\"\n", "tls.cert"),
            ("[limits]\nburst = 0\n", "limits.burst"),
            ("[server]\ncors_origins = [\"*\"]\n", "server.cors_origins"),
            ("[server]\ncors_origins = [\"https://a/b\"]\n", "server.cors_origins"),
        ] {
            let error = check(text).expect_err(field);
            assert!(error.starts_with(field), "{error}");
        }
        check("[server]\ncors_origins = [\"https://maps.example:8443\"]\n").expect("a site");
    }
}
