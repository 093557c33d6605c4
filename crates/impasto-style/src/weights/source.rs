//! A file that is read in parts, none of which can be longer than the file.

use std::io::{Read, Seek, SeekFrom};

/// Whatever can be read from any place.
pub(crate) trait ReadSeek: Read + Seek + Send {}
impl<T: Read + Seek + Send> ReadSeek for T {}

/// An opened file.
pub(crate) struct ByteSource {
    reader: Box<dyn ReadSeek>,
    length: u64,
}

impl ByteSource {
    pub(crate) fn new(mut reader: Box<dyn ReadSeek>) -> Result<Self, String> {
        let length = reader.seek(SeekFrom::End(0)).map_err(|e| unreadable(&e))?;
        Ok(Self { reader, length })
    }

    /// In bytes.
    pub(crate) fn length(&self) -> u64 {
        self.length
    }

    /// Whether the file is that long.
    pub(crate) fn within(&self, start: u64, length: u64) -> Result<(), String> {
        match start.checked_add(length) {
            Some(end) if end <= self.length => Ok(()),
            _ => Err("ends too early; copy or download it again".into()),
        }
    }

    /// A little-endian integer of eight bytes.
    pub(crate) fn number(&mut self, start: u64) -> Result<u64, String> {
        let bytes = self.bytes(start, 8)?;
        Ok(bytes.first_chunk().map_or(0, |n| u64::from_le_bytes(*n)))
    }

    /// Part of the file; nothing is allocated for what it does not have.
    pub(crate) fn bytes(&mut self, start: u64, length: u64) -> Result<Vec<u8>, String> {
        self.within(start, length)?;
        let size = usize::try_from(length).map_err(|_| "is too large for this machine")?;
        let mut bytes = vec![0; size];
        self.reader
            .seek(SeekFrom::Start(start))
            .and_then(|_| self.reader.read_exact(&mut bytes))
            .map_err(|e| unreadable(&e))?;
        Ok(bytes)
    }
}

fn unreadable(error: &std::io::Error) -> String {
    format!("cannot be read ({error})")
}
