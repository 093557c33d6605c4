//! What pages see: frames, coarse and sharp, and what is painted on them.

#![allow(clippy::unwrap_used, reason = "a failure here is a failed test")]

mod common;

use std::sync::atomic::Ordering;

use common::{Frame, Heard, Setup, Studio, identity};
use impasto_view::Limits;
use serde_json::json;

const SIZE: [u32; 2] = [320, 180];

/// Makes the painter so slow that pictures are made of several pieces.
fn slow(studio: &Studio) {
    studio.asked.milliseconds.store(40, Ordering::SeqCst);
}

fn covers(frames: &[Frame], level: u8) {
    let sharp = frames.iter().filter(|frame| frame.level == level);
    let mut rows: Vec<(u16, u16)> = sharp.map(|f| (f.place[1], f.place[3])).collect();
    rows.sort_unstable();
    let end = rows.iter().fold(0, |end, (from, count)| {
        assert_eq!(*from, end, "{rows:?}");
        from + count
    });
    assert_eq!(u32::from(end), SIZE[1], "{rows:?}");
}

#[test]
fn a_view_is_coarse_at_once_and_sharp_in_the_end() {
    let studio = Studio::open();
    slow(&studio);
    let mut page = studio.page();
    page.look(5, SIZE, false);
    let frames = page.frames(5);
    let first = &frames[0];
    assert_eq!((first.number, first.view, first.coats), (1, 5, 0));
    assert_eq!((first.place, first.size), ([0, 0, 320, 180], [320, 180]));
    assert_eq!((first.level, first.last), (0, false));
    assert!(first.picture.width() < 320);
    covers(&frames, 2);
    for (i, frame) in frames.iter().enumerate() {
        assert_eq!(frame.number, i as u32 + 1);
        assert_eq!(frame.last, i + 1 == frames.len());
        let [_, _, width, height] = frame.place.map(u32::from);
        if frame.level == 2 {
            assert_eq!(frame.picture.dimensions(), (width, height));
        }
    }
    // Red grows from left to right.
    let picture = &frames[1].picture;
    let red = |x: u32| picture.get_pixel(x, picture.height() / 2)[0];
    assert!(red(10) < 40 && red(310) > 215, "{} {}", red(10), red(310));
}

#[test]
fn a_moving_view_is_coarse_only_and_sharpens_when_it_rests() {
    let studio = Studio::open();
    slow(&studio);
    let mut page = studio.page();
    for id in 1..4 {
        page.look(id, SIZE, true);
        let frame = page.frame();
        assert_eq!((frame.view, frame.level, frame.last), (id, 0, true));
    }
    let views = studio.asked.views.load(Ordering::SeqCst);
    assert_eq!(views, 3);
    // The last place again, at rest.
    page.look(3, SIZE, false);
    let frames = page.frames(3);
    assert_eq!(frames[0].level, 0);
    covers(&frames, 2);
    let bands = frames.len() - 1;
    assert_eq!(studio.asked.views.load(Ordering::SeqCst), views + bands);
}

#[test]
fn a_newer_view_takes_the_place_of_an_older_one() {
    let studio = Studio::open();
    studio.asked.milliseconds.store(200, Ordering::SeqCst);
    let mut page = studio.page();
    page.look(1, SIZE, false);
    page.frame();
    for id in 2..60 {
        page.look(id, SIZE, true);
    }
    let frames = page.frames(59);
    let seen: std::collections::BTreeSet<u32> = frames.iter().map(|f| f.view).collect();
    assert!(seen.len() < 20, "views were queued: {seen:?}");
    // Nothing comes after the last.
    page.say(&json!({"type": "pick", "id": 9, "x": 0.5, "y": 0.9}));
    assert!(matches!(page.hear(), Heard::Text(_)));
}

#[test]
fn other_coats_need_no_geometry() {
    let studio = Studio::open();
    slow(&studio);
    let blue = studio.upload([10, 20, 230]);
    let mut page = studio.page();
    page.look(1, SIZE, false);
    page.frames(1);
    let views = studio.asked.views.load(Ordering::SeqCst);
    let paints = studio.asked.paints.load(Ordering::SeqCst);
    page.coat(7, &blue);
    assert_eq!(page.told("painted")["id"], 7);
    let frames = page.frames(1);
    assert!(frames.iter().all(|frame| frame.coats == 7));
    // All geometry is there, so it is sharp at once.
    covers(&frames, 2);
    let pixel = frames[0].picture.get_pixel(50, 4).0;
    assert!(pixel[2] > 200 && pixel[0] < 40, "{pixel:?}");
    assert_eq!(studio.asked.views.load(Ordering::SeqCst), views);
    assert!(studio.asked.paints.load(Ordering::SeqCst) > paints);
    // Off again.
    page.say(&json!({"type": "coats", "id": 8, "coats": []}));
    assert_eq!(page.told("painted")["id"], 8);
    assert!(page.frames(1)[0].coats == 8);
    assert_eq!(studio.asked.views.load(Ordering::SeqCst), views);
}

#[test]
fn geometry_is_let_go_of_where_there_is_no_room() {
    let studio = Studio::limited(Limits {
        geometry: 1000,
        ..Limits::default()
    });
    let blue = studio.upload([10, 20, 230]);
    let mut page = studio.page();
    page.look(1, SIZE, false);
    page.frames(1);
    let views = studio.asked.views.load(Ordering::SeqCst);
    page.coat(7, &blue);
    covers(&page.frames(1), 2);
    assert!(studio.asked.views.load(Ordering::SeqCst) > views);
}

#[test]
fn coats_that_cannot_be_had_are_a_problem_and_change_nothing() {
    let studio = Studio::open();
    let mut page = studio.page();
    page.coat(3, "nowhere.jpg");
    let said = page.told("problem");
    assert_eq!(said["id"], 3);
    assert!(said["message"].as_str().unwrap().contains("nowhere.jpg"));
    page.look(1, SIZE, true);
    assert_eq!(page.frame().coats, 0);
}

#[test]
fn a_place_can_be_pointed_at() {
    let studio = Studio::open();
    let mut page = studio.page();
    page.say(&json!({"type": "pick", "id": 1, "x": 0.5, "y": 0.5}));
    assert_eq!(page.told("problem")["id"], 1);
    page.look_from(1, identity(), SIZE, false);
    page.frames(1);
    page.say(&json!({"type": "pick", "id": 2, "x": 0.5, "y": 0.75}));
    let ground = page.told("picked");
    assert_eq!((&ground["id"], &ground["depth"]), (&2.into(), &2.0.into()));
    let point: Vec<f64> = serde_json::from_value(ground["point"].clone()).unwrap();
    // A quarter of the height off the axis, at depth 2.
    let wanted = 2.0 * 0.5 * 25f64.to_radians().tan();
    assert!(
        point[0].abs() < 0.02 && (point[1] - wanted).abs() < 0.02,
        "{point:?}"
    );
    assert!((point[2] - 2.0).abs() < 1e-6);
    let colour: Vec<f64> = serde_json::from_value(ground["colour"].clone()).unwrap();
    assert!((colour[0] - 0.5).abs() < 0.05 && (colour[2] - 0.5).abs() < 0.05);
    page.say(&json!({"type": "pick", "id": 3, "x": 0.5, "y": 0.1}));
    let sky = page.told("picked");
    assert!(sky["point"].is_null() && sky["depth"].is_null());
}

#[test]
fn a_model_that_is_written_is_shown() {
    let studio = Studio::with(Setup {
        waiting: true,
        ..Setup::default()
    });
    let scene = studio.ask("GET", "/api/scene", &[]).json();
    assert_eq!(scene["waiting"], true);
    let mut page = studio.page();
    page.look(1, SIZE, false);
    std::fs::write(studio.model.path().join("model.safetensors"), "new").unwrap();
    let said = page.told("model");
    assert_eq!(
        (&said["name"], &said["styled"]),
        (&"again".into(), &true.into())
    );
    page.frames(1);
    assert_eq!(studio.ask("GET", "/api/scene", &[]).json()["name"], "again");
}

#[test]
fn a_training_is_followed() {
    let studio = Studio::open();
    let mut page = studio.page();
    assert_eq!(
        studio.ask("GET", "/api/run", &[]).json(),
        json!({"training": false})
    );
    page.say(&json!({"type": "watch", "on": true}));
    // Whoever hears this was heard before.
    page.say_text("nonsense");
    page.told("problem");
    let log = "{\"event\":\"stage_started\",\"stage\":\"style\"}\n\
               {\"event\":\"step\",\"stage\":\"style\",\"step\":12,\"progress\":0.25,\"loss\":1.5,\"seconds_since_start\":2.0}\n";
    std::fs::write(studio.model.path().join("log.jsonl"), log).unwrap();
    let mut said = page.told("run");
    while said["step"] != 12 {
        said = page.told("run");
    }
    assert_eq!(
        (&said["stage"], &said["loss"]),
        (&"style".into(), &1.5.into())
    );
    let asked = studio.ask("GET", "/api/run", &[]).json();
    assert_eq!(asked["losses"], json!([[2.0, 1.5]]));
    assert_eq!(studio.ask("GET", "/api/preview", &[]).status, 404);
}
