//! The G-buffer: all that `app` sees of rays and that no style changes. Below it something knows
//! geometry and fills it; above it paint is shaded, any number of times.

use crate::appearance::{Appearance, Ground, StrokeSettings};
use crate::config::{AppearanceConfig, DETAIL_BANDS};
use crate::distilled::{DistilledFeatures, Surroundings};
use crate::encoding::{frequencies, host, matrix};
use crate::rays::RayBatch;
use crate::volrend::accumulate::MergedRays;
use burn::tensor::{Device, Tensor};
use impasto_kernels::{CompositeLayout, RaySpan, ops};
use std::sync::Arc;

/// Samples of rays, or what they were accumulated to, with everything that `app` of one
/// configuration needs of them.
#[derive(Debug, Clone)]
pub struct GBuffer {
    pub(crate) layout: Arc<CompositeLayout>,
    /// Inner and outer volume, absent when no ray has a sample there.
    pub(crate) volumes: [Option<VolumeBuffer>; 2],
    pub(crate) density: Tensor<1>,
}

/// One volume's part: what `app` sees of its samples.
#[derive(Debug, Clone)]
#[allow(
    clippy::large_enum_variant,
    reason = "there are two in a buffer of thousands of rows"
)]
pub(crate) enum VolumeBuffer {
    /// Of every sample.
    Samples {
        /// `[n, width]`.
        features: Tensor<2>,
        /// Encoded view directions, where `app` sees them.
        views: Option<Tensor<2>>,
    },
    /// Of samples that were accumulated to one a ray.
    Painted(PaintedBuffer),
}

/// What the painter sees of samples.
#[derive(Debug, Clone)]
pub(crate) struct PaintedBuffer {
    /// Unstylised colours, `[n, 3]`.
    colours: Tensor<2>,
    /// Distilled features, `[n, DistilledFeatures::LEN]`.
    features: Tensor<2>,
    /// Normals in contracted space, `[n, 3]`; zeros where none are known.
    normals: Tensor<2>,
    /// Contracted positions with their footprints, `[n, 4]`.
    places: Tensor<2>,
}

/// Where the light of rays comes from.
#[derive(Debug, Clone, Default)]
pub struct SurfacePoints {
    /// Contracted positions, `n × 3`.
    pub places: Vec<f32>,
    /// Numbers of the rays.
    pub rays: Vec<usize>,
    /// How much of its ray's light comes from each, 0 to 1.
    pub weights: Vec<f32>,
}

/// One volume's accumulated samples, before the painter sees them.
pub(crate) struct MergedSurface<'a> {
    /// Mean features, `[n, width]`.
    pub(crate) features: Tensor<2>,
    /// Mean points, `[n, 3]`, in the unit cube.
    pub(crate) points: Tensor<2>,
    /// Standard deviation, `[n]`, of the points in the unit cube that light comes from.
    pub(crate) stretch: Tensor<1>,
    /// Whose they are: numbers of rays, of each sample.
    pub(crate) rays: &'a [usize],
    /// Whether this is the outer volume.
    pub(crate) outer: bool,
}

/// How much of the stretch of a ray that light comes from counts as footprint: in a haze, what is finer
/// would be something else for every view.
const HAZE: f32 = 0.1;

impl MergedSurface<'_> {
    /// The unstylised colours.
    fn colours(&self, photo: &Appearance, views: &[f32]) -> Tensor<2> {
        let device = self.points.device();
        let views = encoded_views(views, self.rays.iter().copied(), &photo.config, &device);
        let weights = match self.outer {
            true => &photo.outer,
            false => &photo.inner,
        };
        let network = photo.config.network(self.features.dims()[1]);
        let weights = network.folded(weights, photo.latent.as_ref());
        let inputs = [self.features.clone()].into_iter().chain(views).collect();
        network.forward(inputs, weights, None)
    }

    /// Contracted positions, of one scale in both volumes: the unit ball has half the radius of all space,
    /// 1. With each the footprint of a brush's finest touch there.
    fn places(&self, batch: &RayBatch) -> Tensor<2> {
        let device = self.points.device();
        let origins = self.rays.iter().flat_map(|ray| batch.origins[*ray]);
        let origins = matrix(origins.collect(), 3, &device);
        let touches = self.rays.iter().map(|ray| batch.touches[*ray]);
        let touches = matrix(touches.collect(), 1, &device);
        let length = |rows: Tensor<2>| rows.square().sum_dim(1).sqrt();
        // The inner cube is one unit wide, the outer one two.
        let scale = if self.outer { 2.0 } else { 1.0 };
        let places = (self.points.clone() - 0.5) * scale;
        let distance = if self.outer {
            let radius = length(places.clone()).clamp(0.5, 1.0);
            let inverse = (-radius.clone() + 1.0) * 2.0;
            let direction = places.clone() / radius.clone();
            length(direction - origins * inverse) * radius
        } else {
            length(places.clone() - origins * 0.5)
        };
        let stretch = self.stretch.clone().unsqueeze_dim::<2>(1) * (scale * HAZE);
        let footprint = ((distance * touches).square() + stretch.square()).sqrt();
        Tensor::cat(vec![places, footprint], 1)
    }

    /// What the painter sees of them; `views` are unit directions of the rays, `rays × 3`.
    pub(crate) fn painted(&self, ground: &Ground, batch: &RayBatch, views: &[f32]) -> VolumeBuffer {
        let places = self.places(batch);
        let [count, _] = places.dims();
        let zeros = |width| Tensor::zeros([count, width], &places.device());
        let Surroundings { features, normals } = match &ground.features {
            Some(known) => known.around(places.clone()),
            None => Surroundings {
                features: zeros(DistilledFeatures::LEN),
                normals: zeros(3),
            },
        };
        VolumeBuffer::Painted(PaintedBuffer {
            colours: self.colours(&ground.photo, views),
            features,
            normals,
            places,
        })
    }
}

/// Encoded directions of the rays that samples belong to, `[n, …]`, where `app` sees them.
fn encoded_views<'a>(
    views: &[f32],
    rays: impl Iterator<Item = usize> + 'a,
    config: &AppearanceConfig,
    device: &Device,
) -> Option<Tensor<2>> {
    let bands = config.app.view_bands?;
    let width = 3 * (1 + 2 * bands);
    let encoded = frequencies(views, 3, bands);
    let rows = rays.flat_map(|ray| &encoded[ray * width..(ray + 1) * width]);
    Some(matrix(rows.copied().collect(), width, device))
}

impl PaintedBuffer {
    /// Places whose footprints are those of larger or smaller touches.
    fn places_for(&self, strokes: StrokeSettings) -> Tensor<2> {
        if strokes.size == 1.0 {
            return self.places.clone();
        }
        let part = |range| self.places.clone().slice_dim(1, range);
        Tensor::cat(vec![part(0..3), part(3..4) * strokes.size], 1)
    }

    /// Colours: the unstylised ones as the painting's, with as much of its detail and what else W^app says.
    fn shade(&self, look: &Appearance, app: &Tensor<1>) -> Tensor<2> {
        let Some(paint) = &look.paint else {
            unreachable!("an appearance of this configuration has paint");
        };
        let ground = paint.palette.whiten(self.colours.clone());
        let places = self.places_for(paint.strokes);
        let detail = ops::exemplar(places, self.normals.clone(), paint.exemplar.clone());
        let network = look.config.network(3);
        let inputs = vec![ground.clone(), self.features.clone(), detail.clone()];
        let said = network.forward(inputs, network.folded(app, look.latent.as_ref()), None);
        let mut strokes = said.clone().slice_dim(1, 0..3);
        for band in 0..DETAIL_BANDS {
            let share = said.clone().slice_dim(1, 3 + band..4 + band) + 1.0;
            strokes = strokes + detail.clone().slice_dim(1, 3 * band..3 * band + 3) * share;
        }
        paint
            .palette
            .colour(ground + strokes * paint.strokes.strength)
    }

    fn parts(self) -> [Tensor<2>; 4] {
        [self.colours, self.features, self.normals, self.places]
    }

    fn of([colours, features, normals, places]: [Tensor<2>; 4]) -> Self {
        Self {
            colours,
            features,
            normals,
            places,
        }
    }
}

impl VolumeBuffer {
    fn parts(&self) -> Vec<&Tensor<2>> {
        match self {
            Self::Samples { features, views } => [features].into_iter().chain(views).collect(),
            Self::Painted(own) => vec![&own.colours, &own.features, &own.normals, &own.places],
        }
    }

    fn samples(&self) -> usize {
        self.parts().first().map_or(0, |rows| rows.dims()[0])
    }

    fn numbers(&self) -> usize {
        let parts = self.parts().into_iter();
        parts
            .map(|rows| rows.dims().iter().product::<usize>())
            .sum()
    }

    fn map(self, f: &impl Fn(Tensor<2>) -> Tensor<2>) -> Self {
        match self {
            Self::Samples { features, views } => Self::Samples {
                features: f(features),
                views: views.map(f),
            },
            Self::Painted(own) => Self::Painted(PaintedBuffer::of(own.parts().map(f))),
        }
    }

    /// This with those of the same configuration after it.
    fn joined(self, rest: Vec<Self>) -> Self {
        let (mut features, mut views) = (Vec::new(), Vec::new());
        let mut painted: [Vec<Tensor<2>>; 4] = Default::default();
        let all = [self].into_iter().chain(rest);
        for part in all {
            match part {
                Self::Samples {
                    features: own,
                    views: seen,
                } => {
                    features.push(own);
                    views.extend(seen);
                }
                Self::Painted(own) => {
                    let parts = painted.iter_mut().zip(own.parts());
                    parts.for_each(|(all, own)| all.push(own));
                }
            }
        }
        let cat = |all: Vec<Tensor<2>>| Tensor::cat(all, 0);
        match features.is_empty() {
            true => Self::Painted(PaintedBuffer::of(painted.map(cat))),
            false => Self::Samples {
                features: cat(features),
                views: (!views.is_empty()).then(|| cat(views)),
            },
        }
    }

    /// Those of one configuration, one after the other.
    fn join(mut parts: Vec<Self>) -> Option<Self> {
        let rest = parts.split_off(1.min(parts.len()));
        Some(parts.pop()?.joined(rest))
    }

    /// Colour of every sample; `app` is the volume's W^app.
    fn colours(&self, look: &Appearance, app: &Tensor<1>, known: Option<Tensor<2>>) -> Tensor<2> {
        let (features, views) = match self {
            Self::Samples { features, views } => (features, views),
            // Computed again where it is known: a few numbers a sample.
            Self::Painted(own) => return own.shade(look, app),
        };
        let inputs = [features].into_iter().chain(views).cloned().collect();
        let network = look.config.network(features.dims()[1]);
        network.forward(inputs, network.folded(app, look.latent.as_ref()), known)
    }
}

impl GBuffer {
    /// Of samples that are all shaded: features of each volume, `[n, width]`, densities, `[n]`, and
    /// unit directions of the rays, `rays × 3`.
    pub(crate) fn of_samples(
        layout: Arc<CompositeLayout>,
        features: [Option<Tensor<2>>; 2],
        density: Tensor<1>,
        views: &[f32],
        config: &AppearanceConfig,
    ) -> Self {
        let device = density.device();
        let mut volume = 0;
        let volumes = features.map(|features| {
            let outer = volume == 1;
            volume += 1;
            let rays = layout.rays.iter().enumerate().flat_map(move |(ray, span)| {
                let own = if outer { &span.outer } else { &span.inner };
                std::iter::repeat_n(ray, own.len())
            });
            Some(VolumeBuffer::Samples {
                features: features?,
                views: encoded_views(views, rays, config, &device),
            })
        });
        Self {
            layout,
            volumes,
            density,
        }
    }

    /// Of rays that were accumulated to one sample a volume.
    pub(crate) fn of_merged(
        merged: MergedRays,
        ground: &Ground,
        rays: &RayBatch,
        device: &Device,
    ) -> Self {
        let views = rays.views();
        let mut outer = false;
        let volumes = merged.volumes.map(|own| {
            let width = own.features.len().checked_div(own.rays.len());
            let surface = width.map(|width| MergedSurface {
                features: matrix(own.features, width, device),
                points: matrix(own.cube, 3, device),
                stretch: Tensor::from_data(own.footprint.as_slice(), device),
                rays: &own.rays,
                outer,
            });
            outer = true;
            surface.map(|surface| surface.painted(ground, rays, &views))
        });
        Self {
            layout: Arc::new(merged.layout),
            volumes,
            density: Tensor::from_data(merged.density.as_slice(), device),
        }
    }

    /// Those of one batch of rays after the other as one. `None` of none.
    pub(crate) fn join(mut parts: Vec<Self>) -> Option<Self> {
        if parts.len() < 2 {
            return parts.pop();
        }
        let split = |part: &Self| part.layout.rays.iter().map(|span| span.inner.len()).sum();
        let splits: Vec<usize> = parts.iter().map(split).collect();
        let mut at = [0, splits.iter().sum()];
        let mut layout = CompositeLayout::default();
        let mut halves: [[Vec<f32>; 3]; 2] = Default::default();
        let mut density = [const { Vec::new() }; 2];
        for (part, split) in parts.iter().zip(&splits) {
            let own = &part.layout;
            let steps = [&own.deltas, &own.depths, &own.distances];
            let [length] = part.density.dims();
            for (volume, rows) in [0..*split, *split..length].into_iter().enumerate() {
                let all = halves[volume].iter_mut().zip(steps);
                all.for_each(|(all, own)| all.extend(&own[rows.clone()]));
                if !rows.is_empty() {
                    density[volume].push(part.density.clone().slice_dim(0, rows));
                }
            }
            let from = [0, *split];
            let moved = |range: &std::ops::Range<usize>, v: usize| {
                range.start - from[v] + at[v]..range.end - from[v] + at[v]
            };
            layout.rays.extend(own.rays.iter().map(|span| RaySpan {
                inner: moved(&span.inner, 0),
                outer: moved(&span.outer, 1),
            }));
            at = [at[0] + split, at[1] + length - split];
        }
        let [inner, outer] = halves;
        let mut steps = inner
            .into_iter()
            .zip(outer)
            .map(|(inner, outer)| [inner, outer].concat());
        let mut next = || steps.next().unwrap_or_default();
        (layout.deltas, layout.depths, layout.distances) = (next(), next(), next());
        let mut volumes: [Vec<VolumeBuffer>; 2] = Default::default();
        for part in parts {
            let own = volumes.iter_mut().zip(part.volumes);
            own.for_each(|(all, own)| all.extend(own));
        }
        Some(Self {
            layout: Arc::new(layout),
            volumes: volumes.map(VolumeBuffer::join),
            density: Tensor::cat(density.concat(), 0),
        })
    }

    /// Where the light comes from, of rays that were accumulated; nothing of others.
    pub fn surface_points(&self) -> SurfacePoints {
        let mut points = SurfacePoints::default();
        let mut places = Vec::new();
        for volume in self.volumes.iter().flatten() {
            if let VolumeBuffer::Painted(own) = volume {
                places.extend(host(own.places.clone().slice_dim(1, 0..3)));
            }
        }
        if places.is_empty() {
            return points;
        }
        let density = host(self.density.clone());
        for (ray, span) in self.layout.rays.iter().enumerate() {
            let mut light = 1.0;
            for sample in span.inner.clone().chain(span.outer.clone()) {
                let passes = (-density[sample] * self.layout.deltas[sample]).exp();
                points.weights.push(light * (1.0 - passes));
                points.places.extend(&places[3 * sample..][..3]);
                points.rays.push(ray);
                light *= passes;
            }
        }
        points
    }

    /// Number of samples, accumulated ones where it was made for surfaces.
    pub fn samples(&self) -> usize {
        self.layout.depths.len()
    }

    /// Number of rays.
    pub fn rays(&self) -> usize {
        self.layout.rays.len()
    }

    /// About how much memory it takes, bytes.
    pub fn bytes(&self) -> usize {
        let volumes = self.volumes.iter().flatten().map(VolumeBuffer::numbers);
        // Of each ray two ranges; of each sample a density and a length, two depths.
        let layout = 4 * self.layout.depths.len() + 8 * self.rays();
        (volumes.sum::<usize>() + layout) * size_of::<f32>()
    }

    /// The same as constants of an autodiff graph, for training `app` on frozen geometry.
    #[must_use]
    pub fn lifted(self) -> Self {
        Self {
            volumes: self
                .volumes
                .map(|volume| volume.map(|volume| volume.map(&Tensor::from_inner))),
            density: Tensor::from_inner(self.density),
            layout: self.layout,
        }
    }

    /// Shades and composites: deferred shading, where there is one sample a volume.
    ///
    /// # Shapes
    /// Result: `[rays, 6]` as of [`ops::composite`]. The appearance must be of the configuration
    /// that the buffer was made for.
    pub fn shade(&self, appearance: &Appearance) -> Tensor<2> {
        self.composite(self.colours(appearance, None))
    }

    /// Colour of every sample, or `known` ones, of another graph, with the gradients that
    /// computing them would have.
    ///
    /// # Shapes
    /// Result and `known`: `[samples, 3]`, inner ones first.
    pub fn colours(&self, appearance: &Appearance, known: Option<&Tensor<2>>) -> Tensor<2> {
        let mut start = 0;
        let weights = [&appearance.inner, &appearance.outer];
        let mut colours = Vec::new();
        for (volume, app) in self.volumes.iter().zip(weights) {
            let Some(volume) = volume else { continue };
            let range = start..start + volume.samples();
            start = range.end;
            let known = known.map(|colours| colours.clone().slice_dim(0, range));
            colours.push(volume.colours(appearance, app, known));
        }
        match colours.len() {
            1 => colours.remove(0),
            _ => Tensor::cat(colours, 0),
        }
    }

    /// Composites samples of given colours, `[samples, 3]`; result as of [`Self::shade`].
    pub fn composite(&self, colours: Tensor<2>) -> Tensor<2> {
        ops::composite(self.density.clone(), colours, Arc::clone(&self.layout))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sphere::{inner_cube, outer_cube};

    /// Place and footprint of a point in the cube of its volume, seen from near the origin.
    fn place(cube: [f32; 3], outer: bool, stretch: f32) -> Vec<f32> {
        let mut batch = RayBatch::default();
        batch.push_painted([0.1, 0.0, 0.0], [0.0, 0.0, 1.0], 0.01);
        let device = Device::flex();
        let surface = MergedSurface {
            features: Tensor::zeros([1, 1], &device),
            points: matrix(cube.to_vec(), 3, &device),
            stretch: Tensor::from_floats([stretch], &device),
            rays: &[0],
            outer,
        };
        host(surface.places(&batch))
    }

    #[test]
    fn paint_does_not_change_where_one_volume_ends() {
        let direction = [0.6, 0.0, 0.8f32];
        let inside = place(inner_cube(direction.map(|c| 0.9999 * c)), false, 0.0);
        let [x, y, z] = direction;
        let outside = place(outer_cube([x, y, z, 0.9999]), true, 0.0);
        for (a, b) in inside.iter().zip(&outside) {
            assert!((a - b).abs() < 1e-3, "{inside:?} {outside:?}");
        }
        // Half the scene's unit, 0.943 away.
        assert!((inside[3] - 0.5 * 0.01 * 0.943).abs() < 1e-4, "{inside:?}");
    }

    #[test]
    fn footprints_stay_finite_at_infinity_and_grow_in_haze() {
        let far = place(outer_cube([0.0, 0.0, 1.0, 0.0]), true, 0.0);
        assert_eq!(far, [0.0, 0.0, 1.0, 0.01]);
        let hazy = place(outer_cube([0.0, 0.0, 1.0, 0.0]), true, 0.5);
        assert!((hazy[3] - (0.01f32.powi(2) + 0.1f32.powi(2)).sqrt()).abs() < 1e-6);
    }
}
