//! The command line, one file a subcommand.
//!
//! Exit codes: 0 done; 2 bad arguments or input; 1 anything else. A failure's message goes to
//! stderr, in one line.
#![allow(clippy::print_stdout, clippy::print_stderr, reason = "this is the part that prints")]

pub mod ablate;
mod answerer;
pub mod ask;
pub mod bench;
pub mod classify;
pub mod config;
mod credentials;
pub mod demo;
pub mod doctor;
pub mod edit;
mod encoder;
pub mod eval;
mod heap;
mod invocation;
pub mod map;
pub mod mesh;
mod numbers;
mod open;
pub mod planner;
pub mod query;
pub mod render;
pub mod serve;
pub mod slice;
pub mod snapshot;
pub mod stream;

use std::process::ExitCode;

use clap::{Parser, Subcommand};

use crate::error::Error;

#[derive(Debug, Parser)]
#[command(name = "orenx", version, about, arg_required_else_help = true)]
struct Arguments {
    #[command(subcommand)]
    command: Command,
}

#[derive(Debug, Subcommand)]
enum Command {
    Demo(demo::DemoArgs),
    Serve(serve::ServeArgs),
    Stream(stream::StreamArgs),
    Snapshot(snapshot::SnapshotArgs),
    Edit(edit::EditArgs),
    Map(map::MapArgs),
    Eval(eval::EvalArgs),
    Query(query::QueryArgs),
    Planner(planner::PlannerArgs),
    Slice(slice::SliceArgs),
    Mesh(mesh::MeshArgs),
    Render(render::RenderArgs),
    Ask(ask::AskArgs),
    Classify(classify::ClassifyArgs),
    Bench(bench::BenchArgs),
    Ablate(ablate::AblateArgs),
    Doctor(doctor::DoctorArgs),
    Config(config::ConfigArgs),
}

/// Without a session there is no display. A layer of Mesa asks it all the same which GPU it is on,
/// and writes to stderr that it found none; this switches the layer off. To be called while the
/// process has one thread.
fn no_display() {
    if std::env::var_os("XDG_RUNTIME_DIR").is_none() {
        // SAFETY: no other thread reads the environment; the caller is the only one.
        unsafe { std::env::set_var("NODEVICE_SELECT", "1") };
    }
}

/// Parses the process's arguments and runs the subcommand. Wrong arguments end the process with
/// code 2, as clap does.
pub fn run() -> ExitCode {
    no_display();
    let command = Arguments::parse().command;
    // A server has settings of its log.
    if !matches!(command, Command::Serve(_)) {
        crate::telemetry::log_to_stderr();
    }
    let result = match command {
        Command::Demo(arguments) => arguments.run(),
        Command::Serve(arguments) => arguments.run(),
        Command::Stream(arguments) => arguments.run(),
        Command::Snapshot(arguments) => arguments.run(),
        Command::Edit(arguments) => arguments.run(),
        Command::Map(arguments) => arguments.run(),
        Command::Eval(arguments) => arguments.run(),
        Command::Query(arguments) => arguments.run(),
        Command::Planner(arguments) => arguments.run(),
        Command::Slice(arguments) => arguments.run(),
        Command::Mesh(arguments) => arguments.run(),
        Command::Render(arguments) => arguments.run(),
        Command::Ask(arguments) => arguments.run(),
        Command::Classify(arguments) => arguments.run(),
        Command::Bench(arguments) => arguments.run(),
        Command::Ablate(arguments) => arguments.run(),
        Command::Doctor(arguments) => arguments.run(),
        Command::Config(arguments) => arguments.run(),
    };
    crate::telemetry::end_log();
    match result {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("error: {}", one_line(&error));
            ExitCode::from(exit_code(&error))
        }
    }
}

/// The code of the first of our own errors in the chain; anything else is 1.
fn exit_code(error: &anyhow::Error) -> u8 {
    error.chain().find_map(|cause| cause.downcast_ref::<Error>()).map_or(1, Error::exit_code)
}

/// The message and its causes, less those that the message before them already tells.
fn one_line(error: &anyhow::Error) -> String {
    let mut line = String::new();
    for cause in error.chain() {
        let text = cause.to_string().replace('\n', " ");
        if line.is_empty() {
            line = text;
        } else if !line.contains(&text) {
            line = format!("{line}: {text}");
        }
    }
    line
}

#[cfg(test)]
mod tests {
    use anyhow::Context;
    use clap::CommandFactory;

    use super::*;

    #[test]
    fn the_command_line_is_consistent() {
        Arguments::command().debug_assert();
    }

    #[test]
    fn codes_and_messages_come_from_the_innermost_error_of_ours() {
        let missing = std::io::Error::from(std::io::ErrorKind::NotFound);
        let missing: anyhow::Error = Error::io("a.png", missing).into();
        assert_eq!(exit_code(&missing), 2);
        assert_eq!(one_line(&missing), "a.png: entity not found");
        let wrapped = Err::<(), _>(Error::invalid("stride", "must be\nat least 1"))
            .context("cannot map")
            .expect_err("an error");
        assert_eq!(exit_code(&wrapped), 2);
        assert_eq!(one_line(&wrapped), "cannot map: stride: must be at least 1");
        assert_eq!(exit_code(&anyhow::anyhow!("other")), 1);
        assert_eq!(exit_code(&Error::Internal("broken".into()).into()), 1);
    }
}
