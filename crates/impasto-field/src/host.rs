//! The field on a CPU, with no tensors between its layers: rays in, colours and paintable rays out.
//! For fields of hash grids, and for paint on surfaces or without a canvas, which is what the default
//! preset trains; others go the way that every device goes.

use crate::appearance::{Appearance, AppearanceConfig, Shading};
use crate::branch::{Branch, BranchWeights};
use crate::encoding::frequencies;
use crate::field::{Field, FieldWeights, Grids};
use crate::paintable::Paintable;
use crate::render::{Geometry, SHADE_LEAST, median_depth, worth_shading};
use crate::sampling::{March, RayBatch};
use crate::sphere::dot;
use burn::tensor::{Device, Tensor};
use impasto_kernels::cpu::composite;
use impasto_kernels::cpu::passes::{self, GeometryPass, ShadingPass};
use impasto_kernels::ops::OnHost;
use impasto_kernels::{HashGridSpec, MlpSpec};

/// Weights in the CPU's memory, with what of a field they are for.
pub(crate) struct HostWeights<'a> {
    field: &'a Field,
    volumes: [HostVolume; 2],
    /// Looks that are shaded at samples, in their order.
    looks: Vec<HostLook>,
    /// What the others, which are shaded once per ray and volume, are made ready for.
    surface: Option<&'a AppearanceConfig>,
    device: Device,
}

struct HostVolume {
    grid: HashGridSpec,
    encoding: OnHost,
    base: OnHost,
    geo: OnHost,
}

/// `app` of both volumes.
struct HostLook {
    app: [(MlpSpec, OnHost); 2],
    bands: Option<usize>,
}

/// What rays go through.
pub(crate) struct Passes<'a> {
    of: &'a HostWeights<'a>,
    march: March<'a>,
    geometry: [GeometryPass<'a>; 2],
    shading: Vec<(ShadingPass<'a>, Option<usize>)>,
}

/// Rays as all looks see them.
pub(crate) struct HostSeen {
    /// `rays × 3` colours in `[0, 1]` of the looks that are shaded at samples, in their order.
    pub(crate) shaded: Vec<Vec<f32>>,
    /// For the others.
    pub(crate) surface: Option<Paintable>,
    pub(crate) depth: Vec<f32>,
}

impl<'a> HostWeights<'a> {
    /// Of a field, of looks that are shaded at samples, and for those of a configuration that are
    /// shaded on surfaces; `None` if some of it is on no CPU or not made of a hash grid and plain
    /// layers.
    pub(crate) fn of(
        (field, weights): (&'a Field, &FieldWeights),
        looks: &[&Appearance],
        surface: Option<&'a AppearanceConfig>,
    ) -> Option<Self> {
        let by_position = surface.is_some_and(AppearanceConfig::paints_by_position);
        if field.config.cascade.is_some() || by_position {
            return None;
        }
        let looks = looks.iter().map(|look| HostLook::of(field, look));
        Some(Self {
            field,
            volumes: [
                HostVolume::of(&field.inner, &weights.inner)?,
                HostVolume::of(&field.outer, &weights.outer)?,
            ],
            looks: looks.collect::<Option<_>>()?,
            surface,
            device: weights.inner.encoding.device(),
        })
    }

    pub(crate) fn passes(&'a self, grids: &'a Grids) -> Passes<'a> {
        let pass = |branch: &'a Branch, volume: &'a HostVolume| {
            let (base, geo, density) = branch.layers();
            let grid = (volume.grid, &*volume.encoding);
            GeometryPass::new(grid, (base, &volume.base), (geo, &volume.geo), density)
        };
        let shading = self.looks.iter().map(|look| {
            let app = look
                .app
                .each_ref()
                .map(|(spec, weights)| (spec, &**weights));
            (ShadingPass::new(app, self.field.features()), look.bands)
        });
        Passes {
            of: self,
            march: March::to_light(&self.field.config.sampling, grids).bare(),
            geometry: [
                pass(&self.field.inner, &self.volumes[0]),
                pass(&self.field.outer, &self.volumes[1]),
            ],
            shading: shading.collect(),
        }
    }
}

impl HostVolume {
    fn of(branch: &Branch, weights: &BranchWeights) -> Option<Self> {
        Some(Self {
            grid: branch.hash_grid()?,
            encoding: OnHost::of(&weights.encoding)?,
            base: OnHost::of(&branch.folded(weights))?,
            geo: OnHost::of(&weights.geo)?,
        })
    }
}

impl HostLook {
    fn of(field: &Field, look: &Appearance) -> Option<Self> {
        let config = &look.config;
        if config.canvas.is_some() || config.shading != Shading::Samples {
            return None;
        }
        let app = |branch: &Branch, weights: &Tensor<1>| {
            let network = config.network(branch.features(), branch.dimensions());
            let weights = network.folded(weights, look.latent.as_ref());
            Some((network.chain().clone(), OnHost::of(&weights)?))
        };
        Some(Self {
            app: [
                app(&field.inner, &look.inner)?,
                app(&field.outer, &look.outer)?,
            ],
            bands: config.view_bands,
        })
    }
}

impl Passes<'_> {
    /// Looks at rays, on the calling thread.
    pub(crate) fn see(&self, rays: &RayBatch) -> HostSeen {
        let samples = self.march.samples(rays);
        let (inner, mut densities) = self.geometry[0].run(&samples.inner.cube);
        let (outer, behind) = self.geometry[1].run(&samples.outer.cube);
        densities.extend(behind);
        let views: Vec<[f32; 3]> = rays.directions.iter().map(|d| view(*d)).collect();
        let layout = &*samples.layout;
        let light = composite::weights(layout, &densities);
        let depth = median_depth(layout, &light);
        let keep = match self.shading.is_empty() {
            true => Vec::new(),
            false => worth_shading(layout, &light, SHADE_LEAST),
        };
        let shaded = self.shading.iter().map(|(pass, bands)| {
            let rows = |bands| frequencies(views.as_flattened(), 3, bands);
            let views = bands.map_or_else(Vec::new, rows);
            let mut colours = pass.run(&passes::ShadingSamples {
                layout,
                densities: &densities,
                features: [&inner, &outer],
                keep: &keep,
                views: &views,
            });
            colours.iter_mut().for_each(|c| *c = c.clamp(0.0, 1.0));
            colours
        });
        let shaded = shaded.collect();
        let surface = self.of.surface.map(|config| {
            let [inner_width, outer_width] = self.of.field.features();
            let features = [(&*inner, inner_width), (&*outer, outer_width)];
            let samples = (&samples, Some(&*views));
            let merged = Geometry::merged_of(samples, features, &light, &self.of.device);
            merged.paintable(config)
        });
        HostSeen {
            shaded,
            surface,
            depth,
        }
    }
}

fn view(direction: [f32; 3]) -> [f32; 3] {
    let length = dot(direction, direction).sqrt();
    direction.map(|c| c / length)
}

#[cfg(test)]
mod tests {
    use crate::config::SamplingConfig;
    use crate::field::Grids;
    use crate::sampling::{March, RayBatch, march};
    use impasto_kernels::DensityGrid;

    /// Something in the ball where z is between 0.5 and 0.7, nothing else.
    fn slab(density: f32) -> Grids {
        let empty = DensityGrid::new(40, 0.0);
        let levels = (0..empty.cells()).map(|cell| {
            let z = 2.0 * empty.position(cell, [0.5; 3])[2] - 1.0;
            DensityGrid::level_of(if (0.5..0.7).contains(&z) {
                density
            } else {
                0.0
            })
        });
        let inner = DensityGrid::from_levels(levels.collect());
        Grids::new(inner.unwrap_or_else(|| empty.clone()), empty)
    }

    #[test]
    fn samples_are_left_out_where_no_light_is_expected() {
        let config = SamplingConfig {
            samples: 32,
            explore: 0.8,
            inner_step: 0.02,
            outer_steps: 96,
            inner_grid: 40,
            outer_grid: 40,
            near: 0.05,
        };
        let mut rays = RayBatch::default();
        for i in 0..20 {
            let x = 0.02 * i as f32 - 0.2;
            rays.push([0.0, 0.0, -0.3], [x, 0.1, 1.0]);
        }
        for (density, shines_through) in [(1.0, true), (300.0, false)] {
            let grids = slab(density);
            let all = march(&rays, &config, &grids, None);
            let few = March::to_light(&config, &grids).samples(&rays);
            let mut behind = 0;
            for (whole, span) in all.layout.rays.iter().zip(&few.layout.rays) {
                let (before, after) = (
                    &all.layout.depths[whole.inner.clone()],
                    &few.layout.depths[span.inner.clone()],
                );
                assert!(after.len() < before.len());
                // The slab is 0.8 to 1 deep; parts that begin or end beside it may have their middle
                // there.
                let within = |depths: &[f32]| {
                    let all = depths.iter().filter(|d| (0.8..1.0).contains(*d));
                    all.copied().collect::<Vec<f32>>()
                };
                assert_eq!(within(after), within(before), "nothing seen is lost");
                let beside = |d: &&f32| !(0.77..1.03).contains(*d);
                assert!(after.iter().filter(beside).count() <= 2, "{after:?}");
                let farthest = &all.layout.depths[whole.outer.clone()];
                let kept = &few.layout.depths[span.outer.clone()];
                assert_eq!(kept.last(), farthest.last());
                behind += kept.len();
            }
            assert_eq!(behind > rays.len(), shines_through, "{behind} behind");
        }
    }
}
