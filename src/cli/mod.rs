//! The command line. A command is one file: its arguments and how they become a [`CommandOutput`].

mod batch;
mod bench;
mod command_output;
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
mod train_painter;
mod values;
mod view;
mod weights;

pub use command_output::{CommandOutput, of_synthetic, to_json};
pub use error::CliError;

use std::process::ExitCode;

use clap::{Parser, Subcommand};
use impasto::TrainError;

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
    TrainPainter(train_painter::TrainPainterArgs),
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

/// Runs the process's command line.
pub fn main() -> ExitCode {
    let cli = Cli::parse();
    let output = device::guarded(|| match &cli.command {
        Command::Demo(args) => demo::run(args),
        Command::Prepare(args) => prepare::run(args),
        Command::Train(args) => train::run(args),
        Command::TrainEncoder(args) => train_encoder::run(args),
        Command::TrainPainter(args) => train_painter::run(args),
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
    match output {
        Ok(output) => output.print(cli.json),
        Err(error) => {
            match &error {
                CliError::Train(TrainError::Stopped { .. }) => {
                    console::note(format_args!("{error}:\n  {}", run_facts::resuming()));
                }
                CliError::SomeFailed(output) => {
                    output.print(cli.json);
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
