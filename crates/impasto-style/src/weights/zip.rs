//! Where the entries of a zip file lie, as far as PyTorch uses zip: stored, not compressed.

use super::source::ByteSource;
use std::collections::HashMap;

/// An entry's place in the file, in bytes.
#[derive(Debug, Clone, Copy)]
pub(crate) struct ZipEntry {
    pub start: u64,
    pub length: u64,
}

/// Length of the record at the file's end, without its comment.
const END: usize = 22;
const LONGEST_COMMENT: u64 = 0xffff;
/// Most bytes of the list of entries.
const LONGEST_LIST: u64 = 16 << 20;
/// Length of an entry in that list and of its head in the file, both without names.
const LISTED: usize = 46;
const HEAD: u64 = 30;

/// All entries by name.
pub(crate) fn entries(source: &mut ByteSource) -> Result<HashMap<String, ZipEntry>, String> {
    let (count, start, length) = end(source)?;
    if length > LONGEST_LIST {
        return Err("has a longer list of entries than any checkpoint".into());
    }
    let list = source.bytes(start, length)?;
    let mut rest = list.as_slice();
    let mut entries = HashMap::new();
    for _ in 0..count {
        let (record, after) = rest.split_at_checked(LISTED).ok_or(DAMAGED)?;
        if !record.starts_with(b"PK\x01\x02") {
            return Err(DAMAGED.into());
        }
        let [name, extra, comment] = [28, 30, 32].map(|at| usize::from(u16_at(record, at)));
        let (tail, after) = after
            .split_at_checked(name + extra + comment)
            .ok_or(DAMAGED)?;
        rest = after;
        let name = String::from_utf8_lossy(&tail[..name]).into_owned();
        let [flags, method] = [8, 10].map(|at| u16_at(record, at));
        let [packed, length, head] = [20, 24, 42].map(|at| u64::from(u32_at(record, at)));
        if flags & 1 != 0 || method != 0 || packed != length {
            return Err(format!(
                "has \"{name}\" compressed or encrypted, which PyTorch never does; save it again \
                 with torch.save"
            ));
        }
        let start = contents(source, head)?;
        source.within(start, length)?;
        entries.insert(name, ZipEntry { start, length });
    }
    Ok(entries)
}

const DAMAGED: &str = "is a zip file with a damaged list of entries; copy or download it again";

fn u16_at(bytes: &[u8], at: usize) -> u16 {
    u16::from_le_bytes([bytes[at], bytes[at + 1]])
}

fn u32_at(bytes: &[u8], at: usize) -> u32 {
    u32::from_le_bytes([bytes[at], bytes[at + 1], bytes[at + 2], bytes[at + 3]])
}

/// Number of entries, and start and length of their list.
fn end(source: &mut ByteSource) -> Result<(u16, u64, u64), String> {
    let tail = source.length().min(END as u64 + LONGEST_COMMENT);
    let tail = source.bytes(source.length() - tail, tail)?;
    let record = (0..=tail.len().saturating_sub(END))
        .rev()
        .filter_map(|at| tail.get(at..))
        .find(|record| {
            record.len() >= END
                && record.starts_with(b"PK\x05\x06")
                && END + usize::from(u16_at(record, 20)) == record.len()
        })
        .ok_or("is a zip file that ends too early; copy or download it again")?;
    let [length, start] = [12, 16].map(|at| u64::from(u32_at(record, at)));
    if start == u64::from(u32::MAX) || length == u64::from(u32::MAX) {
        return Err("is a zip file of more than 4 GiB, no VGG-19 is that large".into());
    }
    Ok((u16_at(record, 10), start, length))
}

/// Where an entry's contents start, whose head is at `head`.
fn contents(source: &mut ByteSource, head: u64) -> Result<u64, String> {
    let bytes = source.bytes(head, HEAD)?;
    if !bytes.starts_with(b"PK\x03\x04") {
        return Err(DAMAGED.into());
    }
    let [name, extra] = [26, 28].map(|at| u64::from(u16_at(&bytes, at)));
    Ok(head + HEAD + name + extra)
}
