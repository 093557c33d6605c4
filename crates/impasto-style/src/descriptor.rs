//! What is around a pixel: features of VGG-16 at relu2_1 and relu3_1 along the few directions that they
//! vary most along in photos.

use crate::perceptual::{check_size, vgg16_stack};
use crate::{StyleError, TensorFile};
use impasto_kernels::{FeatureMap, PerceptualStack};

/// Directions, made by `impasto-eval`'s `examples/descriptor_directions.rs`.
static DIRECTIONS: &[u8] =
    include_bytes!("../../../assets/vgg16_descriptor_directions_f16.safetensors");
const FILE: &str = "vgg16_descriptor_directions_f16.safetensors";

/// Layers, their channels, and how many directions of each are kept.
pub const DESCRIPTOR_LAYERS: [(&str, usize, usize); 2] =
    [("conv2_1", 128, 8), ("conv3_1", 256, 12)];
/// Features count no more than this, of which the mean over pictures is 1.
pub const GREATEST_FEATURE: f32 = 8.0;

/// Computes descriptors of pictures.
#[derive(Debug, Clone)]
pub struct Descriptor {
    stack: PerceptualStack,
    layers: [Directions; 2],
}

/// Of one layer: what is taken off features, and rows that what is left is projected on, so that what
/// comes out has deviation 1 over photos.
#[derive(Debug, Clone)]
struct Directions {
    mean: Vec<f32>,
    rows: Vec<f32>,
}

impl Descriptor {
    /// Numbers of a pixel.
    pub const LEN: usize = DESCRIPTOR_LAYERS[0].2 + DESCRIPTOR_LAYERS[1].2;

    /// The shipped one.
    ///
    /// # Errors
    /// If an asset is damaged.
    pub fn shipped() -> Result<Self, StyleError> {
        let file = TensorFile::open(FILE, DIRECTIONS)?;
        let layer = |(name, channels, kept): (&str, usize, usize)| {
            Ok::<_, StyleError>(Directions {
                mean: file.floats_of(&format!("{name}.mean"), channels)?,
                rows: file.floats_of(&format!("{name}.rows"), channels * kept)?,
            })
        };
        let [second, third] = DESCRIPTOR_LAYERS.map(layer);
        Ok(Self {
            // Up to relu3_1.
            stack: vgg16_stack(5)?,
            layers: [second?, third?],
        })
    }

    /// Descriptors of the pixels of a picture, `height × width × 3` in `[0, 1]`: `height · width ×`
    /// [`Self::LEN`], those of coarser layers interpolated.
    ///
    /// # Errors
    /// If a side has fewer than 4 pixels.
    pub fn of(&self, image: &[f32], height: usize, width: usize) -> Result<Vec<f32>, StyleError> {
        check_size(&self.stack, height, width)?;
        let (_, trace) = self.stack.forward(image, height, width);
        let maps = trace.features().skip(1).zip(&self.layers);
        let maps: Vec<FeatureMap> = maps.map(|(map, layer)| layer.projected(&map)).collect();
        let mut all = vec![0.0; height * width * Self::LEN];
        let rows = all.chunks_mut(width * Self::LEN).enumerate();
        rows.for_each(|(y, row)| {
            for (x, pixel) in row.chunks_exact_mut(Self::LEN).enumerate() {
                let mut rest = pixel;
                for map in &maps {
                    let (own, others) = rest.split_at_mut(map.channels);
                    let at = |i: usize, size: usize, own: usize| {
                        (i as f32 + 0.5) * own as f32 / size as f32 - 0.5
                    };
                    interpolate(map, at(y, height, map.height), at(x, width, map.width), own);
                    rest = others;
                }
            }
        });
        Ok(all)
    }
}

impl Directions {
    fn projected(&self, map: &FeatureMap) -> FeatureMap {
        let channels = self.rows.len() / self.mean.len();
        let pixels = map.data.chunks_exact(map.channels);
        let data = pixels.flat_map(|pixel| {
            let rows = self.rows.chunks_exact(self.mean.len());
            rows.map(|row| {
                let off = pixel.iter().zip(&self.mean).zip(row);
                off.map(|((x, mean), r)| (x.min(GREATEST_FEATURE) - mean) * r)
                    .sum::<f32>()
            })
        });
        FeatureMap {
            data: data.collect(),
            channels,
            ..*map
        }
    }
}

/// A map between its pixels, of which the outermost go on.
fn interpolate(map: &FeatureMap, y: f32, x: f32, out: &mut [f32]) {
    let place = |at: f32, size: usize| {
        let at = at.clamp(0.0, (size - 1) as f32);
        let low = at as usize;
        [
            (low, 1.0 - at.fract()),
            ((low + 1).min(size - 1), at.fract()),
        ]
    };
    let columns = place(x, map.width);
    for (row, down) in place(y, map.height) {
        for (column, across) in columns {
            let pixel = &map.data[(row * map.width + column) * map.channels..];
            let pixels = out.iter_mut().zip(pixel);
            pixels.for_each(|(o, p)| *o += down * across * p);
        }
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, reason = "a test may panic")]

    use super::*;

    #[test]
    fn even_places_are_alike_and_edges_are_not() {
        let (height, width) = (40, 48);
        // Dark on the left, bright on the right.
        let image: Vec<f32> = (0..height * width)
            .flat_map(|i| [if i % width < 24 { 0.2 } else { 0.8 }; 3])
            .collect();
        let all = Descriptor::shipped()
            .unwrap()
            .of(&image, height, width)
            .unwrap();
        let at = |y: usize, x: usize| &all[(y * width + x) * Descriptor::LEN..][..Descriptor::LEN];
        let apart = |a: &[f32], b: &[f32]| {
            let squares = a.iter().zip(b).map(|(a, b)| (a - b).powi(2));
            squares.sum::<f32>().sqrt()
        };
        let along = apart(at(16, 24), at(24, 24));
        let across = apart(at(20, 12), at(20, 24));
        assert!(
            along < 0.2 * across,
            "{along} along the edge, {across} across"
        );
        assert!(apart(at(16, 12), at(24, 12)) < 0.2 * across);
        assert!(all.iter().all(|x| x.is_finite()));
    }

    #[test]
    fn pictures_too_small_are_refused() {
        let descriptor = Descriptor::shipped().unwrap();
        assert!(descriptor.of(&[0.5; 4 * 3 * 3], 4, 3).is_err());
        assert!(descriptor.of(&[0.5; 4 * 4 * 3], 4, 4).is_ok());
    }
}
