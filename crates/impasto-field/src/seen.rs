//! Rays that are looked at once and painted many times.

use crate::appearance::{Appearance, AppearanceConfig, Shading};
use crate::field::{Field, FieldWeights, Grids};
use crate::host::HostWeights;
use crate::paintable::Paintable;
use crate::render::{Seen, colours, in_chunks, render_rays};
use crate::sampling::RayBatch;
use impasto_kernels::device::is_cpu;
use rayon::prelude::*;

/// Rays whose geometry is known and kept, so that any number of paints cost little more than `app`.
#[derive(Debug, Clone)]
pub struct SeenRays {
    /// `rays × 3` colours in `[0, 1]` in the photo's look.
    pub photo: Vec<f32>,
    /// Median depth per ray, along the camera's axis, scene units.
    pub depth: Vec<f32>,
    kept: Kept,
}

#[derive(Debug, Clone)]
enum Kept {
    /// On a CPU, in groups that fit its cache.
    Paintables(Vec<Paintable>),
    /// On a GPU, which finds the geometry again sooner than its memory would hold it.
    Rays(RayBatch),
}

/// Looks at rays without gradients, for paints of configuration `config` to come.
pub fn see_rays(
    (field, weights, grids): (&Field, &FieldWeights, &Grids),
    photo: &Appearance,
    config: &AppearanceConfig,
    rays: &RayBatch,
) -> SeenRays {
    let device = weights.inner.encoding.device();
    if !is_cpu(&device) {
        let mut rendered = render_rays(field, weights, grids, &[photo], rays);
        return SeenRays {
            photo: rendered.colours.pop().unwrap_or_default(),
            depth: rendered.depth,
            kept: Kept::Rays(rays.clone()),
        };
    }
    let surface = (config.shading == Shading::Surface).then_some(config);
    let on_host = surface.and_then(|_| HostWeights::of((field, weights), &[photo], surface));
    let passes = on_host.as_ref().map(|weights| weights.passes(grids));
    let chunks = in_chunks(rays, &device, usize::MAX, |_, chunk| {
        if let Some(passes) = &passes {
            let mut seen = passes.see(&chunk);
            return (
                seen.shaded.pop().unwrap_or_default(),
                seen.surface,
                seen.depth,
            );
        }
        let seen = Seen::of((field, weights, grids), &[&photo.config, config], &chunk);
        let shown = seen.paintable(&photo.config);
        let shown = shown.map_or_else(Vec::new, |paintable| colours(&paintable, photo));
        (shown, seen.paintable(config), seen.depth)
    });
    let (mut shown, mut depth) = (Vec::with_capacity(3 * rays.len()), Vec::new());
    let mut paintables = Vec::with_capacity(chunks.len());
    for (photo, paintable, depths) in chunks {
        shown.extend(photo);
        paintables.extend(paintable);
        depth.extend(depths);
    }
    SeenRays {
        photo: shown,
        depth,
        kept: Kept::Paintables(paintables),
    }
}

impl SeenRays {
    /// The rays in another look, of the configuration that they were looked at for: `rays × 3`
    /// colours in `[0, 1]`, as of [`render_rays`].
    pub fn colours(
        &self,
        (field, weights, grids): (&Field, &FieldWeights, &Grids),
        appearance: &Appearance,
    ) -> Vec<f32> {
        match &self.kept {
            Kept::Paintables(chunks) => {
                let chunks = chunks.par_iter();
                let colours: Vec<_> = chunks.map(|chunk| colours(chunk, appearance)).collect();
                colours.concat()
            }
            Kept::Rays(rays) => {
                let rendered = render_rays(field, weights, grids, &[appearance], rays);
                rendered.colours.into_iter().flatten().collect()
            }
        }
    }

    /// About how much memory it takes, bytes.
    pub fn bytes(&self) -> usize {
        let kept = match &self.kept {
            Kept::Paintables(chunks) => chunks.iter().map(Paintable::bytes).sum(),
            Kept::Rays(rays) => 6 * rays.len() * size_of::<f32>(),
        };
        kept + (self.photo.len() + self.depth.len()) * size_of::<f32>()
    }
}
