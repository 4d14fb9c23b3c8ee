//! What a client shows a server, and whom it trusts.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use tokio::io::{AsyncRead, AsyncWrite};
use tokio::net::TcpStream;
use tokio_rustls::TlsConnector;
use tokio_rustls::rustls::crypto::ring;
use tokio_rustls::rustls::pki_types::pem::PemObject;
use tokio_rustls::rustls::pki_types::{CertificateDer, PrivateKeyDer, ServerName};
use tokio_rustls::rustls::{AlertDescription, ClientConfig, RootCertStore};
use tonic::metadata::{Ascii, MetadataValue};
use tonic::service::Interceptor;
use tonic::{Request, Status};

use super::CONNECT;
use crate::config::{Secret, check_key};
use crate::error::{Error, Result};

/// The header of a key, over either protocol.
pub(super) const KEY_HEADER: &str = "api-key";

/// A key, a certificate, and who signs those of servers; nothing by default.
#[derive(Debug, Clone, Default)]
pub struct Credentials {
    pub key: Option<Secret>,
    /// Authorities to trust, PEM; those of the system otherwise.
    pub ca: Option<PathBuf>,
    /// Our own certificates and their key, PEM, for servers that want to see one.
    pub identity: Option<(PathBuf, PathBuf)>,
}

impl Credentials {
    /// The key as the value of a header, which logs leave out.
    pub(super) fn header(&self) -> Result<Option<MetadataValue<Ascii>>> {
        let Some(key) = &self.key else { return Ok(None) };
        check_key("api key", key)?;
        let mut value: MetadataValue<Ascii> = key
            .reveal()
            .parse()
            .map_err(|_| Error::invalid("api key", "does not fit into a header"))?;
        value.set_sensitive(true);
        Ok(Some(value))
    }

    /// What connections of TLS are made with, for a protocol by its name in TLS.
    fn connector(&self, protocol: &[u8]) -> Result<TlsConnector> {
        let mut roots = RootCertStore::empty();
        match &self.ca {
            Some(path) => {
                for certificate in certificates("ca", path)? {
                    roots.add(certificate).map_err(|e| wrong("ca", path, &e))?;
                }
            }
            // What the system has and cannot be read is missed by the first server that needs it.
            None => drop(
                roots.add_parsable_certificates(rustls_native_certs::load_native_certs().certs),
            ),
        }
        let builder = ClientConfig::builder_with_provider(Arc::new(ring::default_provider()))
            .with_safe_default_protocol_versions()
            .map_err(|e| Error::Internal(format!("TLS: {e}")))?
            .with_root_certificates(roots);
        let mut config = match &self.identity {
            None => builder.with_no_client_auth(),
            Some((cert, key)) => {
                let chain = certificates("client-cert", cert)?;
                let secret =
                    PrivateKeyDer::from_pem_file(key).map_err(|e| wrong("client-key", key, &e))?;
                builder
                    .with_client_auth_cert(chain, secret)
                    .map_err(|e| wrong("client-key", key, &e))?
            }
        };
        config.alpn_protocols = vec![protocol.to_vec()];
        Ok(TlsConnector::from(Arc::new(config)))
    }
}

fn wrong(field: &str, path: &Path, error: &dyn std::fmt::Display) -> Error {
    Error::invalid(field, format!("{}: {error}", path.display()))
}

fn certificates(field: &str, path: &Path) -> Result<Vec<CertificateDer<'static>>> {
    let found: Vec<_> = CertificateDer::pem_file_iter(path)
        .and_then(Iterator::collect)
        .map_err(|e| wrong(field, path, &e))?;
    if found.is_empty() {
        return Err(wrong(field, path, &"holds no certificate"));
    }
    Ok(found)
}

/// Puts a key into each call of gRPC.
#[derive(Clone)]
pub(super) struct Showing(pub(super) Option<MetadataValue<Ascii>>);

impl Interceptor for Showing {
    fn call(&mut self, mut request: Request<()>) -> std::result::Result<Request<()>, Status> {
        if let Some(key) = &self.0 {
            request.metadata_mut().insert(KEY_HEADER, key.clone());
        }
        Ok(request)
    }
}

/// Bytes to a server and back.
pub(super) trait Bytes: AsyncRead + AsyncWrite + Send + Unpin {}

impl<T: AsyncRead + AsyncWrite + Send + Unpin> Bytes for T {}

/// How to reach a server.
#[derive(Clone)]
pub(super) struct Dial {
    /// Without brackets.
    host: String,
    port: u16,
    /// `None`: in the clear.
    tls: Option<TlsConnector>,
}

/// Why there is no connection.
pub(super) enum NoConnection {
    /// The server speaks TLS, and over it another protocol.
    OtherProtocol,
    Failed(String),
}

impl Dial {
    pub(super) fn plain(host: &str, port: u16) -> Self {
        Self { host: host.trim_matches(['[', ']']).into(), port, tls: None }
    }

    /// Over TLS; `protocol` is its name there.
    pub(super) fn secure(
        host: &str,
        port: u16,
        credentials: &Credentials,
        protocol: &[u8],
    ) -> Result<Self> {
        let tls = Some(credentials.connector(protocol)?);
        Ok(Self { tls, ..Self::plain(host, port) })
    }

    pub(super) fn is_secure(&self) -> bool {
        self.tls.is_some()
    }

    /// Host and port as a URL has them.
    pub(super) fn authority(&self) -> String {
        match self.host.contains(':') {
            true => format!("[{}]:{}", self.host, self.port),
            false => format!("{}:{}", self.host, self.port),
        }
    }

    pub(super) async fn connect(&self) -> std::result::Result<Box<dyn Bytes>, NoConnection> {
        let failed = |e: &dyn std::fmt::Display| NoConnection::Failed(e.to_string());
        let connecting = async {
            let stream = TcpStream::connect((self.host.as_str(), self.port)).await;
            let stream = stream.map_err(|e| failed(&e))?;
            stream.set_nodelay(true).map_err(|e| failed(&e))?;
            let Some(tls) = &self.tls else { return Ok(Box::new(stream) as Box<dyn Bytes>) };
            let name = ServerName::try_from(self.host.clone()).map_err(|e| failed(&e))?;
            let secured = tls.connect(name, stream).await.map_err(|e| no_tls(&e))?;
            Ok(Box::new(secured) as Box<dyn Bytes>)
        };
        let late = |_| NoConnection::Failed(format!("no connection within {CONNECT:?}"));
        tokio::time::timeout(CONNECT, connecting).await.map_err(late)?
    }
}

fn no_tls(error: &std::io::Error) -> NoConnection {
    use tokio_rustls::rustls::Error::AlertReceived;
    let alert = error.get_ref().and_then(|e| e.downcast_ref::<tokio_rustls::rustls::Error>());
    match alert {
        Some(AlertReceived(AlertDescription::NoApplicationProtocol)) => NoConnection::OtherProtocol,
        _ => NoConnection::Failed(format!("TLS: {error}")),
    }
}
