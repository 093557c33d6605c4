//! Reading little-endian records without trusting their counts.

use std::path::Path;

use crate::error::SceneError;

/// A position in a file's bytes; every failure names the file and the offset.
pub(super) struct Bytes<'a> {
    path: &'a Path,
    data: &'a [u8],
    at: usize,
}

impl<'a> Bytes<'a> {
    pub(super) fn new(path: &'a Path, data: &'a [u8]) -> Self {
        Self { path, data, at: 0 }
    }

    pub(super) fn error(&self, problem: impl Into<String>) -> SceneError {
        SceneError::malformed(self.path, format!("byte {}", self.at), problem)
    }

    fn remaining(&self) -> usize {
        self.data.len() - self.at
    }

    fn take<const N: usize>(&mut self) -> Result<[u8; N], SceneError> {
        let Some((head, _)) = self.data[self.at..].split_first_chunk::<N>() else {
            return Err(self.error(format!(
                "the file ends here, {} bytes short; it is cut off, copy it again",
                N - self.remaining()
            )));
        };
        self.at += N;
        Ok(*head)
    }

    pub(super) fn u8(&mut self) -> Result<u8, SceneError> {
        self.take::<1>().map(|[byte]| byte)
    }

    pub(super) fn u32(&mut self) -> Result<u32, SceneError> {
        self.take().map(u32::from_le_bytes)
    }

    pub(super) fn u64(&mut self) -> Result<u64, SceneError> {
        self.take().map(u64::from_le_bytes)
    }

    pub(super) fn f64(&mut self) -> Result<f64, SceneError> {
        self.take().map(f64::from_le_bytes)
    }

    pub(super) fn f64s<const N: usize>(&mut self) -> Result<[f64; N], SceneError> {
        let mut numbers = [0.0; N];
        for number in &mut numbers {
            *number = self.f64()?;
        }
        Ok(numbers)
    }

    /// A count of records of at least `record` bytes each. More than the rest of the file can
    /// hold is an error here, before anything is allocated for them.
    pub(super) fn count(&mut self, record: usize, what: &str) -> Result<usize, SceneError> {
        let start = self.at;
        let count = self.u64()?;
        let room = self.remaining() / record;
        match usize::try_from(count) {
            Ok(count) if count <= room => Ok(count),
            _ => {
                self.at = start;
                Err(self.error(format!(
                    "{count} {what} are announced but the file has room for {room} at most; it is \
                     cut off or damaged, copy it again"
                )))
            }
        }
    }

    /// A text that ends with a zero byte.
    pub(super) fn name(&mut self) -> Result<String, SceneError> {
        let rest = &self.data[self.at..];
        let Some(length) = rest.iter().position(|&b| b == 0) else {
            return Err(
                self.error("the file ends inside an image's name; it is cut off, copy it again")
            );
        };
        let name = std::str::from_utf8(&rest[..length])
            .map_err(|_| self.error("an image's name is not UTF-8"))?
            .to_owned();
        self.at += length + 1;
        Ok(name)
    }

    /// Refuses bytes after the last record: then the counts were wrong.
    pub(super) fn finish(&self) -> Result<(), SceneError> {
        match self.remaining() {
            0 => Ok(()),
            extra => Err(self.error(format!(
                "{extra} bytes follow the last record; the file is damaged, copy it again"
            ))),
        }
    }
}
