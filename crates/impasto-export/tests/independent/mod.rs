//! A reader of PLY files and a rasteriser of Gaussians that share no code with the crate's: what
//! another program makes of a file.

use std::collections::BTreeMap;
use std::path::Path;

use glam::{DMat2, DMat3, DMat4, DQuat, DVec2, DVec3};
use impasto_scene::{Camera, Normalisation};

/// A file's one element, column by column.
pub struct Ply {
    /// Lines after "comment ".
    pub comments: Vec<String>,
    /// Types and names in the file's order.
    pub properties: Vec<(String, String)>,
    /// Rows.
    pub count: usize,
    columns: BTreeMap<String, Vec<f64>>,
}

impl Ply {
    pub fn read(path: &Path) -> Self {
        let bytes = std::fs::read(path).unwrap();
        let end = b"end_header\n";
        let at = bytes.windows(end.len()).position(|w| w == end).unwrap();
        let header = std::str::from_utf8(&bytes[..at]).unwrap();
        let mut lines = header.lines();
        assert_eq!(lines.next(), Some("ply"));
        assert_eq!(lines.next(), Some("format binary_little_endian 1.0"));
        let (mut comments, mut properties, mut count) = (Vec::new(), Vec::new(), 0);
        for line in lines {
            match line.split(' ').collect::<Vec<_>>()[..] {
                ["comment", ..] => comments.push(line["comment ".len()..].to_owned()),
                ["element", "vertex", number] => count = number.parse().unwrap(),
                ["property", kind, name] => properties.push((kind.to_owned(), name.to_owned())),
                _ => panic!("unknown line {line:?}"),
            }
        }
        let mut columns: BTreeMap<String, Vec<f64>> = BTreeMap::new();
        let mut rest = &bytes[at + end.len()..];
        for _ in 0..count {
            for (kind, name) in &properties {
                let (value, size) = match kind.as_str() {
                    "float" => (f32::from_le_bytes(rest[..4].try_into().unwrap()).into(), 4),
                    "uchar" => (rest[0].into(), 1),
                    other => panic!("unknown type {other}"),
                };
                columns.entry(name.clone()).or_default().push(value);
                rest = &rest[size..];
            }
        }
        assert!(rest.is_empty(), "{} bytes too many", rest.len());
        Self {
            comments,
            properties,
            count,
            columns,
        }
    }

    pub fn names(&self) -> Vec<&str> {
        self.properties.iter().map(|(_, n)| n.as_str()).collect()
    }

    pub fn get(&self, name: &str, row: usize) -> f64 {
        self.columns[name][row]
    }

    pub fn triple(&self, names: [&str; 3], row: usize) -> DVec3 {
        DVec3::from_array(names.map(|name| self.get(name, row)))
    }

    pub fn position(&self, row: usize) -> DVec3 {
        self.triple(["x", "y", "z"], row)
    }
}

struct Gaussian {
    depth: f64,
    middle: DVec2,
    inverse: DMat2,
    reach: DVec2,
    opacity: f64,
    colour: DVec3,
}

/// The camera where the capture has it.
pub fn in_capture(camera: &Camera, normalisation: &Normalisation) -> Camera {
    let pose: DMat4 = camera.camera_to_world;
    let centre = pose.w_axis.truncate() / normalisation.scale + normalisation.centre;
    Camera {
        camera_to_world: DMat4::from_mat3_translation(DMat3::from_mat4(pose), centre),
        ..*camera
    }
}

/// The file's splats as a camera in the capture's coordinates sees them, `height × width × 3`, on
/// black. Lens distortion is part of the projection.
pub fn rasterise(ply: &Ply, camera: &Camera) -> Vec<f32> {
    let mut gaussians: Vec<Gaussian> = (0..ply.count)
        .filter_map(|row| gaussian(ply, row, camera))
        .collect();
    gaussians.sort_by(|a, b| a.depth.total_cmp(&b.depth));
    let (width, height) = (camera.intrinsics.width, camera.intrinsics.height);
    let mut picture = vec![DVec3::ZERO; (width * height) as usize];
    let mut through = vec![1.0; picture.len()];
    for g in &gaussians {
        let range = |middle: f64, reach: f64, side: u32| {
            let from = (middle - reach).floor().clamp(0.0, f64::from(side)) as u32;
            let to = (middle + reach).ceil().clamp(0.0, f64::from(side)) as u32;
            from..to
        };
        for y in range(g.middle.y, g.reach.y, height) {
            for x in range(g.middle.x, g.reach.x, width) {
                let off = DVec2::new(f64::from(x) + 0.5, f64::from(y) + 0.5) - g.middle;
                let alpha = g.opacity * (-0.5 * off.dot(g.inverse * off)).exp();
                if alpha < 1.0 / 255.0 {
                    continue;
                }
                let alpha = alpha.min(0.99);
                let pixel = (y * width + x) as usize;
                picture[pixel] += through[pixel] * alpha * g.colour;
                through[pixel] *= 1.0 - alpha;
            }
        }
    }
    let channels = picture.iter().flat_map(DVec3::to_array);
    channels.map(|c| c as f32).collect()
}

fn gaussian(ply: &Ply, row: usize, camera: &Camera) -> Option<Gaussian> {
    let position = ply.position(row);
    let (middle, depth) = camera.project(position)?;
    let k = &camera.intrinsics;
    let size = DVec2::new(f64::from(k.width), f64::from(k.height));
    // Well outside nothing shows, and lenses' distortion there is anybody's guess.
    if (middle / size - 0.5).abs().max_element() > 1.0 {
        return None;
    }
    let names = ["rot_0", "rot_1", "rot_2", "rot_3"];
    let [w, x, y, z] = names.map(|name| ply.get(name, row));
    let axes = DMat3::from_quat(DQuat::from_xyzw(x, y, z, w).normalize());
    let scale = ply.triple(["scale_0", "scale_1", "scale_2"], row);
    let sides = DMat3::from_diagonal(scale.map(f64::exp));
    let spread = axes * sides * sides * axes.transpose();
    // The projection's derivatives by the three coordinates.
    let step = 1e-4 * depth;
    let derivative = |axis: DVec3| {
        let ahead = camera.project(position + step * axis)?.0;
        let behind = camera.project(position - step * axis)?.0;
        Some((ahead - behind) / (2.0 * step))
    };
    let by = [
        derivative(DVec3::X)?,
        derivative(DVec3::Y)?,
        derivative(DVec3::Z)?,
    ];
    let row_of = |of: fn(&DVec2) -> f64| DVec3::new(of(&by[0]), of(&by[1]), of(&by[2]));
    let (across, down) = (row_of(|d| d.x), row_of(|d| d.y));
    let xx = across.dot(spread * across) + 0.3;
    let xy = across.dot(spread * down);
    let yy = down.dot(spread * down) + 0.3;
    let harmonics = ply.triple(["f_dc_0", "f_dc_1", "f_dc_2"], row);
    let opacity = 1.0 / (1.0 + (-ply.get("opacity", row)).exp());
    let reach = 4.0 * DVec2::new(xx.sqrt(), yy.sqrt());
    Some(Gaussian {
        depth,
        middle,
        inverse: DMat2::from_cols_array(&[xx, xy, xy, yy]).inverse(),
        reach,
        opacity,
        colour: (harmonics * 0.282_094_791_773_878_14 + 0.5).max(DVec3::ZERO),
    })
}

/// Of two pictures with channels in `[0, 1]`, in dB.
pub fn psnr(a: &[f32], b: &[f32]) -> f64 {
    assert_eq!(a.len(), b.len());
    let squares = a.iter().zip(b).map(|(a, b)| f64::from(a - b).powi(2));
    -10.0 * (squares.sum::<f64>() / a.len() as f64).log10()
}

/// A picture for people.
pub fn save(pixels: &[f32], width: u32, height: u32, path: &Path) {
    let bytes = pixels.iter().map(|p| (p.clamp(0.0, 1.0) * 255.0) as u8);
    let image = image::RgbImage::from_raw(width, height, bytes.collect());
    image.unwrap().save(path).unwrap();
}
