//! The model file.
#![no_main]

use std::path::PathBuf;
use std::sync::LazyLock;

use impasto_fuzz::{check_message, scratch};
use impasto_model::{Device, ModelFile};
use libfuzzer_sys::fuzz_target;

static FILE: LazyLock<PathBuf> = LazyLock::new(|| scratch().join("model.safetensors"));

fuzz_target!(|bytes: &[u8]| {
    std::fs::write(&*FILE, bytes).expect("memory is writable");
    if let Err(error) = ModelFile::load(&FILE, &Device::default()) {
        check_message(&error);
    }
});
