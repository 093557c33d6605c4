//! COLMAP's `points3D.bin` in a capture that is otherwise whole.
#![no_main]

use std::sync::LazyLock;

use impasto_fuzz::scene::Target;
use impasto_fuzz::scratch;
use libfuzzer_sys::fuzz_target;

static TARGET: LazyLock<Target> = LazyLock::new(|| Target::named("colmap_points_bin", &scratch()));

fuzz_target!(|bytes: &[u8]| {
    TARGET.run(bytes);
});
