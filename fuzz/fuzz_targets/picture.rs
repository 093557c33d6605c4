//! Pictures of every format. Those of more than a megapixel are left out, so that the bound on
//! memory is one of the decoder and not of the picture.
#![no_main]

use std::io::Cursor;
use std::path::PathBuf;
use std::sync::LazyLock;

use image::ImageReader;
use impasto_fuzz::{check_message, scratch};
use impasto_scene::read_rgb;
use libfuzzer_sys::fuzz_target;

static FILE: LazyLock<PathBuf> = LazyLock::new(|| scratch().join("picture"));

fuzz_target!(|bytes: &[u8]| {
    let header = ImageReader::new(Cursor::new(bytes)).with_guessed_format();
    let size = header.ok().and_then(|r| r.into_dimensions().ok());
    if size.is_some_and(|(w, h)| u64::from(w) * u64::from(h) > 1 << 20) {
        return;
    }
    std::fs::write(&*FILE, bytes).expect("memory is writable");
    match read_rgb(&FILE) {
        Ok(pixels) => assert!(pixels.width() > 0 && pixels.height() > 0),
        Err(error) => check_message(&error),
    }
});
