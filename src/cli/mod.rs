//! The command line: one file a subcommand.

pub mod eval;
pub mod mesh;
mod open;
pub mod query;
pub mod slice;
