//! Settings as TOML and as JSON.
#![no_main]

use impasto_fuzz::check_message;
use impasto_model::TrainConfig;
use libfuzzer_sys::fuzz_target;

fuzz_target!(|bytes: &[u8]| {
    let Ok(text) = std::str::from_utf8(bytes) else {
        return;
    };
    let read = [
        toml::from_str::<TrainConfig>(text).ok(),
        serde_json::from_str::<TrainConfig>(text).ok(),
    ];
    for config in read.into_iter().flatten() {
        if let Err(error) = config.validate() {
            check_message(&error);
        }
    }
});
