//! Names of photos that captures state, which may come from anybody.

use std::path::{Component, Path, PathBuf};

use crate::error::SceneError;

/// A path without `.`, and without `..` where it takes something back. No file is looked at.
pub(crate) fn plain_path(path: &Path) -> PathBuf {
    let mut plain = PathBuf::new();
    for part in path.components() {
        match part {
            Component::CurDir => {}
            Component::ParentDir if plain.file_name().is_some() => {
                plain.pop();
            }
            other => plain.push(other),
        }
    }
    plain
}

/// Refuses a name, stated in `file` and relative to the folder `depth` levels below `root`, that
/// leads out of `root`.
///
/// Only the name is judged: links inside the capture are the user's own, and people link large
/// folders of photos.
pub(super) fn check(name: &str, root: &Path, depth: usize, file: &Path) -> Result<(), SceneError> {
    if name.trim().is_empty() || name.contains('\0') {
        let problem = "this is no name of a photo; write the file anew";
        return Err(SceneError::malformed(
            file,
            format!("frame {name:?}"),
            problem,
        ));
    }
    let leads_out = if is_absolute(name) {
        let absolute = |path: &Path| std::path::absolute(path).map(|path| plain_path(&path));
        match (absolute(&root.join(".")), absolute(Path::new(name))) {
            (Ok(root), Ok(photo)) => !photo.starts_with(root),
            _ => true,
        }
    } else {
        climbs(name, depth)
    };
    if leads_out {
        return Err(SceneError::Outside {
            path: file.to_owned(),
            name: name.to_owned(),
            root: root.to_owned(),
        });
    }
    Ok(())
}

/// Absolute on whatever system the file was written on.
fn is_absolute(name: &str) -> bool {
    let mut start = name.chars();
    let (first, second) = (start.next(), start.next());
    let drive = first.is_some_and(|c| c.is_ascii_alphabetic()) && second == Some(':');
    drive || matches!(first, Some('/' | '\\'))
}

/// Whether a name is ever above the folder that is `depth` levels above where it starts.
fn climbs(name: &str, mut depth: usize) -> bool {
    for part in name.split(['/', '\\']) {
        match part {
            "" | "." => {}
            ".." if depth == 0 => return true,
            ".." => depth -= 1,
            _ => depth += 1,
        }
    }
    false
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_stay_inside_the_capture() {
        let root = Path::new("/data/scene");
        let refused = |name: &str, depth| check(name, root, depth, Path::new("f.json")).is_err();
        for name in [
            "a.png",
            "./images/a.png",
            "x/../a.png",
            "/data/scene/images/a.png",
            "a..png",
        ] {
            assert!(!refused(name, 0), "{name}");
        }
        for name in [
            "../a.png",
            "x/../../a",
            "/etc/a.png",
            "/data/scene/../a",
            "..\\a.png",
            "C:\\a.png",
            "",
            "a\0b",
        ] {
            assert!(refused(name, 0), "{name}");
        }
        assert!(!refused("../photos/a.png", 1) && refused("../../a.png", 1));
    }

    #[test]
    fn plain_paths_lose_what_is_taken_back() {
        let plain = |path: &str| plain_path(Path::new(path));
        assert_eq!(plain("a/./b/../c"), Path::new("a/c"));
        assert_eq!(plain("../a/../b"), Path::new("../b"));
        assert_eq!(plain("/a/../b"), Path::new("/b"));
    }
}
