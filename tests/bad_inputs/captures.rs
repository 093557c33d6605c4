//! Captures of every format.

use std::fs;

use impasto::scene::npy;
use serde_json::json;

use super::base::{cut, link, photo, pipe, replace, transforms, write};
use super::{Case, bad};

const SCENE: &str = "train scene -o new";
const COLMAP: &str = "train colmap -o new";
const NERF: &str = "train nerf -o new";
const LLFF: &str = "train llff -o new";

pub fn cases() -> Vec<Case> {
    [places(), transforms_files(), colmap(), others()]
        .into_iter()
        .flatten()
        .collect()
}

fn places() -> Vec<Case> {
    vec![
        bad(
            "no such folder",
            "train nowhere -o new",
            |_| {},
            &["nowhere", "no such", "give the folder"],
        ),
        bad(
            "an empty folder",
            "train empty -o new",
            |f| fs::create_dir(f.join("empty")).unwrap(),
            &["empty", "Supported"],
        ),
        bad(
            "photos without poses",
            "train styles -o new",
            |_| {},
            &["styles", "no camera poses", "COLMAP"],
        ),
        bad(
            "a picture instead of a capture",
            "train styles/red.png -o new",
            |_| {},
            &["red.png", "not a capture", "Supported"],
        ),
        bad(
            "a format that is not there",
            "train scene -o new --format llff",
            |_| {},
            &["scene", "\"llff\"", "Supported"],
        ),
        bad(
            "a loop of links",
            "train loop -o new",
            |f| {
                link(f, "loop", "other");
                link(f, "other", "loop");
            },
            &["loop", "links"],
        ),
        bad(
            "a pipe instead of a capture",
            "info pipe",
            |f| pipe(f, "pipe"),
            &["pipe", "not a capture"],
        ),
    ]
}

#[allow(clippy::too_many_lines, reason = "one table")]
fn transforms_files() -> Vec<Case> {
    vec![
        bad(
            "transforms.json cut off",
            SCENE,
            |f| cut(f, "scene/transforms.json"),
            &["transforms.json", "line", "EOF"],
        ),
        bad(
            "transforms.json that is not JSON",
            SCENE,
            |f| write(f, "scene/transforms.json", "poses"),
            &["transforms.json, line 1", "not a transforms file"],
        ),
        bad(
            "transforms.json that is not text",
            SCENE,
            |f| write(f, "scene/transforms.json", [0xFF, 0xFE]),
            &["transforms.json, byte 0", "not text"],
        ),
        bad(
            "transforms.json that is an empty file",
            SCENE,
            |f| write(f, "scene/transforms.json", ""),
            &["transforms.json", "line 1"],
        ),
        bad(
            "transforms.json without frames",
            SCENE,
            |f| transforms(f, |t| t["frames"] = json!([])),
            &["transforms.json", "frames", "empty"],
        ),
        bad(
            "one frame",
            SCENE,
            |f| transforms(f, |t| t["frames"].as_array_mut().unwrap().truncate(1)),
            &["scene", "1 posed photo", "at least 2"],
        ),
        bad(
            "a scaled pose",
            SCENE,
            |f| {
                transforms(f, |t| {
                    t["frames"][2]["transform_matrix"][0] = json!([2.0, 0.0, 0.0, 1.0])
                })
            },
            &["transforms.json", "0002.png", "not a rotation", "export"],
        ),
        bad(
            "a pose of two rows",
            SCENE,
            |f| {
                transforms(f, |t| {
                    t["frames"][2]["transform_matrix"] = json!([[1.0], [0.0]])
                })
            },
            &["transforms.json", "0002.png", "4×4"],
        ),
        bad(
            "a pose with a last row of its own",
            SCENE,
            |f| {
                transforms(f, |t| {
                    t["frames"][2]["transform_matrix"][3] = json!([0, 0, 1, 1])
                })
            },
            &["0002.png", "last row", "[0, 0, 0, 1]"],
        ),
        bad(
            "all cameras at one place",
            SCENE,
            |f| {
                transforms(f, |t| {
                    let pose = t["frames"][0]["transform_matrix"].clone();
                    for frame in t["frames"].as_array_mut().unwrap() {
                        frame["transform_matrix"] = pose.clone();
                    }
                })
            },
            &["scene", "one place", "different places"],
        ),
        bad(
            "a focal length of zero",
            SCENE,
            |f| transforms(f, |t| t["fl_x"] = json!(0.0)),
            &["transforms.json", "0000.png", "focal length", "positive"],
        ),
        bad(
            "a focal length in millimetres",
            SCENE,
            |f| {
                transforms(f, |t| {
                    t["fl_x"] = json!(0.035);
                    t["fl_y"] = json!(0.035);
                })
            },
            &["0000.png", "0.035 pixels", "same pixels"],
        ),
        bad(
            "no focal length",
            SCENE,
            |f| {
                transforms(f, |t| {
                    for key in ["fl_x", "fl_y", "camera_angle_x", "camera_angle_y"] {
                        t.as_object_mut().unwrap().remove(key);
                    }
                })
            },
            &["0000.png", "focal length"],
        ),
        bad(
            "a principal point of another image",
            SCENE,
            |f| transforms(f, |t| t["cx"] = json!(2000.0)),
            &["0000.png", "principal point", "far outside"],
        ),
        bad(
            "a fisheye lens",
            SCENE,
            |f| transforms(f, |t| t["camera_model"] = json!("OPENCV_FISHEYE")),
            &["transforms.json", "OPENCV_FISHEYE", "undistort"],
        ),
        bad(
            "a name that leads out of the capture",
            SCENE,
            |f| {
                transforms(f, |t| {
                    t["frames"][3]["file_path"] = json!("../../etc/passwd")
                })
            },
            &[
                "transforms.json",
                "../../etc/passwd",
                "leads out",
                "put the photo into",
            ],
        ),
        bad(
            "an absolute name",
            SCENE,
            |f| transforms(f, |t| t["frames"][3]["file_path"] = json!("/home/me/a.png")),
            &["transforms.json", "/home/me/a.png", "leads out"],
        ),
        bad(
            "a name that steers terminals",
            SCENE,
            |f| transforms(f, |t| t["frames"][3]["file_path"] = json!("\u{1b}[2J.png")),
            &["missing", "remove the frame"],
        ),
        bad(
            "a name with a zero",
            SCENE,
            |f| transforms(f, |t| t["frames"][3]["file_path"] = json!("a\u{0}.png")),
            &["transforms.json", "no name of a photo"],
        ),
        bad(
            "two frames of one photo",
            SCENE,
            |f| {
                transforms(f, |t| {
                    t["frames"][3]["file_path"] = t["frames"][2]["file_path"].clone()
                })
            },
            &["scene", "0002.png", "keep one"],
        ),
        bad(
            "a split of photos that no frame has",
            SCENE,
            |f| {
                transforms(f, |t| {
                    t["train_filenames"] = json!(["images/0001.png"]);
                    t["test_filenames"] = json!(["images/z.png"]);
                })
            },
            &["transforms.json", "z.png", "no frame has it"],
        ),
        bad(
            "a file of 5 GB",
            SCENE,
            |f| {
                fs::File::options()
                    .write(true)
                    .open(f.join("scene/transforms.json"))
                    .unwrap()
                    .set_len(5 << 30)
                    .unwrap()
            },
            &["transforms.json", "larger than 4096 MiB", "smaller"],
        ),
    ]
}

#[allow(clippy::too_many_lines, reason = "one table")]
fn colmap() -> Vec<Case> {
    vec![
        bad(
            "COLMAP: an unknown lens",
            COLMAP,
            |f| replace(f, "colmap/sparse/0/cameras.txt", "PINHOLE", "FOV"),
            &["cameras.txt", "camera 1", "FOV", "image_undistorter"],
        ),
        bad(
            "COLMAP: too few lens parameters",
            COLMAP,
            |f| replace(f, "colmap/sparse/0/cameras.txt", " 30 20", ""),
            &["cameras.txt", "camera 1", "2 parameters", "PINHOLE"],
        ),
        bad(
            "COLMAP: a word instead of a number",
            COLMAP,
            |f| replace(f, "colmap/sparse/0/cameras.txt", "40", "forty"),
            &["cameras.txt, line 1", "\"forty\"", "height"],
        ),
        bad(
            "COLMAP: a camera that is not there",
            COLMAP,
            |f| replace(f, "colmap/sparse/0/images.txt", "1 a.png", "9 a.png"),
            &["images.txt", "a.png", "camera 9"],
        ),
        bad(
            "COLMAP: a pose of NaN",
            COLMAP,
            |f| replace(f, "colmap/sparse/0/images.txt", "1 1 0 0 0", "1 nan 0 0 0"),
            &["images.txt", "a.png", "NaN"],
        ),
        bad(
            "COLMAP: a pose that is no rotation",
            COLMAP,
            |f| replace(f, "colmap/sparse/0/images.txt", "1 1 0 0 0", "1 3 0 0 0"),
            &["images.txt", "a.png", "not a rotation"],
        ),
        bad(
            "COLMAP: no registered image",
            COLMAP,
            |f| write(f, "colmap/sparse/0/images.txt", ""),
            &["colmap", "0 posed photo"],
        ),
        bad(
            "COLMAP: a name that leads out",
            COLMAP,
            |f| replace(f, "colmap/sparse/0/images.txt", "b.png", "../../b.png"),
            &["images.txt", "../../b.png", "leads out"],
        ),
        bad(
            "COLMAP: one image twice",
            COLMAP,
            |f| replace(f, "colmap/sparse/0/images.txt", "b.png", "a.png"),
            &["colmap", "a.png", "keep one"],
        ),
        bad(
            "COLMAP: a point of NaN",
            COLMAP,
            |f| replace(f, "colmap/sparse/0/points3D.txt", "0 0 5", "0 nan 5"),
            &["points3D.txt", "point 1", "NaN"],
        ),
        bad(
            "COLMAP: a binary model cut off",
            COLMAP,
            |f| {
                write(f, "colmap/sparse/0/cameras.bin", [9, 0, 0]);
                write(f, "colmap/sparse/0/images.bin", "");
            },
            &["cameras.bin, byte", "short"],
        ),
        bad(
            "COLMAP: a binary model that announces too much",
            COLMAP,
            |f| {
                write(f, "colmap/sparse/0/cameras.bin", [255; 8]);
                write(f, "colmap/sparse/0/images.bin", "");
            },
            &["cameras.bin, byte 0", "cut off or damaged"],
        ),
        bad(
            "COLMAP: photos of another shape",
            COLMAP,
            |f| photo_of(f, "colmap/images/b.png", 40, 60),
            &["b.png", "40×60", "60×40", "use the photos"],
        ),
    ]
}

fn photo_of(folder: &std::path::Path, name: &str, width: u32, height: u32) {
    image::imageops::thumbnail(&photo(), width, height)
        .save(folder.join(name))
        .unwrap();
}

fn others() -> Vec<Case> {
    vec![
        bad(
            "NeRF++: a pose too few",
            NERF,
            |f| fs::remove_file(f.join("nerf/train/pose/b.txt")).unwrap(),
            &["nerf", "train", "2 poses", "one of each"],
        ),
        bad(
            "NeRF++: a pose of three numbers",
            NERF,
            |f| write(f, "nerf/train/pose/b.txt", "1 0 0"),
            &["pose/b.txt", "3 numbers", "16"],
        ),
        bad(
            "NeRF++: a word instead of a number",
            NERF,
            |f| write(f, "nerf/train/pose/b.txt", "one"),
            &["pose/b.txt", "number 1", "\"one\""],
        ),
        bad(
            "NeRF++: skewed pixels",
            NERF,
            |f| replace(f, "nerf/train/intrinsics/b.txt", "50 0 30", "50 9 30"),
            &["intrinsics/b.txt", "skewed"],
        ),
        bad(
            "NeRF++: a cut photo",
            NERF,
            |f| write(f, "nerf/train/rgb/b.png", "\u{89}PNG"),
            &["b.png", "not a usable photo"],
        ),
        bad(
            "LLFF: no NumPy file",
            LLFF,
            |f| write(f, "llff/poses_bounds.npy", "PK"),
            &["poses_bounds.npy", "no NumPy file"],
        ),
        bad(
            "LLFF: rows of another length",
            LLFF,
            |f| write(f, "llff/poses_bounds.npy", npy::encode(&[0.0; 32], 16, 2)),
            &["poses_bounds.npy", "[2, 16]", "17"],
        ),
        bad(
            "LLFF: a photo too few",
            LLFF,
            |f| fs::remove_file(f.join("llff/images/b.png")).unwrap(),
            &[
                "poses_bounds.npy",
                "3 poses but 2 photos",
                "every pose needs its photo",
            ],
        ),
        bad(
            "LLFF: poses of zeros",
            LLFF,
            |f| write(f, "llff/poses_bounds.npy", npy::encode(&[0.0; 51], 17, 3)),
            &["images/a.png", "not a rotation"],
        ),
    ]
}
