//! `impasto study`: what people say, asked with a page and counted.

use std::path::{Path, PathBuf};

use clap::{Args, Subcommand};
use impasto::eval::methods::Stylizer;
use impasto::eval::study::{
    MeanPreference, PerQuestion, Preference, StudyKey, StudyOptions, StudyPlan, StudySummary,
    summarise,
};
use impasto::scene::file::{LARGEST_FILE, read_whole};
use serde_json::json;

use super::device::DeviceArgs;
use super::methods::{JudgedArgs, MethodArgs};
use super::progress::FrameProgress;
use super::{CliError, CommandOutput, console, of_synthetic, to_json};
use crate::output::{Staging, check_folder};

/// What participants open.
const PAGE: &str = "study.html";
/// What the experimenter keeps.
const KEY: &str = "key.json";

/// Ask people which clip matches the painting better and which flickers less, and count
#[derive(Debug, Args)]
pub struct StudyArgs {
    #[command(subcommand)]
    command: StudyCommand,
}

#[derive(Debug, Subcommand)]
enum StudyCommand {
    Make(MakeArgs),
    Summary(SummaryArgs),
}

/// Make the page that asks, and the key to it
///
/// DIR/study.html goes to participants: it holds all clips, needs no network, and ends with a file
/// of answers to send back. DIR/key.json says which clip is whose: keep it.
#[derive(Debug, Args)]
#[command(verbatim_doc_comment)]
struct MakeArgs {
    #[command(flatten)]
    judged: JudgedArgs,
    #[command(flatten)]
    methods: MethodArgs,
    /// Frames of a clip, at 12 a second
    #[arg(long, value_name = "N", default_value_t = 40,
          value_parser = clap::value_parser!(u16).range(2..))]
    frames: u16,
    /// Most pairs to ask about; there are two for each painting and method, as pictures and as a
    /// video
    #[arg(long, value_name = "N", default_value_t = 8,
          value_parser = clap::value_parser!(u16).range(1..))]
    questions: u16,
    /// Pairs with a known answer beside them: a method's clip and the unstylised render
    #[arg(long, value_name = "N", default_value_t = 1)]
    catches: u16,
    /// About how large the page may be; clips are as large as that allows, up to 400 pixels
    #[arg(long, value_name = "MB", default_value_t = 15,
          value_parser = clap::value_parser!(u16).range(1..))]
    megabytes: u16,
    /// Start of the random numbers that choose pairs and sides
    #[arg(long, default_value_t = 0)]
    seed: u64,
    #[command(flatten)]
    device: DeviceArgs,
    /// Folder for the page and the key
    #[arg(short, long, value_name = "DIR")]
    output: PathBuf,
}

/// Count the answers
///
/// Answers that cannot tell count as half. Participants who find an unstylised render nearer to the
/// painting in a catch trial are left out.
#[derive(Debug, Args)]
#[command(verbatim_doc_comment)]
struct SummaryArgs {
    /// The study's folder, for its key
    study: PathBuf,
    /// The files that participants sent back
    #[arg(required = true, value_name = "ANSWERS.json")]
    answers: Vec<PathBuf>,
}

/// Runs the command.
pub fn run(args: &StudyArgs) -> Result<CommandOutput, CliError> {
    match &args.command {
        StudyCommand::Make(args) => make(args),
        StudyCommand::Summary(args) => summary(args),
    }
}

fn make(args: &MakeArgs) -> Result<CommandOutput, CliError> {
    if args.methods.is_empty() {
        let usage = "say what to compare with, for example --against adain";
        return Err(CliError::Usage(usage.into()));
    }
    check_folder(&args.output)?;
    let key = args.output.join(KEY);
    if key.exists() {
        return Err(CliError::Refused(format!(
            "{} is the key to answers that may have been given already; choose another folder",
            key.display()
        )));
    }
    let (model, read) = args.judged.load(&args.device.open()?)?;
    let opened = args.methods.open()?;
    let against: Vec<&dyn Stylizer> = opened.iter().map(Box::as_ref).collect();
    let options = StudyOptions {
        paintings: &read.named,
        against: &against,
        frames: args.frames.into(),
        questions: args.questions.into(),
        catches: args.catches.into(),
        bytes: usize::from(args.megabytes) * 1_000_000,
        seed: args.seed,
    };
    let plan = StudyPlan::new(&model, options)?;
    let mut bar = FrameProgress::new("render", plan.frames());
    let study = plan.make(&model, &mut || bar.tick())?;
    drop(bar);

    let mut staging = Staging::new(&args.output)?;
    let text = format!("{:#}\n", to_json(&study.key));
    for (name, text) in [(KEY, &text), (PAGE, &study.page)] {
        staging.write(name, text)?;
    }
    staging.commit()?;
    Ok(made(args, &study.key, study.page.len()))
}

fn made(args: &MakeArgs, key: &StudyKey, bytes: usize) -> CommandOutput {
    let (page, path) = (args.output.join(PAGE), args.output.join(KEY));
    let [width, height] = key.size;
    let kind = if key.synthetic { "synthetic " } else { "" };
    CommandOutput {
        text: format!(
            "{} pairs of {kind}clips, {} frames of {width}×{height} each as JPEG of quality {}: {:.1} MB\n\
             for participants: {}\nto keep: {}",
            key.questions.len(),
            key.frames,
            key.quality,
            bytes as f64 / 1e6,
            page.display(),
            path.display(),
        ),
        json: json!({
            "study": key.study,
            "synthetic": key.synthetic,
            "page": page,
            "key": path,
            "questions": key.questions.len(),
            "frames": key.frames,
            "size": key.size,
            "quality": key.quality,
            "bytes": bytes,
        }),
    }
}

fn summary(args: &SummaryArgs) -> Result<CommandOutput, CliError> {
    let key = StudyKey::read(&read(&args.study.join(KEY))?)?;
    let files = args.answers.iter().map(|path| {
        let text = read(path)?;
        Ok((path.display().to_string(), text))
    });
    let files: Vec<_> = files.collect::<Result<_, CliError>>()?;
    let summary = summarise(&key, &files)?;
    for aside in &summary.set_aside {
        console::note(format_args!("set aside: {} {}", aside.file, aside.reason));
    }
    Ok(CommandOutput {
        text: describe(&summary),
        json: to_json(&summary),
    })
}

/// A file's text; what is no text in it is left to whoever parses it.
fn read(path: &Path) -> Result<String, CliError> {
    let bytes = read_whole(path, LARGEST_FILE).map_err(CliError::read(path))?;
    Ok(String::from_utf8_lossy(&bytes).into_owned())
}

fn describe(summary: &StudySummary) -> String {
    let kind = of_synthetic(summary.synthetic);
    let mut lines = vec![format!(
        "study {}{kind}\nparticipants: {}; left out after a catch trial: {}; files set aside: {}",
        summary.study,
        summary.participants,
        summary.left_out,
        summary.set_aside.len(),
    )];
    for (method, shares) in &summary.methods {
        lines.push(format!("against {method}"));
        lines.extend(
            questions(shares)
                .map(|(question, share)| describe_share(question, share, summary.participants)),
        );
    }
    if let Some(mean) = &summary.mean {
        lines.push("mean over methods".into());
        lines.extend(questions(mean).map(|(question, mean)| {
            let MeanPreference {
                share,
                over_participants,
            } = mean;
            let interval = over(*over_participants, summary.participants);
            format!(
                "  {question}: {:.1} % prefer Impasto\n    {interval}",
                100.0 * share
            )
        }));
    }
    if let Some(seconds) = summary.seconds {
        lines.push(format!("median time for a pair: {seconds:.1} s"));
    }
    lines.join("\n")
}

fn questions<T>(both: &PerQuestion<T>) -> impl Iterator<Item = (&'static str, &T)> {
    let named = [
        ("matches the painting better", &both.matches),
        ("flickers less", &both.flicker),
    ];
    named.into_iter()
}

fn describe_share(question: &str, found: &Preference, participants: usize) -> String {
    format!(
        "  {question}: {:.1} % prefer Impasto ({} to {}, {} cannot tell)\n    {}; {} over answers as if independent (Wilson)\n    \
         sign test: p = {:.3} over participants, {:.3} over answers as if independent",
        100.0 * found.share,
        found.impasto,
        found.other,
        found.neither,
        over(found.over_participants, participants),
        interval(found.wilson),
        found.sign_test_participants,
        found.sign_test_answers,
    )
}

fn interval([low, high]: [f64; 2]) -> String {
    format!("{:.1} to {:.1} %", 100.0 * low, 100.0 * high)
}

/// The interval over participants, or why there is none.
fn over(found: Option<[f64; 2]>, participants: usize) -> String {
    match (found, participants) {
        (Some(found), _) => format!(
            "95 %: {} over participants (cluster bootstrap)",
            interval(found)
        ),
        (None, 1) => "95 %: no interval over participants, there is only one".into(),
        (None, _) => "95 %: no interval over participants, they all answer alike".into(),
    }
}
