//! Files of points and of splats.

use std::path::Path;

use glam::Vec3;

use crate::ExportError;
use crate::cloud::{CloudOptions, cloud};
use crate::fit::fit;
use crate::ply::{self, Properties};
use crate::splats::{Splat, splat};
use crate::views::{RENDERED, Views, Watch};

/// First coefficient of spherical harmonics: a colour is ½ + this times `f_dc`.
const HARMONIC: f32 = 0.282_094_8;
/// Distance between points, and between splats, in pixels of the views.
const POINT_SPACING: f32 = 1.0;
const SPLAT_SPACING: f32 = 2.0;
/// Shares of the time at which points are merged, and splats are fitted.
const MERGED: f64 = 0.75;
const FITTED: f64 = 0.98;

const POINT: [Properties; 2] = [
    ("float", &["x", "y", "z", "nx", "ny", "nz"]),
    ("uchar", &["red", "green", "blue"]),
];

const SPLAT: [Properties; 1] = [(
    "float",
    &[
        "x", "y", "z", "nx", "ny", "nz", "f_dc_0", "f_dc_1", "f_dc_2", "opacity", "scale_0",
        "scale_1", "scale_2", "rot_0", "rot_1", "rot_2", "rot_3",
    ],
)];

/// What was written.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Exported {
    /// Points, or splats.
    pub count: usize,
    /// Size of the file.
    pub bytes: u64,
    /// Mean PSNR in dB of the splats' pictures against the views, while they were last fitted.
    pub psnr: Option<f64>,
}

/// Writes a cloud of oriented, coloured points: PLY with positions and normals in the capture's
/// coordinates and colours of bytes. The file appears whole or not at all.
///
/// # Errors
/// If no view shows a surface, the file cannot be written or somebody asks for the end.
pub fn export_points(
    views: &Views,
    path: &Path,
    watch: &mut Watch<'_>,
) -> Result<Exported, ExportError> {
    let options = CloudOptions {
        spacing: POINT_SPACING,
        everything: false,
    };
    let surfels = cloud(views, &options, [RENDERED, FITTED], watch)?;
    let comments = comments(views, "point cloud of surfaces");
    write(path, &comments, &POINT, &surfels, watch, |surfel, row| {
        floats(row, &capture(views, surfel.position));
        floats(row, &surfel.normal.to_array());
        row.extend(surfel.colour.to_array().map(byte));
    })
}

/// Writes flat Gaussians in the form of 3DGS: PLY with its property names in its order, of
/// spherical harmonics only the first band (`f_dc`, no `f_rest`), in the capture's coordinates.
/// Colours and opacities are fitted to the views. The file appears whole or not at all.
///
/// # Errors
/// As [`export_points`].
pub fn export_splats(
    views: &Views,
    path: &Path,
    watch: &mut Watch<'_>,
) -> Result<Exported, ExportError> {
    let options = CloudOptions {
        spacing: SPLAT_SPACING,
        everything: true,
    };
    let surfels = cloud(views, &options, [RENDERED, MERGED], watch)?;
    let mut splats: Vec<Splat> = surfels.iter().map(splat).collect();
    drop(surfels);
    let psnr = fit(&mut splats, views, [MERGED, FITTED], watch)?;
    let what = "3-D Gaussian splats, colours without view dependence";
    let comments = comments(views, what);
    let scale = (1.0 / views.normalisation.scale) as f32;
    let exported = write(path, &comments, &SPLAT, &splats, watch, |splat, row| {
        floats(row, &capture(views, splat.position));
        floats(row, &splat.normal.to_array());
        floats(row, &((splat.colour - 0.5) / HARMONIC).to_array());
        floats(row, &[(splat.opacity / (1.0 - splat.opacity)).ln()]);
        floats(row, &(splat.scale * scale).to_array().map(f32::ln));
        let q = splat.rotation;
        floats(row, &[q.w, q.x, q.y, q.z]);
    })?;
    Ok(Exported {
        psnr: Some(psnr),
        ..exported
    })
}

/// Writes these properties of each row, the last part of the work.
fn write<T>(
    path: &Path,
    comments: &[String],
    properties: &[Properties],
    rows: &[T],
    watch: &mut Watch<'_>,
    row: impl Fn(&T, &mut Vec<u8>),
) -> Result<Exported, ExportError> {
    watch.at("write", FITTED)?;
    let bytes = ply::write(path, comments, properties, rows, row)?;
    (watch.progress)("write", 1.0);
    Ok(Exported {
        count: rows.len(),
        bytes,
        psnr: None,
    })
}

fn comments(views: &Views, what: &str) -> Vec<String> {
    let synthetic = if views.synthetic { "synthetic " } else { "" };
    vec![
        format!("Impasto: {what}"),
        format!("{synthetic}scene: {}", views.name),
        "coordinates: those of the capture's camera poses, in its units".into(),
    ]
}

fn capture(views: &Views, scene: Vec3) -> [f32; 3] {
    let point = views.normalisation.to_capture(scene.as_dvec3());
    point.as_vec3().to_array()
}

fn floats(row: &mut Vec<u8>, numbers: &[f32]) {
    row.extend(numbers.iter().flat_map(|number| number.to_le_bytes()));
}

fn byte(colour: f32) -> u8 {
    (colour.clamp(0.0, 1.0) * 255.0).round() as u8
}
