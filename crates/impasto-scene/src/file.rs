//! Whole files, of which nothing is known but the path.

use std::fs::{self, File, Metadata};
use std::io::{self, Read};
use std::path::Path;

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

/// Why a path cannot be read, and what to do where that is known, as a part of a sentence.
pub fn plainly(error: &io::Error) -> String {
    match error.kind() {
        io::ErrorKind::NotFound => "there is no such file; check the path".into(),
        io::ErrorKind::PermissionDenied => "permission denied; allow this user to read it".into(),
        io::ErrorKind::NotADirectory => "it is not a folder".into(),
        _ => {
            let said = error.to_string();
            match said.find(" (os error ") {
                Some(end) => said[..end].to_owned(),
                None => said,
            }
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
