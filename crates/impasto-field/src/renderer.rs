//! The one ray renderer.

use crate::appearance::{Appearance, Ground};
use crate::backend::cpu::{Cpu, CpuWeights};
#[cfg(feature = "gpu")]
use crate::backend::gpu::{Gpu, GpuField};
use crate::backend::reference::Reference;
use crate::backend::{Backend, BufferSpec};
use crate::config::{AppearanceConfig, Shading};
use crate::encoding::host;
use crate::field::{Field, FieldWeights};
use crate::grids::OccupancyGrids;
use crate::rays::RayBatch;
use crate::volrend::gbuffer::GBuffer;
use burn::tensor::{Device, Tensor};
use impasto_kernels::device::is_cpu;
use rayon::prelude::*;

/// A field, opened for rendering on the device that its weights are on.
pub struct Renderer {
    field: Field,
    weights: FieldWeights,
    grids: Option<OccupancyGrids>,
    ground: Ground,
    engine: Engine,
}

/// Samples with less weight than this are not shaded when rendering.
pub const SHADE_LEAST: f32 = 1e-3;

/// What each backend keeps between calls.
enum Engine {
    Reference,
    Cpu(Box<CpuWeights>),
    #[cfg(feature = "gpu")]
    Gpu(Box<GpuField>),
}

/// What rendering rays yields on the host.
#[derive(Debug, Clone)]
pub struct RenderedRays {
    /// Per appearance, `rays × 3` colours in `[0, 1]`.
    pub colours: Vec<Vec<f32>>,
    /// Median depth per ray, along the camera's axis, scene units.
    pub depth: Vec<f32>,
}

/// What rays are evaluated for.
#[derive(Debug, Clone, Copy)]
pub struct GBufferOptions<'a> {
    /// Configuration of the appearances to come.
    pub config: &'a AppearanceConfig,
    /// An appearance to shade the rays with on the way.
    pub photo: Option<&'a Appearance>,
    /// Seed of where samples lie; none for rendering.
    pub seed: Option<u64>,
    /// Samples with less weight are left out, where samples are shaded.
    pub least_weight: f32,
    /// About how many rays one G-buffer holds; else as many as the device handles at a time.
    pub rays_at_once: Option<usize>,
}

/// Rays whose geometry is known and kept, so that any number of paints cost little more than `app`.
#[derive(Debug, Clone)]
pub struct RayBuffers {
    /// Of the first field of a cascade, where there is one, then of the field; each in parts, ray
    /// after ray.
    pub levels: Vec<Vec<GBuffer>>,
    /// `[rays, 3 or more]`, colours first: the rays as the photo's appearance shades them, where
    /// that was asked for.
    pub photo: Option<Tensor<2>>,
    /// Median depth, along the camera's axis, scene units, `[rays]`.
    pub depth: Tensor<1>,
}

impl RayBuffers {
    /// The G-buffers of the field itself.
    pub fn fine(&self) -> &[GBuffer] {
        self.levels.last().map_or(&[], Vec::as_slice)
    }

    /// The rays in another appearance, of the configuration that they were evaluated for: `rays × 3`
    /// colours in `[0, 1]`.
    pub fn shade(&self, appearance: &Appearance) -> Vec<f32> {
        let parts = self.fine().par_iter();
        let colours: Vec<_> = parts.map(|part| pixels(part.shade(appearance))).collect();
        colours.concat()
    }
}

/// Colours of composited rays, `rays × 3` in `[0, 1]`.
pub fn pixels(composite: Tensor<2>) -> Vec<f32> {
    host(composite.slice_dim(1, 0..3).clamp(0.0, 1.0))
}

impl Renderer {
    /// Opens a field on the fastest backend that can do it all: rendering with the unstylised appearance,
    /// which is shaded at samples, and with those of the configuration `style` on what is known of surfaces.
    pub fn open(
        field: Field,
        weights: FieldWeights,
        grids: Option<OccupancyGrids>,
        ground: impl Into<Ground>,
        style: &AppearanceConfig,
    ) -> Self {
        let ground = ground.into();
        let apps = [&ground.photo.config, style];
        let engine = Engine::of(&field, &weights, grids.as_ref(), apps);
        Self {
            field,
            weights,
            grids,
            ground,
            engine,
        }
    }

    /// Opens a field on the slow, obvious twin of the other backends.
    pub fn reference(
        field: Field,
        weights: FieldWeights,
        grids: Option<OccupancyGrids>,
        ground: impl Into<Ground>,
    ) -> Self {
        Self {
            field,
            weights,
            grids,
            ground: ground.into(),
            engine: Engine::Reference,
        }
    }

    /// The field's sizes.
    pub fn field(&self) -> &Field {
        &self.field
    }

    /// Its weights.
    pub fn weights(&self) -> &FieldWeights {
        &self.weights
    }

    /// Its density grids, where samples go by those.
    pub fn grids(&self) -> Option<&OccupancyGrids> {
        self.grids.as_ref()
    }

    /// Where it computes.
    pub fn device(&self) -> Device {
        self.weights.inner.encoding.device()
    }

    /// Renders rays; geometry is computed once for all appearances.
    pub fn render(&self, rays: &RayBatch, appearances: &[&Appearance]) -> RenderedRays {
        let ground = &self.ground;
        let job = Render {
            rays,
            appearances,
            ground,
        };
        self.with_backend(&self.engine, job)
    }

    /// Evaluates rays for paints to come.
    ///
    /// # Panics
    /// If there are no rays.
    pub fn gbuffer(&self, rays: &RayBatch, options: &GBufferOptions<'_>) -> RayBuffers {
        // A GPU knows how many samples a ray has, the host does not: it buffers surfaces.
        let engine = match &self.engine {
            #[cfg(feature = "gpu")]
            Engine::Gpu(_) if options.config.shading == Shading::Samples => &Engine::Reference,
            engine => engine,
        };
        let ground = &self.ground;
        let job = Buffer {
            rays,
            options,
            ground,
        };
        self.with_backend(engine, job)
    }

    fn with_backend<J: Job>(&self, engine: &Engine, job: J) -> J::Output {
        let (field, grids) = (&self.field, self.grids.as_ref());
        let reference = Reference {
            field,
            weights: &self.weights,
            grids,
        };
        match engine {
            Engine::Reference => job.run(&reference),
            Engine::Cpu(weights) => match grids.and_then(|grids| Cpu::new(field, weights, grids)) {
                Some(cpu) => job.run(&cpu),
                None => job.run(&reference),
            },
            #[cfg(feature = "gpu")]
            Engine::Gpu(gpu) => match Gpu::new(field, &self.weights, gpu) {
                Some(gpu) => job.run(&gpu),
                None => job.run(&reference),
            },
        }
    }
}

impl Engine {
    fn of(
        field: &Field,
        weights: &FieldWeights,
        grids: Option<&OccupancyGrids>,
        apps: [&AppearanceConfig; 2],
    ) -> Self {
        if is_cpu(&weights.inner.encoding.device()) {
            let weights = CpuWeights::of(field, weights).map(Box::new);
            return weights.map_or(Self::Reference, Self::Cpu);
        }
        #[cfg(feature = "gpu")]
        if let Some(gpu) = grids.and_then(|grids| GpuField::of(field, weights, grids, apps)) {
            return Self::Gpu(Box::new(gpu));
        }
        #[cfg(not(feature = "gpu"))]
        let _ = (grids, apps);
        Self::Reference
    }
}

/// Something to do with whatever backend a field was opened on.
trait Job {
    type Output;

    fn run<B: Backend>(self, backend: &B) -> Self::Output;
}

/// Does something with groups of about `most` rays and their numbers: on a CPU many at a time, one
/// thread each; on a GPU one after the other, each wide enough for all of it.
fn in_chunks<B: Backend, T: Send>(
    backend: &B,
    rays: &RayBatch,
    most: usize,
    work: impl Fn(usize, RayBatch) -> T + Sync,
) -> Vec<T> {
    let size = backend.rays_together(most);
    let count = rays.len().div_ceil(size);
    let one = |chunk: usize| {
        let range = chunk * size..((chunk + 1) * size).min(rays.len());
        work(chunk, rays.part(range))
    };
    if backend.on_host() {
        (0..count).into_par_iter().map(one).collect()
    } else {
        (0..count).map(one).collect()
    }
}

struct Render<'a> {
    rays: &'a RayBatch,
    appearances: &'a [&'a Appearance],
    ground: &'a Ground,
}

impl Job for Render<'_> {
    type Output = RenderedRays;

    fn run<B: Backend>(self, backend: &B) -> RenderedRays {
        let shaders: Vec<Option<B::Shader>> = self
            .appearances
            .iter()
            .map(|a| (a.config.shading == Shading::Samples).then(|| backend.shader(a)))
            .collect();
        let chunks = in_chunks(backend, self.rays, usize::MAX, |_, rays| {
            let samples = backend.sample(&rays, None);
            let Some(evaluated) = backend.evaluate(&rays, samples, None).pop() else {
                unreachable!("the field itself is the last level");
            };
            let mut buffers: Vec<(&AppearanceConfig, GBuffer)> = Vec::new();
            let colours = self
                .appearances
                .iter()
                .zip(&shaders)
                .map(|(appearance, shader)| {
                    let config = &appearance.config;
                    if let Some(shader) = shader {
                        return backend.shade(&evaluated, shader, SHADE_LEAST);
                    }
                    // Appearances of one model have one configuration.
                    let known = buffers.iter().position(|(known, _)| *known == config);
                    let at = known.unwrap_or_else(|| {
                        let spec = BufferSpec {
                            config,
                            least_weight: 0.0,
                            ground: self.ground,
                            rays: &rays,
                        };
                        buffers.push((config, backend.accumulate(&evaluated, spec)));
                        buffers.len() - 1
                    });
                    buffers[at].1.shade(appearance)
                });
            // Here, where chunks are worked on side by side.
            let colours: Vec<Tensor<2>> = colours.map(|c| c.slice_dim(1, 0..3)).collect();
            (colours, backend.depth(&evaluated))
        });
        let mut parts: Vec<Vec<Tensor<2>>> = vec![Vec::new(); self.appearances.len()];
        let mut depth = Vec::with_capacity(chunks.len());
        for (colours, own) in chunks {
            depth.push(own);
            parts
                .iter_mut()
                .zip(colours)
                .for_each(|(all, own)| all.push(own));
        }
        let read = |parts: Vec<Tensor<2>>| match parts.is_empty() {
            true => Vec::new(),
            false => pixels(Tensor::cat(parts, 0)),
        };
        RenderedRays {
            colours: parts.into_iter().map(read).collect(),
            depth: match depth.is_empty() {
                true => Vec::new(),
                false => host(Tensor::cat(depth, 0)),
            },
        }
    }
}

struct Buffer<'a> {
    rays: &'a RayBatch,
    options: &'a GBufferOptions<'a>,
    ground: &'a Ground,
}

impl Job for Buffer<'_> {
    type Output = RayBuffers;

    fn run<B: Backend>(self, backend: &B) -> RayBuffers {
        let options = self.options;
        let shader = options.photo.map(|photo| backend.shader(photo));
        let most = options.rays_at_once.unwrap_or(usize::MAX);
        let parts = in_chunks(backend, self.rays, most, |chunk, rays| {
            let seed = options.seed.map(|seed| seed.wrapping_add(chunk as u64));
            let samples = backend.sample(&rays, seed);
            let levels = backend.evaluate(&rays, samples, seed);
            let fine = levels.last();
            let photo = fine.zip(shader.as_ref());
            let least = options.least_weight;
            let photo = photo.map(|(fine, shader)| backend.shade(fine, shader, least));
            let depth = fine.map(|fine| backend.depth(fine));
            let spec = BufferSpec {
                config: options.config,
                least_weight: least,
                ground: self.ground,
                rays: &rays,
            };
            let buffers = levels.iter().map(|level| backend.accumulate(level, spec));
            (buffers.collect::<Vec<_>>(), photo, depth)
        });
        let together = options
            .rays_at_once
            .map_or(1, |most| most / backend.rays_together(most));
        let (mut levels, mut photo, mut depth) =
            (Vec::<Vec<GBuffer>>::new(), Vec::new(), Vec::new());
        for (buffers, own, own_depth) in parts {
            levels.resize_with(buffers.len(), Vec::new);
            for (level, buffer) in levels.iter_mut().zip(buffers) {
                level.push(buffer);
            }
            photo.extend(own);
            depth.extend(own_depth);
        }
        let joined = |level: Vec<GBuffer>| {
            let mut parts = level.into_iter().peekable();
            let mut joined = Vec::new();
            while parts.peek().is_some() {
                joined.extend(GBuffer::join(
                    parts.by_ref().take(together.max(1)).collect(),
                ));
            }
            joined
        };
        RayBuffers {
            levels: levels.into_iter().map(joined).collect(),
            photo: (!photo.is_empty()).then(|| Tensor::cat(photo, 0)),
            depth: Tensor::cat(depth, 0),
        }
    }
}
