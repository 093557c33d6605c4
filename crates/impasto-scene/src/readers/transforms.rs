//! `transforms.json` as instant-ngp, nerfstudio and Blender write it.
//!
//! Intrinsics may be global or belong to a frame; poses are camera-to-world in OpenGL axes.

use std::path::{Path, PathBuf};

use glam::DMat4;
use serde::Deserialize;

use super::capture::{Capture, RawFrame};
use super::names;
use crate::camera::{Camera, Distortion, Intrinsics};
use crate::error::{SceneError, read_text};
use crate::picture_file::{PICTURE_ENDINGS, stored_size};
use crate::pose;
use crate::scene::Split;

/// LensEntry models whose coefficients are all among k1, k2, p1, p2.
const LENS_MODELS: [&str; 6] = [
    "OPENCV",
    "PINHOLE",
    "SIMPLE_PINHOLE",
    "RADIAL",
    "SIMPLE_RADIAL",
    "PERSPECTIVE",
];

/// A lens description; any part may be absent. Sizes may be written as 1080.0.
#[derive(Deserialize, Default)]
struct LensEntry {
    w: Option<f64>,
    h: Option<f64>,
    fl_x: Option<f64>,
    fl_y: Option<f64>,
    cx: Option<f64>,
    cy: Option<f64>,
    camera_angle_x: Option<f64>,
    camera_angle_y: Option<f64>,
    k1: Option<f64>,
    k2: Option<f64>,
    k3: Option<f64>,
    k4: Option<f64>,
    p1: Option<f64>,
    p2: Option<f64>,
    camera_model: Option<String>,
    is_fisheye: Option<bool>,
}

#[derive(Deserialize)]
struct FrameEntry {
    file_path: String,
    /// nerfstudio's: a picture that is white where the photo is used.
    mask_path: Option<String>,
    transform_matrix: Vec<Vec<f64>>,
    #[serde(flatten)]
    lens: LensEntry,
}

#[derive(Deserialize)]
struct File {
    frames: Vec<FrameEntry>,
    #[serde(flatten)]
    lens: LensEntry,
    train_filenames: Option<Vec<String>>,
    val_filenames: Option<Vec<String>>,
    test_filenames: Option<Vec<String>>,
    /// Our own key: the built-in scene's files say that its photos are rendered.
    #[serde(default)]
    synthetic: bool,
}

/// Reads the frames of all `files`; each file's own split, if it has one, is that of its frames.
pub(crate) fn read(files: &[(PathBuf, Option<Split>)]) -> Result<Capture, SceneError> {
    let mut frames = Vec::new();
    let mut synthetic = false;
    for (path, split) in files {
        let text = read_text(path)?;
        let file: File = serde_json::from_str(&text).map_err(|e| {
            let place = format!("line {}, column {}", e.line(), e.column());
            let problem = format!("not a transforms file ({}); export it again", reason(&e));
            SceneError::malformed(path, place, problem)
        })?;
        if file.frames.is_empty() {
            let problem = "the list of frames is empty; export it again with its photos";
            return Err(SceneError::malformed(path, "\"frames\"", problem));
        }
        synthetic |= file.synthetic;
        let named = NamedSplits::of(&file, path)?;
        for entry in &file.frames {
            let listed = named.as_ref().map(|named| named.split(&entry.file_path));
            // A frame that is in neither list is left out.
            if listed != Some(None) {
                let split = listed.unwrap_or(*split);
                frames.push(frame(entry, &file.lens, split, path)?);
            }
        }
    }
    Ok(Capture {
        frames,
        points: Vec::new(),
        synthetic,
    })
}

/// serde's message without the position that it repeats at the end.
fn reason(error: &serde_json::Error) -> String {
    let message = error.to_string();
    let end = message.rfind(" at line ").unwrap_or(message.len());
    message[..end].to_owned()
}

/// nerfstudio's lists of the photos of each split.
struct NamedSplits<'a> {
    train: &'a [String],
    test: &'a [String],
}

impl<'a> NamedSplits<'a> {
    /// The lists of `file`, if it says both what to train on and what to test on. The validation
    /// list stands in for an absent test list. Frames in neither are left out, as nerfstudio does.
    fn of(file: &'a File, path: &Path) -> Result<Option<Self>, SceneError> {
        fn filled(list: &Option<Vec<String>>) -> Option<&[String]> {
            list.as_deref().filter(|l| !l.is_empty())
        }
        let test = filled(&file.test_filenames).or(filled(&file.val_filenames));
        let (Some(train), Some(test)) = (filled(&file.train_filenames), test) else {
            return Ok(None);
        };
        let known: std::collections::HashSet<&str> =
            file.frames.iter().map(|f| plain(&f.file_path)).collect();
        for name in train.iter().chain(test) {
            if !known.contains(plain(name)) {
                let problem = "the split lists this photo but no frame has it; add the frame or take it off the list";
                let place = format!("frame {name}");
                return Err(SceneError::malformed(path, place, problem));
            }
        }
        Ok(Some(Self { train, test }))
    }

    fn split(&self, name: &str) -> Option<Split> {
        let lists = |list: &[String]| list.iter().any(|n| plain(n) == plain(name));
        let test = lists(self.test).then_some(Split::Test);
        test.or_else(|| lists(self.train).then_some(Split::Train))
    }
}

/// A relative path without the `./` that Blender's files begin with.
fn plain(name: &str) -> &str {
    name.strip_prefix("./").unwrap_or(name)
}

fn frame(
    entry: &FrameEntry,
    global: &LensEntry,
    split: Option<Split>,
    path: &Path,
) -> Result<RawFrame, SceneError> {
    let (name, photo) = find_photo(&entry.file_path, path)?;
    let matrix = matrix(&entry.transform_matrix).ok_or_else(|| {
        let problem = "is not a 4×4 or 3×4 matrix; write it as rows of four numbers";
        SceneError::pose(path, &name, problem)
    })?;
    check_model(&entry.lens, global, path, &format!("frame {name}"))?;
    let measured = stated_size(&entry.lens, global).is_none();
    let camera = Camera {
        intrinsics: intrinsics(&entry.lens, global, &photo)?,
        camera_to_world: pose::from_opengl(matrix),
    };
    let mask = entry.mask_path.as_deref();
    let mask = mask.map(|mask| find_mask(mask, &name, path)).transpose()?;
    Ok(RawFrame {
        mask,
        measured,
        ..RawFrame::checked(path, name, photo, camera, split)?
    })
}

/// The name (with its ending) and the path of a frame's photo.
fn find_photo(file_path: &str, path: &Path) -> Result<(String, PathBuf), SceneError> {
    let folder = path.parent().unwrap_or(Path::new(""));
    names::check(file_path, folder, 0, path)?;
    let name = plain(file_path);
    let upper = PICTURE_ENDINGS.map(str::to_ascii_uppercase);
    let endings = PICTURE_ENDINGS.map(str::to_owned).into_iter().chain(upper);
    // The ending may be left out, and programs on Windows write their own separator.
    let mut names = [name.to_owned(), name.replace('\\', "/")]
        .into_iter()
        .chain(endings.map(|ending| format!("{name}.{ending}")));
    let found = names.find(|name| folder.join(name).is_file());
    let photo = found.map(|name| (name.clone(), folder.join(name)));
    photo.ok_or_else(|| SceneError::PhotoMissing {
        frame: file_path.to_owned(),
        path: folder.join(name),
    })
}

/// The path of a frame's mask.
fn find_mask(mask_path: &str, frame: &str, path: &Path) -> Result<PathBuf, SceneError> {
    let folder = path.parent().unwrap_or(Path::new(""));
    names::check(mask_path, folder, 0, path)?;
    let mask = folder.join(plain(mask_path));
    if mask.exists() {
        return Ok(mask);
    }
    let (mask, place) = (mask.display(), format!("frame {frame}"));
    let problem = format!("there is no mask {mask}; add it or remove \"mask_path\"");
    Err(SceneError::malformed(path, place, problem))
}

fn matrix(rows: &[Vec<f64>]) -> Option<DMat4> {
    let mut matrix = DMat4::IDENTITY.to_cols_array_2d();
    if !(3..=4).contains(&rows.len()) {
        return None;
    }
    for (to, from) in matrix.iter_mut().zip(rows) {
        *to = from.as_slice().try_into().ok()?;
    }
    Some(DMat4::from_cols_array_2d(&matrix).transpose())
}

/// Refuses lenses that k1, k2, p1, p2 do not describe.
fn check_model(
    own: &LensEntry,
    global: &LensEntry,
    path: &Path,
    place: &str,
) -> Result<(), SceneError> {
    let refuse = |model: &str| Err(SceneError::lens_model(path, place, model));
    if own.is_fisheye.or(global.is_fisheye) == Some(true) {
        return refuse("fisheye");
    }
    if let Some(model) = own.camera_model.as_ref().or(global.camera_model.as_ref())
        && !LENS_MODELS.contains(&model.as_str())
    {
        return refuse(model);
    }
    let higher = [own.k3.or(global.k3), own.k4.or(global.k4)];
    if higher.into_iter().flatten().any(|k| k != 0.0) {
        return refuse("with coefficients k3 or k4");
    }
    Ok(())
}

fn stated_size(own: &LensEntry, global: &LensEntry) -> Option<(f64, f64)> {
    own.w.or(global.w).zip(own.h.or(global.h))
}

/// A frame's lens: its own numbers where it has them, else the global ones; a size that is stated
/// nowhere is the photo's. A stated focal length comes before a field of view at the same level.
fn intrinsics(own: &LensEntry, global: &LensEntry, photo: &Path) -> Result<Intrinsics, SceneError> {
    let (width, height) = match stated_size(own, global) {
        Some(stated) => stated,
        None => {
            let (w, h) = stored_size(photo)?;
            (f64::from(w), f64::from(h))
        }
    };
    let from_angle = |angle: f64, side: f64| 0.5 * side / (0.5 * angle).tan();
    let focal = |lens: &LensEntry| {
        let angle_x = lens.camera_angle_x.map(|a| from_angle(a, width));
        let angle_y = lens.camera_angle_y.map(|a| from_angle(a, height));
        let x = lens.fl_x.or(angle_x);
        // A lone fl_x means square pixels, whatever rounded angle stands beside it.
        let y = lens.fl_y.or(angle_y.filter(|_| lens.fl_x.is_none()));
        let either = x.or(y)?;
        Some((x.unwrap_or(either), y.unwrap_or(either)))
    };
    // Zero is refused by the check of the finished lens.
    let (fl_x, fl_y) = focal(own).or_else(|| focal(global)).unwrap_or((0.0, 0.0));
    let coefficient = |get: fn(&LensEntry) -> Option<f64>| get(own).or(get(global)).unwrap_or(0.0);
    Ok(Intrinsics {
        // Saturating: anything absurd becomes a size that no photo has, or zero.
        width: width.round() as u32,
        height: height.round() as u32,
        fl_x,
        fl_y,
        cx: own.cx.or(global.cx).unwrap_or(0.5 * width),
        cy: own.cy.or(global.cy).unwrap_or(0.5 * height),
        distortion: Distortion {
            k1: coefficient(|l| l.k1),
            k2: coefficient(|l| l.k2),
            p1: coefficient(|l| l.p1),
            p2: coefficient(|l| l.p2),
        },
    })
}
