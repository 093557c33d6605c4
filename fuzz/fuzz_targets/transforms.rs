//! `transforms.json` beside its photos.
#![no_main]

use std::sync::LazyLock;

use impasto_fuzz::{Capture, Kind};
use libfuzzer_sys::fuzz_target;

static CAPTURE: LazyLock<Capture> =
    LazyLock::new(|| Capture::new(Kind::Transforms, "transforms.json"));

fuzz_target!(|bytes: &[u8]| CAPTURE.load_with(bytes));
