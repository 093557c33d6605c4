//! The installed VGG-19.
#![no_main]

use std::path::PathBuf;
use std::sync::LazyLock;

use impasto_fuzz::{check_message, scratch};
use impasto_style::weights::inspect_vgg19;
use libfuzzer_sys::fuzz_target;

static FILE: LazyLock<PathBuf> = LazyLock::new(|| scratch().join("vgg19.safetensors"));

fuzz_target!(|bytes: &[u8]| {
    std::fs::write(&*FILE, bytes).expect("memory is writable");
    if let Err(error) = inspect_vgg19(&FILE) {
        check_message(&error);
    }
});
