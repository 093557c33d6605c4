//! Whole files, of which nothing is known but the path: read up to a limit, written all at once.

use std::fs::{self, File, Metadata};
use std::hash::{BuildHasher, Hasher, RandomState};
use std::io::{self, BufWriter, Read, Write};
use std::path::{Path, PathBuf};
use std::sync::LazyLock;
use std::sync::atomic::{AtomicU64, Ordering};

/// Largest file of poses, settings or cameras, in bytes: 4 GiB, the model of some ten thousand
/// photos.
pub const LARGEST_FILE: u64 = 4 << 30;

/// Reads a regular file of at most `most` bytes, through links.
///
/// Nothing else is even opened: a pipe would wait for ever, a device would never end.
///
/// # Errors
/// What the system says, or that the path is no regular file, is larger, or became shorter while
/// it was read. To be told by [`plainly`].
pub fn read_whole(path: &Path, most: u64) -> io::Result<Vec<u8>> {
    let facts = check_regular(path)?;
    let too_large = || {
        let limit = most >> 20;
        Err(io::Error::other(format!(
            "it is larger than {limit} MiB, the most that is read; give a smaller file"
        )))
    };
    if facts.len() > most {
        return too_large();
    }
    // Smaller than `most`, so a 32-bit machine that cannot hold it says so by failing to grow.
    let mut bytes = Vec::with_capacity(usize::try_from(facts.len()).unwrap_or(0));
    File::open(path)?.take(most + 1).read_to_end(&mut bytes)?;
    let length = bytes.len() as u64;
    if length > most {
        return too_large();
    }
    if length < facts.len() {
        return Err(io::Error::other(
            "it became shorter while it was read; wait until it is complete and try again",
        ));
    }
    Ok(bytes)
}

/// Reads a regular file of at most [`LARGEST_FILE`] bytes of text.
///
/// # Errors
/// As [`read_whole`]; also for what is not UTF-8.
pub fn read_text(path: &Path) -> io::Result<String> {
    String::from_utf8(read_whole(path, LARGEST_FILE)?)
        .map_err(|_| io::Error::other("it is not text (not UTF-8)"))
}

/// What the system knows of a regular file.
///
/// # Errors
/// What the system says, or that the path is something else.
pub fn check_regular(path: &Path) -> io::Result<Metadata> {
    let facts = fs::metadata(path)?;
    if facts.is_dir() {
        return Err(io::Error::other("it is a folder; give a file"));
    }
    if !facts.is_file() {
        return Err(io::Error::other(
            "it is a pipe, a socket or a device; give a regular file",
        ));
    }
    Ok(facts)
}

/// Writes a file under a temporary name beside it, flushes it to the disk and renames it, so that
/// nobody ever finds half of it and a crash leaves the old file or the new one.
///
/// # Errors
/// What the system says. The old file is then still there, and the temporary one is not.
pub fn write_atomic(path: &Path, bytes: &[u8]) -> io::Result<()> {
    write_atomic_with(path, |file| file.write_all(bytes))
}

/// [`write_atomic`] of what `write` writes, for what is too large to be held whole.
///
/// # Errors
/// As [`write_atomic`].
pub fn write_atomic_with(
    path: &Path,
    write: impl FnOnce(&mut BufWriter<File>) -> io::Result<()>,
) -> io::Result<()> {
    replace(path, write, |_| Ok(()))
}

/// [`write_atomic`] that reads the new file back and lets it take the old one's place only if
/// `right` accepts it.
///
/// # Errors
/// As [`write_atomic`]; also if `right` refuses what was read back.
pub fn write_verified(path: &Path, bytes: &[u8], right: &dyn Fn(&[u8]) -> bool) -> io::Result<()> {
    replace(
        path,
        |file| file.write_all(bytes),
        |temporary| {
            if right(&fs::read(temporary)?) {
                return Ok(());
            }
            Err(io::Error::other(
                "what was written is not what can be read back; check the disk",
            ))
        },
    )
}

/// The name that a temporary file of [`write_atomic`] or [`write_verified`] would have got; `None`
/// for every other name, so that a foreign file is never taken for a leftover.
pub fn name_of_temporary(name: &str) -> Option<&str> {
    let inner = name.strip_prefix('.')?.strip_suffix(TEMPORARY_ENDING)?;
    let (target, writer) = inner.rsplit_once('.')?;
    let (process, count) = writer.split_once('-')?;
    let is_number = |text: &str| !text.is_empty() && text.bytes().all(|b| b.is_ascii_digit());
    (!target.is_empty() && is_number(process) && is_number(count)).then_some(target)
}

/// What the names of temporary files end with.
const TEMPORARY_ENDING: &str = ".impasto.tmp";

/// Name under which to write a file that will be `path`: of this process and this call alone, since
/// two writers of one file must not share it. Numbers of processes may be the same on two machines
/// that share a folder; random ones are not.
fn temporary_path(path: &Path) -> io::Result<PathBuf> {
    static COUNT: AtomicU64 = AtomicU64::new(0);
    let name = path.file_name().ok_or_else(|| {
        let problem = "it does not end with a file's name; give the path of a file";
        io::Error::new(io::ErrorKind::InvalidInput, problem)
    })?;
    static PROCESS: LazyLock<u64> = LazyLock::new(|| RandomState::new().build_hasher().finish());
    let (process, count) = (*PROCESS, COUNT.fetch_add(1, Ordering::Relaxed));
    let mut temporary = std::ffi::OsString::from(".");
    temporary.push(name);
    temporary.push(format!(".{process}-{count}{TEMPORARY_ENDING}"));
    Ok(path.with_file_name(temporary))
}

/// Writes a file beside `path` and, if `check` of it succeeds, renames it.
fn replace(
    path: &Path,
    write: impl FnOnce(&mut BufWriter<File>) -> io::Result<()>,
    check: impl FnOnce(&Path) -> io::Result<()>,
) -> io::Result<()> {
    let temporary = temporary_path(path)?;
    let written = write_synced(&temporary, write)
        .and_then(|()| check(&temporary))
        .and_then(|()| fs::rename(&temporary, path));
    if written.is_err() {
        // Best effort: the first failure is what matters.
        let _ = fs::remove_file(&temporary);
    }
    written.and_then(|()| sync_folder(path))
}

fn write_synced(
    path: &Path,
    write: impl FnOnce(&mut BufWriter<File>) -> io::Result<()>,
) -> io::Result<()> {
    let mut file = BufWriter::with_capacity(1 << 20, File::create(path)?);
    write(&mut file)?;
    file.into_inner()?.sync_all()
}

/// Makes a rename last. Only Unix can open folders.
fn sync_folder(path: &Path) -> io::Result<()> {
    match path.parent() {
        Some(folder) if cfg!(unix) => {
            let here = folder.as_os_str().is_empty();
            File::open(if here { Path::new(".") } else { folder })?.sync_all()
        }
        _ => Ok(()),
    }
}

/// Why a path cannot be read, and what to do where that is known, as a part of a sentence.
pub fn plainly(error: &io::Error) -> String {
    match error.kind() {
        io::ErrorKind::NotFound => "there is no such file; check the path".into(),
        io::ErrorKind::PermissionDenied => "permission denied; allow this user to read it".into(),
        io::ErrorKind::NotADirectory => "it is not a folder".into(),
        _ => {
            let said = error.to_string();
            said[..said.find(" (os error ").unwrap_or(said.len())].to_owned()
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_regular_files_of_bounded_size_are_read() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("x");
        fs::write(&path, [7; 10]).unwrap();
        assert_eq!(read_whole(&path, 10).unwrap(), [7; 10]);
        let said = |path: &Path| plainly(&read_whole(path, 9).unwrap_err());
        assert!(said(&path).contains("larger than"));
        assert!(said(dir.path()).contains("folder"));
        assert!(said(&dir.path().join("none")).contains("no such file"));
    }

    /// Names of the files in a folder.
    fn names(folder: &Path) -> Vec<String> {
        let name = |entry: io::Result<fs::DirEntry>| entry.unwrap().file_name();
        fs::read_dir(folder)
            .unwrap()
            .map(|entry| name(entry).into_string().unwrap())
            .collect()
    }

    #[test]
    fn a_file_is_replaced_as_a_whole() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("model.safetensors");
        for bytes in [&b"old"[..], b"new", b""] {
            write_atomic(&path, bytes).unwrap();
            assert_eq!(fs::read(&path).unwrap(), bytes);
            assert_eq!(names(dir.path()), ["model.safetensors"]);
        }
    }

    #[test]
    fn a_file_that_reads_back_wrong_does_not_replace_the_old_one() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("model.safetensors");
        write_atomic(&path, b"old").unwrap();
        let error = write_verified(&path, b"new", &|bytes| bytes != b"new").unwrap_err();
        assert!(error.to_string().contains("check the disk"), "{error}");
        assert_eq!(fs::read(&path).unwrap(), b"old");
        assert_eq!(names(dir.path()), ["model.safetensors"]);
        write_verified(&path, b"new", &|bytes| bytes == b"new").unwrap();
        assert_eq!(fs::read(&path).unwrap(), b"new");
    }

    #[test]
    fn a_failed_write_leaves_what_was_there() {
        let dir = tempfile::tempdir().unwrap();
        // A folder in the way makes the renaming fail.
        let taken = dir.path().join("taken");
        fs::create_dir(&taken).unwrap();
        fs::write(taken.join("inside"), b"old").unwrap();
        write_atomic(&taken, b"new").unwrap_err();
        assert_eq!(fs::read(taken.join("inside")).unwrap(), b"old");
        write_atomic(&dir.path().join("none/file"), b"new").unwrap_err();
        write_atomic(&dir.path().join(".."), b"new").unwrap_err();
        assert_eq!(names(dir.path()), ["taken"]);
    }

    #[test]
    fn writers_of_one_file_do_not_meet() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("shared");
        std::thread::scope(|scope| {
            for byte in 0..4 {
                let path = &path;
                scope.spawn(move || write_atomic(path, &[byte; 1000]).unwrap());
            }
        });
        let bytes = fs::read(&path).unwrap();
        assert_eq!(bytes, [bytes[0]; 1000]);
        assert_eq!(names(dir.path()), ["shared"]);
    }

    #[test]
    fn only_our_temporary_files_are_recognised() {
        let temporary = temporary_path(Path::new("folder/a.b.json")).unwrap();
        assert_eq!(temporary.parent(), Some(Path::new("folder")));
        let name = temporary.file_name().unwrap().to_str().unwrap();
        assert_eq!(name_of_temporary(name), Some("a.b.json"), "{name}");
        for foreign in [
            "a.json",
            "a.tmp",
            ".a.tmp",
            ".a.impasto.tmp",
            ".a.mine.impasto.tmp",
            ".a.1-.impasto.tmp",
            "..1-2.impasto.tmp",
            "a.1-2.impasto.tmp",
            ".a.1-2.impasto.tmp.bak",
        ] {
            assert_eq!(name_of_temporary(foreign), None, "{foreign}");
        }
    }

    #[cfg(unix)]
    #[test]
    fn pipes_devices_and_loops_of_links_end() {
        let dir = tempfile::tempdir().unwrap();
        let pipe = dir.path().join("pipe");
        let made = std::process::Command::new("mkfifo").arg(&pipe).status();
        assert!(made.unwrap().success());
        for path in [pipe.as_path(), Path::new("/dev/zero")] {
            let said = plainly(&read_whole(path, 9).unwrap_err());
            assert!(said.contains("regular file"), "{said}");
        }
        let links = ["a", "b"].map(|name| dir.path().join(name));
        std::os::unix::fs::symlink(&links[0], &links[1]).unwrap();
        std::os::unix::fs::symlink(&links[1], &links[0]).unwrap();
        let said = plainly(&read_whole(&links[0], 9).unwrap_err());
        assert!(
            said.contains("links") && !said.contains("os error"),
            "{said}"
        );
    }
}
