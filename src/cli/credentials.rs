//! What commands show a server, and whom they trust.

use std::path::PathBuf;

use clap::Args;

use crate::client::Credentials;
use crate::config::Secret;
use crate::error::{Error, Result};

/// For servers that want to know who asks, and over TLS. A key itself is given in the variable
/// ORENX_API_KEY: others on this machine see arguments.
#[derive(Debug, Args)]
pub(super) struct CredentialArgs {
    /// A file that holds the key to show the server; the variable ORENX_API_KEY holds the key itself
    #[arg(long, value_name = "FILE", env = "ORENX_API_KEY_FILE")]
    pub(super) api_key_file: Option<PathBuf>,
    /// The authorities that sign servers' certificates (PEM), in the place of the system's
    #[arg(long, value_name = "FILE", env = "ORENX_CA")]
    pub(super) ca: Option<PathBuf>,
    /// A certificate to show the server (PEM)
    #[arg(long, value_name = "FILE", env = "ORENX_CLIENT_CERT", requires = "client_key")]
    pub(super) client_cert: Option<PathBuf>,
    /// Its key (PEM)
    #[arg(long, value_name = "FILE", env = "ORENX_CLIENT_KEY", requires = "client_cert")]
    pub(super) client_key: Option<PathBuf>,
}

impl CredentialArgs {
    /// Reads the key. A file goes over the variable.
    pub(super) fn read(&self) -> Result<Credentials> {
        let key = match &self.api_key_file {
            Some(path) => {
                let text = std::fs::read_to_string(path).map_err(|e| Error::io(path, e))?;
                Some(Secret::new(text.trim()))
            }
            None => match std::env::var("ORENX_API_KEY") {
                Ok(text) => Some(Secret::new(text.trim())),
                Err(std::env::VarError::NotPresent) => None,
                Err(error) => return Err(Error::invalid("ORENX_API_KEY", error.to_string())),
            },
        };
        let identity = self.client_cert.clone().zip(self.client_key.clone());
        Ok(Credentials { key, ca: self.ca.clone(), identity })
    }
}
