//! `orenx snapshot`: the snapshots of a server's map, from the command line.

use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::PathBuf;

use anyhow::Context;
use clap::{Args, Subcommand};

use super::credentials::CredentialArgs;
use super::open::asking_runtime;
use crate::client::Client;
use crate::service::DEFAULT_MAP;
use crate::storage::{Snapshot, write_file};

/// Keep a server's map under a name, go back to it, or move it to another server
#[derive(Debug, Args)]
pub struct SnapshotArgs {
    /// The server, over gRPC, as in http://127.0.0.1:7610
    pub url: String,
    #[command(subcommand)]
    pub verb: Verb,
    /// The map
    #[arg(long, global = true, default_value = DEFAULT_MAP)]
    pub map: String,
    #[command(flatten)]
    credentials: CredentialArgs,
}

#[derive(Debug, Subcommand)]
pub enum Verb {
    /// List them
    List,
    /// Write what the map is now
    Create {
        /// a-z, 0-9, - and _; left out: a name that says when it was made
        name: Option<String>,
    },
    /// Make the map what a snapshot holds
    Restore { name: String },
    /// Write one to a file here, which any `orenx` opens
    Download {
        name: String,
        /// Left out: NAME.orenx
        #[arg(long, value_name = "FILE.orenx")]
        out: Option<PathBuf>,
    },
    /// Send a file to be a snapshot
    Upload { name: String, file: PathBuf },
    /// Delete one
    Delete { name: String },
}

impl SnapshotArgs {
    pub fn run(self) -> anyhow::Result<()> {
        let runtime = asking_runtime()?;
        let client =
            runtime.block_on(Client::connect_with(&self.url, &self.credentials.read()?))?;
        let map = self.map.as_str();
        match self.verb {
            Verb::List => {
                for snapshot in runtime.block_on(client.list_snapshots(map))? {
                    print(&snapshot);
                }
            }
            Verb::Create { name } => {
                print(&runtime.block_on(client.create_snapshot(map, name.as_deref()))?);
            }
            Verb::Restore { name } => {
                let restored = runtime.block_on(client.restore_snapshot(map, &name))?;
                println!("map '{map}' is '{name}' from epoch {} on", restored.epoch);
                if restored.frames_dropped > 0 {
                    println!("{} frames that waited were dropped", restored.frames_dropped);
                }
            }
            Verb::Download { name, out } => {
                let path = out.unwrap_or_else(|| PathBuf::from(format!("{name}.orenx")));
                let bytes = write_file(&path, |out: &mut BufWriter<File>| {
                    let got = runtime.block_on(client.download_snapshot(map, &name, out));
                    out.flush()?;
                    got.map_err(std::io::Error::other)
                })?;
                println!("{}: {bytes} bytes", path.display());
            }
            Verb::Upload { name, file } => {
                let from = File::open(&file).with_context(|| file.display().to_string())?;
                print(&runtime.block_on(client.upload_snapshot(map, &name, from))?);
            }
            Verb::Delete { name } => runtime.block_on(client.delete_snapshot(map, &name))?,
        }
        Ok(())
    }
}

fn print(snapshot: &Snapshot) {
    let Snapshot { name, bytes, epoch, frames, problem, .. } = snapshot;
    let mib = *bytes as f64 / f64::from(1 << 20);
    match problem.as_str() {
        "" => println!("{name}: {frames} frames, epoch {epoch}, {mib:.1} MiB"),
        problem => println!("{name}: {mib:.1} MiB, cannot be read: {problem}"),
    }
}
