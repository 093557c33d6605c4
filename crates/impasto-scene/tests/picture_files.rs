//! Pictures as cameras and editors write them, and as nobody should.
#![allow(clippy::unwrap_used, reason = "a failure here is a failed test")]

use std::alloc::{GlobalAlloc, Layout, System};
use std::fs;
use std::io::Cursor;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicUsize, Ordering};

use image::{DynamicImage, ImageBuffer, ImageFormat, Rgb, RgbImage, Rgba};
use impasto_scene::read_rgb;

/// Remembers the largest piece of memory that was ever asked for.
struct Watching;

static LARGEST: AtomicUsize = AtomicUsize::new(0);

// SAFETY: everything is passed on to the system's allocator.
unsafe impl GlobalAlloc for Watching {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        LARGEST.fetch_max(layout.size(), Ordering::Relaxed);
        // SAFETY: the caller's promise is passed on.
        unsafe { System.alloc(layout) }
    }

    unsafe fn alloc_zeroed(&self, layout: Layout) -> *mut u8 {
        LARGEST.fetch_max(layout.size(), Ordering::Relaxed);
        // SAFETY: the caller's promise is passed on.
        unsafe { System.alloc_zeroed(layout) }
    }

    unsafe fn realloc(&self, at: *mut u8, layout: Layout, size: usize) -> *mut u8 {
        LARGEST.fetch_max(size, Ordering::Relaxed);
        // SAFETY: the caller's promise is passed on.
        unsafe { System.realloc(at, layout, size) }
    }

    unsafe fn dealloc(&self, at: *mut u8, layout: Layout) {
        // SAFETY: the caller's promise is passed on.
        unsafe { System.dealloc(at, layout) }
    }
}

#[global_allocator]
static ALLOCATOR: Watching = Watching;

/// The fixtures' flag: upper left, upper right, lower left, lower right.
const FLAG: [[i32; 3]; 4] = [[220, 30, 40], [40, 180, 60], [40, 60, 200], [230, 210, 50]];

fn fixture(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("tests/fixtures")
        .join(name)
}

#[track_caller]
fn assert_flag(picture: &RgbImage, expected: [[i32; 3]; 4], name: &str) {
    assert_eq!(picture.dimensions(), (32, 16), "{name}");
    for ((x, y), colour) in [(4, 4), (28, 4), (4, 12), (28, 12)]
        .into_iter()
        .zip(expected)
    {
        let found = picture.get_pixel(x, y).0.map(i32::from);
        let near = found.iter().zip(colour).all(|(a, b)| (a - b).abs() <= 4);
        assert!(
            near,
            "{name} at ({x}, {y}): {found:?} instead of {colour:?}"
        );
    }
}

#[test]
fn every_format_has_its_colours() {
    for name in [
        "rgb.jpg",
        "progressive.jpg",
        "cmyk.jpg",
        "ycck.jpg",
        "cmyk.tif",
        "rgb.tif",
        "palette.png",
        "lossy.webp",
        "lossless.webp",
        "animated.gif",
    ] {
        assert_flag(&read_rgb(&fixture(name)).unwrap(), FLAG, name);
    }
    let grey = [88, 124, 70, 198].map(|v| [v; 3]);
    assert_flag(&read_rgb(&fixture("grey.jpg")).unwrap(), grey, "grey.jpg");
    let faint = FLAG.map(|colour| colour.map(|c| (c + 255) / 2));
    assert_flag(
        &read_rgb(&fixture("alpha.webp")).unwrap(),
        faint,
        "alpha.webp",
    );
}

#[test]
fn sixteen_bits_become_eight() {
    let dir = tempfile::tempdir().unwrap();
    let wide = |x: u32, y: u32| FLAG[(y / 8 * 2 + x / 16) as usize].map(|c| c as u16 * 257);
    let rgb = ImageBuffer::from_fn(32, 16, |x, y| Rgb(wide(x, y)));
    let rgba = ImageBuffer::from_fn(32, 16, |x, y| {
        let [r, g, b] = wide(x, y);
        Rgba([r, g, b, u16::MAX])
    });
    for (name, picture) in [
        ("rgb.png", DynamicImage::ImageRgb16(rgb.clone())),
        ("rgba.png", DynamicImage::ImageRgba16(rgba)),
        ("rgb.tiff", DynamicImage::ImageRgb16(rgb)),
    ] {
        let path = dir.path().join(name);
        picture.save(&path).unwrap();
        assert_flag(&read_rgb(&path).unwrap(), FLAG, name);
    }
}

#[test]
fn pictures_are_turned_upright() {
    let jpegs = (1..=8).map(|n| format!("orientation_{n}.jpg"));
    let others = ["png", "webp", "tif"].map(|ending| format!("orientation_6.{ending}"));
    for name in jpegs.chain(others) {
        assert_flag(&read_rgb(&fixture(&name)).unwrap(), FLAG, &name);
    }
}

fn refusal(path: &Path) -> String {
    read_rgb(path).expect_err("must be refused").to_string()
}

#[test]
fn what_is_no_picture_is_named_for_what_it_is() {
    let dir = tempfile::tempdir().unwrap();
    for (bytes, says) in [
        (&b""[..], "empty"),
        (b"words", "no JPEG, PNG, WebP, TIFF or GIF"),
        (b"\0\0\0\x18ftypheic\0\0\0\0", "HEIC"),
        (b"\0\0\0\x18ftypavif\0\0\0\0", "AVIF"),
        (b"BM\x46\0\0\0\0\0\0\0", "no JPEG"),
    ] {
        let path = dir.path().join("a.png");
        fs::write(&path, bytes).unwrap();
        let said = refusal(&path);
        assert!(said.contains("a.png") && said.contains(says), "{said}");
    }
}

#[test]
fn cut_pictures_of_every_format_are_refused() {
    let dir = tempfile::tempdir().unwrap();
    for name in [
        "rgb.jpg",
        "cmyk.jpg",
        "rgb.tif",
        "lossy.webp",
        "lossless.webp",
        "palette.png",
    ] {
        let bytes = fs::read(fixture(name)).unwrap();
        let path = dir.path().join(name);
        for length in 0..bytes.len() / 2 {
            fs::write(&path, &bytes[..length]).unwrap();
            assert!(refusal(&path).contains(name));
        }
    }
}

/// A PNG chunk with its checksum.
fn chunk(kind: &[u8; 4], data: &[u8]) -> Vec<u8> {
    let body = [kind, data].concat();
    let mut crc = u32::MAX;
    for byte in &body {
        crc ^= u32::from(*byte);
        for _ in 0..8 {
            crc = (crc >> 1) ^ (0xEDB8_8320 & (crc & 1).wrapping_neg());
        }
    }
    [
        &(data.len() as u32).to_be_bytes(),
        &body[..],
        &(!crc).to_be_bytes(),
    ]
    .concat()
}

fn png(width: u32, height: u32, rest: &[Vec<u8>]) -> Vec<u8> {
    let header = [
        &width.to_be_bytes()[..],
        &height.to_be_bytes(),
        &[8, 2, 0, 0, 0],
    ]
    .concat();
    [
        &b"\x89PNG\r\n\x1a\n"[..],
        &chunk(b"IHDR", &header),
        &rest.concat(),
    ]
    .concat()
}

/// A zlib stream of about `length` zeros, a thousandth as long.
fn zeros(length: usize) -> Vec<u8> {
    let (mut bytes, mut held, mut count) = (vec![0x78, 0x9C], 0u32, 0);
    let mut push = |bits: &str| {
        for bit in bits.bytes() {
            held |= u32::from(bit - b'0') << count;
            count += 1;
            if count == 8 {
                bytes.push(held as u8);
                (held, count) = (0, 0);
            }
        }
    };
    // The last block, with fixed codes: one zero, then copies of 258 bytes from one byte back.
    push("110");
    push("00110000");
    for _ in 0..length / 258 {
        push("1100010100000");
    }
    push("000000000000000");
    bytes
}

#[test]
fn pictures_that_claim_to_be_huge_cost_nothing() {
    let dir = tempfile::tempdir().unwrap();
    let data = chunk(b"IDAT", &zeros(1000));
    let mut jpeg = fs::read(fixture("rgb.jpg")).unwrap();
    let frame = jpeg.windows(2).position(|w| w == [0xFF, 0xC0]).unwrap();
    jpeg[frame + 5..frame + 9].copy_from_slice(&[0xEA, 0x60, 0xEA, 0x60]);
    let mut gif = fs::read(fixture("animated.gif")).unwrap();
    gif[6..10].copy_from_slice(&[0x60, 0xEA, 0x60, 0xEA]);
    let mut tiff = Vec::new();
    RgbImage::new(3, 3)
        .write_to(&mut Cursor::new(&mut tiff), ImageFormat::Tiff)
        .unwrap();
    let sides = [0x100u16, 0x101].map(|tag| {
        // A directory entry: tag, type (16 or 32 bits), one value, the value.
        let entry = [&tag.to_le_bytes()[..], &[4, 0, 1, 0, 0, 0]].concat();
        tiff.windows(8).position(|w| w == entry).unwrap() + 8
    });
    for side in sides {
        tiff[side..side + 2].copy_from_slice(&60_000u16.to_le_bytes());
    }
    for (name, bytes) in [
        ("a.png", png(60_000, 60_000, &[data, chunk(b"IEND", &[])])),
        ("a.jpg", jpeg),
        ("a.gif", gif),
        ("a.tif", tiff),
    ] {
        let path = dir.path().join(name);
        fs::write(&path, bytes).unwrap();
        let said = refusal(&path);
        let parts = [name, "60000×60000", "200 megapixels", "shrink"];
        assert!(parts.iter().all(|part| said.contains(part)), "{said}");
    }
    // A colour profile of 300 MB in a picture of one pixel.
    let profile = [b"x\0\0", &zeros(300_000_000)[..]].concat();
    let pixel = [0x78, 0x01, 1, 4, 0, 251, 255, 0, 9, 9, 9, 0, 0x55, 0, 0x1C];
    let rest = [
        chunk(b"iCCP", &profile),
        chunk(b"IDAT", &pixel),
        chunk(b"IEND", &[]),
    ];
    let path = dir.path().join("profile.png");
    fs::write(&path, png(1, 1, &rest)).unwrap();
    // Refused or read without the profile, as the decoder likes.
    let _ = read_rgb(&path);
    let largest = LARGEST.load(Ordering::Relaxed);
    assert!(
        largest < 160 << 20,
        "{largest} bytes were asked for at once"
    );
}

#[cfg(unix)]
#[test]
fn pipes_and_devices_are_not_opened() {
    let dir = tempfile::tempdir().unwrap();
    let pipe = dir.path().join("pipe.png");
    assert!(
        std::process::Command::new("mkfifo")
            .arg(&pipe)
            .status()
            .unwrap()
            .success()
    );
    let endless = dir.path().join("endless.png");
    std::os::unix::fs::symlink("/dev/zero", &endless).unwrap();
    for path in [pipe, endless] {
        assert!(refusal(&path).contains("regular file"));
    }
}
