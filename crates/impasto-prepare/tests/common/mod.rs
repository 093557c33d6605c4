//! Photos, and a program that stands in for COLMAP.
#![allow(dead_code, reason = "each test file uses its own part")]
#![allow(clippy::unwrap_used, reason = "a failure here is a failed test")]

use std::fs;
use std::os::unix::fs::symlink;
use std::path::{Path, PathBuf};

use image::{Rgb, RgbImage};
use tempfile::TempDir;

/// Width and height of the photos.
pub const SIZE: (u32, u32) = (64, 48);
/// How far every feature lies from where the camera puts its point, in pixels.
pub const ERROR: f64 = 0.5;

const OPTIONS: &str = "COLMAP 3.8 (Commit Unknown on Unknown without CUDA)\n
  -h [ --help ]
  --SiftExtraction.num_threads arg (=-1)
  --SiftExtraction.use_gpu arg (=1)
  --SiftMatching.use_gpu arg (=1)
  --ExhaustiveMatching.block_size arg (=50)
";

/// A photo unlike those of other numbers.
pub fn photo(number: usize, (width, height): (u32, u32)) -> RgbImage {
    RgbImage::from_fn(width, height, |x, y| {
        Rgb([(x * 4) as u8, (y * 5) as u8, (number * 40) as u8])
    })
}

/// A folder for a test: `photos/`, and `colmap`, which behaves as the folder says.
pub struct Place {
    pub folder: TempDir,
}

impl Place {
    /// With photos of these names, and a program that places all of them.
    pub fn new(fixtures: &Path, names: &[&str]) -> Self {
        let place = Self {
            folder: tempfile::tempdir().unwrap(),
        };
        for (number, name) in names.iter().enumerate() {
            let path = place.path("photos").join(name);
            fs::create_dir_all(path.parent().unwrap()).unwrap();
            photo(number, SIZE).save(path).unwrap();
        }
        symlink(fixtures.join("colmap"), place.path("colmap")).unwrap();
        place.write("options", OPTIONS);
        place.model(0, names);
        place
    }

    /// A path in the folder.
    pub fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    /// Writes a file.
    pub fn write(&self, name: &str, text: &str) {
        fs::write(self.path(name), text).unwrap();
    }

    /// Every command line of the program so far, without the questions for options.
    pub fn calls(&self) -> Vec<String> {
        let text = fs::read_to_string(self.path("calls")).unwrap_or_default();
        let calls = text.lines().filter(|line| !line.ends_with(" -h"));
        calls.map(str::to_owned).collect()
    }

    /// What is in the folder of the capture, sorted.
    pub fn scene(&self) -> Vec<String> {
        let Ok(entries) = fs::read_dir(self.path("scene")) else {
            return Vec::new();
        };
        let name = |entry: fs::DirEntry| entry.file_name().to_string_lossy().into_owned();
        let mut names: Vec<String> = entries.map(|entry| name(entry.unwrap())).collect();
        names.sort();
        names
    }

    /// A model that the mapper will make: cameras in a row that look at one point.
    pub fn model(&self, number: usize, names: &[&str]) {
        let folder = self.path("models").join(number.to_string());
        fs::create_dir_all(&folder).unwrap();
        let (width, height) = SIZE;
        let (focal, cx, cy) = (50.0, f64::from(width) / 2.0, f64::from(height) / 2.0);
        let mut cameras = 1u64.to_le_bytes().to_vec();
        cameras.extend(1u32.to_le_bytes());
        // SIMPLE_RADIAL
        cameras.extend(2u32.to_le_bytes());
        cameras.extend(u64::from(width).to_le_bytes());
        cameras.extend(u64::from(height).to_le_bytes());
        cameras.extend(
            [focal, cx, cy, 0.0]
                .iter()
                .flat_map(|x: &f64| x.to_le_bytes()),
        );

        let mut images = (names.len() as u64).to_le_bytes().to_vec();
        let mut points = 1u64.to_le_bytes().to_vec();
        points.extend(1u64.to_le_bytes());
        points.extend([0.0, 0.0, 5.0].iter().flat_map(|x: &f64| x.to_le_bytes()));
        points.extend([200, 100, 50]);
        points.extend(ERROR.to_le_bytes());
        points.extend((names.len() as u64).to_le_bytes());
        for (index, name) in names.iter().enumerate() {
            let id = index as u32 + 1;
            let left = -0.3 * index as f64;
            images.extend(id.to_le_bytes());
            let pose = [1.0, 0.0, 0.0, 0.0, left, 0.0, 0.0];
            images.extend(pose.iter().flat_map(|x: &f64| x.to_le_bytes()));
            images.extend(1u32.to_le_bytes());
            images.extend(name.as_bytes());
            images.push(0);
            images.extend(1u64.to_le_bytes());
            images.extend((cx + focal * left / 5.0 + ERROR).to_le_bytes());
            images.extend(cy.to_le_bytes());
            images.extend(1u64.to_le_bytes());
            points.extend(id.to_le_bytes());
            points.extend(0u32.to_le_bytes());
        }
        for (name, bytes) in [
            ("cameras", cameras),
            ("images", images),
            ("points3D", points),
        ] {
            fs::write(folder.join(format!("{name}.bin")), bytes).unwrap();
        }
    }
}
