//! The command line. A command is one file: its arguments and how they become an [`Answer`].

mod batch;
mod bench;
mod console;
mod demo;
mod device;
mod error;
mod eval;
mod export;
mod ffmpeg;
mod info;
mod interrupt;
mod methods;
mod painting;
mod prepare;
mod progress;
mod render;
mod run_facts;
mod settings;
mod shard;
mod study;
mod train;
mod train_baseline;
mod train_encoder;
mod values;
mod view;
mod weights;

pub use error::CliError;

use std::process::ExitCode;

use clap::{Parser, Subcommand};
use impasto::TrainError;
use serde_json::Value;

/// Photos of a place become a 3-D scene that can be repainted with any painting
#[derive(Debug, Parser)]
#[command(name = "impasto", version)]
struct Cli {
    /// Print the result as one JSON object
    #[arg(long, global = true)]
    json: bool,
    #[command(subcommand)]
    command: Command,
}

#[derive(Debug, Subcommand)]
enum Command {
    Demo(demo::DemoArgs),
    Prepare(prepare::PrepareArgs),
    Train(train::TrainArgs),
    TrainEncoder(train_encoder::TrainEncoderArgs),
    TrainBaseline(train_baseline::TrainBaselineArgs),
    Render(render::RenderArgs),
    Batch(batch::BatchArgs),
    View(view::ViewArgs),
    Eval(eval::EvalArgs),
    Study(study::StudyArgs),
    Export(export::ExportArgs),
    Info(info::InfoArgs),
    Weights(weights::WeightsArgs),
    Bench(bench::BenchArgs),
}

/// What a command has to say in the end, for people and for programs.
#[derive(Debug)]
pub struct Answer {
    text: String,
    json: Value,
}

impl Answer {
    fn print(&self, as_json: bool) {
        match as_json {
            true => console::result(&self.json.to_string()),
            false => console::result(&self.text),
        }
    }
}

/// A plain structure as JSON. Numbers that JSON lacks (NaN, infinity) become `null`.
pub fn to_json(structure: &impl serde::Serialize) -> Value {
    // Structures with text keys, for which this cannot fail.
    serde_json::to_value(structure).unwrap_or_default()
}

/// Runs the process's command line.
pub fn main() -> ExitCode {
    let cli = Cli::parse();
    let answer = device::guarded(|| match &cli.command {
        Command::Demo(args) => demo::run(args),
        Command::Prepare(args) => prepare::run(args),
        Command::Train(args) => train::run(args),
        Command::TrainEncoder(args) => train_encoder::run(args),
        Command::TrainBaseline(args) => train_baseline::run(args),
        Command::Render(args) => render::run(args),
        Command::Batch(args) => batch::run(args),
        Command::View(args) => view::run(args),
        Command::Eval(args) => eval::run(args),
        Command::Study(args) => study::run(args),
        Command::Export(args) => export::run(args),
        Command::Info(args) => info::run(args),
        Command::Weights(args) => weights::run(args),
        Command::Bench(args) => bench::run(args),
    });
    match answer {
        Ok(answer) => answer.print(cli.json),
        Err(error) => {
            match &error {
                CliError::Train(TrainError::Stopped { .. }) => {
                    console::note(format_args!("{error}:\n  {}", run_facts::resuming()));
                }
                CliError::SomeFailed(answer) => {
                    answer.print(cli.json);
                    console::error(&error);
                }
                _ => console::error(&error),
            }
            return error.exit_code();
        }
    }
    ExitCode::SUCCESS
}

#[cfg(test)]
mod tests {
    use clap::CommandFactory;

    use super::*;

    #[test]
    fn the_arguments_are_consistent() {
        Cli::command().debug_assert();
    }

    #[test]
    fn a_budget_is_a_time_or_a_number_of_steps() {
        let parse = |budget: &[&str]| {
            let words = ["impasto", "train", "scene", "-o", "model"];
            Cli::try_parse_from(words.iter().chain(budget)).map(|_| ())
        };
        assert!(parse(&["--budget", "90s"]).is_ok() && parse(&["--steps", "3"]).is_ok());
        assert!(parse(&["--budget", "90s", "--steps", "3"]).is_err());
        assert!(parse(&["--steps", "0"]).is_err());
    }
}
