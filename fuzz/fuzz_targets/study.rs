//! A study's key and a participant's answers, with a line between them that is `---`.
#![no_main]

use impasto_eval::study::{StudyKey, summarise};
use impasto_fuzz::check_message;
use libfuzzer_sys::fuzz_target;

fuzz_target!(|bytes: &[u8]| {
    let Ok(text) = std::str::from_utf8(bytes) else {
        return;
    };
    let (key, answers) = text.split_once("\n---\n").unwrap_or((text, "{}"));
    let key = match StudyKey::read(key) {
        Ok(key) => key,
        Err(error) => return check_message(&error),
    };
    let files = [("one.json".to_owned(), answers.to_owned())];
    match summarise(&key, &files) {
        Ok(summary) => drop(serde_json::to_string(&summary).expect("JSON")),
        Err(error) => check_message(&error),
    }
});
