//! Which clip is whose: what the page does not say.

use super::StudyError;
use crate::names::{OURS, PHOTO};
use serde::{Deserialize, Serialize};
use std::collections::BTreeSet;

/// Version of the forms of key, page and answers.
pub const SCHEMA: u32 = 1;

/// One of two clips.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Side {
    /// The left one.
    A,
    /// The right one.
    B,
}

/// What a page's question shows.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Question {
    /// The only name that the page has for it.
    pub id: String,
    /// Name of the painting.
    pub painting: String,
    /// Name of the method whose clip is A.
    pub a: String,
    /// Name of the method whose clip is B.
    pub b: String,
}

/// What a question is for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Asked<'a> {
    /// A comparison with a method.
    Compared {
        /// The other method's name.
        method: &'a str,
        /// Impasto's side.
        ours: Side,
    },
    /// A catch trial.
    Catch {
        /// The unstylised render's side: the wrong answer to which matches the painting better.
        photo: Side,
    },
}

/// The experimenter's half of a study.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct StudyKey {
    /// [`SCHEMA`].
    pub schema: u32,
    /// Name of the study, made from its contents.
    pub study: String,
    /// Whether the scene was made by code.
    pub synthetic: bool,
    /// Start of the random numbers.
    pub seed: u64,
    /// Frames of a clip.
    pub frames: usize,
    /// Width and height of a frame in pixels.
    pub size: [u32; 2],
    /// JPEG quality of all frames, 1 to 100.
    pub quality: u8,
    /// Frames a second.
    pub rate: u32,
    /// Every question of the page.
    pub questions: Vec<Question>,
}

impl Question {
    /// What it is for; `None` if it is neither a comparison with Impasto nor a catch trial.
    pub fn asked(&self) -> Option<Asked<'_>> {
        let compared = |method, ours| Some(Asked::Compared { method, ours });
        match [self.a.as_str(), self.b.as_str()] {
            [OURS, OURS | PHOTO] | [PHOTO, OURS | PHOTO] => None,
            [OURS, method] => compared(method, Side::A),
            [method, OURS] => compared(method, Side::B),
            [PHOTO, _] => Some(Asked::Catch { photo: Side::A }),
            [_, PHOTO] => Some(Asked::Catch { photo: Side::B }),
            _ => None,
        }
    }
}

impl StudyKey {
    /// Reads a key's JSON.
    ///
    /// # Errors
    /// If it is not one, or of another version, or its questions make no sense.
    pub fn read(text: &str) -> Result<Self, StudyError> {
        let key: Self =
            serde_json::from_str(text).map_err(|error| StudyError::Key(error.to_string()))?;
        let fault = |what: String| Err(StudyError::Key(what));
        if key.schema != SCHEMA {
            return fault(format!("its schema is {}, not {SCHEMA}", key.schema));
        }
        let mut ids = BTreeSet::new();
        for question in &key.questions {
            if question.asked().is_none() {
                let Question { id, a, b, .. } = question;
                return fault(format!("question {id} compares {a} with {b}"));
            }
            if !ids.insert(&question.id) {
                return fault(format!("question {} is there twice", question.id));
            }
        }
        if key.questions.is_empty() {
            return fault("it has no questions".into());
        }
        Ok(key)
    }
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;

    pub(in crate::study) fn key(pairs: &[[&str; 2]]) -> StudyKey {
        let question = |(i, [a, b]): (usize, &[&str; 2])| Question {
            id: format!("q{i}"),
            painting: format!("painting {i}"),
            a: (*a).to_owned(),
            b: (*b).to_owned(),
        };
        StudyKey {
            schema: SCHEMA,
            study: "5eed".into(),
            synthetic: true,
            seed: 7,
            frames: 2,
            size: [40, 30],
            quality: 75,
            rate: 12,
            questions: pairs.iter().enumerate().map(question).collect(),
        }
    }

    #[test]
    fn questions_compare_with_impasto_or_catch() {
        let key = key(&[["impasto", "wct"], ["wct", "impasto"], ["wct", "photo"]]);
        let asked: Vec<_> = key.questions.iter().map(Question::asked).collect();
        let compared = |ours| {
            Some(Asked::Compared {
                method: "wct",
                ours,
            })
        };
        let caught = Some(Asked::Catch { photo: Side::B });
        assert_eq!(asked, [compared(Side::A), compared(Side::B), caught]);
        let text = serde_json::to_string(&key).unwrap();
        assert_eq!(StudyKey::read(&text).unwrap(), key);
    }

    #[test]
    fn what_is_no_key_is_refused() {
        let text = |key: &StudyKey| serde_json::to_string(key).unwrap();
        let mut twice = key(&[["impasto", "wct"]; 2]);
        twice.questions[1].id = "q0".into();
        let mut newer = key(&[["impasto", "wct"]]);
        newer.schema = 9;
        for (wrong, why) in [
            ("{".to_owned(), "EOF"),
            ("[]".to_owned(), "key of a study"),
            (text(&key(&[])), "no questions"),
            (
                text(&key(&[["impasto", "photo"]])),
                "compares impasto with photo",
            ),
            (text(&key(&[["wct", "adain"]])), "compares wct with adain"),
            (text(&twice), "q0 is there twice"),
            (text(&newer), "schema is 9"),
        ] {
            let error = StudyKey::read(&wrong).unwrap_err().to_string();
            assert!(error.contains(why), "{error} lacks {why}");
        }
    }
}
