//! ZIP files whose entries are stored as they are: pictures cannot be packed any smaller.

use std::io::{self, Write};

/// Version of the format that is needed to read these files: 2.0.
const VERSION: u16 = 20;
/// Names are UTF-8.
const FLAGS: u16 = 1 << 11;
/// The first of January 1980, the format's first day: the same pictures are the same file.
const DATE: u16 = (1 << 5) | 1;

/// Writes entries one after the other.
pub struct ZipWriter<W> {
    to: W,
    written: u64,
    /// The list that comes last.
    directory: Vec<u8>,
    entries: u16,
}

impl<W: Write> ZipWriter<W> {
    /// Begins an empty file.
    pub fn new(to: W) -> Self {
        Self {
            to,
            written: 0,
            directory: Vec::new(),
            entries: 0,
        }
    }

    /// Adds an entry.
    ///
    /// # Errors
    /// What the system says, and [`io::ErrorKind::FileTooLarge`] beyond what the format can hold
    /// (4 GiB, 65,535 entries).
    pub fn add(&mut self, name: &str, bytes: &[u8]) -> io::Result<()> {
        let full = |_| io::Error::from(io::ErrorKind::FileTooLarge);
        let start = u32::try_from(self.written).map_err(full)?;
        let size = u32::try_from(bytes.len()).map_err(full)?;
        let name_length = u16::try_from(name.len()).map_err(full)?;
        self.entries = u16::try_from(u32::from(self.entries) + 1).map_err(full)?;

        // What both headers say: how it is stored, when it was made, and what it is.
        let mut facts = [VERSION, FLAGS, 0, 0, DATE].map(u16::to_le_bytes).concat();
        facts.extend([crc32(bytes), size, size].map(u32::to_le_bytes).concat());
        facts.extend([name_length, 0].map(u16::to_le_bytes).concat());

        self.write(b"PK\x03\x04")?;
        self.write(&facts)?;
        self.write(name.as_bytes())?;
        self.write(bytes)?;

        self.directory.extend(b"PK\x01\x02");
        self.directory.extend(VERSION.to_le_bytes());
        self.directory.extend(facts);
        // No comment, the first disk, no attributes.
        self.directory.extend([0; 10]);
        self.directory.extend(start.to_le_bytes());
        self.directory.extend(name.as_bytes());
        Ok(())
    }

    /// Writes the list of entries.
    ///
    /// # Errors
    /// As [`Self::add`].
    pub fn finish(mut self) -> io::Result<()> {
        let full = |_| io::Error::from(io::ErrorKind::FileTooLarge);
        let start = u32::try_from(self.written).map_err(full)?;
        let size = u32::try_from(self.directory.len()).map_err(full)?;
        let directory = std::mem::take(&mut self.directory);
        self.write(&directory)?;
        self.write(b"PK\x05\x06")?;
        let counts = [0, 0, self.entries, self.entries].map(u16::to_le_bytes);
        self.write(&counts.concat())?;
        self.write(&[size, start].map(u32::to_le_bytes).concat())?;
        self.write(&0u16.to_le_bytes())?;
        self.to.flush()
    }

    fn write(&mut self, bytes: &[u8]) -> io::Result<()> {
        self.written += bytes.len() as u64;
        self.to.write_all(bytes)
    }
}

/// Of each byte, the remainder that the checksum goes on with.
const REMAINDERS: [u32; 256] = {
    const POLYNOMIAL: u32 = 0xedb8_8320;
    let mut table = [0; 256];
    let mut byte = 0;
    while byte < 256 {
        let mut remainder = byte as u32;
        let mut bit = 0;
        while bit < 8 {
            let low = remainder & 1;
            remainder >>= 1;
            if low == 1 {
                remainder ^= POLYNOMIAL;
            }
            bit += 1;
        }
        table[byte] = remainder;
        byte += 1;
    }
    table
};

fn crc32(bytes: &[u8]) -> u32 {
    let step = |sum: u32, byte: &u8| (sum >> 8) ^ REMAINDERS[usize::from(sum as u8 ^ byte)];
    !bytes.iter().fold(!0, step)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_checksum_is_the_formats() {
        assert_eq!(crc32(b"123456789"), 0xcbf4_3926);
        assert_eq!(crc32(b""), 0);
    }

    #[test]
    fn entries_are_where_the_list_says() {
        let files = [
            ("a/0000.png", &b"one"[..]),
            ("b", b""),
            ("cameras.json", b"{}"),
        ];
        let mut bytes = Vec::new();
        let mut zip = ZipWriter::new(&mut bytes);
        for (name, content) in files {
            zip.add(name, content).unwrap();
        }
        zip.finish().unwrap();
        let number = |at: usize| u32::from_le_bytes(bytes[at..at + 4].try_into().unwrap()) as usize;
        let end = bytes.len() - 22;
        assert_eq!(&bytes[end..end + 4], b"PK\x05\x06");
        let mut at = number(end + 16);
        assert_eq!(at + number(end + 12), end);
        for (name, content) in files {
            assert_eq!(&bytes[at..at + 4], b"PK\x01\x02");
            assert_eq!(
                (number(at + 20), number(at + 16)),
                (content.len(), crc32(content) as usize)
            );
            let local = number(at + 42);
            assert_eq!(&bytes[local..local + 4], b"PK\x03\x04");
            let found = &bytes[local + 30..local + 30 + name.len() + content.len()];
            assert_eq!(found, [name.as_bytes(), content].concat());
            assert_eq!(&bytes[at + 46..at + 46 + name.len()], name.as_bytes());
            at += 46 + name.len();
        }
        assert_eq!(at, end);
    }
}
