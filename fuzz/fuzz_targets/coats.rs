//! Layers of paint as JSON.
#![no_main]

use impasto_fuzz::check_message;
use impasto_model::StyleLayers;
use libfuzzer_sys::fuzz_target;

fuzz_target!(|bytes: &[u8]| {
    let Ok(layers) = serde_json::from_slice::<StyleLayers>(bytes) else {
        return;
    };
    if let Err(error) = layers.check() {
        check_message(&error);
        return;
    }
    let written = serde_json::to_vec(&layers).expect("JSON");
    let again: StyleLayers = serde_json::from_slice(&written).expect("what was written");
    assert_eq!(again, layers);
});
