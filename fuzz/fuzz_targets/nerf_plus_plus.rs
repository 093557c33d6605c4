//! A matrix of a NeRF++ capture: the first byte decides whether it is a pose or intrinsics.
#![no_main]

use std::sync::LazyLock;

use impasto_fuzz::{Capture, Kind};
use libfuzzer_sys::fuzz_target;

static CAPTURES: LazyLock<[Capture; 2]> = LazyLock::new(|| {
    ["train/pose/1.txt", "train/intrinsics/1.txt"]
        .map(|file| Capture::new(Kind::NerfPlusPlus, file))
});

fuzz_target!(|bytes: &[u8]| {
    if let Some((which, text)) = bytes.split_first() {
        CAPTURES[usize::from(which % 2)].load_with(text);
    }
});
