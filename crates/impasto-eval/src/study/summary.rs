//! What participants said.

use super::StudyError;
use super::answers::Answers;
use super::key::{Asked, StudyKey};
use super::statistics::{bootstrap, sign_test, wilson};
use serde::Serialize;
use std::collections::BTreeMap;

/// Something of both questions.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct PerQuestion<T> {
    /// Which matches the painting better?
    #[serde(rename = "match")]
    pub matches: T,
    /// Which flickers less?
    pub flicker: T,
}

/// The questions' indices where there is one number for each.
const QUESTIONS: [usize; 2] = [0, 1];

impl<T> PerQuestion<T> {
    fn of(make: impl Fn(usize) -> T) -> Self {
        let [matches, flicker] = QUESTIONS.map(make);
        Self { matches, flicker }
    }
}

/// How many prefer Impasto to a method. Shares are from 0 to 1; ½ is no preference.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Preference {
    /// Share of answers that prefer Impasto, those that cannot tell counted as half.
    pub share: f64,
    /// 95 % cluster bootstrap over participants: it respects that answers of one participant are
    /// alike. None with one participant, or if all participants agree.
    pub over_participants: Option<[f64; 2]>,
    /// Wilson's 95 % interval over answers, as if they were independent: too narrow if they are not.
    pub wilson: [f64; 2],
    /// Answers that prefer Impasto.
    pub impasto: usize,
    /// Answers that prefer the method.
    pub other: usize,
    /// Answers that cannot tell.
    pub neither: usize,
    /// Two-sided p-value over answers that prefer either, as if they were independent.
    pub sign_test_answers: f64,
    /// Two-sided p-value over participants, each for what most of their answers prefer.
    pub sign_test_participants: f64,
}

/// Mean share over methods.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct MeanPreference {
    /// Every method counts alike.
    pub share: f64,
    /// 95 % cluster bootstrap, see [`Preference::over_participants`].
    pub over_participants: Option<[f64; 2]>,
}

/// A file that does not count.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct SetAside {
    /// Its name.
    pub file: String,
    /// What is wrong with it.
    pub reason: String,
}

/// The results of a study.
#[derive(Debug, Clone, Serialize)]
pub struct StudySummary {
    /// Name of the study.
    pub study: String,
    /// Whether the scene was made by code.
    pub synthetic: bool,
    /// Participants whose answers count.
    pub participants: usize,
    /// Participants who found an unstylised render nearer to the painting, and are left out.
    pub left_out: usize,
    /// Files that are malformed, of another study, or of a participant who answered already.
    pub set_aside: Vec<SetAside>,
    /// By compared method.
    pub methods: BTreeMap<String, PerQuestion<Preference>>,
    /// Over methods; none without participants.
    pub mean: Option<PerQuestion<MeanPreference>>,
    /// Median time for a pair, both questions, in seconds; none without participants.
    pub seconds: Option<f64>,
}

/// Answers to one question.
#[derive(Debug, Clone, Copy, Default)]
struct Tally {
    impasto: usize,
    other: usize,
    neither: usize,
}

/// By method, then by participant, then by question.
type Tallies<'a> = BTreeMap<&'a str, Vec<[Tally; 2]>>;

/// Results of answer files (name and text) to the study that `key` is of. Files that cannot be used
/// are set aside and named. Of several files of one participant the first counts.
///
/// # Errors
/// If no file can be used.
pub fn summarise(key: &StudyKey, files: &[(String, String)]) -> Result<StudySummary, StudyError> {
    let (usable, set_aside) = sorted(key, files);
    if usable.is_empty() {
        let first = set_aside.into_iter().next();
        return Err(StudyError::NoAnswers {
            files: files.len(),
            first: first.map_or_else(String::new, |first| {
                format!("; {} {}", first.file, first.reason)
            }),
        });
    }
    let counted: Vec<&Answers> = usable.iter().filter(|a| !caught(key, a)).collect();
    let tallies = tallies(key, &counted);
    let methods = tallies.iter().map(|(method, all)| {
        let of = |question| preference(&all.iter().map(|t| t[question]).collect::<Vec<_>>());
        ((*method).to_owned(), PerQuestion::of(of))
    });
    Ok(StudySummary {
        study: key.study.clone(),
        synthetic: key.synthetic,
        participants: counted.len(),
        left_out: usable.len() - counted.len(),
        set_aside,
        methods: methods.collect(),
        mean: (!tallies.is_empty()).then(|| {
            PerQuestion::of(|question| mean_preference(&tallies, question, counted.len()))
        }),
        seconds: median(counted.iter().flat_map(|a| a.seconds()).collect()),
    })
}

/// Files that can be used, and the others.
fn sorted(key: &StudyKey, files: &[(String, String)]) -> (Vec<Answers>, Vec<SetAside>) {
    let (mut usable, mut set_aside) = (Vec::new(), Vec::new());
    let mut first_of = BTreeMap::new();
    for (file, text) in files {
        let read = Answers::read(text, key).and_then(|answers| {
            match first_of.insert(answers.participant.clone(), file) {
                None => Ok(answers),
                Some(first) => Err(format!("is of the same participant as {first}")),
            }
        });
        match read {
            Ok(answers) => usable.push(answers),
            Err(reason) => set_aside.push(SetAside {
                file: file.clone(),
                reason,
            }),
        }
    }
    (usable, set_aside)
}

/// Whether a participant fell for a catch trial.
fn caught(key: &StudyKey, answers: &Answers) -> bool {
    answers.asked(key).any(|(asked, answer)| match asked {
        Asked::Catch { photo } => answer.matches.choice.is(photo) == Some(true),
        Asked::Compared { .. } => false,
    })
}

/// What participants, at least one, said of every method.
fn tallies<'a>(key: &'a StudyKey, participants: &[&Answers]) -> Tallies<'a> {
    let mut tallies = Tallies::new();
    for (index, participant) in participants.iter().enumerate() {
        for (asked, answer) in participant.asked(key) {
            let Asked::Compared { method, ours } = asked else {
                continue;
            };
            let all = tallies.entry(method).or_default();
            all.resize(index + 1, [Tally::default(); 2]);
            for (tally, reply) in all[index].iter_mut().zip([answer.matches, answer.flicker]) {
                tally.add(reply.choice.is(ours));
            }
        }
    }
    tallies
}

impl Tally {
    /// One more answer: for Impasto, against it, or neither.
    fn add(&mut self, answer: Option<bool>) {
        *match answer {
            Some(true) => &mut self.impasto,
            Some(false) => &mut self.other,
            None => &mut self.neither,
        } += 1;
    }

    fn sum(all: impl Iterator<Item = Self>) -> Self {
        all.fold(Self::default(), |sum, tally| Self {
            impasto: sum.impasto + tally.impasto,
            other: sum.other + tally.other,
            neither: sum.neither + tally.neither,
        })
    }

    fn score(self) -> f64 {
        self.impasto as f64 + 0.5 * self.neither as f64
    }

    fn count(self) -> f64 {
        (self.impasto + self.other + self.neither) as f64
    }

    fn share(self) -> f64 {
        self.score() / self.count()
    }
}

/// Of one method and question, by participant.
fn preference(all: &[Tally]) -> Preference {
    let total = Tally::sum(all.iter().copied());
    let leaning = |than: fn(&usize, &usize) -> bool| {
        let theirs = all.iter().filter(|t| than(&t.impasto, &t.other));
        theirs.count()
    };
    Preference {
        share: total.share(),
        over_participants: bootstrap(all.len(), |drawn| {
            Tally::sum(drawn.iter().map(|i| all[*i])).share()
        }),
        wilson: wilson(total.score(), total.count()),
        impasto: total.impasto,
        other: total.other,
        neither: total.neither,
        sign_test_answers: sign_test(total.impasto, total.other),
        sign_test_participants: sign_test(leaning(usize::gt), leaning(usize::lt)),
    }
}

fn mean_preference(tallies: &Tallies<'_>, question: usize, participants: usize) -> MeanPreference {
    let mean = |drawn: &[usize]| {
        let shares = tallies
            .values()
            .map(|all| Tally::sum(drawn.iter().map(|i| all[*i][question])).share());
        shares.sum::<f64>() / tallies.len() as f64
    };
    let everyone: Vec<usize> = (0..participants).collect();
    MeanPreference {
        share: mean(&everyone),
        over_participants: bootstrap(participants, mean),
    }
}

fn median(mut values: Vec<f64>) -> Option<f64> {
    values.sort_by(f64::total_cmp);
    let middle = values.len() / 2;
    match values.len() % 2 {
        1 => Some(values[middle]),
        _ => Some((values.get(middle.checked_sub(1)?)? + values[middle]) / 2.0),
    }
}

#[cfg(test)]
mod tests {
    use super::super::key::tests::key;
    use super::*;
    use serde_json::{Value, json};

    /// Impasto is A, then B, then A, against wct; then a catch trial whose render is B.
    fn four() -> StudyKey {
        key(&[
            ["impasto", "wct"],
            ["wct", "impasto"],
            ["impasto", "wct_temporal"],
            ["wct", "photo"],
        ])
    }

    /// A file with a letter per question for `match`, and as many for `flicker`: a, b, or n.
    fn file(participant: &str, matches: &str, flicker: &str) -> Value {
        let choice = |letters: &str, i: usize| match letters.as_bytes()[i] {
            b'a' => "a",
            b'b' => "b",
            _ => "neither",
        };
        let answer = |i| {
            json!({
                "question": format!("q{i}"),
                "match": {"choice": choice(matches, i), "seconds": 3.0},
                "flicker": {"choice": choice(flicker, i), "seconds": 5.0 + i as f64},
            })
        };
        let answers: Vec<Value> = (0..matches.len()).map(answer).collect();
        json!({"schema": 1, "study": "5eed", "participant": participant, "answers": answers})
    }

    fn summary(files: &[Value]) -> StudySummary {
        let named = files.iter().enumerate();
        let named: Vec<_> = named
            .map(|(i, f)| (format!("{i}.json"), f.to_string()))
            .collect();
        summarise(&four(), &named).unwrap()
    }

    #[test]
    fn answers_are_counted_for_whom_they_are() {
        // Everyone prefers Impasto once and wct once; nobody can tell about the video.
        let found = summary(&[file("x", "aana", "bbaa"), file("y", "bbna", "abba")]);
        assert_eq!((found.participants, found.left_out), (2, 0));
        let wct = found.methods["wct"];
        assert_eq!(
            (wct.matches.impasto, wct.matches.other, wct.matches.neither),
            (2, 2, 0)
        );
        assert_eq!((wct.flicker.impasto, wct.flicker.other), (3, 1));
        assert_eq!(
            (wct.flicker.share, wct.flicker.sign_test_answers),
            (0.75, 0.625)
        );
        // One participant leans to Impasto, the other to neither.
        assert_eq!(wct.flicker.sign_test_participants, 1.0);
        let video = found.methods["wct_temporal"];
        assert_eq!((video.matches.share, video.matches.neither), (0.5, 2));
        assert_eq!(
            (
                video.matches.over_participants,
                video.matches.sign_test_answers
            ),
            (None, 1.0)
        );
        assert_eq!(video.flicker.over_participants, Some([0.0, 1.0]));
        let mean = found.mean.unwrap();
        assert_eq!((mean.matches.share, mean.flicker.share), (0.5, 0.625));
        assert_eq!(found.seconds, Some(6.5));
    }

    #[test]
    fn one_participant_has_no_interval_over_participants() {
        let found = summary(&[file("x", "abaa", "abaa")]);
        for of in [found.methods["wct"].matches, found.methods["wct"].flicker] {
            assert_eq!((of.share, of.over_participants), (1.0, None));
            assert!(of.wilson[0] > 0.3 && of.wilson[0] < 0.4);
        }
        assert_eq!(found.mean.unwrap().matches.over_participants, None);
    }

    /// Participants who differ make an interval wider than Wilson's, which takes their answers for
    /// independent.
    #[test]
    fn agreement_within_participants_widens_the_interval() {
        let key = key(&[["impasto", "wct"]; 10]);
        let files = (0..8).map(|i| {
            let all = if i % 2 == 0 {
                "aaaaaaaaaa"
            } else {
                "bbbbbbbbbb"
            };
            (format!("{i}"), file(&format!("p{i}"), all, all).to_string())
        });
        let files: Vec<_> = files.collect();
        let found = summarise(&key, &files).unwrap().methods["wct"].matches;
        let [low, high] = found.over_participants.unwrap();
        assert_eq!(found.share, 0.5);
        assert!(
            high - low > 2.0 * (found.wilson[1] - found.wilson[0]),
            "{low} to {high}"
        );
    }

    #[test]
    fn who_falls_for_a_catch_trial_is_left_out() {
        let found = summary(&[file("x", "abab", "abaa"), file("y", "baba", "babb")]);
        assert_eq!((found.participants, found.left_out), (1, 1));
        // Only the second, who prefers wct; what flickers less is no trap.
        assert_eq!(found.methods["wct"].matches.share, 0.0);
        let nobody = summary(&[file("x", "abab", "abaa")]);
        assert_eq!((nobody.participants, nobody.left_out), (0, 1));
        assert!(nobody.methods.is_empty() && nobody.mean.is_none() && nobody.seconds.is_none());
    }

    #[test]
    fn files_that_cannot_be_used_are_set_aside_with_a_reason() {
        let good = || file("x", "aaaa", "aaaa");
        let with = |edit: fn(&mut Value)| {
            let mut file = file("z", "aaaa", "aaaa");
            edit(&mut file);
            file
        };
        let wrong = [
            (good(), "same participant as 0.json"),
            (json!({"schema": 1}), "no file of answers"),
            (with(|f| f["schema"] = json!(2)), "schema 2"),
            (
                with(|f| f["study"] = json!("other")),
                "answers study other, not 5eed",
            ),
            (file("z", "aaa", "aaa"), "3 of 4 questions"),
            (file("z", "aaaaa", "aaaaa"), "answers q4, which"),
            (
                with(|f| f["answers"][1]["question"] = json!("q0")),
                "a question twice",
            ),
            (
                with(|f| f["answers"][0]["match"]["choice"] = json!("c")),
                "unknown variant",
            ),
            (
                with(|f| f["answers"][2]["match"]["seconds"] = json!(-1)),
                "impossible time for q2",
            ),
        ];
        let all = std::iter::once(good()).chain(wrong.iter().map(|(file, _)| file.clone()));
        let found = summary(&all.collect::<Vec<_>>());
        assert_eq!(
            (found.participants, found.set_aside.len()),
            (1, wrong.len())
        );
        for (aside, (_, why)) in found.set_aside.iter().zip(&wrong) {
            assert!(aside.reason.contains(why), "{aside:?} lacks {why}");
        }
        let error = summarise(&four(), &[("x.json".into(), "{}".into())]).unwrap_err();
        assert!(
            error
                .to_string()
                .contains("none of the 1 files of answers can be used; x.json")
        );
    }
}
