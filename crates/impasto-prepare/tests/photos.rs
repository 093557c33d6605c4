//! Which photos are taken, and how.
#![cfg(unix)]
#![allow(clippy::unwrap_used, reason = "a failure here is a failed test")]

mod common;

use std::fs;
use std::io::BufWriter;
use std::os::unix::fs::{MetadataExt, symlink};
use std::path::Path;

use common::{Place, SIZE, photo};
use image::codecs::jpeg::JpegEncoder;
use image::metadata::Orientation;
use image::{ImageDecoder, ImageEncoder, ImageReader, RgbImage};
use impasto_prepare::{Cameras, Matching, PrepareOptions, PrepareSummary, prepare};

fn place(names: &[&str]) -> Place {
    let fixtures = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/fixtures");
    Place::new(&fixtures, names)
}

fn run(place: &Place) -> PrepareSummary {
    let options = PrepareOptions {
        input: place.path("photos"),
        scene: place.path("scene"),
        frames: 10,
        matching: Matching::Auto,
        cameras: Cameras::Auto,
        colmap: place.path("colmap"),
        ffmpeg: place.path("no-ffmpeg"),
    };
    prepare(&options, &mut |_| ()).unwrap_or_else(|e| panic!("{e}"))
}

/// EXIF of a camera called "Cam", little-endian.
fn exif(orientation: u16) -> Vec<u8> {
    let mut chunk = b"II*\0\x08\0\0\0\x02\0".to_vec();
    let mut entry = |tag: u16, kind: u16, count: u32, value: [u8; 4]| {
        chunk.extend(tag.to_le_bytes());
        chunk.extend(kind.to_le_bytes());
        chunk.extend(count.to_le_bytes());
        chunk.extend(value);
    };
    entry(0x0110, 2, 4, *b"Cam\0");
    let [low, high] = orientation.to_le_bytes();
    entry(0x0112, 3, 1, [low, high, 0, 0]);
    chunk.extend([0; 4]);
    chunk
}

fn save_with_exif(picture: &RgbImage, orientation: u16, path: &Path) {
    let file = BufWriter::new(fs::File::create(path).unwrap());
    let mut encoder = JpegEncoder::new_with_quality(file, 100);
    encoder.set_exif_metadata(exif(orientation)).unwrap();
    let (width, height) = picture.dimensions();
    encoder
        .write_image(picture, width, height, image::ExtendedColorType::Rgb8)
        .unwrap();
}

#[test]
fn photos_are_taken_as_they_are_by_links() {
    let place = place(&["b/1.png", "b/2.png", "a.png"]);
    let summary = run(&place);
    assert_eq!(summary.photos.turned, 0);
    for name in ["b/1.png", "b/2.png", "a.png"] {
        let inode = |folder: &str| fs::metadata(place.path(folder).join(name)).unwrap().ino();
        assert_eq!(inode("photos"), inode("scene/images"), "{name}");
    }
}

#[test]
fn turned_photos_become_upright_and_keep_their_camera() {
    let names = ["a.jpg", "b.jpg", "c.jpg", "d.jpg"];
    let place = place(&names);
    // Upright, left half dark and right half light; stored as EXIF 6 wants it, a quarter turn back.
    let (width, height) = SIZE;
    let upright = |number: u8| {
        RgbImage::from_fn(width, height, |x, _| {
            image::Rgb(
                [if x < width / 2 {
                    20 + number
                } else {
                    230 - number
                }; 3],
            )
        })
    };
    save_with_exif(
        &image::imageops::rotate270(&upright(0)),
        6,
        &place.path("photos/a.jpg"),
    );
    save_with_exif(
        &image::imageops::rotate180(&upright(1)),
        3,
        &place.path("photos/b.jpg"),
    );
    save_with_exif(&upright(2), 1, &place.path("photos/c.jpg"));
    let summary = run(&place);
    assert_eq!(summary.photos.turned, 2);
    for name in &names[..3] {
        let path = place.path("scene/images").join(name);
        let mut decoder = ImageReader::open(&path).unwrap().into_decoder().unwrap();
        assert_eq!(decoder.dimensions(), SIZE, "{name}");
        assert_eq!(decoder.orientation().unwrap(), Orientation::NoTransforms);
        let chunk = decoder.exif_metadata().unwrap().unwrap();
        assert!(chunk.windows(3).any(|bytes| bytes == b"Cam"), "{name}");
        let pixels = image::open(&path).unwrap().into_rgb8();
        let (dark, light) = (pixels.get_pixel(5, 30)[0], pixels.get_pixel(60, 30)[0]);
        assert!(dark < 40 && light > 210, "{name}: {dark} {light}");
    }
    // Three of one camera, and one that does not say.
    let calls = place.calls();
    assert!(calls[0].contains("single_camera 1") && calls[1].contains("single_camera_per_image 1"));
}

#[test]
fn copies_and_other_files_are_left_out_by_name() {
    let place = place(&["a.png", "b.png", "c.png"]);
    fs::copy(place.path("photos/a.png"), place.path("photos/z.png")).unwrap();
    let bytes = fs::read(place.path("photos/b.png")).unwrap();
    fs::write(place.path("photos/cut.png"), &bytes[..bytes.len() / 2]).unwrap();
    place.write("photos/notes.txt", "sunny");
    place.write("photos/.hidden.png", "no photo");
    symlink(place.path("photos"), place.path("photos/circle")).unwrap();
    symlink(place.path("gone"), place.path("photos/gone.jpg")).unwrap();
    let summary = run(&place);
    let files: Vec<&str> = summary.left_out.iter().map(|f| f.file.as_str()).collect();
    assert_eq!(files, ["cut.png", "gone.jpg", "notes.txt", "z.png"]);
    assert_eq!(summary.left_out[3].reason, "a copy of a.png");
    assert!(summary.left_out[1].reason.contains("cannot be read"));
    assert_eq!((summary.photos.given, summary.photos.used), (5, 3));
}

#[test]
fn photos_of_two_sizes_have_two_cameras() {
    let place = place(&["a.png", "b.png", "c.png", "d.png", "e.png"]);
    for (number, name) in [(7, "d.png"), (8, "e.png")] {
        let path = place.path("photos").join(name);
        photo(number, (SIZE.1, SIZE.0)).save(path).unwrap();
    }
    place.model(0, &["a.png", "b.png", "c.png"]);
    run(&place);
    let calls = place.calls();
    let shared = |call: &&String| call.contains("--ImageReader.single_camera 1");
    assert_eq!(calls.iter().filter(shared).count(), 2, "{calls:?}");
}
