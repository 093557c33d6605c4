//! The one ray renderer: samples → features and density → colours → pixels.

use crate::appearance::{Appearance, AppearanceConfig, Shading};
use crate::field::{Field, FieldWeights, Grids};
use crate::host::HostWeights;
use crate::paintable::Paintable;
use crate::sampling::{March, RayBatch, Samples, cascade, march};
use burn::tensor::{Device, Tensor};
use impasto_kernels::CompositeLayout;
use impasto_kernels::cpu::composite;
use impasto_kernels::device::is_cpu;
use rayon::prelude::*;
use std::borrow::Cow;

/// What a failure of [`host`] begins with.
pub const LOST: &str = "numbers cannot be read back";

/// The numbers of a tensor, in row-major order.
///
/// # Panics
/// If its device is lost or has no memory left: nothing that was computed there can be trusted.
pub fn host<const D: usize>(tensor: Tensor<D>) -> Vec<f32> {
    // Every tensor of this program is f32, so that a conversion never fails for its type.
    tensor
        .try_into_vec_as::<f32>()
        .unwrap_or_else(|error| panic!("{LOST}: {error}"))
}

/// Everything about a batch of rays that does not depend on the style.
#[derive(Debug, Clone)]
pub struct Geometry {
    pub(crate) samples: Samples,
    /// Features of each volume, absent when no ray has a sample there.
    pub(crate) inner: Option<Tensor<2>>,
    pub(crate) outer: Option<Tensor<2>>,
    pub(crate) density: Tensor<1>,
}

impl Geometry {
    /// Number of samples.
    pub fn samples(&self) -> usize {
        self.samples.len()
    }

    /// The fixed part of the composite.
    pub fn layout(&self) -> &CompositeLayout {
        &self.samples.layout
    }

    /// Density of each sample.
    pub fn densities(&self) -> Tensor<1> {
        self.density.clone()
    }

    /// Contribution of each sample to its ray.
    pub fn weights(&self) -> Vec<f32> {
        composite::weights(&self.samples.layout, &host(self.density.clone()))
    }
}

/// Depth along the camera's axis at which half of a ray's light has been gathered, of every ray.
pub(crate) fn median_depth(layout: &CompositeLayout, weights: &[f32]) -> Vec<f32> {
    let rays = layout.rays.iter().map(|span| {
        let mut sum = 0.0;
        let mut all = span.inner.clone().chain(span.outer.clone());
        let crossing = all.find(|i| {
            sum += weights[*i];
            sum >= 0.5
        });
        crossing.map_or(f32::INFINITY, |i| layout.depths[i])
    });
    rays.collect()
}

/// Which samples [`Geometry::contributing`] keeps, given their contributions.
pub(crate) fn worth_shading(layout: &CompositeLayout, weights: &[f32], least: f32) -> Vec<bool> {
    let mut keep: Vec<bool> = weights.iter().map(|w| *w >= least).collect();
    for span in &layout.rays {
        let all = || span.inner.clone().chain(span.outer.clone());
        let small = all().map(|i| weights[i]).filter(|w| *w < least);
        if small.sum::<f32>() > MOST_DROPPED {
            all().for_each(|i| keep[i] = weights[i] >= 0.1 * least);
        }
        // What is left of the light belongs to the farthest sample.
        if let Some(last) = all().last() {
            keep[last] = true;
        }
    }
    keep
}

/// Most of a ray's light that leaving out small contributions may move to the background.
const MOST_DROPPED: f32 = 0.02;

impl Field {
    /// Samples of rays: where density grids expect light, or the first ones of a cascade.
    pub fn sample(&self, rays: &RayBatch, grids: &Grids, seed: Option<u64>) -> Samples {
        match &self.config.cascade {
            None => march(rays, &self.config.sampling, grids, seed),
            Some(cascade) => cascade::first(rays, cascade, self.config.sampling.near, seed),
        }
    }

    /// The cascade's second samples, given the densities of its first ones; the same samples where
    /// there is no cascade.
    pub fn refine(
        &self,
        rays: &RayBatch,
        first: Samples,
        densities: &[f32],
        seed: Option<u64>,
    ) -> Samples {
        match &self.config.cascade {
            None => first,
            Some(cascade) => cascade::refined(rays, &first, densities, cascade, seed),
        }
    }

    /// Features and densities of the samples of rays, the first field's word included.
    pub fn look(
        &self,
        weights: &FieldWeights,
        rays: &RayBatch,
        grids: &Grids,
        seed: Option<u64>,
    ) -> Geometry {
        self.look_twice(weights, rays, grids, seed).1
    }

    /// What the first field of a cascade, where there is one, and what the field says of its
    /// samples of rays.
    pub fn look_twice(
        &self,
        weights: &FieldWeights,
        rays: &RayBatch,
        grids: &Grids,
        seed: Option<u64>,
    ) -> (Option<Geometry>, Geometry) {
        let samples = self.sample(rays, grids, seed);
        let Some(coarse) = &weights.coarse else {
            return (None, self.geometry(weights, samples));
        };
        let first = self.geometry(coarse, samples.clone());
        let densities = host(first.density.clone());
        let samples = self.refine(rays, samples, &densities, seed);
        (Some(first), self.geometry(weights, samples))
    }

    /// Features and densities of samples.
    pub fn geometry(&self, weights: &FieldWeights, samples: Samples) -> Geometry {
        let (outer, outer_density) = self
            .outer
            .geometry(&weights.outer, &samples.outer.positions(4));
        let (inner, density) = if samples.inner.is_empty() {
            (None, outer_density)
        } else {
            let (features, density) = self
                .inner
                .geometry(&weights.inner, &samples.inner.positions(3));
            (Some(features), Tensor::cat(vec![density, outer_density], 0))
        };
        Geometry {
            samples,
            inner,
            outer: Some(outer),
            density,
        }
    }
}

impl Geometry {
    /// Geometries of one batch of rays after the other as one.
    fn joined(parts: Vec<Self>) -> Self {
        let splits: Vec<[usize; 2]> = parts
            .iter()
            .map(|part| [part.samples.inner.len(), part.samples.outer.len()])
            .collect();
        let densities: Vec<Vec<f32>> = parts.iter().map(|p| host(p.density.clone())).collect();
        let density: Vec<f32> = [0, 1]
            .into_iter()
            .flat_map(|volume| {
                densities.iter().zip(&splits).flat_map(move |(d, split)| {
                    let (inner, outer) = d.split_at(split[0]);
                    if volume == 0 { inner } else { outer }
                })
            })
            .copied()
            .collect();
        let device = parts
            .first()
            .map(|p| p.density.device())
            .unwrap_or_default();
        let (mut inner, mut outer, mut samples) = (Vec::new(), Vec::new(), Vec::new());
        for part in parts {
            inner.extend(part.inner);
            outer.extend(part.outer);
            samples.push(part.samples);
        }
        let joined = |all: Vec<Tensor<2>>| (!all.is_empty()).then(|| Tensor::cat(all, 0));
        let samples = Samples::joined(samples);
        Self {
            samples,
            inner: joined(inner),
            outer: joined(outer),
            density: Tensor::from_data(density.as_slice(), &device),
        }
    }

    /// Only the samples that contribute at least `least` of a ray's light, and the farthest of
    /// each ray. Of a ray whose smaller samples add up to more than 2 % of the light, as haze
    /// does, all those that contribute a tenth of `least` are kept. No gradients.
    pub fn contributing(&self, least: f32) -> Self {
        self.kept(&self.weights(), least)
    }

    fn kept(&self, weights: &[f32], least: f32) -> Self {
        let keep = worth_shading(&self.samples.layout, weights, least);
        if !keep.contains(&false) {
            return self.clone();
        }
        let samples = self.samples.pruned(&keep);
        let split = self.samples.inner.len();
        let device = self.density.device();
        let kept_of = |features: &Option<Tensor<2>>, keep: &[bool]| {
            let features = features.as_ref().filter(|_| keep.contains(&true))?;
            let kept = (0i32..).zip(keep).filter(|(_, keep)| **keep);
            let kept: Vec<i32> = kept.map(|(row, _)| row).collect();
            let kept = Tensor::from_data(kept.as_slice(), &device);
            Some(features.clone().select(0, kept))
        };
        let densities = host(self.density.clone());
        let kept = densities.iter().zip(&keep).filter(|(_, k)| **k);
        let density: Vec<f32> = kept.map(|(d, _)| *d).collect();
        Self {
            inner: kept_of(&self.inner, &keep[..split]),
            outer: kept_of(&self.outer, &keep[split..]),
            density: Tensor::from_data(density.as_slice(), &device),
            samples,
        }
    }

    /// What an appearance of this configuration is shaded on.
    pub fn prepared(self, config: &AppearanceConfig) -> Self {
        match config.shading {
            Shading::Samples => self,
            Shading::Surface => {
                let weights = self.weights();
                self.merged(&weights)
            }
        }
    }

    /// All that an appearance of this configuration looks at. The geometry must be
    /// [`Self::prepared`] for it.
    pub fn paintable(self, config: &AppearanceConfig) -> Paintable {
        Paintable::new(self, config)
    }
}

/// What rendering rays yields on the host.
#[derive(Debug, Clone)]
pub struct RenderedRays {
    /// Per appearance, `rays × 3` colours in `[0, 1]`.
    pub colours: Vec<Vec<f32>>,
    /// Median depth per ray, along the camera's axis, scene units.
    pub depth: Vec<f32>,
}

/// Samples with less weight than this are not shaded when rendering.
pub(crate) const SHADE_LEAST: f32 = 1e-3;
/// Rays rendered together by one thread of a CPU: their features stay in its cache.
const RENDER_CHUNK: usize = 128;
/// Rays rendered together by a GPU, to keep all of it busy.
const GPU_CHUNK: usize = 1 << 14;

/// Renders rays without gradients; geometry is computed once for all appearances.
pub fn render_rays(
    field: &Field,
    weights: &FieldWeights,
    grids: &Grids,
    appearances: &[&Appearance],
    rays: &RayBatch,
) -> RenderedRays {
    #[cfg(feature = "gpu")]
    if let Some(rendered) = field.render_resident(weights, grids, appearances, rays) {
        return rendered;
    }
    let device = weights.inner.encoding.device();
    let is_surface = |look: &&Appearance| look.config.shading == Shading::Surface;
    let (surfaces, shaded): (Vec<&Appearance>, Vec<_>) =
        appearances.iter().partition(|look| is_surface(look));
    let config = surfaces.first().map(|look| &look.config);
    let of_one = surfaces.iter().all(|look| Some(&look.config) == config);
    let on_host = of_one.then(|| HostWeights::of((field, weights), &shaded, config));
    let on_host = on_host.flatten();
    let passes = on_host.as_ref().map(|weights| weights.passes(grids));
    let chunks = in_chunks(rays, &device, usize::MAX, |_, chunk| {
        let Some(passes) = &passes else {
            return render_chunk(field, weights, grids, appearances, &chunk);
        };
        let seen = passes.see(&chunk);
        let mut shaded = seen.shaded.into_iter();
        let all = appearances.iter().map(|look| match (&seen.surface, look) {
            (Some(surface), look) if is_surface(look) => colours(surface, look),
            _ => shaded.next().unwrap_or_default(),
        });
        RenderedRays {
            colours: all.collect(),
            depth: seen.depth,
        }
    });
    let mut out = RenderedRays {
        colours: vec![Vec::with_capacity(rays.len() * 3); appearances.len()],
        depth: Vec::with_capacity(rays.len()),
    };
    for chunk in chunks {
        out.depth.extend(chunk.depth);
        for (all, own) in out.colours.iter_mut().zip(chunk.colours) {
            all.extend(own);
        }
    }
    out
}

/// Rays that a device handles at a time, where `most` have room, as far as that is reasonable.
fn chunk_of(device: &Device, most: usize) -> usize {
    match is_cpu(device) {
        true => RENDER_CHUNK,
        false => most.clamp(RENDER_CHUNK, GPU_CHUNK),
    }
}

/// Does something with groups of rays and their numbers: on a CPU many at a time, one thread each;
/// on a GPU one after the other, each wide enough for all of it.
pub(crate) fn in_chunks<T: Send>(
    rays: &RayBatch,
    device: &Device,
    most: usize,
    work: impl Fn(usize, RayBatch) -> T + Sync,
) -> Vec<T> {
    let size = chunk_of(device, most);
    let count = rays.len().div_ceil(size);
    let one = |chunk: usize| {
        let range = chunk * size..((chunk + 1) * size).min(rays.len());
        work(chunk, rays.part(range))
    };
    match is_cpu(device) {
        true => (0..count).into_par_iter().map(one).collect(),
        false => (0..count).map(one).collect(),
    }
}

/// Rays made ready for painting, whatever the style.
#[derive(Debug, Clone)]
pub struct Prepared {
    /// Of the first field of a cascade, where there is one, then of the field; each in turns, ray
    /// after ray.
    pub levels: Vec<Vec<Paintable>>,
    /// The field's colours of the rays in the photo's look, as [`Paintable::composite`] gives them,
    /// where that was asked for.
    pub colours: Option<Tensor<2>>,
}

/// Geometry of rays, [prepared](Geometry::prepared) for an appearance of configuration `app`
/// without samples that contribute less than `least` where samples are shaded, about `turn` rays at a time, and the rays'
/// colours in the look of `photo`. No gradients.
///
/// # Panics
/// If there are no rays.
pub fn prepare_rays(
    (field, weights, grids): (&Field, &FieldWeights, &Grids),
    photo: Option<&Appearance>,
    (app, least, turn): (&AppearanceConfig, f32, usize),
    rays: &RayBatch,
    seed: u64,
) -> Prepared {
    #[cfg(feature = "gpu")]
    if let Some(prepared) = field.prepare_resident((weights, grids), photo, (app, turn), rays, seed)
    {
        return prepared;
    }
    let device = weights.inner.encoding.device();
    let parts = in_chunks(rays, &device, turn, |chunk, rays| {
        let seed = seed.wrapping_add(chunk as u64);
        let (first, geometry) = field.look_twice(weights, &rays, grids, Some(seed));
        // What is merged anyway is merged as it is rendered, of all samples.
        let prepared = |geometry: Cow<'_, Geometry>, config: &AppearanceConfig| match config.shading
        {
            Shading::Samples => geometry.contributing(least),
            Shading::Surface => geometry.into_owned().prepared(config),
        };
        let colours = photo.map(|photo| {
            let geometry = prepared(Cow::Borrowed(&geometry), &photo.config);
            geometry.paintable(&photo.config).composite(photo)
        });
        let levels = first.into_iter().chain([geometry]).map(Cow::Owned);
        let levels: Vec<Geometry> = levels.map(|level| prepared(level, app)).collect();
        (levels, colours)
    });
    let (mut levels, mut colours) = (Vec::<Vec<Paintable>>::new(), Vec::new());
    let mut parts = parts.into_iter().peekable();
    while parts.peek().is_some() {
        let mut chunks: Vec<Vec<Geometry>> = Vec::new();
        for (geometries, own) in parts.by_ref().take((turn / chunk_of(&device, turn)).max(1)) {
            chunks.resize_with(geometries.len(), Vec::new);
            for (level, geometry) in chunks.iter_mut().zip(geometries) {
                level.push(geometry);
            }
            colours.extend(own);
        }
        levels.resize_with(chunks.len(), Vec::new);
        for (level, chunks) in levels.iter_mut().zip(chunks) {
            level.push(Geometry::joined(chunks).paintable(app));
        }
    }
    Prepared {
        levels,
        colours: (!colours.is_empty()).then(|| Tensor::cat(colours, 0)),
    }
}

fn render_chunk(
    field: &Field,
    weights: &FieldWeights,
    grids: &Grids,
    appearances: &[&Appearance],
    rays: &RayBatch,
) -> RenderedRays {
    let configs: Vec<_> = appearances.iter().map(|a| &a.config).collect();
    let seen = Seen::of((field, weights, grids), &configs, rays);
    let mut paintables: Vec<(&AppearanceConfig, Paintable)> = Vec::new();
    let colours = appearances.iter().map(|appearance| {
        let config = &appearance.config;
        // Looks of one model have one configuration.
        if !paintables.iter().any(|(known, _)| *known == config) {
            paintables.extend(seen.paintable(config).map(|paintable| (config, paintable)));
        }
        let paintable = paintables.iter().find(|(known, _)| *known == config);
        paintable.map_or_else(Vec::new, |(_, paintable)| colours(paintable, appearance))
    });
    RenderedRays {
        colours: colours.collect(),
        depth: seen.depth,
    }
}

/// Rays as appearances see them.
pub(crate) struct Seen {
    /// For those that are shaded at samples, and for those that are once per ray and volume.
    samples: Option<Geometry>,
    surface: Option<Geometry>,
    pub(crate) depth: Vec<f32>,
}

impl Seen {
    pub(crate) fn of(
        (field, weights, grids): (&Field, &FieldWeights, &Grids),
        configs: &[&AppearanceConfig],
        rays: &RayBatch,
    ) -> Self {
        let geometry = match &weights.coarse {
            Some(_) => field.look(weights, rays, grids, None),
            None => {
                let march = March::to_light(&field.config.sampling, grids);
                field.geometry(weights, march.all(rays, None))
            }
        };
        let light = geometry.weights();
        let depth = median_depth(geometry.layout(), &light);
        let needs = |shading| configs.iter().any(|config| config.shading == shading);
        Self {
            samples: needs(Shading::Samples).then(|| geometry.kept(&light, SHADE_LEAST)),
            surface: needs(Shading::Surface).then(|| geometry.merged(&light)),
            depth,
        }
    }

    pub(crate) fn paintable(&self, config: &AppearanceConfig) -> Option<Paintable> {
        let geometry = match config.shading {
            Shading::Samples => &self.samples,
            Shading::Surface => &self.surface,
        };
        geometry.clone().map(|geometry| geometry.paintable(config))
    }
}

/// `rays × 3` colours in `[0, 1]`.
pub(crate) fn colours(paintable: &Paintable, appearance: &Appearance) -> Vec<f32> {
    let pixels = host(paintable.composite(appearance));
    let (pixels, _) = pixels.as_chunks::<{ CompositeLayout::outputs(3) }>();
    let colours = pixels.iter().flat_map(|pixel| &pixel[..3]);
    colours.map(|c| c.clamp(0.0, 1.0)).collect()
}
