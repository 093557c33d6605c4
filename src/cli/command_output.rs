//! What a command has to say in the end.

use serde_json::Value;

use super::console;

/// The result of a command, for people and for programs.
#[derive(Debug)]
pub struct CommandOutput {
    /// For people.
    pub text: String,
    /// For programs.
    pub json: Value,
}

impl CommandOutput {
    /// Prints one of both.
    pub fn print(&self, as_json: bool) {
        if as_json {
            console::result(&self.json.to_string());
        } else {
            console::result(&self.text);
        }
    }
}

/// A plain structure as JSON. Numbers that JSON lacks (NaN, infinity) become `null`.
pub fn to_json(structure: &impl serde::Serialize) -> Value {
    // Structures with text keys, for which this cannot fail.
    serde_json::to_value(structure).unwrap_or_default()
}

/// What follows the name of a result that shows no real place.
pub fn of_synthetic(synthetic: bool) -> &'static str {
    if synthetic {
        " of a synthetic scene"
    } else {
        ""
    }
}
