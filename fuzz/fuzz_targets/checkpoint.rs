//! Checkpoints of PyTorch, in both forms, and of safetensors: nothing is read that the file does
//! not hold.
#![no_main]

use std::io::Cursor;

use impasto_fuzz::{WeightsFile, check_message};
use libfuzzer_sys::fuzz_target;

fuzz_target!(|bytes: &[u8]| {
    let mut checkpoint = match WeightsFile::read("input", Cursor::new(bytes.to_vec())) {
        Ok(checkpoint) => checkpoint,
        Err(error) => return check_message(&error),
    };
    // Many tensors may share one storage: a few say as much as all.
    let names: Vec<String> = checkpoint.names().take(8).map(str::to_owned).collect();
    for name in names {
        let shape = checkpoint.shape(&name).expect("it is listed").to_vec();
        match checkpoint.floats(&name, &shape) {
            Ok(floats) => assert!(2 * floats.len() <= bytes.len()),
            Err(error) => check_message(&error),
        }
    }
});
