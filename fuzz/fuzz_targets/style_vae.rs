//! The style encoder's file: what is accepted is written and read again.
#![no_main]

use impasto_fuzz::check_message;
use impasto_style::StyleVae;
use libfuzzer_sys::fuzz_target;

fuzz_target!(|bytes: &[u8]| match StyleVae::from_bytes("input", bytes) {
    Ok(vae) => assert!(!vae.to_bytes().expect("it was read").is_empty()),
    Err(error) => check_message(&error),
});
