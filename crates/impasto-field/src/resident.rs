//! The field on a GPU, where everything stays there: rays in, paintable rays, pixels or gradients
//! out. For fields of hash grids and plain layers, which is what the default preset trains; others
//! go the way that every device goes.

use crate::appearance::{Appearance, AppearanceConfig, Shading};
use crate::config::{EncodingConfig, SamplingConfig};
use crate::encoding::frequencies_of;
use crate::field::{DENSE, Field, FieldWeights, Grids, Visible};
use crate::loss::Wanted;
use crate::paintable::{CanvasPlaces, Paintable, PaintableVolume};
use crate::render::{Prepared, RenderedRays, host};
use crate::sampling::{ANY, LEAST_LIGHT, RayBatch, contracted_distance, jitter};
use burn::tensor::{Device, Tensor};
use impasto_kernels::gpu::{
    self, DensityGrids, Descent, FieldSamples, FieldSpec, MarchSpec, MergedSamples, RaySamples,
    Rays, Targets, surface_layout,
};
use impasto_kernels::{Volume, device::is_cpu};
use std::sync::Arc;

/// Most numbers of a tensor: 128 MiB, the largest buffer that a Vulkan device must be able to bind.
const MOST_NUMBERS: usize = 1 << 25;

/// Grids that were copied to a device.
#[derive(Debug, Clone)]
pub(crate) struct Copied {
    device: Device,
    grids: DensityGrids,
}

impl Grids {
    fn on(&self, device: &Device) -> DensityGrids {
        let copy = || DensityGrids::new([&self.inner, &self.outer], None, device);
        let copied = self.resident.get_or_init(|| Copied {
            device: device.clone(),
            grids: copy(),
        });
        match copied.device == *device {
            true => copied.grids.clone(),
            false => copy(),
        }
    }
}

impl SamplingConfig {
    fn march(&self, least: f32) -> MarchSpec {
        MarchSpec {
            samples: self.samples,
            uniform_fraction: self.explore,
            inner_step: self.inner_step,
            outer_steps: self.outer_steps,
            near: self.near,
            least_weight: least,
        }
    }
}

/// Weights in the order of a volume's numbers, hash tables in the place of encodings.
fn volumes(weights: &FieldWeights, apps: [&Tensor<1>; 2]) -> [Volume<Tensor<1>>; 2] {
    let volume = |branch: &crate::BranchWeights, app: &Tensor<1>| Volume {
        encoded: branch.encoding.clone(),
        base: branch.base.clone(),
        geo: branch.geo.clone(),
        app: app.clone(),
    };
    [
        volume(&weights.inner, apps[0]),
        volume(&weights.outer, apps[1]),
    ]
}

/// Whether `app` is a chain of layers on features and views.
fn plain(app: &AppearanceConfig) -> bool {
    app.canvas.is_none() && !app.remap && app.latent.is_none()
}

/// Encoded views of rays for an `app`.
fn views(directions: &Tensor<2>, app: &AppearanceConfig) -> Option<Tensor<2>> {
    let bands = app.view_bands?;
    Some(frequencies_of(directions, bands))
}

impl Field {
    /// Networks of the field with an `app`, if all can stay on the device.
    fn resident(&self, app: &AppearanceConfig, device: &Device) -> Option<FieldSpec> {
        let config = &self.config;
        let latent = config.inner.latent.or(config.outer.latent);
        let is_hosts = is_cpu(device) || app.paints_by_position();
        if is_hosts || config.cascade.is_some() || latent.is_some() {
            return None;
        }
        let spec = FieldSpec {
            grids: [
                config.inner.encoding.hash_grid()?,
                config.outer.encoding.hash_grid()?,
            ],
            volumes: [(&self.inner, 3), (&self.outer, 4)].map(|(branch, dimensions)| {
                branch.volume_spec(&app.network(branch.features(), dimensions))
            }),
        };
        spec.fits().then_some(spec)
    }

    /// Rays handled together: as many as every device has room for, which keeps a large one busy.
    fn rays_together(&self, spec: &FieldSpec) -> usize {
        (MOST_NUMBERS / spec.widest() / self.config.sampling.samples.max(1)).max(1)
    }

    fn marched(&self, rays: &RayBatch, grids: &DensityGrids, seed: Option<u64>) -> RaySamples {
        let mut resident = Rays::default();
        for (ray, (origin, direction)) in rays.origins.iter().zip(&rays.directions).enumerate() {
            let shift = seed.map_or(0.5, |seed| jitter(seed, ray));
            resident.push(*origin, *direction, shift, None);
        }
        // As on a CPU: what is learned from looks at everything.
        let least = if seed.is_some() { ANY } else { LEAST_LIGHT };
        grids.march(&resident, &self.config.sampling.march(least))
    }

    /// What [`crate::render_rays`] does, if all of it can stay on the device.
    pub(crate) fn render_resident(
        &self,
        weights: &FieldWeights,
        grids: &Grids,
        appearances: &[&Appearance],
        rays: &RayBatch,
    ) -> Option<RenderedRays> {
        let device = weights.inner.encoding.device();
        let sampled = |a: &&Appearance| a.config.shading == Shading::Samples;
        let rest = appearances.iter().copied().filter(sampled);
        if appearances.is_empty() || rays.is_empty() || !rest.map(|a| &a.config).all(plain) {
            return None;
        }
        let specs = appearances
            .iter()
            .map(|a| self.resident(&a.config, &device))
            .collect::<Option<Vec<_>>>()?;
        let grids = grids.on(&device);
        let own = volumes(weights, [&appearances[0].inner, &appearances[0].outer]);
        let mut colours: Vec<Vec<Tensor<2>>> = vec![Vec::new(); appearances.len()];
        let mut depth = Vec::new();
        let widest = specs.iter().max_by_key(|spec| spec.widest())?;
        let size = self.rays_together(widest);
        for start in (0..rays.len()).step_by(size) {
            let part = rays.part(start..(start + size).min(rays.len()));
            let samples = self.marched(&part, &grids, None);
            let directions = samples.directions();
            let geometry = gpu::evaluate(&specs[0], samples, &own);
            let surface = geometry.accumulate();
            depth.push(surface.depth.clone());
            let mut paintables: Vec<(&AppearanceConfig, Paintable)> = Vec::new();
            for ((appearance, spec), colours) in appearances.iter().zip(&specs).zip(&mut colours) {
                let config = &appearance.config;
                let pixels = match config.shading {
                    Shading::Samples => sample_colours(&geometry, spec, appearance, &directions),
                    Shading::Surface => {
                        if !paintables.iter().any(|(known, _)| *known == config) {
                            paintables.push((config, painted(&surface, config, &directions)));
                        }
                        let known = paintables.iter().find(|(known, _)| *known == config);
                        known?.1.composite(appearance)
                    }
                };
                colours.push(pixels.slice_dim(1, 0..3).clamp(0.0, 1.0));
            }
        }
        Some(RenderedRays {
            colours: colours
                .into_iter()
                .map(|parts| host(Tensor::cat(parts, 0)))
                .collect(),
            depth: host(Tensor::cat(depth, 0)),
        })
    }

    /// What [`crate::prepare_rays`] does, if all of it can stay on the device and rays are merged to
    /// one sample a volume. Samples that contribute little are not left out.
    pub(crate) fn prepare_resident(
        &self,
        (weights, grids): (&FieldWeights, &Grids),
        photo: Option<&Appearance>,
        (app, turn): (&AppearanceConfig, usize),
        rays: &RayBatch,
        seed: u64,
    ) -> Option<Prepared> {
        let device = weights.inner.encoding.device();
        let sampled =
            |photo: &Appearance| photo.config.shading == Shading::Samples && plain(&photo.config);
        if app.shading != Shading::Surface || !photo.is_none_or(sampled) {
            return None;
        }
        let spec = self.resident(photo.map_or(app, |photo| &photo.config), &device)?;
        let grids = grids.on(&device);
        // Not looked at by what comes before `app`.
        let none = Tensor::zeros([1], &device);
        let own = volumes(weights, [&none, &none]);
        let (mut level, mut colours) = (Vec::new(), Vec::new());
        let size = turn.clamp(1, self.rays_together(&spec));
        for (chunk, start) in (0..rays.len()).step_by(size).enumerate() {
            let part = rays.part(start..(start + size).min(rays.len()));
            let samples = self.marched(&part, &grids, Some(seed.wrapping_add(chunk as u64)));
            let directions = samples.directions();
            let geometry = gpu::evaluate(&spec, samples, &own);
            level.push(painted(&geometry.accumulate(), app, &directions));
            colours.extend(photo.map(|photo| sample_colours(&geometry, &spec, photo, &directions)));
        }
        Some(Prepared {
            levels: vec![level],
            colours: (!colours.is_empty()).then(|| Tensor::cat(colours, 0)),
        })
    }
}

/// Pixels of samples that are all shaded.
fn sample_colours(
    geometry: &FieldSamples,
    spec: &FieldSpec,
    appearance: &Appearance,
    directions: &Tensor<2>,
) -> Tensor<2> {
    let apps = [appearance.inner.clone(), appearance.outer.clone()];
    let views = views(directions, &appearance.config);
    geometry.composite(&spec.volumes, apps, views)
}

/// Merged samples as paints want them.
fn painted(
    surface: &MergedSamples,
    config: &AppearanceConfig,
    directions: &Tensor<2>,
) -> Paintable {
    let [rays, _] = directions.dims();
    let views = views(directions, config);
    let grid = config.canvas.as_ref().and_then(EncodingConfig::hash_grid);
    let volume = |v: usize| PaintableVolume {
        features: surface.features[v].clone(),
        views: views.clone(),
        canvas: grid.map(|grid| {
            let spreads = Some(surface.footprint[v].clone());
            CanvasPlaces::on_grid(grid, surface.points[v].clone(), spreads)
        }),
    };
    Paintable {
        layout: Arc::new(surface_layout(rays)),
        volumes: [Some(volume(0)), Some(volume(1))],
        density: surface.density.clone(),
    }
}

/// A field in training on a GPU.
#[derive(Debug)]
pub struct ResidentTraining {
    spec: FieldSpec,
    grids: DensityGrids,
    march: MarchSpec,
    app: AppearanceConfig,
    sides: [usize; 2],
}

impl ResidentTraining {
    /// `None` if the field, with an `app` on its samples, cannot stay on the device.
    pub fn new(
        field: &Field,
        app: &AppearanceConfig,
        (grids, visible): (&Grids, &Visible),
        device: &Device,
    ) -> Option<Self> {
        let spec = field.resident(app, device).filter(|_| plain(app))?;
        let flags = [&visible.inner[..], &visible.outer];
        Some(Self {
            spec,
            grids: DensityGrids::new([&grids.inner, &grids.outer], Some(flags), device),
            march: field.config.sampling.march(ANY),
            app: app.clone(),
            sides: [grids.inner.resolution(), grids.outer.resolution()],
        })
    }

    /// What [`Field::update_grids`] does.
    pub fn update_grids(&self, weights: &FieldWeights, shares: [f32; 2], seed: u32) {
        // What comes before `app` does not look at its weights.
        let none = &weights.inner.geo;
        let dense = self.sides.map(|side| DENSE * side as f32);
        let weights = volumes(weights, [none, none]);
        self.grids
            .update(&self.spec, &weights, (shares, dense), seed);
    }

    /// The loss of rays, as [`Field::loss`] gives it, and its gradients; grids take note of the
    /// densities. `surfaces` are distances of surfaces that are known on some of the rays, from
    /// which depths are measured; `directions` have any length.
    pub fn descend(
        &self,
        (weights, app): (&FieldWeights, &Appearance),
        (rays, surfaces): (&RayBatch, &[Option<f32>]),
        wanted: Wanted,
        seed: u64,
    ) -> Descent {
        let mut resident = Rays::default();
        let pairs = rays.origins.iter().zip(&rays.directions).zip(surfaces);
        for (ray, ((origin, direction), surface)) in pairs.enumerate() {
            let surface = surface.map(contracted_distance);
            resident.push(*origin, *direction, jitter(seed, ray), surface);
        }
        let samples = self.grids.march(&resident, &self.march);
        let targets = Targets {
            views: views(&samples.directions(), &self.app),
            colours: wanted.colours,
            depth: wanted.depth,
            distortion: wanted.distortion,
        };
        let weights = volumes(weights, [&app.inner, &app.outer]);
        let descent = gpu::descend(&self.spec, &samples, &weights, &targets);
        self.grids.observe(&samples, &descent.densities);
        descent
    }

    /// The grids as they are now; `None` if the device is lost.
    pub fn grids(&self) -> Option<Grids> {
        let [inner, outer] = self.grids.read();
        Some(Grids::new(inner?, outer?))
    }
}
