//! Runs the programs that do the work, and understands how they end.

use std::ffi::OsString;
use std::io::{self, BufRead, BufReader};
use std::path::Path;
use std::process::{Child, Command, ExitStatus, Stdio};

use crate::error::PrepareError;
use crate::log::CommandLog;

/// A program of the system.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Program<'a> {
    /// What people call it.
    pub(crate) name: &'static str,
    /// Where it is, or a name to look for.
    pub(crate) path: &'a Path,
    /// Debian's package.
    pub(crate) package: &'static str,
    /// The environment variable that names it.
    pub(crate) variable: &'static str,
}

/// How a program ended.
pub(crate) struct ProgramOutcome {
    status: ExitStatus,
    /// The line that says what went wrong, or else the last one.
    pub(crate) said: String,
    out_of_memory: bool,
}

/// Ends the child when its reader gives up.
struct Guarded(Child);

impl Drop for Guarded {
    fn drop(&mut self) {
        // Fails, as it should, where the child has ended already.
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

impl Program<'_> {
    /// Runs the program to its end, however it ends. Its output goes to the log, and line by line
    /// to `line`. The child stays in this process's group, so that Ctrl-C ends both.
    pub(crate) fn run(
        &self,
        arguments: &[OsString],
        log: &mut CommandLog,
        line: &mut dyn FnMut(&str),
    ) -> Result<ProgramOutcome, PrepareError> {
        log.command(self.path, arguments)?;
        let missing = |source| PrepareError::ProgramMissing {
            name: self.name,
            program: self.path.to_owned(),
            package: self.package,
            variable: self.variable,
            source,
        };
        // One pipe for both outputs keeps their order.
        let (output, to_pipe) = io::pipe().map_err(missing)?;
        let mut command = Command::new(self.path);
        command
            .args(arguments)
            .stdin(Stdio::null())
            .stdout(to_pipe.try_clone().map_err(missing)?)
            .stderr(to_pipe);
        let mut child = Guarded(command.spawn().map_err(missing)?);
        // It holds the pipe's other end, which must be closed for the output to end.
        drop(command);
        let mut run = Listener::default();
        let mut output = BufReader::new(output);
        let mut bytes = Vec::new();
        let unreadable = || PrepareError::read(self.path);
        while output.read_until(b'\n', &mut bytes).map_err(unreadable())? > 0 {
            log.output(&bytes)?;
            let text = String::from_utf8_lossy(&bytes);
            run.hear(text.trim());
            line(text.trim());
            bytes.clear();
        }
        let status = child.0.wait().map_err(unreadable())?;
        Ok(ProgramOutcome {
            status,
            said: run.complaint.unwrap_or(run.last),
            out_of_memory: run.out_of_memory,
        })
    }

    /// Runs the program, which must succeed.
    pub(crate) fn succeed(
        &self,
        arguments: &[OsString],
        log: &mut CommandLog,
        line: &mut dyn FnMut(&str),
    ) -> Result<(), PrepareError> {
        self.run(arguments, log, line)?
            .succeeded(&self.command(arguments), log)
    }

    /// The program and its command, for messages.
    pub(crate) fn command(&self, arguments: &[OsString]) -> String {
        let first = arguments.first().map(|word| word.to_string_lossy());
        let command = first.filter(|word| !word.starts_with('-'));
        command.map_or(self.name.to_owned(), |word| format!("{} {word}", self.name))
    }
}

impl ProgramOutcome {
    /// Whether the exit code says so.
    pub(crate) fn is_success(&self) -> bool {
        self.status.success()
    }

    /// Whether the program was ended instead of ending itself.
    pub(crate) fn was_killed(&self) -> bool {
        signal(self.status).is_some() || self.out_of_memory
    }

    /// An error unless the program succeeded.
    pub(crate) fn succeeded(self, command: &str, log: &CommandLog) -> Result<(), PrepareError> {
        const SIGKILL: i32 = 9;
        if self.status.success() {
            return Ok(());
        }
        let log = log.destination();
        let command = command.to_owned();
        let how = match signal(self.status) {
            Some(signal @ SIGKILL) => {
                return Err(PrepareError::Killed {
                    command,
                    signal,
                    log,
                });
            }
            _ if self.out_of_memory => {
                "memory ran out; use fewer or smaller photos, or a machine with more".to_owned()
            }
            Some(number) => format!("signal {number} ended it after \"{}\"", self.said),
            None => format!(
                "exit code {}, \"{}\"",
                self.status.code().unwrap_or(-1),
                self.said
            ),
        };
        Err(PrepareError::Failed { command, how, log })
    }
}

/// Remembers what matters of an output.
#[derive(Default)]
struct Listener {
    last: String,
    complaint: Option<String>,
    out_of_memory: bool,
}

impl Listener {
    fn hear(&mut self, line: &str) {
        if line.is_empty() {
            return;
        }
        line.clone_into(&mut self.last);
        self.out_of_memory |= line.contains("bad_alloc") || line.contains("Cannot allocate memory");
        // "Final error : 0.2 [px]" is no complaint.
        if line.contains("ERROR") || line.contains("rror:") || line.starts_with("terminate called")
        {
            self.complaint = Some(self.last.clone());
        }
    }
}

#[cfg(unix)]
fn signal(status: ExitStatus) -> Option<i32> {
    std::os::unix::process::ExitStatusExt::signal(&status)
}

#[cfg(not(unix))]
fn signal(_: ExitStatus) -> Option<i32> {
    None
}
