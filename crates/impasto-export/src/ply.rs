//! PLY files: binary, little-endian, one element `vertex`.

use std::fs::File;
use std::io::{self, BufWriter, Write};
use std::path::Path;

use crate::ExportError;

/// A type, and the names of the properties that have it.
pub(crate) type Properties = (&'static str, &'static [&'static str]);

/// Writes a file under a temporary name beside its own, and renames it; returns its size.
pub(crate) fn write<T>(
    path: &Path,
    comments: &[String],
    properties: &[Properties],
    rows: &[T],
    row: impl Fn(&T, &mut Vec<u8>),
) -> Result<u64, ExportError> {
    let header = header(comments, properties, rows.len());
    put(path, &header, rows, row).map_err(|source| ExportError::Write {
        path: path.to_owned(),
        source,
    })
}

fn header(comments: &[String], properties: &[Properties], rows: usize) -> String {
    let printable = |c: char| if (' '..='~').contains(&c) { c } else { '?' };
    let mut header = String::from("ply\nformat binary_little_endian 1.0\n");
    for comment in comments {
        // A name may hold anything; a header's line may not.
        let line: String = comment.chars().map(printable).collect();
        header += &format!("comment {line}\n");
    }
    header += &format!("element vertex {rows}\n");
    for (kind, names) in properties {
        for name in *names {
            header += &format!("property {kind} {name}\n");
        }
    }
    header + "end_header\n"
}

fn put<T>(
    path: &Path,
    header: &str,
    rows: &[T],
    row: impl Fn(&T, &mut Vec<u8>),
) -> io::Result<u64> {
    let folder = match path.parent() {
        Some(folder) if !folder.as_os_str().is_empty() => folder,
        _ => Path::new("."),
    };
    let mut file = tempfile::Builder::new()
        .prefix(".impasto-")
        .suffix(".tmp")
        // Readable by whom other files are: the crate's own way hides them from everybody else.
        .make_in(folder, |path| File::create_new(path))
        // The temporary name would only puzzle.
        .map_err(|error| io::Error::from(error.kind()))?;
    let mut bytes = header.len();
    let mut out = BufWriter::new(file.as_file_mut());
    out.write_all(header.as_bytes())?;
    let mut line = Vec::new();
    for thing in rows {
        line.clear();
        row(thing, &mut line);
        bytes += line.len();
        out.write_all(&line)?;
    }
    out.flush()?;
    drop(out);
    file.as_file().sync_all()?;
    file.persist(path).map_err(|failed| failed.error)?;
    Ok(bytes as u64)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_name_cannot_end_the_header() {
        let comments = ["scene a\nend_header\u{e9}".to_owned()];
        assert_eq!(
            header(&comments, &[("float", &["x"])], 3),
            "ply\nformat binary_little_endian 1.0\ncomment scene a?end_header?\nelement vertex 3\n\
             property float x\nend_header\n"
        );
    }
}
