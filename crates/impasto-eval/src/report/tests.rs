#![allow(clippy::unwrap_used, reason = "a test may panic")]

use super::*;
use crate::consistency::{ByRange, Consistency};
use crate::fidelity::{PaintingResult, StyleFidelity};
use crate::guards::FailedGuard;
use crate::methods::UNAVAILABLE;
use crate::record::{ImageRecord, RecordPlan, SampleImages, WorstPair};
use crate::results::{MethodResult, TrueDepth};
use crate::strokes::StrokeResult;
use image::{Rgb, RgbImage};
use std::collections::BTreeMap;

/// Painting names as strangers may choose them.
const NAMES: [&str; 2] = ["</script><script>alert('x')</script>.png", "a, \"b\"\n.jpg"];

fn consistency(e100: f64, pairs: usize) -> Consistency {
    Consistency {
        e100,
        rmse: 0.05,
        rmse_all: 0.0625,
        relative: 0.5 * e100,
        vgg_unweighted: Some(1.25),
        coverage: 0.75,
        pairs,
        dropped: 2,
    }
}

const STROKES: StrokeResult = StrokeResult {
    stroke_score: 0.375,
    stroke_retrieval: 0.5,
};

/// A method of that E × 100 at short range; no pair counts at long range.
fn method(e100: f64, style_gain: f64, sharpness: f64) -> MethodResult {
    let long = consistency(f64::NAN, 0);
    let painting = |name: &str, more: f64| PaintingResult {
        name: name.to_owned(),
        style_loss: 0.5,
        style_gain: style_gain + more,
        retrieved: 1.0,
        taken_for: None,
        content_loss: 4.0,
        strokes: Some(STROKES),
        consistency: Some([consistency(e100 + more, 9), long].into()),
        sharpness: Some(sharpness),
    };
    MethodResult {
        fidelity: StyleFidelity::of(vec![painting(NAMES[0], 0.0), painting(NAMES[1], 0.0)], 3),
        strokes: Some(STROKES),
        consistency: Some([consistency(e100, 9), long].into()),
        over_photo: Some(ByRange {
            short: 10.0 * e100,
            long: f64::NAN,
        }),
        true_depth: Some(TrueDepth {
            consistency: [consistency(e100 + 0.5, 9), long].into(),
            difference: ByRange {
                short: 0.5,
                long: f64::NAN,
            },
        }),
        estimated_flow: Some([consistency(7.5, 9), long].into()),
        sharpness: Some(sharpness),
    }
}

/// A record of all methods with a film of eight frames.
fn record(methods: &BTreeMap<String, MethodResult>) -> ImageRecord {
    let noise = |seed: u32| {
        let shade = move |x: u32, y: u32| ((x * 31 + y * 17 + seed * 101) * 97 % 251) as u8;
        RgbImage::from_fn(24, 16, |x, y| Rgb([shade(x, y), shade(y, x), seed as u8]))
    };
    let paintings = NAMES.map(|name| (name.to_owned(), noise(3)));
    let mut record = ImageRecord::new(RecordPlan::default(), &paintings);
    for (i, name) in methods.keys().enumerate() {
        let sample = SampleImages {
            view: noise(i as u32),
            frame: Some(noise(50 + i as u32)),
            film: (0..8).map(noise).collect(),
        };
        let copies = if name == PHOTO { 1 } else { NAMES.len() };
        let samples = vec![sample; copies];
        record.samples.insert(name.clone(), samples);
        let pair = WorstPair {
            painting: (name != PHOTO).then_some(1),
            frames: [6, 5],
            square: 0.043_21,
            coverage: 0.5,
            first: noise(1),
            warped: noise(2),
            squares: (0..24 * 16).map(|i| (i % 2 == 0).then_some(0.02)).collect(),
        };
        record.worst.insert(name.clone(), [Some(pair), None]);
    }
    record
}

/// An evaluation in which a method of blurred frames has the least E.
fn evaluation(pictures: bool) -> Evaluation {
    let methods = BTreeMap::from(
        [
            (PHOTO, method(0.1, 0.0, 1.0)),
            (OURS, method(0.3, 0.6, 1.2)),
            ("wct", method(1.5, 0.7, 1.4)),
            ("wct_temporal", method(1.2, 0.7, 0.9)),
            ("blur", method(0.05, 0.65, 0.25)),
        ]
        .map(|(name, result)| (name.to_owned(), result)),
    );
    Evaluation {
        unavailable: UNAVAILABLE.into_iter().collect(),
        flow: "exact",
        depth_error: Some(0.0123),
        reconstructed: None,
        frames: 10,
        record: pictures.then(|| record(&methods)),
        methods,
    }
}

fn report(evaluation: &Evaluation) -> EvalReport<'_> {
    EvalReport {
        evaluation,
        reconstruction: Quality {
            psnr: 27.625,
            ssim: 0.8125,
            views: 3,
            fitted_psnr: 28.0,
            aligned_psnr: Some(28.5),
            grain: Some(Grain {
                colour: 1.25,
                depth: 1.5,
                wrong_pixels: 0.75,
            }),
        },
        scene: "<b>yard</b>",
        synthetic: false,
        unreadable: &[],
        settings: Settings {
            model: "model".into(),
            styles: "<i>".into(),
            paintings: 2,
            frames: 10,
            frame_size: Some([40, 30]),
            supersampling: 2,
            against: vec!["wct".to_owned()],
        },
        version: "1.2.3",
        command: "impasto eval '<u>'".to_owned(),
        machine: "a machine".to_owned(),
        date: "2026-01-02".to_owned(),
        seconds: 61.0,
    }
}

fn page() -> String {
    report(&evaluation(true)).html().unwrap()
}

/// The text of every cell of a method's row in the table under a heading.
fn cells(page: &str, table: &str, method: &str, how: &str) -> Vec<String> {
    let table = page.split(&format!("<h2>{table}</h2>")).nth(1).unwrap();
    let table = table.split("</table>").next().unwrap();
    let heading = format!("<th scope=\"row\">{method}<small>{how}</small></th>");
    let row = table.split(&heading).nth(1).unwrap();
    let row = row.split("</tr>").next().unwrap();
    let cells = row.split("</td>").filter(|cell| !cell.is_empty());
    let text = |cell: &str| {
        let parts = cell.split('<').filter_map(|part| part.split_once('>'));
        parts.map(|(_, text)| text).collect()
    };
    cells.map(text).collect()
}

#[test]
fn the_page_needs_nothing_but_itself() {
    let page = page();
    for reach in [
        "http:", "https:", "<link", "@import", "url(", "href=", "srcset",
    ] {
        assert!(!page.contains(reach), "{reach}");
    }
    let sources: Vec<&str> = page.split("src=").skip(1).collect();
    assert!(sources.len() > 20);
    assert!(
        sources
            .iter()
            .all(|s| s.starts_with("\"data:image/jpeg;base64,/9j/"))
    );
}

#[test]
fn hostile_names_stay_text() {
    let page = page();
    for name in ["</script><script>", "<b>yard", "<i>", "<u>"] {
        assert!(!page.contains(name), "{name}");
    }
    assert!(page.contains("&lt;/script&gt;&lt;script&gt;alert(&#39;x&#39;)"));
    assert!(page.contains("<h1>&lt;b&gt;yard&lt;/b&gt;</h1>"));
    assert_eq!(
        page.matches("<script").count(),
        2,
        "the frames and the viewer"
    );
}

#[test]
fn the_tables_show_the_results() {
    let page = page();
    let wct = cells(&page, "Short-range consistency", "WCT", "as a video");
    assert_eq!(
        wct,
        [
            "1.200", "1.00", "12.00", "0.0500", "0.0625", "1.250", "75 %", "9 (2)", "0.700",
            "100 %", "0.375", "50 %", "4.00", "0.90", "passes"
        ]
    );
    let ours = cells(&page, "Short-range consistency", "Impasto", "this model");
    // Relative to the video, the best that passes, and not to the blur.
    assert_eq!(ours[..2], ["0.300", "0.25"]);
    let ours = cells(&page, "Long-range consistency", "Impasto", "this model");
    assert_eq!((ours[0].as_str(), ours[7].as_str()), ("–", "0 (2)"));
    let ours = cells(&page, "Consistency by true depth", "Impasto", "this model");
    assert_eq!(ours[0], "0.800");
    assert!(page.contains("differs from it by 1.23 % in the median"));
    let heading = "Consistency by estimated flow";
    let ours = cells(&page, heading, "Impasto", "this model");
    assert_eq!(ours[0], "7.500");
    assert!(page.contains("27.62 dB") && page.contains("0.812"));
    for name in ["LST", "TPFR", "ReReVST", "MCCNet"] {
        let row = format!("<th scope=\"row\">{name}</th>");
        let found = page
            .split(&row)
            .skip(1)
            .map(|rest| rest.split("</tr>").next());
        let found: Vec<_> = found.flatten().collect();
        assert_eq!(found.len(), 2);
        assert!(found.iter().all(|row| row.contains(UNAVAILABLE[0].1)));
    }
}

#[test]
fn agreement_by_blur_is_no_win() {
    let page = page();
    let words = |method, how| {
        let cells = cells(&page, "Short-range consistency", method, how);
        cells.last().unwrap().clone()
    };
    assert_eq!(
        words("blur", "frame by frame"),
        "lowest E of all, but blurred (sharpness 0.25 &lt; 0.5): not a win"
    );
    assert_eq!(words("Impasto", "this model"), "passes");
    assert_eq!(words("Photo", "unstylised, the floor"), "the floor");
    assert!(
        page.contains("<strong>0.300</strong>"),
        "the least of those that pass"
    );
    let pale = method(0.3, 0.01, f64::NAN);
    let [FailedGuard::Blurred(_), FailedGuard::HardlyStylised(gain)] =
        FailedGuard::of("x", &pale)[..]
    else {
        panic!("no number is no detail");
    };
    assert!((gain - 0.01).abs() < 1e-9);
}

#[test]
fn the_csv_has_a_row_for_every_method_and_painting() {
    let evaluation = evaluation(false);
    let text = report(&evaluation).csv();
    // RFC 4180: an even number of quotes before a break means that it is outside of them.
    let (mut rows, mut row, mut field, mut inside) = (vec![], vec![], String::new(), false);
    let mut letters = text.chars().peekable();
    while let Some(letter) = letters.next() {
        match letter {
            '"' if inside && letters.next_if_eq(&'"').is_some() => field.push('"'),
            '"' => inside = !inside,
            ',' if !inside => row.push(std::mem::take(&mut field)),
            '\n' if !inside => {
                row.push(field.trim_end_matches('\r').to_owned());
                field.clear();
                rows.push(std::mem::take(&mut row));
            }
            other => field.push(other),
        }
    }
    assert!(row.is_empty() && field.is_empty() && !inside);
    let columns: Vec<String> = rows.remove(0);
    assert_eq!(rows.len(), evaluation.methods.len() * (NAMES.len() + 1));
    assert!(rows.iter().all(|row| row.len() == columns.len()));
    let at = |row: &[String], name: &str| {
        row[columns.iter().position(|column| column == name).unwrap()].clone()
    };
    let named = rows.iter().map(|row| (row[1].as_str(), row.as_slice()));
    let of = |method: &str| {
        named
            .clone()
            .filter(|(name, _)| *name == method)
            .map(|(_, row)| row)
            .collect::<Vec<_>>()
    };
    for method in evaluation.methods.keys() {
        let names: Vec<String> = of(method).iter().map(|row| at(row, "painting")).collect();
        assert_eq!(names, [NAMES[0], NAMES[1], ""]);
    }
    let mean = of("wct").into_iter().find(|row| row[0] == "mean").unwrap();
    assert_eq!(at(mean, "short_e100"), "1.5");
    assert_eq!(at(mean, "sharpness"), "1.4");
    assert_eq!(at(mean, "long_e100"), "", "what is no number is empty");
}

#[test]
fn as_many_frames_are_shown_as_fit() {
    let evaluation = evaluation(true);
    let record = evaluation.record.as_ref().unwrap();
    let films = |budget| viewer::viewer(&NAMES, record, budget).unwrap();
    let frames = |page: &str| page.matches("data:image").count();
    // Four methods with both paintings, and the photo once.
    let all = films(PAGE_BYTES);
    assert_eq!(frames(&all), 9 * 8);
    assert!(all.contains("All 8 frames with the first 2 paintings"));
    let one = films(all.len() * 5 / 8);
    assert_eq!(frames(&one), 5 * 8);
    assert!(one.contains("All 8 frames with the first 1 painting,"));
    let some = films(all.len() / 4);
    assert!((5 * 2..5 * 8).contains(&frames(&some)));
    assert!(some.contains("of 8 frames") && some.len() < all.len() / 2);
}

#[test]
fn without_pictures_there_are_tables_alone() {
    let page = report(&evaluation(false)).html().unwrap();
    assert!(!page.contains("<img") && !page.contains("<script") && !page.contains("Worst pairs"));
    assert!(page.contains("Short-range consistency"));
}

#[test]
fn the_json_has_the_methods_and_the_run() {
    let evaluation = evaluation(true);
    let json = serde_json::to_value(report(&evaluation)).unwrap();
    assert_eq!(json["methods"]["wct"]["short"]["e100"], 1.5);
    let painting = &json["methods"]["wct"]["paintings"][1];
    assert_eq!(
        (&painting["short"]["e100"], &painting["long"]["e100"]),
        (&1.5.into(), &().into())
    );
    assert_eq!(json["reconstruction"]["psnr"], 27.625);
    assert_eq!(json["settings"]["frame_size"], serde_json::json!([40, 30]));
    for key in [
        "machine",
        "date",
        "command",
        "version",
        "seconds",
        "scene",
        "unavailable",
    ] {
        assert!(!json[key].is_null(), "{key}");
    }
    assert!(json.get("record").is_none());
}

#[test]
fn the_worst_pairs_say_what_they_are() {
    let page = page();
    let pairs = page.split("<h2>Worst pairs</h2>").nth(1).unwrap();
    let named = "frames 7 and 6: E×100 4.321 over 50 % of the pixels";
    assert_eq!(
        pairs.matches(named).count(),
        5,
        "one of each method, at one range"
    );
    assert_eq!(pairs.matches("Unstylised, frames").count(), 1);
}
