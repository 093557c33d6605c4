//! Single files that appear whole, also where several processes write to one folder.
//!
//! Processes of several machines, whose numbers may be the same, so temporary names are random and
//! never reused; and a file may be put only where none is. `impasto_scene::file::write_atomic`, which
//! is for one machine, does neither.

use std::collections::BTreeSet;
use std::fs::{self, File};
use std::io::{ErrorKind, Write};
use std::path::Path;

use tempfile::NamedTempFile;

use super::staging::{file_name, parent};
use crate::cli::CliError;

/// What names of temporary files end with; they begin with a dot and the name that they will have.
const ENDING: &str = ".tmp";
/// Characters between that name and the ending, and the dot before them.
const RANDOM: usize = 6;

/// Puts a file in its place, whatever was there.
pub fn put(path: &Path, bytes: &[u8]) -> Result<(), CliError> {
    let written = temporary(path, bytes)?;
    match written.persist(path) {
        Ok(_) => Ok(()),
        // Another process had put the same file there, and swept ours away with what was left over.
        Err(failed) if failed.error.kind() == ErrorKind::NotFound && path.exists() => Ok(()),
        Err(failed) => Err(CliError::write(path)(failed.error)),
    }
}

/// Puts a file in its place unless there is one; tells whether it did.
pub fn put_new(path: &Path, bytes: &[u8]) -> Result<bool, CliError> {
    let written = temporary(path, bytes)?;
    match written.persist_noclobber(path) {
        Ok(_) => Ok(true),
        Err(_) if path.exists() => Ok(false),
        Err(failed) => Err(CliError::write(path)(failed.error)),
    }
}

/// The bytes, safe on the disk, beside the place where they will be.
fn temporary(path: &Path, bytes: &[u8]) -> Result<NamedTempFile<File>, CliError> {
    let name = file_name(path);
    let written = tempfile::Builder::new()
        .prefix(&format!(".{name}."))
        .suffix(ENDING)
        .rand_bytes(RANDOM)
        // Readable by whom other files are: the crate's own way hides them from everybody else.
        .make_in(parent(path), |path| File::create_new(path))
        .and_then(|mut written| {
            written.as_file_mut().write_all(bytes)?;
            written.as_file().sync_all()?;
            Ok(written)
        });
    // The temporary name would only puzzle.
    written.map_err(CliError::write(path))
}

/// Names of the files in a folder; none if there is no such folder.
pub fn listed(folder: &Path) -> Result<BTreeSet<String>, CliError> {
    let entries = match fs::read_dir(folder) {
        Ok(entries) => entries,
        Err(error) if error.kind() == ErrorKind::NotFound => return Ok(BTreeSet::new()),
        Err(error) => return Err(CliError::read(folder)(error)),
    };
    let name = |entry: fs::DirEntry| entry.file_name().to_string_lossy().into_owned();
    let names: std::io::Result<_> = entries.map(|entry| entry.map(name)).collect();
    names.map_err(CliError::read(folder))
}

/// Removes what killed processes left half-written of files that are whole by now.
pub fn sweep(folder: &Path, names: &BTreeSet<String>) {
    for name in names {
        if final_name(name).is_some_and(|whole| names.contains(whole)) {
            // Best effort: it is hidden and harms nobody.
            let _ = fs::remove_file(folder.join(name));
        }
    }
}

/// The name that a temporary file would have got.
fn final_name(name: &str) -> Option<&str> {
    let random = name.strip_prefix('.')?.strip_suffix(ENDING)?;
    let (whole, random) = random.rsplit_once('.')?;
    (random.len() == RANDOM).then_some(whole)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn files_are_put_and_leave_nothing_else() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("0000.png");
        put(&path, b"one").unwrap();
        assert!(!put_new(&path, b"two").unwrap());
        assert_eq!(fs::read(&path).unwrap(), b"one");
        put(&path, b"three").unwrap();
        assert_eq!(fs::read(&path).unwrap(), b"three");
        assert!(put_new(&folder.path().join("job.json"), b"{}").unwrap());
        assert_eq!(
            listed(folder.path()).unwrap(),
            ["0000.png", "job.json"].map(String::from).into()
        );
    }

    #[test]
    fn only_what_is_whole_by_now_is_swept() {
        let folder = tempfile::tempdir().unwrap();
        let files = [
            "0000.png",
            ".0000.png.abc123.tmp",
            ".0001.png.abc123.tmp",
            ".0000.png.mine.tmp",
            ".hidden",
        ];
        for name in files {
            fs::write(folder.path().join(name), "").unwrap();
        }
        sweep(folder.path(), &listed(folder.path()).unwrap());
        let left = listed(folder.path()).unwrap();
        assert_eq!(left.len(), files.len() - 1);
        assert!(!left.contains(".0000.png.abc123.tmp"));
    }

    #[test]
    fn a_folder_that_is_not_there_is_named() {
        let folder = tempfile::Builder::new().prefix("frames-").tempdir();
        let folder = folder.unwrap();
        let path = folder.path().join("none/0000.png");
        let problem = put(&path, b"").unwrap_err().to_string();
        assert!(problem.contains("0000.png"), "{problem}");
        assert!(!problem.contains("/.0000"), "{problem}");
        assert!(listed(&folder.path().join("none")).unwrap().is_empty());
    }
}
