//! What a participant sends back.

use super::key::{Asked, SCHEMA, Side, StudyKey};
use serde::Deserialize;
use std::collections::BTreeMap;

/// A participant's file.
#[derive(Debug, Clone, Deserialize)]
pub(super) struct Answers {
    schema: u32,
    study: String,
    /// A random name.
    pub(super) participant: String,
    /// In the order in which the questions were asked.
    answers: Vec<PairAnswer>,
}

/// What was said of a pair.
#[derive(Debug, Clone, Deserialize)]
pub(super) struct PairAnswer {
    question: String,
    /// Which matches the painting better.
    #[serde(rename = "match")]
    pub(super) matches: Reply,
    /// Which flickers less.
    pub(super) flicker: Reply,
}

/// One click.
#[derive(Debug, Clone, Copy, Deserialize)]
pub(super) struct Reply {
    pub(super) choice: Choice,
    /// Since the pair was first shown.
    pub(super) seconds: f64,
}

/// What can be clicked.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case")]
pub(super) enum Choice {
    A,
    B,
    /// Cannot tell.
    Neither,
}

impl Choice {
    /// Whether it is this side; `None` for neither.
    pub(super) fn is(self, side: Side) -> Option<bool> {
        match self {
            Self::A => Some(side == Side::A),
            Self::B => Some(side == Side::B),
            Self::Neither => None,
        }
    }
}

impl Answers {
    /// Reads a file's JSON; the error is what is wrong with it.
    pub(super) fn read(text: &str, key: &StudyKey) -> Result<Self, String> {
        let file: Self = serde_json::from_str(text)
            .map_err(|error| format!("is no file of answers ({error})"))?;
        if file.schema != SCHEMA {
            return Err(format!("has schema {}, not {SCHEMA}", file.schema));
        }
        if file.study != key.study {
            return Err(format!("answers study {}, not {}", file.study, key.study));
        }
        if let Some(answer) = file.answers.iter().find(|a| !a.timed()) {
            return Err(format!("took an impossible time for {}", answer.question));
        }
        let answered = file.by_question();
        let asked = |id: &str| key.questions.iter().any(|question| question.id == id);
        if let Some(id) = answered.keys().find(|id| !asked(id)) {
            return Err(format!("answers {id}, which this study does not ask"));
        }
        if answered.len() < file.answers.len() {
            return Err("answers a question twice".into());
        }
        match (answered.len(), key.questions.len()) {
            (given, all) if given < all => Err(format!("answers {given} of {all} questions")),
            _ => Ok(file),
        }
    }

    /// What was asked, in the key's order, and answered.
    pub(super) fn asked<'a, 'k>(
        &'a self,
        key: &'k StudyKey,
    ) -> impl Iterator<Item = (Asked<'k>, &'a PairAnswer)> {
        let given = self.by_question();
        let questions = key.questions.iter();
        questions.filter_map(move |q| Some((q.asked()?, *given.get(q.id.as_str())?)))
    }

    fn by_question(&self) -> BTreeMap<&str, &PairAnswer> {
        let answers = self.answers.iter();
        answers.map(|a| (a.question.as_str(), a)).collect()
    }

    /// Time for every pair, in seconds.
    pub(super) fn seconds(&self) -> impl Iterator<Item = f64> + '_ {
        let answers = self.answers.iter();
        answers.map(|a| a.matches.seconds.max(a.flicker.seconds))
    }
}

impl PairAnswer {
    fn timed(&self) -> bool {
        [self.matches, self.flicker]
            .iter()
            .all(|reply| reply.seconds.is_finite() && reply.seconds >= 0.0)
    }
}
