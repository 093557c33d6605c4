//! `transforms.json` beside its photos.
#![no_main]

use std::sync::LazyLock;

use impasto_fuzz::scene::Target;
use impasto_fuzz::scratch;
use libfuzzer_sys::fuzz_target;

static TARGET: LazyLock<Target> = LazyLock::new(|| Target::named("transforms", &scratch()));

fuzz_target!(|bytes: &[u8]| {
    TARGET.run(bytes);
});
