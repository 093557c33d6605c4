//! Photos, masks and paintings.

use std::fs;
use std::path::Path;

use image::{GrayImage, RgbImage};

use super::base::{cut, link, pipe, transforms, write};
use super::{Case, bad};

const SCENE: &str = "train scene -o new";
const PHOTO: &str = "scene/images/0003.png";
const TRAIN_STYLES: &str = "train scene -o new --styles styles --set style.patch=[24,24]";
const RENDER: &str = "render model -o new --style styles/red.png";

/// The start of a PNG of 60000×60000 pixels, header and checksum as they should be.
const HUGE: &[u8] = b"\x89PNG\r\n\x1a\n\0\0\0\rIHDR\0\0\xea\x60\0\0\xea\x60\x08\x02\0\0\0";

fn huge() -> Vec<u8> {
    let mut crc = u32::MAX;
    for byte in &HUGE[12..] {
        crc ^= u32::from(*byte);
        for _ in 0..8 {
            crc = (crc >> 1) ^ (0xEDB8_8320 & (crc & 1).wrapping_neg());
        }
    }
    // An empty chunk of pixels, so that the header is complete.
    [HUGE, &(!crc).to_be_bytes(), b"\0\0\0\0IDAT\x35\xaf\x06\x1e"].concat()
}

#[allow(clippy::too_many_lines, reason = "one table")]
pub fn photos() -> Vec<Case> {
    vec![
        bad(
            "a photo cut off",
            SCENE,
            |f| cut(f, PHOTO),
            &["0003.png", "not a usable photo", "replace it"],
        ),
        bad(
            "a photo of no bytes",
            SCENE,
            |f| write(f, PHOTO, ""),
            &["0003.png", "empty", "replace it"],
        ),
        bad(
            "a photo that is text",
            SCENE,
            |f| write(f, PHOTO, "photo"),
            &["0003.png", "no JPEG, PNG, WebP, TIFF or GIF"],
        ),
        bad(
            "a photo from a telephone (HEIC)",
            SCENE,
            |f| write(f, PHOTO, b"\0\0\0\x18ftypheic\0\0\0\0"),
            &["0003.png", "HEIC", "convert it to JPEG"],
        ),
        bad(
            "a JPEG cut off",
            SCENE,
            |f| write(f, PHOTO, b"\xff\xd8\xff\xe0\0\x10JFIF"),
            &["0003.png", "cut off", "replace it"],
        ),
        bad(
            "a photo of 3.6 gigapixels",
            SCENE,
            |f| write(f, PHOTO, huge()),
            &["0003.png", "60000×60000", "200 megapixels", "shrink it"],
        ),
        bad(
            "a photo that is missing",
            SCENE,
            |f| fs::remove_file(f.join(PHOTO)).unwrap(),
            &["0003.png", "missing", "put it there or remove the frame"],
        ),
        bad(
            "a photo that is a pipe",
            "train colmap -o new",
            |f| pipe(f, "colmap/images/b.png"),
            &["b.png", "pipe", "regular file"],
        ),
        bad(
            "a photo that links to an endless device",
            "train colmap -o new",
            |f| link(f, "colmap/images/b.png", "/dev/zero"),
            &["b.png", "device", "regular file"],
        ),
        bad(
            "a photo that links to itself",
            "train colmap -o new",
            |f| link(f, "colmap/images/b.png", "b.png"),
            &["b.png", "links"],
        ),
        bad(
            "a photo that is a folder",
            "train colmap -o new",
            |f| {
                fs::remove_file(f.join("colmap/images/b.png")).unwrap();
                fs::create_dir(f.join("colmap/images/b.png")).unwrap();
            },
            &["b.png", "folder"],
        ),
        bad(
            "a photo of another shape than its camera",
            SCENE,
            |f| RgbImage::new(40, 60).save(f.join(PHOTO)).unwrap(),
            &["0003.png", "40×60", "60×40", "use the photos"],
        ),
        bad(
            "photos smaller than a patch",
            "train scene -o new --styles styles --downscale 20",
            |_| {},
            &["photo", "3×2", "smaller --downscale"],
        ),
        bad(
            "a mask that hides everything",
            SCENE,
            |f| mask(f, &GrayImage::new(60, 40)),
            &["masks/0003.png", "hides the whole photo", "white where"],
        ),
        bad(
            "a mask of another shape",
            SCENE,
            |f| mask(f, &GrayImage::new(40, 40)),
            &["masks/0003.png", "40×40", "60×40", "shape"],
        ),
        bad(
            "a mask that is text",
            SCENE,
            |f| write(f, "scene/masks/0003.png", "mask"),
            &["masks/0003.png", "not a usable mask", "--masks off"],
        ),
        bad(
            "a mask that is named but missing",
            SCENE,
            |f| transforms(f, |t| t["frames"][3]["mask_path"] = "m.png".into()),
            &["transforms.json", "no mask", "m.png", "mask_path"],
        ),
    ]
}

fn mask(folder: &Path, picture: &GrayImage) {
    fs::create_dir(folder.join("scene/masks")).unwrap();
    picture.save(folder.join("scene/masks/0003.png")).unwrap();
}

#[allow(clippy::too_many_lines, reason = "one table")]
pub fn paintings() -> Vec<Case> {
    vec![
        bad(
            "a painting that is text",
            RENDER,
            |f| write(f, "styles/red.png", "red"),
            &["red.png", "not a usable painting", "give a JPEG"],
        ),
        bad(
            "a painting cut off",
            RENDER,
            |f| cut(f, "styles/red.png"),
            &["red.png", "not a usable painting"],
        ),
        bad(
            "a painting that is missing",
            "render model -o new --style styles/blue.png",
            |_| {},
            &["blue.png", "no such file", "check the path"],
        ),
        bad(
            "a painting that is a folder",
            "render model -o new --style styles",
            |_| {},
            &["styles", "folder", "give a file"],
        ),
        bad(
            "a painting that is a pipe",
            RENDER,
            |f| pipe(f, "styles/red.png"),
            &["red.png", "pipe", "regular file"],
        ),
        bad(
            "a painting of 3.6 gigapixels",
            RENDER,
            |f| write(f, "styles/red.png", huge()),
            &["red.png", "200 megapixels", "shrink it"],
        ),
        bad(
            "no folder of paintings",
            "train scene -o new --styles none --set style.patch=[24,24]",
            |_| {},
            &["style folder none", "no such"],
        ),
        bad(
            "a folder of no paintings",
            TRAIN_STYLES,
            |f| fs::remove_file(f.join("styles/red.png")).unwrap(),
            &["style folder styles", "empty", "put"],
        ),
        bad(
            "a folder of broken paintings",
            TRAIN_STYLES,
            |f| write(f, "styles/red.png", "red"),
            &["style folder styles", "no readable painting", "red.png"],
        ),
        bad(
            "a file instead of a folder of paintings",
            "train scene -o new --styles styles/red.png --set style.patch=[24,24]",
            |_| {},
            &["style folder styles/red.png", "folder"],
        ),
        bad(
            "a folder of paintings that links to itself",
            "train scene -o new --styles loop --set style.patch=[24,24]",
            |f| link(f, "loop", "loop"),
            &["style folder loop", "links"],
        ),
        bad(
            "a folder with nothing but a loop of links",
            "train scene -o new --styles styles --set style.patch=[24,24]",
            |f| {
                fs::remove_file(f.join("styles/red.png")).unwrap();
                link(f, "styles/up", "../styles");
            },
            &["style folder styles", "empty"],
        ),
    ]
}
