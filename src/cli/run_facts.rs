//! What a written result says of the run that it came from.

use std::time::{SystemTime, UNIX_EPOCH};

/// The command as it was given, its words quoted for a shell where they must be.
pub fn command() -> String {
    let words = std::env::args_os().enumerate().map(|(i, word)| {
        let word = word.to_string_lossy();
        match i {
            // Where the program lies says nothing of the result.
            0 => env!("CARGO_BIN_NAME").to_owned(),
            _ => quoted(&word),
        }
    });
    words.collect::<Vec<_>>().join(" ")
}

/// The command that goes on where this one was stopped.
pub fn resuming() -> String {
    const FLAG: &str = "--resume";
    let given = std::env::args_os().any(|word| word == FLAG);
    match command() {
        command if given => command,
        command => format!("{command} {FLAG}"),
    }
}

fn quoted(word: &str) -> String {
    let plain = |c: char| c.is_alphanumeric() || "-_./,:=+@%[]".contains(c);
    if !word.is_empty() && word.chars().all(plain) {
        return word.to_owned();
    }
    format!("'{}'", word.replace('\'', "'\\''"))
}

/// Now, as `2025-11-30 17:05 UTC`.
pub fn now() -> String {
    let since = SystemTime::now().duration_since(UNIX_EPOCH);
    // A clock before 1970 is wrong anyway.
    date(since.unwrap_or_default().as_secs())
}

/// Seconds since 1970 in the Gregorian calendar.
fn date(seconds: u64) -> String {
    let (mut day, second) = (seconds / 86_400, seconds % 86_400);
    let every = |year: u64, years| year.is_multiple_of(years);
    let leap = |year| every(year, 4) && (!every(year, 100) || every(year, 400));
    let mut year = 1970;
    while day >= 365 + u64::from(leap(year)) {
        day -= 365 + u64::from(leap(year));
        year += 1;
    }
    let february = 28 + u64::from(leap(year));
    let mut month = 1;
    for days in [31, february, 31, 30, 31, 30, 31, 31, 30, 31, 30] {
        if day < days {
            break;
        }
        day -= days;
        month += 1;
    }
    let (hour, minute) = (second / 3600, second / 60 % 60);
    format!("{year}-{month:02}-{:02} {hour:02}:{minute:02} UTC", day + 1)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn seconds_become_dates() {
        for (seconds, wanted) in [
            (0, "1970-01-01 00:00 UTC"),
            (951_782_400, "2000-02-29 00:00 UTC"),
            (951_868_800, "2000-03-01 00:00 UTC"),
            (1_767_225_599, "2025-12-31 23:59 UTC"),
            (1_767_225_600, "2026-01-01 00:00 UTC"),
            (4_107_542_400, "2100-03-01 00:00 UTC"),
        ] {
            assert_eq!(date(seconds), wanted);
        }
    }

    #[test]
    fn words_are_quoted_where_a_shell_would_split_them() {
        assert_eq!(quoted("a/b-1.5_x=[3]"), "a/b-1.5_x=[3]");
        assert_eq!(quoted("my photos"), "'my photos'");
        assert_eq!(quoted("it's"), "'it'\\''s'");
        assert_eq!(quoted(""), "''");
    }
}
