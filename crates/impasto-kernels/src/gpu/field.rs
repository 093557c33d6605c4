//! What stays on a GPU from one step to the next: density grids, the samples that rays have in
//! them, and all that is computed of these. The host says which rays; nothing comes back unless it
//! is asked for.
//!
//! How many samples lie in the inner volume only the device knows, so both volumes' rows stand in
//! buffers with room for all of a batch's samples: inner ones first, outer ones behind them.

use super::composite::{self, DeviceLayout};
use super::density_grid::{self, Cells, Places};
use super::launch::{Rows, Uploaded, empty, from_slice, from_u32, whole};
use super::march::{self, Marched};
use super::radiance::{self, TrunkTape};
use super::{hash_grid, merge, mlp};
use crate::{CompositeLayout, DensityGrid, HashGridSpec, OccupancySpec, Volume, VolumeSpec};
use burn::backend::ops::FloatTensorOps;
use burn::tensor::{Device, Int, Slice, Tensor};
use burn_cubecl::CubeBackend;
use burn_cubecl::tensor::CubeTensor;

/// Networks of both volumes, and the hash grids before them.
#[derive(Debug, Clone)]
pub struct FieldSpec {
    /// Encodings, inner and outer volume.
    pub grids: [HashGridSpec; 2],
    /// Layers.
    pub volumes: [VolumeSpec; 2],
}

impl FieldSpec {
    /// Whether every GPU can compute all of it here.
    pub fn fits(&self) -> bool {
        let networks = self.volumes.iter().flat_map(|v| [&v.base, &v.geo, &v.app]);
        networks.into_iter().all(mlp::fits)
    }

    /// Most numbers of a sample in one tensor.
    pub fn widest(&self) -> usize {
        let networks = self.volumes.iter().flat_map(|v| [&v.base, &v.geo, &v.app]);
        let widths = networks.flat_map(|network| [network.inputs(), network.outputs()]);
        widths.max().unwrap_or(1).max(4)
    }
}

fn primitive<const D: usize>(tensor: Tensor<D>) -> CubeTensor {
    match tensor.try_into_primitive::<CubeBackend>() {
        Ok(tensor) => whole(tensor),
        Err(_) => unreachable!("what stays on a GPU is made of tensors of that GPU"),
    }
}

fn tensor<const D: usize>(primitive: CubeTensor) -> Tensor<D> {
    Tensor::from_primitive::<CubeBackend>(primitive)
}

/// Rays for [`DensityGrids::march`]. Directions have any length but zero.
#[derive(Debug, Clone, Default)]
pub struct Rays(Vec<f32>);

impl Rays {
    /// Adds a ray: where its samples lie in their parts, in `[0, 1)`, and the contracted distance of
    /// a surface that is known on it.
    pub fn push(
        &mut self,
        origin: [f32; 3],
        direction: [f32; 3],
        shift: f32,
        surface: Option<f32>,
    ) {
        self.0.extend(origin);
        self.0.extend(direction);
        self.0.extend([shift, surface.unwrap_or(-1.0)]);
    }
}

/// Density grids of both volumes on a GPU.
#[derive(Debug, Clone)]
pub struct DensityGrids {
    cells: [Cells; 2],
    /// Cells that may be looked at, and how many they are.
    visible: [(CubeTensor, usize); 2],
}

impl DensityGrids {
    /// Copies grids to a GPU. Of each one only `visible` cells, one flag a cell, are ever looked at
    /// by [`Self::update`]; without flags all are.
    ///
    /// # Panics
    /// If the device is the CPU, or flags are not as many as cells.
    pub fn new(grids: [&DensityGrid; 2], visible: Option<[&[bool]; 2]>, device: &Device) -> Self {
        let like = primitive(Tensor::<1>::zeros([1], device));
        let cells = grids.map(|grid| {
            let levels: Vec<u32> = grid.levels().iter().map(|l| u32::from(*l)).collect();
            Cells {
                opacity: from_slice(&like, grid.opacities(), [grid.cells()]),
                levels: from_u32(&like, &levels),
                side: grid.resolution(),
            }
        });
        let flags = [0, 1].map(|v| match visible {
            Some(flags) => flags[v].iter().map(|flag| u32::from(*flag)).collect(),
            None => vec![1; grids[v].cells()],
        });
        let visible = [0, 1].map(|v| {
            let flags: &Vec<u32> = &flags[v];
            assert_eq!(flags.len(), grids[v].cells(), "flags of a grid's cells");
            let count = flags.iter().sum::<u32>() as usize;
            (from_u32(&like, flags), count)
        });
        Self { cells, visible }
    }

    /// The grids as they are now, on the host, with what was observed.
    pub fn read(&self) -> [Option<DensityGrid>; 2] {
        self.cells.each_ref().map(|cells| {
            let levels = Tensor::<1, Int>::from_primitive::<CubeBackend>(cells.levels.clone());
            let levels = levels.try_into_vec_as::<u32>().ok()?;
            let opacity = Tensor::<1>::from_primitive::<CubeBackend>(cells.opacity.clone());
            let opacity = opacity.try_into_vec_as::<f32>().ok()?;
            DensityGrid::from_levels(levels.into_iter().map(|level| level as u8).collect())?
                .with_observed(opacity)
        })
    }

    /// Places samples along rays where the grids expect their light, as
    /// [`crate::sampling::least_weight`] says.
    ///
    /// # Panics
    /// If there are no rays.
    pub fn march(&self, rays: &Rays, spec: &OccupancySpec, least_weight: f32) -> RaySamples {
        let [inner, outer] = &self.cells;
        let count = rays.0.len() / march::RAY;
        let rays = from_slice(&inner.levels, rays.0.clone(), [count, march::RAY]);
        let levels = [&inner.levels, &outer.levels];
        RaySamples {
            marched: march::march(&rays, levels, [inner.side, outer.side], spec, least_weight),
            rays,
        }
    }

    /// Takes note of the densities of samples, `[n]`, until the next [`Self::update`].
    pub fn observe(&self, samples: &RaySamples, densities: &Tensor<1>) {
        let densities = primitive(densities.clone());
        for (v, cells) in self.cells.iter().enumerate() {
            let points = &samples.marched.points;
            density_grid::observe(cells, points, &densities, samples.rows(v));
        }
    }

    /// Takes note of the densities at random places: in `shares[0]` of the cells under the level of
    /// `dense`, a density per volume, and in `shares[1]` of the others. Every cell's level is then
    /// what was observed of it.
    pub fn update(
        &self,
        spec: &FieldSpec,
        weights: &[Volume<Tensor<1>>; 2],
        (shares, dense): ([f32; 2], [f32; 2]),
        seed: u32,
    ) {
        for (v, cells) in self.cells.iter().enumerate() {
            let (visible, count) = &self.visible[v];
            // Room for more than the larger share is ever expected to draw.
            let most = (*count as f32 * shares[0].max(shares[1]) * 1.1) as usize + 256;
            let dense = DensityGrid::level_of(dense[v]);
            let seed = seed.wrapping_add(v as u32);
            let places = Places {
                shares,
                dense,
                outer: v == 1,
                seed,
                most,
            };
            let (points, bounds) = density_grid::draw(cells, visible, &places);
            let rows = Rows::between(&bounds, 0, most);
            let volume = weights[v].clone().map(primitive);
            let density = empty(&points, [most]);
            trunk(&points, spec, &volume, v, rows, &density);
            density_grid::observe(cells, &points, &density, rows);
            density_grid::settle(cells);
        }
    }
}

/// Samples of a batch of rays.
#[derive(Clone)]
pub struct RaySamples {
    marched: Marched,
    rays: CubeTensor,
}

/// A batch of samples as the host sees it.
#[derive(Debug, Clone)]
pub struct SamplesRead {
    /// `n × 3`, in the unit cube: inner samples ray by ray, then outer ones.
    pub points: Vec<f32>,
    /// Start and end of the inner, then of the outer samples of each ray.
    pub spans: Vec<u32>,
    /// Step lengths, depths, contracted distances and distances from known surfaces, `n` each.
    pub steps: Vec<f32>,
}

impl RaySamples {
    /// Number of rays.
    pub fn rays(&self) -> usize {
        self.rays.meta.shape()[0]
    }

    /// Unit directions of the rays, `[rays, 3]`.
    pub fn directions(&self) -> Tensor<2> {
        let directions = tensor::<2>(self.rays.clone()).slice_dim(1, 3..6);
        let lengths = directions.clone().square().sum_dim(1).sqrt();
        directions / lengths
    }

    fn count(&self) -> usize {
        self.marched.points.meta.shape()[0]
    }

    fn rows(&self, volume: usize) -> Rows<'_> {
        Rows::between(&self.marched.bounds, volume as u32, self.count())
    }

    /// The layout; of known surfaces, with the distances from them for depths.
    fn layout(&self, from_surfaces: bool) -> DeviceLayout {
        DeviceLayout {
            spans: Uploaded::of(&self.marched.spans),
            steps: Uploaded::of(&self.marched.steps),
            rays: self.rays(),
            samples: self.count(),
            depths: if from_surfaces { 3 } else { 1 },
        }
    }

    /// Copies them to the host; empty if the device is lost.
    pub fn read(&self) -> SamplesRead {
        let spans = Tensor::<1, Int>::from_primitive::<CubeBackend>(self.marched.spans.clone());
        let numbers = |of: &CubeTensor| {
            let numbers = tensor::<2>(of.clone()).try_into_vec_as::<f32>();
            numbers.unwrap_or_default()
        };
        SamplesRead {
            points: numbers(&self.marched.points),
            spans: spans.try_into_vec_as::<u32>().unwrap_or_default(),
            steps: numbers(&self.marched.steps),
        }
    }
}

/// A volume's samples at some rows of points, whose densities go to the same rows of `density`.
fn trunk(
    points: &CubeTensor,
    spec: &FieldSpec,
    weights: &Volume<CubeTensor>,
    volume: usize,
    rows: Rows<'_>,
    density: &CubeTensor,
) -> TrunkTape {
    let grid = &spec.grids[volume];
    let encoded = empty(points, [rows.most(), grid.outputs()]);
    hash_grid::encode_into(points, &weights.encoded, grid, rows, &encoded);
    TrunkTape::new(encoded, &spec.volumes[volume], weights, rows, density)
}

/// What rays should look like, and what else counts.
#[derive(Debug, Clone)]
pub struct Targets {
    /// Encoded views, `[rays, …]`; `None` if `app` does not see them.
    pub views: Option<Tensor<2>>,
    /// Wanted colours, `rays × 3`.
    pub colours: Vec<f32>,
    /// Weight of the mean distance of light from known surfaces.
    pub depth: f32,
    /// Weight of the mean distortion.
    pub distortion: f32,
    /// Distance from which on samples get their whole gradient; see [`crate::RadianceSpec`].
    pub learned_from: f32,
}

/// A loss and its gradients.
#[derive(Debug, Clone)]
pub struct Descent {
    /// The loss and its mean squared difference of colours, `[2]`.
    pub loss: Tensor<1>,
    /// Density of each sample.
    pub densities: Tensor<1>,
    /// Gradients of hash tables (in the place of encodings) and networks.
    pub gradients: [Volume<Tensor<1>>; 2],
}

/// The loss of [`crate::ops::radiance_loss`] with its gradients for hash tables and networks, all
/// without autodiff. `weights` hold the hash tables in the place of encodings.
///
/// # Panics
/// If targets are not as many as rays.
pub fn descend(
    spec: &FieldSpec,
    samples: &RaySamples,
    weights: &[Volume<Tensor<1>>; 2],
    targets: &Targets,
) -> Descent {
    assert_eq!(targets.colours.len(), 3 * samples.rays(), "wanted colours");
    let points = &samples.marched.points;
    let weights = weights.clone().map(|volume| volume.map(primitive));
    let views = targets.views.clone().map(primitive);
    let layout = samples.layout(true);
    let density = empty(points, [samples.count()]);
    let trunks = [0, 1].map(|v| trunk(points, spec, &weights[v], v, samples.rows(v), &density));
    let apps = weights.each_ref().map(|volume| &volume.app);
    let features = trunks.each_ref().map(|trunk| &trunk.features);
    let (seen, colours) = shade(&spec.volumes, samples, features, apps, views.as_ref());
    let pixels = composite::forward(&layout, &density, &colours);
    let wanted = Uploaded::f32(points, &targets.colours);
    let counted = [targets.depth, targets.distortion];
    let ([loss, error], pixel_grads) = radiance::pixel_loss(&pixels, &wanted, counted);
    let (density_grads, colour_grads) = composite::backward(
        &layout,
        &density,
        &colours,
        &pixel_grads,
        targets.learned_from,
    );
    let gradients = [0, 1].map(|v| {
        let (own, rows) = (&spec.volumes[v], samples.rows(v));
        let grads = [&density_grads, &colour_grads];
        let grads = trunks[v].back(own, &weights[v], &seen[v], rows, grads);
        let table = hash_grid::encode_backward(points, &grads.encoded, &spec.grids[v], rows);
        Volume {
            encoded: table,
            ..grads
        }
    });
    Descent {
        loss: tensor(CubeBackend::float_cat(vec![loss, error], 0)),
        densities: tensor(density),
        gradients: gradients.map(|volume| volume.map(tensor)),
    }
}

/// Inputs of `app` and the colours that it gives all samples, `[n, 3]`.
fn shade(
    volumes: &[VolumeSpec; 2],
    samples: &RaySamples,
    features: [&CubeTensor; 2],
    apps: [&CubeTensor; 2],
    views: Option<&CubeTensor>,
) -> ([CubeTensor; 2], CubeTensor) {
    let layout = samples.layout(false);
    let colours = empty(features[0], [samples.count(), 3]);
    let seen = [0, 1].map(|v| {
        let own = &volumes[v].app;
        let view = own.inputs() - features[v].meta.shape()[1];
        let length = views.map_or(0, |views| views.meta.num_elements());
        assert_eq!(length, view * samples.rays(), "encoded views");
        let seen = match views {
            Some(views) => {
                radiance::with_views(features[v], &Uploaded::of(views), view, &layout, v, 0)
            }
            None => features[v].clone(),
        };
        mlp::forward_into(&seen, apps[v], own, samples.rows(v), &colours);
        seen
    });
    (seen, colours)
}

/// Features and densities of the samples of rays.
#[derive(Clone)]
pub struct FieldSamples {
    samples: RaySamples,
    features: [CubeTensor; 2],
    density: CubeTensor,
}

/// One sample a ray and volume: the means of all, by their weights.
#[derive(Debug, Clone)]
pub struct MergedSamples {
    /// Mean features, inner and outer volume, `[rays, width]`.
    pub features: [Tensor<2>; 2],
    /// Mean points in the unit cube, `[rays, 3]`.
    pub points: [Tensor<2>; 2],
    /// Standard deviation of where the light comes from, in the unit cube, `[rays]`.
    pub footprint: [Tensor<1>; 2],
    /// Optical depths, `[2 · rays]`: all inner ones, then all outer ones.
    pub density: Tensor<1>,
    /// Depth at which half of a ray's light has been gathered, `[rays]`.
    pub depth: Tensor<1>,
}

/// Features and densities of samples. `weights` hold the hash tables in the place of encodings;
/// `app` is not looked at.
pub fn evaluate(
    spec: &FieldSpec,
    samples: RaySamples,
    weights: &[Volume<Tensor<1>>; 2],
) -> FieldSamples {
    let points = &samples.marched.points;
    let density = empty(points, [samples.count()]);
    let features = [0, 1].map(|v| {
        let volume = weights[v].clone().map(primitive);
        trunk(points, spec, &volume, v, samples.rows(v), &density).features
    });
    FieldSamples {
        samples,
        features,
        density,
    }
}

impl FieldSamples {
    /// Shades every sample and composites: `[rays, 6]` as of [`crate::ops::composite`]. `volumes`
    /// say the layers of `app`, `apps` its parameters, `views` are the rays' encoded views, `[rays,
    /// …]`, where `app` sees them.
    pub fn composite(
        &self,
        volumes: &[VolumeSpec; 2],
        apps: [Tensor<1>; 2],
        views: Option<Tensor<2>>,
    ) -> Tensor<2> {
        let (apps, views) = (apps.map(primitive), views.map(primitive));
        let (features, apps) = (self.features.each_ref(), apps.each_ref());
        let (_, colours) = shade(volumes, &self.samples, features, apps, views.as_ref());
        let layout = self.samples.layout(false);
        tensor(composite::forward(&layout, &self.density, &colours))
    }

    /// The same rays with one sample a volume.
    pub fn accumulate(&self) -> MergedSamples {
        let layout = self.samples.layout(false);
        let points = &self.samples.marched.points;
        let merged = merge::merge(&layout, &self.density, points);
        let [inner, outer] = &self.features;
        let features = [(inner, 0), (outer, 1)]
            .map(|(own, v)| tensor(merge::means(&layout, own, &merged.shares, v)));
        let rays = self.samples.rays();
        let halves = |of: &CubeTensor| {
            [0..rays, rays..2 * rays]
                .map(|rows| CubeBackend::float_slice(of.clone(), &[Slice::from(rows)]))
        };
        MergedSamples {
            features,
            points: halves(&merged.points).map(tensor),
            footprint: halves(&merged.footprint).map(tensor),
            density: tensor(merged.density),
            depth: tensor(merged.depth),
        }
    }
}

/// The layout of merged samples: those of [`MergedSamples`]. Depths are not known to it.
pub fn surface_layout(rays: usize) -> CompositeLayout {
    let spans = (0..rays).map(|ray| crate::RaySpan {
        inner: ray..ray + 1,
        outer: rays + ray..rays + ray + 1,
    });
    CompositeLayout {
        rays: spans.collect(),
        deltas: vec![1.0; 2 * rays],
        depths: vec![0.0; 2 * rays],
        distances: vec![0.0; 2 * rays],
    }
}
