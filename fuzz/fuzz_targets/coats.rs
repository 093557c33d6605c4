//! Coats of paint as JSON.
#![no_main]

use impasto_fuzz::check_message;
use impasto_train::Coats;
use libfuzzer_sys::fuzz_target;

fuzz_target!(|bytes: &[u8]| {
    let Ok(coats) = serde_json::from_slice::<Coats>(bytes) else {
        return;
    };
    if let Err(error) = coats.check() {
        check_message(&error);
        return;
    }
    let written = serde_json::to_vec(&coats).expect("JSON");
    let again: Coats = serde_json::from_slice(&written).expect("what was written");
    assert_eq!(again, coats);
});
