//! COLMAP's program, whose options depend on its version.

use std::collections::{BTreeMap, BTreeSet};
use std::ffi::OsString;
use std::path::Path;

use crate::child::{Program, ProgramOutcome};
use crate::error::PrepareError;
use crate::log::CommandLog;

/// The commands that are used.
const COMMANDS: [&str; 5] = [
    "feature_extractor",
    "exhaustive_matcher",
    "sequential_matcher",
    "mapper",
    "bundle_adjuster",
];

/// An installed COLMAP.
pub(crate) struct Colmap<'a> {
    program: Program<'a>,
    /// Its version, as it calls itself.
    pub(crate) version: String,
    /// Names of the options of each command, without dashes.
    options: BTreeMap<&'static str, BTreeSet<String>>,
}

impl<'a> Colmap<'a> {
    /// Asks the program what it can do.
    pub(crate) fn new(path: &'a Path, log: &mut CommandLog) -> Result<Self, PrepareError> {
        let program = Program {
            name: "COLMAP",
            path,
            package: "colmap",
            variable: "IMPASTO_COLMAP",
        };
        let mut version = String::new();
        let mut options = BTreeMap::new();
        for command in COMMANDS {
            let mut known = BTreeSet::new();
            let arguments = [command.into(), OsString::from("-h")];
            let run = program.run(&arguments, log, &mut |line| {
                if let Some(rest) = line.strip_prefix("COLMAP ").filter(|_| version.is_empty()) {
                    version = rest.split(" (").next().unwrap_or(rest).to_owned();
                }
                let words = line.split(|c: char| c.is_whitespace() || c == ',');
                known.extend(words.filter_map(|w| w.strip_prefix("--").map(str::to_owned)));
            })?;
            if known.is_empty() {
                run.succeeded(&program.command(&arguments), log)?;
            }
            options.insert(command, known);
        }
        if version.is_empty() {
            version = "version unknown".into();
        }
        Ok(Self {
            program,
            version,
            options,
        })
    }
}

/// A command line in the making.
pub(super) struct Arguments<'a> {
    colmap: &'a Colmap<'a>,
    command: &'static str,
    words: Vec<OsString>,
}

impl<'a> Arguments<'a> {
    pub(super) fn new(colmap: &'a Colmap<'a>, command: &'static str) -> Self {
        Self {
            colmap,
            command,
            words: vec![command.into()],
        }
    }

    /// Runs the command to its end, however it ends.
    pub(super) fn run(
        &self,
        log: &mut CommandLog,
        line: &mut dyn FnMut(&str),
    ) -> Result<ProgramOutcome, PrepareError> {
        self.colmap.program.run(&self.words, log, line)
    }

    /// Runs the command, which must succeed.
    pub(super) fn succeed(
        &self,
        log: &mut CommandLog,
        line: &mut dyn FnMut(&str),
    ) -> Result<(), PrepareError> {
        self.colmap.program.succeed(&self.words, log, line)
    }

    /// What to call it in messages.
    pub(super) fn name(&self) -> String {
        self.colmap.program.command(&self.words)
    }

    /// An option that every version has.
    pub(super) fn set(&mut self, option: &str, value: impl Into<OsString>) -> &mut Self {
        self.words.push(format!("--{option}").into());
        self.words.push(value.into());
        self
    }

    /// The one of these options that this version has. Having none is an error.
    pub(super) fn set_one_of(
        &mut self,
        options: &[&str],
        value: &str,
        log: &CommandLog,
    ) -> Result<&mut Self, PrepareError> {
        match self.known(options) {
            Some(option) => Ok(self.set(&option, value)),
            None => Err(PrepareError::UnknownOption {
                version: self.colmap.version.clone(),
                command: self.command.to_owned(),
                option: options.join(" or "),
                log: log.destination(),
            }),
        }
    }

    /// The one of these options that this version has, if any.
    pub(super) fn set_if_known(&mut self, options: &[&str], value: String) -> &mut Self {
        if let Some(option) = self.known(options) {
            self.set(&option, value);
        }
        self
    }

    fn known(&self, options: &[&str]) -> Option<String> {
        let known = self.colmap.options.get(self.command)?;
        let found = options.iter().find(|&&option| known.contains(option))?;
        Some((*found).to_owned())
    }
}
