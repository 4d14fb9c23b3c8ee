//! Authorities and what they sign, in files of their own.

use std::path::{Path, PathBuf};

use orenx::client::Credentials;
use orenx::config::Settings;
use rcgen::{
    BasicConstraints, CertificateParams, CertifiedIssuer, ExtendedKeyUsagePurpose, IsCa, KeyPair,
};

pub(super) struct Authority {
    issuer: CertifiedIssuer<'static, KeyPair>,
    folder: tempfile::TempDir,
}

/// A chain of certificates and its key.
pub(super) type Files = (PathBuf, PathBuf);

impl Authority {
    pub(super) fn new() -> Self {
        let mut params = CertificateParams::new(Vec::new()).unwrap();
        params.is_ca = IsCa::Ca(BasicConstraints::Unconstrained);
        let issuer = CertifiedIssuer::self_signed(params, KeyPair::generate().unwrap()).unwrap();
        let folder = tempfile::tempdir().unwrap();
        std::fs::write(folder.path().join("ca.pem"), issuer.pem()).unwrap();
        Self { issuer, folder }
    }

    /// Its own certificate.
    pub(super) fn ca(&self) -> PathBuf {
        self.folder.path().join("ca.pem")
    }

    /// A certificate of this machine, of `usage`, changed before it is signed.
    pub(super) fn signed(
        &self,
        name: &str,
        usage: ExtendedKeyUsagePurpose,
        change: impl FnOnce(&mut CertificateParams),
    ) -> Files {
        let names = vec!["localhost".to_owned(), "127.0.0.1".to_owned()];
        let mut params = CertificateParams::new(names).unwrap();
        params.extended_key_usages = vec![usage];
        change(&mut params);
        let key = KeyPair::generate().unwrap();
        let cert = params.signed_by(&key, &self.issuer).unwrap();
        let path = |ending: &str| self.folder.path().join(format!("{name}.{ending}"));
        std::fs::write(path("pem"), cert.pem()).unwrap();
        std::fs::write(path("key"), key.serialize_pem()).unwrap();
        (path("pem"), path("key"))
    }

    pub(super) fn server(&self) -> Files {
        self.signed("server", ExtendedKeyUsagePurpose::ServerAuth, |_| {})
    }

    pub(super) fn client(&self) -> Files {
        self.signed("client", ExtendedKeyUsagePurpose::ClientAuth, |_| {})
    }

    /// What a client has that trusts this authority.
    pub(super) fn trusting(&self, identity: Option<Files>) -> Credentials {
        Credentials { ca: Some(self.ca()), identity, ..Credentials::default() }
    }
}

/// Sets `[tls]`.
pub(super) fn speak_tls(settings: &mut Settings, (cert, key): Files, client_ca: Option<&Path>) {
    settings.tls.cert = cert;
    settings.tls.key = key;
    settings.tls.client_ca = client_ca.map(Path::to_path_buf).unwrap_or_default();
}
