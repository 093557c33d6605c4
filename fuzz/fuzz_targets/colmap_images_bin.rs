//! COLMAP's `images.bin` in a capture that is otherwise whole.
#![no_main]

use std::sync::LazyLock;

use impasto_fuzz::{Capture, Kind};
use libfuzzer_sys::fuzz_target;

static CAPTURE: LazyLock<Capture> =
    LazyLock::new(|| Capture::new(Kind::ColmapBin, "sparse/0/images.bin"));

fuzz_target!(|bytes: &[u8]| CAPTURE.load_with(bytes));
