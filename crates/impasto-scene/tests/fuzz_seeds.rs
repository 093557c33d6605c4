//! A small fuzzing that is the same every time: what the fuzz targets start from, changed at random,
//! and every input that they ever stumbled over. Nothing of it may panic, and nothing may be
//! allocated that the input cannot need. See docs/fuzzing.md.
#![allow(clippy::unwrap_used, reason = "a failure here is a failed test")]

#[path = "../../../fuzz/src/scene/mod.rs"]
mod scene;

use std::alloc::{GlobalAlloc, Layout, System};
use std::fs;
use std::path::Path;
use std::sync::atomic::{AtomicUsize, Ordering};

use scene::Target;

/// Changed inputs of every seed.
const CHANGED: u64 = 150;
/// Most bytes of one allocation: what a decoder may take beside the pixels, and a megapixel of 16-bit
/// RGBA. Inputs have a few kilobytes.
const MOST_AT_ONCE: usize = (64 << 20) + (8 << 20);

/// The system's allocator, which remembers the largest request.
struct Watched;

static LARGEST: AtomicUsize = AtomicUsize::new(0);

#[global_allocator]
static WATCHED: Watched = Watched;

// SAFETY: every call is handed on to the system's allocator as it came.
unsafe impl GlobalAlloc for Watched {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        LARGEST.fetch_max(layout.size(), Ordering::Relaxed);
        // SAFETY: the caller's promises are those that the system's allocator asks for.
        unsafe { System.alloc(layout) }
    }

    unsafe fn alloc_zeroed(&self, layout: Layout) -> *mut u8 {
        LARGEST.fetch_max(layout.size(), Ordering::Relaxed);
        // SAFETY: as above.
        unsafe { System.alloc_zeroed(layout) }
    }

    unsafe fn realloc(&self, pointer: *mut u8, layout: Layout, size: usize) -> *mut u8 {
        LARGEST.fetch_max(size, Ordering::Relaxed);
        // SAFETY: as above.
        unsafe { System.realloc(pointer, layout, size) }
    }

    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        // SAFETY: as above.
        unsafe { System.dealloc(pointer, layout) }
    }
}

/// Marsaglia's xorshift: the tests need no better numbers.
struct Dice(u64);

impl Dice {
    fn below(&mut self, end: usize) -> usize {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        (self.0 >> 16) as usize % end.max(1)
    }
}

/// What numbers in text are replaced by.
const WORDS: [&[u8]; 8] = [
    b"nan",
    b"-1",
    b"0",
    b"1e308",
    b"-1e-308",
    b"4294967295",
    b"18446744073709551615",
    b"\"\"",
];

/// What eight bytes are replaced by.
fn eight(dice: &mut Dice) -> [u8; 8] {
    let floats = [f64::NAN, f64::INFINITY, 1e308, -1e-308, 0.0];
    match dice.below(3) {
        0 => u64::MAX.to_le_bytes(),
        1 => (1u64 << dice.below(64)).to_le_bytes(),
        _ => floats[dice.below(floats.len())].to_le_bytes(),
    }
}

/// The input with a few changes: bits flipped, numbers replaced, parts cut, doubled or dropped.
fn changed(seed: &[u8], dice: &mut Dice) -> Vec<u8> {
    let mut bytes = seed.to_vec();
    for _ in 0..=dice.below(3) {
        let at = dice.below(bytes.len());
        let end = (at + 1 + dice.below(16)).min(bytes.len());
        match dice.below(6) {
            0 if at < bytes.len() => bytes[at] ^= 1 << dice.below(8),
            1 => bytes.truncate(at),
            2 if at + 8 <= bytes.len() => bytes[at..at + 8].copy_from_slice(&eight(dice)),
            3 if at < bytes.len() => {
                let part = bytes[at..end].to_vec();
                bytes.splice(at..at, part);
            }
            4 if at < bytes.len() => drop(bytes.drain(at..end)),
            _ => {
                let number = |b: &u8| b.is_ascii_digit() || b".-+e".contains(b);
                let from = at + bytes[at..].iter().take_while(|b| !number(b)).count();
                let length = bytes[from..].iter().take_while(|b| number(b)).count();
                let word = WORDS[dice.below(WORDS.len())];
                bytes.splice(from..from + length, word.iter().copied());
            }
        }
    }
    bytes
}

#[track_caller]
fn assert_bounded(target: &str) {
    let largest = LARGEST.load(Ordering::Relaxed);
    assert!(
        largest <= MOST_AT_ONCE,
        "{target}: {largest} bytes were allocated at once"
    );
}

#[test]
fn seeds_are_whole_and_changed_ones_do_no_harm() {
    let dir = tempfile::tempdir().unwrap();
    for name in Target::NAMES {
        let target = Target::named(name, dir.path());
        let seeds = scene::seeds();
        let own: Vec<_> = seeds.iter().filter(|(of, ..)| *of == name).collect();
        assert!(!own.is_empty(), "{name} has no seed");
        for (_, seed, bytes) in own {
            assert!(target.run(bytes), "the seed {seed} of {name} is refused");
            let mut dice = Dice(0x9e37_79b9_7f4a_7c15);
            for _ in 0..CHANGED {
                target.run(&changed(bytes, &mut dice));
                assert_bounded(name);
            }
        }
    }
}

#[test]
fn what_was_found_does_no_harm() {
    let dir = tempfile::tempdir().unwrap();
    let found = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/fuzz");
    for name in Target::NAMES {
        let Ok(inputs) = fs::read_dir(found.join(name)) else {
            continue;
        };
        let target = Target::named(name, dir.path());
        for input in inputs {
            target.run(&fs::read(input.unwrap().path()).unwrap());
            assert_bounded(name);
        }
    }
}
