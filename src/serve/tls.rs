//! Certificates of the server, and whose certificates it takes.

use std::path::Path;
use std::sync::{Arc, PoisonError, RwLock};

use tokio_rustls::TlsAcceptor;
use tokio_rustls::rustls::crypto::ring;
use tokio_rustls::rustls::pki_types::pem::PemObject;
use tokio_rustls::rustls::pki_types::{CertificateDer, PrivateKeyDer};
use tokio_rustls::rustls::server::WebPkiClientVerifier;
use tokio_rustls::rustls::{RootCertStore, ServerConfig};

use super::access::Transport;
use crate::config::TlsConfig;
use crate::error::{Error, Result};

/// TLS as the files say, for both ports.
pub(super) struct Tls {
    files: TlsConfig,
    current: RwLock<Read>,
}

/// What the files said when they were read.
#[derive(Clone)]
struct Read {
    /// The files themselves, to tell whether they changed.
    texts: [Vec<u8>; 3],
    grpc: Arc<ServerConfig>,
    http: Arc<ServerConfig>,
}

impl Tls {
    /// Reads the files.
    pub(super) fn new(files: &TlsConfig) -> Result<Self> {
        Ok(Self { files: files.clone(), current: RwLock::new(Read::of(files, texts(files)?)?) })
    }

    /// What the next connection is accepted with.
    pub(super) fn acceptor(&self, transport: Transport) -> TlsAcceptor {
        let current = self.current.read().unwrap_or_else(PoisonError::into_inner);
        TlsAcceptor::from(match transport {
            Transport::Grpc => current.grpc.clone(),
            Transport::Http => current.http.clone(),
        })
    }

    /// Reads the files again; whether they changed. If they are wrong, all stays as it is. Connections
    /// that are open keep what they were opened with.
    pub(super) fn renew(&self) -> Result<bool> {
        let texts = texts(&self.files)?;
        if self.current.read().unwrap_or_else(PoisonError::into_inner).texts == texts {
            return Ok(false);
        }
        let fresh = Read::of(&self.files, texts)?;
        *self.current.write().unwrap_or_else(PoisonError::into_inner) = fresh;
        Ok(true)
    }
}

/// The certificates, the key and the authorities of clients.
fn texts(files: &TlsConfig) -> Result<[Vec<u8>; 3]> {
    let read = |field: &str, path: &Path| {
        std::fs::read(path).map_err(|e| Error::invalid(field, format!("{}: {e}", path.display())))
    };
    let authorities = files.client_ca.as_ref().map(|path| read("tls.client_ca", path));
    Ok([
        read("tls.cert", &files.cert)?,
        read("tls.key", &files.key)?,
        authorities.transpose()?.unwrap_or_default(),
    ])
}

impl Read {
    fn of(files: &TlsConfig, texts: [Vec<u8>; 3]) -> Result<Self> {
        let [cert, key, authorities] = &texts;
        let chain = certificates("tls.cert", &files.cert, cert)?;
        let key = PrivateKeyDer::from_pem_slice(key).map_err(|e| {
            Error::invalid("tls.key", format!("{} holds no key: {e}", files.key.display()))
        })?;
        let provider = Arc::new(ring::default_provider());
        let builder = ServerConfig::builder_with_provider(provider.clone())
            .with_safe_default_protocol_versions()
            .map_err(|e| Error::Internal(format!("TLS: {e}")))?;
        let builder = match &files.client_ca {
            None => builder.with_no_client_auth(),
            Some(path) => {
                let wrong = |problem: String| {
                    Error::invalid("tls.client_ca", format!("{}: {problem}", path.display()))
                };
                let mut roots = RootCertStore::empty();
                for certificate in certificates("tls.client_ca", path, authorities)? {
                    roots.add(certificate).map_err(|e| wrong(e.to_string()))?;
                }
                let verifier =
                    WebPkiClientVerifier::builder_with_provider(Arc::new(roots), provider).build();
                builder.with_client_cert_verifier(verifier.map_err(|e| wrong(e.to_string()))?)
            }
        };
        let mut config = builder.with_single_cert(chain, key).map_err(|e| {
            let problem =
                format!("{} does not fit {}: {e}", files.key.display(), files.cert.display());
            Error::invalid("tls.key", problem)
        })?;
        config.alpn_protocols = vec![b"http/1.1".to_vec()];
        let http = Arc::new(config.clone());
        config.alpn_protocols = vec![b"h2".to_vec()];
        Ok(Self { texts, grpc: Arc::new(config), http })
    }
}

fn certificates(field: &str, path: &Path, pem: &[u8]) -> Result<Vec<CertificateDer<'static>>> {
    let wrong = |problem: String| Error::invalid(field, format!("{}: {problem}", path.display()));
    let found: Vec<_> = CertificateDer::pem_slice_iter(pem)
        .collect::<std::result::Result<_, _>>()
        .map_err(|e| wrong(e.to_string()))?;
    if found.is_empty() {
        return Err(wrong("holds no certificate".into()));
    }
    Ok(found)
}
