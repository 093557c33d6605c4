//! Statistics of pictures on disk, so that a second run need not look at them again.
//!
//! A file is a header and records of equal length, each with its checksum. It is only ever
//! replaced as a whole.

use crate::hash::Hash;
use half::f16;
use impasto_model::ColorStatistics;
use impasto_scene::file::write_atomic_with;
use impasto_style::Statistics;
use std::collections::HashMap;
use std::fs::File;
use std::io::{BufReader, Error, ErrorKind, Read, Write};
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// First bytes of every file; the number is raised when records change.
const HEADER: &[u8; 16] = b"IMPASTO styles 3";
/// Key, colors, statistics, those of the structure, checksum.
const RECORD: usize = 14 + 8 * ColorStatistics::NUMBERS + 4 * Statistics::LEN + 8;
/// No file holds more records, which bounds the memory that reading takes.
const MOST_RECORDS: usize = 160_000;

/// The cache folder of this user: `$IMPASTO_CACHE`, else `$XDG_CACHE_HOME/impasto`, else
/// `~/.cache/impasto`. `None` if `$IMPASTO_CACHE` is empty or there is no home.
pub fn cache_folder() -> Option<PathBuf> {
    let folder = |name: &str| std::env::var_os(name).map(PathBuf::from);
    match folder("IMPASTO_CACHE") {
        Some(chosen) => Some(chosen).filter(|path| !path.as_os_str().is_empty()),
        None => folder("XDG_CACHE_HOME")
            .filter(|path| path.is_absolute())
            .or_else(|| Some(folder("HOME")?.join(".cache")))
            .map(|caches| caches.join("impasto")),
    }
}

/// What is kept of one picture, 8 kB.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Measured {
    /// Statistics, in half precision also when freshly measured: a run must not depend on what
    /// was cached.
    statistics: Box<[f16]>,
    /// What its code is made of.
    structure: Box<[f16]>,
    /// Its colours.
    pub colors: ColorStatistics,
}

impl Measured {
    /// Rounds what was measured.
    pub(crate) fn new(
        statistics: &Statistics,
        structure: &Statistics,
        colors: ColorStatistics,
    ) -> Self {
        let rounded = |s: &Statistics| s.0.iter().map(|x| f16::from_f32(*x)).collect();
        Self {
            statistics: rounded(statistics),
            structure: rounded(structure),
            colors,
        }
    }

    /// What its code is made of.
    pub(crate) fn structure(&self) -> Statistics {
        Statistics(self.structure.iter().map(|x| x.to_f32()).collect())
    }

    /// The statistics.
    pub(crate) fn statistics(&self) -> Statistics {
        Statistics(self.statistics.iter().map(|x| x.to_f32()).collect())
    }
}

/// What was measured of which picture.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub(crate) struct Key {
    /// Identity of the file, or number of the generated picture.
    pub picture: u64,
    /// Which crop.
    pub crop: u16,
    /// Height and width of the windows that were averaged, zeros for the whole.
    pub window: [u16; 2],
}

/// Records of one file, in memory.
#[derive(Debug, Default)]
pub(crate) struct Cache {
    /// Where they are kept; `None` if nothing is to be kept.
    path: Option<PathBuf>,
    records: HashMap<Key, Arc<Measured>>,
    unsaved: usize,
}

impl Cache {
    /// Reads the records that `folder` holds for `subject` (a style folder with the settings that
    /// change its statistics). `warn` hears of a damaged file, of which
    /// what lies before the damage is used.
    pub(crate) fn open(folder: Option<&Path>, subject: Hash, warn: &mut dyn FnMut(String)) -> Self {
        let Some(folder) = folder else {
            return Self::default();
        };
        let mut cache = Self {
            path: Some(folder.join(format!("{:016x}.styles", subject.0))),
            ..Self::default()
        };
        cache.load(warn);
        cache
    }

    fn load(&mut self, warn: &mut dyn FnMut(String)) {
        let Some(path) = &self.path else {
            return;
        };
        let Err(error) = read(path, &mut self.records) else {
            return;
        };
        let place = path.display();
        match error.kind() {
            ErrorKind::NotFound => {}
            ErrorKind::InvalidData | ErrorKind::UnexpectedEof => {
                warn(format!(
                    "the cache of statistics {place} is damaged ({error}); what it lacks is \
                     measured again"
                ));
                // So that it is replaced.
                self.unsaved = 1;
            }
            _ => {
                warn(format!(
                    "the cache of statistics {place} cannot be read ({error}); all of them are \
                     measured again"
                ));
                self.path = None;
            }
        }
    }

    /// One record.
    pub(crate) fn get(&self, key: &Key) -> Option<Arc<Measured>> {
        self.records.get(key).map(Arc::clone)
    }

    /// Adds a record, if records are kept at all.
    pub(crate) fn insert(&mut self, key: Key, measured: &Arc<Measured>) {
        if self.path.is_some() && self.records.len() < MOST_RECORDS {
            self.records.insert(key, Arc::clone(measured));
            self.unsaved += 1;
        }
    }

    /// Writes all records of pictures that `is_current`, if any are new. After a failure, of
    /// which `warn` hears, nothing is kept any more.
    pub(crate) fn save(&mut self, is_current: impl Fn(u64) -> bool, warn: &mut dyn FnMut(String)) {
        let Some(path) = self.path.as_ref().filter(|_| self.unsaved > 0) else {
            return;
        };
        let mut records: Vec<_> = self.records.iter().collect();
        records.retain(|(key, _)| is_current(key.picture));
        records.sort_by_key(|(key, _)| **key);
        if let Err(error) = replace(path, &records) {
            warn(format!(
                "statistics cannot be cached in {} ({error}); the next run measures them again, \
                 unless IMPASTO_CACHE names a folder that can be written to",
                path.display()
            ));
            self.path = None;
        }
        self.unsaved = 0;
    }
}

fn read(path: &Path, records: &mut HashMap<Key, Arc<Measured>>) -> Result<(), Error> {
    let mut file = BufReader::with_capacity(1 << 20, File::open(path)?);
    let mut header = [0; HEADER.len()];
    file.read_exact(&mut header)?;
    if &header != HEADER {
        return Err(Error::new(ErrorKind::InvalidData, "it is of another kind"));
    }
    let mut bytes = [0; RECORD];
    while records.len() < MOST_RECORDS {
        if file.by_ref().take(1).read(&mut bytes[..1])? == 0 {
            break;
        }
        file.read_exact(&mut bytes[1..])?;
        let (key, measured) = decode(&bytes)
            .ok_or_else(|| Error::new(ErrorKind::InvalidData, "a record is damaged"))?;
        records.insert(key, Arc::new(measured));
    }
    Ok(())
}

fn replace(path: &Path, records: &[(&Key, &Arc<Measured>)]) -> Result<(), Error> {
    if let Some(folder) = path.parent() {
        std::fs::create_dir_all(folder)?;
    }
    write_atomic_with(path, |file| {
        file.write_all(HEADER)?;
        let mut records = records.iter();
        records.try_for_each(|(key, measured)| file.write_all(&encode(key, measured)))
    })
}

fn encode(key: &Key, measured: &Measured) -> Vec<u8> {
    let mut bytes = Vec::with_capacity(RECORD);
    bytes.extend(key.picture.to_le_bytes());
    for number in [key.crop, key.window[0], key.window[1]] {
        bytes.extend(number.to_le_bytes());
    }
    let colors = measured.colors.numbers();
    bytes.extend(colors.iter().flat_map(|x| x.to_le_bytes()));
    let halves = measured.statistics.iter().chain(&measured.structure);
    bytes.extend(halves.flat_map(|x| x.to_le_bytes()));
    bytes.extend(Hash::of_bytes(&bytes).0.to_le_bytes());
    bytes
}

fn decode(bytes: &[u8; RECORD]) -> Option<(Key, Measured)> {
    let (content, checksum) = bytes.split_last_chunk::<8>()?;
    if Hash::of_bytes(content).0 != u64::from_le_bytes(*checksum) {
        return None;
    }
    let (picture, rest) = content.split_first_chunk::<8>()?;
    let (key, rest) = rest.split_first_chunk::<6>()?;
    let short = |i: usize| u16::from_le_bytes([key[i], key[i + 1]]);
    let (colors, statistics) = rest.split_at_checked(8 * ColorStatistics::NUMBERS)?;
    let mut numbers = [0.0; ColorStatistics::NUMBERS];
    let (words, _) = colors.as_chunks::<8>();
    for (number, word) in numbers.iter_mut().zip(words) {
        *number = f64::from_le_bytes(*word);
    }
    let (halves, _) = statistics.as_chunks::<2>();
    let (whole, structure) = halves.split_at_checked(Statistics::LEN)?;
    let numbers_of = |halves: &[[u8; 2]]| halves.iter().map(|b| f16::from_le_bytes(*b)).collect();
    Some((
        Key {
            picture: u64::from_le_bytes(*picture),
            crop: short(0),
            window: [short(2), short(4)],
        },
        Measured {
            statistics: numbers_of(whole),
            structure: numbers_of(structure),
            colors: ColorStatistics::of_numbers(&numbers),
        },
    ))
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, reason = "a test may panic")]

    use super::*;

    fn picture(number: u16) -> (Key, Arc<Measured>) {
        let colours = [0.1 * f32::from(number), 0.3, 0.9, 0.2, 0.7, 0.4];
        let statistics = Statistics(vec![f32::from(number) + 0.123_456; Statistics::LEN]);
        let colors = ColorStatistics::of(colours.chunks_exact(3));
        let key = Key {
            picture: u64::from(number),
            crop: number,
            window: [number, 67],
        };
        (
            key,
            Arc::new(Measured::new(&statistics, &statistics, colors)),
        )
    }

    /// A cache of three records in `folder`, and its file.
    fn filled(folder: &Path) -> PathBuf {
        let mut cache = Cache::open(Some(folder), Hash(7), &mut |text| panic!("{text}"));
        for number in 0..3 {
            let (key, measured) = picture(number);
            cache.insert(key, &measured);
        }
        cache.save(|_| true, &mut |text| panic!("{text}"));
        cache.path.unwrap()
    }

    fn reopened(folder: &Path) -> (usize, Vec<String>) {
        let mut warnings = Vec::new();
        let cache = Cache::open(Some(folder), Hash(7), &mut |text| warnings.push(text));
        let whole = |n: &u16| {
            let (key, measured) = picture(*n);
            cache.get(&key) == Some(measured)
        };
        ((0..3).filter(whole).count(), warnings)
    }

    #[test]
    fn records_come_back_exactly() {
        let dir = tempfile::tempdir().unwrap();
        filled(&dir.path().join("made/when/needed"));
        assert_eq!(
            reopened(&dir.path().join("made/when/needed")),
            (3, Vec::new())
        );
        assert_eq!(reopened(dir.path()), (0, Vec::new()), "none is no damage");
    }

    #[test]
    fn records_of_other_pictures_are_dropped() {
        let dir = tempfile::tempdir().unwrap();
        let path = filled(dir.path());
        let mut cache = Cache::open(Some(dir.path()), Hash(7), &mut |_| ());
        let (key, measured) = picture(2);
        cache.insert(key, &measured);
        cache.save(|picture| picture != 1, &mut |text| panic!("{text}"));
        assert_eq!(reopened(dir.path()).0, 2);
        let length = std::fs::metadata(path).unwrap().len() as usize;
        assert_eq!(length, HEADER.len() + 2 * RECORD);
    }

    #[test]
    fn damage_is_told_and_survived() {
        let dir = tempfile::tempdir().unwrap();
        let path = filled(dir.path());
        let whole = std::fs::read(&path).unwrap();
        let mut flipped = whole.clone();
        flipped[HEADER.len() + RECORD + 500] ^= 1;
        for (bytes, left) in [
            (&flipped[..], 1),
            (&whole[..whole.len() - 5], 2),
            (&whole[..7], 0),
            (b"something else altogether", 0),
        ] {
            std::fs::write(&path, bytes).unwrap();
            let (found, warnings) = reopened(dir.path());
            assert_eq!((found, warnings.len()), (left, 1), "{warnings:?}");
        }
    }

    #[test]
    fn a_folder_that_cannot_be_written_is_told_once() {
        let dir = tempfile::tempdir().unwrap();
        let file = dir.path().join("file");
        std::fs::write(&file, "in the way").unwrap();
        let mut warnings = 0;
        let mut cache = Cache::open(Some(dir.path()), Hash(7), &mut |_| ());
        cache.path = Some(file.join("below.styles"));
        for number in 0..2 {
            let (key, measured) = picture(number);
            cache.insert(key, &measured);
            cache.save(|_| true, &mut |_| warnings += 1);
        }
        assert_eq!(warnings, 1);
    }
}
