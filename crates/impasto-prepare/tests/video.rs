//! The real ffmpeg: of a video with blurred frames, the sharp ones are chosen.
#![cfg(unix)]
#![allow(clippy::unwrap_used, reason = "a failure here is a failed test")]
#![allow(clippy::print_stdout, reason = "a skipped test says so")]

mod common;

use std::fs;
use std::path::Path;
use std::process::Command;

use common::Place;
use image::{Rgb, RgbImage};
use impasto_prepare::{Cameras, Matching, PrepareError, PrepareOptions, prepare};

const FRAMES: u32 = 24;
const CHOSEN: usize = 6;

/// A view of a moving wall of bricks; its number is written in the upper left corner as a grey.
fn frame(number: u32) -> RgbImage {
    let wall = RgbImage::from_fn(320, 240, |x, y| {
        let row = y / 12;
        let x = x + 3 * number + 9 * (row % 2);
        let mortar = y % 12 < 2 || x % 18 < 2;
        let shade = if mortar {
            220
        } else {
            60 + ((x / 18 * 37 + row * 53) % 80) as u8
        };
        Rgb([shade, shade / 2 + 40, 70])
    });
    let mut view = if is_sharp(number) {
        wall
    } else {
        image::imageops::blur(&wall, 3.0)
    };
    for y in 0..32 {
        for x in 0..32 {
            view.put_pixel(x, y, Rgb([(number * 10) as u8; 3]));
        }
    }
    view
}

/// One frame in four.
fn is_sharp(number: u32) -> bool {
    number % 4 == [1, 3, 0, 2, 2, 1][(number / 4) as usize]
}

fn number_of(frame: &RgbImage) -> u32 {
    (u32::from(frame.get_pixel(16, 16)[0]) + 5) / 10
}

/// Encodes the video, or says why not.
fn encode(folder: &Path) -> bool {
    fs::create_dir(folder.join("film")).unwrap();
    for number in 0..FRAMES {
        let path = folder.join(format!("film/{number:03}.png"));
        frame(number).save(path).unwrap();
    }
    let made = Command::new("ffmpeg")
        .args(["-loglevel", "error", "-framerate", "8", "-i"])
        .arg(folder.join("film/%03d.png"))
        .args(["-c:v", "mpeg4", "-q:v", "2", "-g", "1"])
        .arg(folder.join("walk.mp4"))
        .status();
    match made {
        Ok(status) => assert!(status.success()),
        Err(_) => println!("skipped: ffmpeg is not installed"),
    }
    folder.join("walk.mp4").is_file()
}

#[test]
fn the_sharpest_of_each_part_are_chosen() {
    let fixtures = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/fixtures");
    let place = Place::new(&fixtures, &[]);
    if !encode(place.folder.path()) {
        return;
    }
    // The stand-in places nothing, so that the frames are seen in its place.
    fs::remove_dir_all(place.path("models")).unwrap();
    let kept = place.path("kept");
    let keep = format!(
        "cp -r \"$(argument --image_path \"$@\")\" {}",
        kept.display()
    );
    place.write("mapper.sh", &keep);
    let mut options = PrepareOptions {
        input: place.path("walk.mp4"),
        scene: place.path("scene"),
        frames: CHOSEN,
        matching: Matching::Auto,
        cameras: Cameras::Auto,
        colmap: place.path("colmap"),
        ffmpeg: "ffmpeg".into(),
    };
    let error = prepare(&options, &mut |_| ()).unwrap_err();
    assert!(
        matches!(error, PrepareError::NotRegistered { photos: CHOSEN, .. }),
        "{error}"
    );
    let mut names: Vec<_> = fs::read_dir(&kept)
        .unwrap()
        .map(|e| e.unwrap().path())
        .collect();
    names.sort();
    assert_eq!(names.len(), CHOSEN);
    assert!(names[0].ends_with("0000.jpg"));
    let chosen: Vec<u32> = names
        .iter()
        .map(|path| number_of(&image::open(path).unwrap().into_rgb8()))
        .collect();
    let sharp: Vec<u32> = (0..FRAMES).filter(|&n| is_sharp(n)).collect();
    assert_eq!(chosen, sharp);
    assert!(
        place
            .calls()
            .iter()
            .any(|call| call.starts_with("sequential_matcher"))
    );

    place.write("broken.mp4", "no video");
    options.input = place.path("broken.mp4");
    let message = prepare(&options, &mut |_| ()).unwrap_err().to_string();
    for word in ["broken.mp4", "no usable video", "mp4", "colmap.log"] {
        assert!(message.contains(word), "{message}");
    }
}
