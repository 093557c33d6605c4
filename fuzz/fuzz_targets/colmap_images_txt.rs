//! COLMAP's `images.txt` in a capture that is otherwise whole.
#![no_main]

use std::sync::LazyLock;

use impasto_fuzz::{Capture, Kind};
use libfuzzer_sys::fuzz_target;

static CAPTURE: LazyLock<Capture> =
    LazyLock::new(|| Capture::new(Kind::ColmapTxt, "sparse/0/images.txt"));

fuzz_target!(|bytes: &[u8]| CAPTURE.load_with(bytes));
