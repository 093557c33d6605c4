//! Writing the built-in scene as an ordinary capture folder.

use std::fs;
use std::io;
use std::path::{Path, PathBuf};

use glam::DMat4;
use serde_json::{Value, json};

use super::{BuiltinOptions, cameras, render};
use crate::camera::Camera;
use crate::npy;

/// Why [`write_capture`] failed.
#[derive(Debug, thiserror::Error)]
pub enum WriteCaptureError {
    /// A file or folder could not be written.
    #[error("cannot write {}: {source}; choose a folder that can be written to", path.display())]
    File {
        /// Which one.
        path: PathBuf,
        /// What the system said.
        source: io::Error,
    },
    /// A photo could not be encoded or written.
    #[error("cannot write photo {}: {source}; choose a folder that can be written to", path.display())]
    Photo {
        /// Which one.
        path: PathBuf,
        /// What the encoder said.
        source: image::ImageError,
    },
}

const README: &str = "SYNTHETIC: these photos show no real place. They were rendered by Impasto's \
built-in scene.\n\nimages/NNNN.png      photos (sRGB)\ntransforms.json      cameras, OpenGL axes \
(x right, y up, z backward), metres\ndepth/NNNN.npy       exact depth along the camera's axis at \
pixel centres, float32,\n                     height x width, metres, inf for sky\n";

/// Renders the built-in scene into `dir`, which is created when missing: `images/0000.png …`,
/// `depth/0000.npy …`, `README.txt` and, last, `transforms.json`, so that an interrupted write is
/// never mistaken for a capture.
///
/// # Errors
/// When a folder or file cannot be written; the error names it.
pub fn write_capture(dir: &Path, options: &BuiltinOptions) -> Result<(), WriteCaptureError> {
    for folder in ["images", "depth"] {
        let path = dir.join(folder);
        fs::create_dir_all(&path).map_err(|source| WriteCaptureError::File { path, source })?;
    }
    let cameras = cameras(options);
    for (index, camera) in cameras.iter().enumerate() {
        let view = render(camera);
        let path = dir.join(photo_name(index));
        let saved = view.pixels.save(&path);
        saved.map_err(|source| WriteCaptureError::Photo { path, source })?;
        let (width, height) = view.pixels.dimensions();
        let depth = npy::encode(&view.depth, width, height);
        write_file(dir.join(depth_name(index)), &depth)?;
    }
    write_file(dir.join("README.txt"), README.as_bytes())?;
    let cameras = format!("{:#}\n", transforms(&cameras));
    write_file(dir.join("transforms.json"), cameras.as_bytes())
}

fn photo_name(index: usize) -> String {
    format!("images/{index:04}.png")
}

fn depth_name(index: usize) -> String {
    format!("depth/{index:04}.npy")
}

fn write_file(path: PathBuf, bytes: &[u8]) -> Result<(), WriteCaptureError> {
    fs::write(&path, bytes).map_err(|source| WriteCaptureError::File { path, source })
}

/// The capture's cameras, which share one lens, in the layout of instant-ngp and nerfstudio.
fn transforms(cameras: &[Camera]) -> Value {
    let frame = |(index, camera): (usize, &Camera)| {
        json!({
            "file_path": photo_name(index),
            "depth_file_path": depth_name(index),
            "transform_matrix": opengl_rows(camera),
        })
    };
    let mut file = json!({
        "synthetic": true,
        "camera_model": "OPENCV",
        "frames": cameras.iter().enumerate().map(frame).collect::<Vec<_>>(),
    });
    if let Some(camera) = cameras.first() {
        let k = &camera.intrinsics;
        let d = &k.distortion;
        file["w"] = json!(k.width);
        file["h"] = json!(k.height);
        let lens = [
            ("fl_x", k.fl_x),
            ("fl_y", k.fl_y),
            ("cx", k.cx),
            ("cy", k.cy),
            ("k1", d.k1),
            ("k2", d.k2),
            ("p1", d.p1),
            ("p2", d.p2),
        ];
        for (key, value) in lens {
            file[key] = json!(value);
        }
    }
    file
}

/// Rows of camera-to-world with OpenGL's camera axes: y and z turned around.
fn opengl_rows(camera: &Camera) -> [[f64; 4]; 4] {
    let m = camera.camera_to_world;
    let flipped = DMat4::from_cols(m.x_axis, -m.y_axis, -m.z_axis, m.w_axis);
    flipped.transpose().to_cols_array_2d()
}
