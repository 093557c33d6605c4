//! The page that participants open.

use super::clips::{Clips, film};
use super::key::{Question, SCHEMA, StudyKey};
use super::plan::{QUALITY, StudyPlan};
use super::trials::ClipKind;
use super::{Study, StudyError};
use crate::error::EvalError;
use crate::html::data_url;
use crate::resize::scaled;
use image::RgbImage;
use image::imageops::FilterType;
use impasto_model::Model;
use serde::Serialize;
use std::collections::BTreeMap;
use std::hash::{DefaultHasher, Hash, Hasher};

/// Frames a second of a clip.
const RATE: u32 = 12;
/// Longer side of a painting, in pixels.
const PAINTING_SIDE: u32 = 400;

const TEMPLATE: &str = include_str!("page.html");
const STYLE: &str = include_str!("page.css");
const SCRIPT: &str = include_str!("page.js");

/// What the script reads.
#[derive(Serialize)]
struct Data<'a> {
    schema: u32,
    study: &'a str,
    synthetic: bool,
    rate: u32,
    size: [u32; 2],
    questions: &'a [Pair<'a>],
}

/// A question as the page knows it.
#[derive(Serialize, Hash)]
struct Pair<'a> {
    id: String,
    painting: &'a str,
    a: &'a [String],
    b: &'a [String],
}

impl StudyPlan<'_> {
    /// Renders and stylises every clip and puts them into a page. `tick` hears of every frame.
    ///
    /// # Errors
    /// If the model has no style stage, or a frame cannot be encoded.
    pub fn make(&self, model: &Model, tick: &mut dyn FnMut()) -> Result<Study, StudyError> {
        if !model.has_style() {
            return Err(EvalError::Unstyled.into());
        }
        let clips = film(model, self, tick)?;
        study(self, model.file.scene.synthetic, &clips)
    }
}

/// Puts a plan's clips into a page, and what they are into a key.
fn study(plan: &StudyPlan<'_>, synthetic: bool, clips: &Clips) -> Result<Study, StudyError> {
    let paintings = plan.trials.iter().map(|trial| {
        let (_, picture) = &plan.options.paintings[trial.painting];
        Ok((trial.painting, data_url(&small(picture), QUALITY)?))
    });
    let paintings: BTreeMap<usize, String> = paintings.collect::<Result<_, StudyError>>()?;
    let (mut pairs, mut questions) = (Vec::new(), Vec::new());
    for (number, trial) in plan.trials.iter().enumerate() {
        // Trials are in random order, so that their numbers tell nothing.
        let id = format!("q{:02}", number + 1);
        let [a, b] = trial.sides.map(|side| frames(clips, trial.painting, side));
        let [a_name, b_name] = trial.sides.map(|side| side.name(plan.options.against));
        pairs.push(Pair {
            id: id.clone(),
            painting: &paintings[&trial.painting],
            a,
            b,
        });
        questions.push(Question {
            id,
            painting: plan.options.paintings[trial.painting].0.clone(),
            a: a_name,
            b: b_name,
        });
    }
    let size = plan.path.first().map_or([0; 2], |camera| {
        [camera.intrinsics.width, camera.intrinsics.height]
    });
    let key = StudyKey {
        schema: SCHEMA,
        study: name(&pairs),
        synthetic,
        seed: plan.options.seed,
        frames: plan.path.len(),
        size,
        quality: QUALITY,
        rate: RATE,
        questions,
    };
    let data = Data {
        schema: SCHEMA,
        study: &key.study,
        synthetic,
        rate: RATE,
        size,
        questions: &pairs,
    };
    let page = page(&data)?;
    Ok(Study { page, key })
}

fn frames(clips: &Clips, painting: usize, side: ClipKind) -> &[String] {
    clips.get(&(painting, side)).map_or(&[], Vec::as_slice)
}

/// A name that studies with other contents do not have. It is stored and compared, never computed
/// again.
fn name(pairs: &[Pair<'_>]) -> String {
    let mut hasher = DefaultHasher::new();
    pairs.hash(&mut hasher);
    format!("{:016x}", hasher.finish())
}

/// The whole page. The data is numbers, our own words and base64: nothing in it can end a script.
fn page(data: &Data<'_>) -> Result<String, StudyError> {
    let template = TEMPLATE
        .replace("{{style}}", STYLE)
        .replace("{{script}}", SCRIPT);
    Ok(template.replace("{{data}}", &serde_json::to_string(data)?))
}

fn small(painting: &RgbImage) -> RgbImage {
    let (width, height) = painting.dimensions();
    let scale = (f64::from(PAINTING_SIDE) / f64::from(width.max(height))).min(1.0);
    scaled(painting, scale, FilterType::Triangle)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::flow::tests::camera;
    use crate::methods::{Stylizer, Transfer};
    use crate::study::{Asked, StudyOptions, trials::Trial};
    use image::Rgb;
    use serde_json::Value;

    /// Leaves pictures as they are.
    struct Nothing;

    impl Stylizer for Nothing {
        fn name(&self) -> &'static str {
            "method"
        }

        fn transfer<'a>(&'a self, _painting: &RgbImage) -> Transfer<'a> {
            Box::new(RgbImage::clone)
        }
    }

    /// Two paintings by both variants of a method, and a catch trial.
    fn made() -> (Study, Clips) {
        let painting = |shade| RgbImage::from_pixel(900, 600, Rgb([shade; 3]));
        let paintings = [
            ("dark".to_owned(), painting(20)),
            ("bright </script>".to_owned(), painting(220)),
        ];
        let (ours, frames, video) = (ClipKind::Ours, ClipKind::Frames(0), ClipKind::Video(0));
        let trial = |painting, sides| Trial { painting, sides };
        let plan = StudyPlan {
            options: StudyOptions {
                paintings: &paintings,
                against: &[&Nothing],
                frames: 2,
                questions: 4,
                catches: 1,
                bytes: 1_000_000,
                seed: 3,
            },
            trials: vec![
                trial(0, [ours, video]),
                trial(1, [frames, ours]),
                trial(1, [ours, video]),
                trial(0, [frames, ClipKind::Photo]),
            ],
            path: vec![camera(0.0), camera(0.1)],
        };
        let mut clips = Clips::new();
        for painting in 0..2 {
            for (kind, shown) in [ours, frames, video, ClipKind::Photo]
                .into_iter()
                .enumerate()
            {
                // Numbers that tell them apart.
                let frame = |i| format!("data:,{painting}{kind}{i}");
                clips.insert((painting, shown), (0..2).map(frame).collect());
            }
        }
        (study(&plan, true, &clips).unwrap(), clips)
    }

    /// The page's data, and the page without it.
    fn parts(page: &str) -> (Value, String) {
        let (before, rest) = page
            .split_once(r#"<script type="application/json" id="study">"#)
            .unwrap();
        let (data, after) = rest.split_once("</script>").unwrap();
        (
            serde_json::from_str(data).unwrap(),
            format!("{before}{after}"),
        )
    }

    #[test]
    fn page_and_key_agree_on_every_clip() {
        let (study, clips) = made();
        let (data, _) = parts(&study.page);
        assert_eq!(data["study"], study.key.study);
        assert_eq!(
            (&data["schema"], &data["synthetic"]),
            (&Value::from(1), &Value::from(true))
        );
        assert_eq!(data["size"], serde_json::json!([40, 30]));
        let pairs = data["questions"].as_array().unwrap();
        assert_eq!(pairs.len(), study.key.questions.len());
        for (pair, question) in pairs.iter().zip(&study.key.questions) {
            assert_eq!(pair["id"], question.id);
            let painting = usize::from(question.painting != "dark");
            for (side, name) in [("a", &question.a), ("b", &question.b)] {
                let shown = match name.as_str() {
                    "impasto" => ClipKind::Ours,
                    "method" => ClipKind::Frames(0),
                    "method_temporal" => ClipKind::Video(0),
                    other => {
                        assert_eq!(other, "photo");
                        ClipKind::Photo
                    }
                };
                assert_eq!(pair[side], serde_json::json!(clips[&(painting, shown)]));
            }
        }
        let catches = study.key.questions.iter().map(|q| q.asked().unwrap());
        let catches = catches.filter(|asked| matches!(asked, Asked::Catch { .. }));
        assert_eq!(catches.count(), 1);
    }

    #[test]
    fn the_page_gives_nothing_away_and_needs_nothing() {
        let (study, _) = made();
        let (data, rest) = parts(&study.page);
        let rest = rest.to_lowercase();
        for word in [
            "impasto", "method", "temporal", "photo", "dark\"", "bright", "{{",
        ] {
            assert!(!rest.contains(word), "the page says {word}");
        }
        for address in ["http:", "https:", "src=", "href="] {
            assert!(
                !rest.contains(address),
                "the page loads something by {address}"
            );
        }
        for pair in data["questions"].as_array().unwrap() {
            let keys: Vec<&str> = pair
                .as_object()
                .unwrap()
                .keys()
                .map(String::as_str)
                .collect();
            assert_eq!(keys, ["a", "b", "id", "painting"]);
            assert!(pair["id"].as_str().unwrap().starts_with('q'));
        }
    }

    #[test]
    fn studies_are_named_by_their_contents() {
        let name_of = |frame: &str| {
            let frames = [frame.to_owned()];
            name(&[Pair {
                id: "q01".into(),
                painting: "data:,",
                a: &frames,
                b: &[],
            }])
        };
        assert_eq!(name_of("data:,1"), name_of("data:,1"));
        assert_ne!(name_of("data:,1"), name_of("data:,2"));
    }
}
