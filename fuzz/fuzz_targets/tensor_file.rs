//! Files of safetensors as networks and models are kept in.
#![no_main]

use impasto_fuzz::{TensorFile, check_message};
use libfuzzer_sys::fuzz_target;

fuzz_target!(|bytes: &[u8]| {
    let file = match TensorFile::open("input", bytes) {
        Ok(file) => file,
        Err(error) => return check_message(&error),
    };
    for name in ["mean", "scale", "gain"] {
        match file.floats(name) {
            Ok(floats) => assert!(2 * floats.len() <= bytes.len()),
            Err(error) => check_message(&error),
        }
        if let Err(error) = file.floats_of(name, 4) {
            check_message(&error);
        }
    }
});
