//! A pose or intrinsics of a NeRF++ capture.
#![no_main]

use std::sync::LazyLock;

use impasto_fuzz::scene::Target;
use impasto_fuzz::scratch;
use libfuzzer_sys::fuzz_target;

static TARGET: LazyLock<Target> = LazyLock::new(|| Target::named("nerf_plus_plus", &scratch()));

fuzz_target!(|bytes: &[u8]| {
    TARGET.run(bytes);
});
