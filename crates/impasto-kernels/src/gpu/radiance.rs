//! From encoded samples to a photometric loss and back, out of the other kernels.

use super::composite::Layout;
use super::launch::{Rows, Uploaded, argument, cube, cubes_for, empty, extent, whole};
use super::{composite, mlp};
use crate::cpu::radiance::LIMIT;
use crate::{Density, RadianceSpec, Volume, VolumeSpec};
use burn::backend::ops::FloatTensorOps;
use burn::tensor::Slice;
use burn_cubecl::CubeBackend;
use burn_cubecl::cubecl::{self, prelude::*};
use burn_cubecl::tensor::CubeTensor;

#[cube(launch_unchecked)]
fn density_kernel(
    raw: &[f32],
    out: &mut [f32],
    bounds: &[u32],
    bound: u32,
    most: u32,
    #[comptime] bounded: bool,
    #[comptime] density: Density,
) {
    let i = ABSOLUTE_POS;
    let (start, end) = extent(bounds, bound, most, bounded);
    if i >= start && i < end {
        let x = raw[i];
        out[i] = match comptime!(density) {
            Density::Exp => f32::exp(x.clamp(-LIMIT, LIMIT)),
            Density::Abs => f32::abs(x),
        };
    }
}

/// Turns the gradients of densities into those of what they were made from.
#[cube(launch_unchecked)]
fn slope_kernel(
    raw: &[f32],
    grad: &[f32],
    out: &mut [f32],
    bounds: &[u32],
    bound: u32,
    most: u32,
    #[comptime] bounded: bool,
    #[comptime] density: Density,
) {
    let i = ABSOLUTE_POS;
    let (start, end) = extent(bounds, bound, most, bounded);
    if i >= start && i < end {
        let x = raw[i];
        let slope = match comptime!(density) {
            Density::Exp => select(f32::abs(x) <= LIMIT, f32::exp(x), 0.0f32),
            Density::Abs => select(x > 0.0, 1.0f32, select(x < 0.0, -1.0f32, 0.0f32)),
        };
        out[i] = grad[i] * slope;
    }
}

/// Puts the view of its ray behind the features of every sample of a volume, whose rows begin behind
/// `before` samples, one unit a ray.
#[cube(launch_unchecked)]
fn views_kernel(
    features: &[f32],
    views: &[f32],
    spans: &[u32],
    out: &mut [f32],
    rays: u32,
    volume: u32,
    before: u32,
    #[comptime] width: usize,
    #[comptime] view: usize,
) {
    let ray = ABSOLUTE_POS;
    if ray < rays as usize {
        let span = 4 * ray + 2 * volume as usize;
        for index in spans[span] as usize..spans[span + 1] as usize {
            let sample = index - before as usize;
            let at = sample * comptime!(width + view);
            for c in 0..width {
                out[at + c] = features[sample * width + c];
            }
            for c in 0..view {
                out[at + width + c] = views[ray * view + c];
            }
        }
    }
}

/// Squared difference of colours and weighted sum of all that counts, of each ray, with the
/// gradient of their means.
#[cube(launch_unchecked)]
fn loss_kernel(
    pixels: &[f32],
    targets: &[f32],
    errors: &mut [f32],
    losses: &mut [f32],
    grad: &mut [f32],
    depth: f32,
    distortion: f32,
    rays: u32,
) {
    let ray = ABSOLUTE_POS;
    if ray < rays as usize {
        let share = 1.0f32 / f32::cast_from(rays);
        let at = ray * 6;
        let mut error = 0.0f32;
        #[unroll]
        for c in 0..3usize {
            let off = pixels[at + c] - targets[ray * 3 + c];
            error += off * off / 3.0f32;
            grad[at + c] = off * share * 2.0f32 / 3.0f32;
        }
        grad[at + 3] = 0.0f32;
        grad[at + 4] = depth * share;
        grad[at + 5] = distortion * share;
        errors[ray] = error * share;
        losses[ray] = (error + depth * pixels[at + 4] + distortion * pixels[at + 5]) * share;
    }
}

/// Densities of some rows of what `geo` says.
pub(crate) fn densities(raw: &CubeTensor, density: Density, rows: Rows<'_>, out: &CubeTensor) {
    if rows.most() == 0 {
        return;
    }
    let (bounds, bound, most) = rows.arguments(raw);
    // SAFETY: units look at their own sample.
    unsafe {
        density_kernel::launch_unchecked(
            &raw.client,
            cubes_for(rows.most()),
            cube(),
            argument(raw),
            argument(out),
            bounds,
            bound,
            most,
            rows.bounded(),
            density,
        );
    }
}

/// The gradient of some rows of what `geo` says, by that of densities, in the same places of a new
/// tensor.
pub(crate) fn densities_back(
    (raw, density): (&CubeTensor, Density),
    grad: &CubeTensor,
    rows: Rows<'_>,
) -> CubeTensor {
    let out = empty(grad, [rows.most(), 1]);
    if rows.most() > 0 {
        let (bounds, bound, most) = rows.arguments(raw);
        // SAFETY: units look at their own sample.
        unsafe {
            slope_kernel::launch_unchecked(
                &grad.client,
                cubes_for(rows.most()),
                cube(),
                argument(raw),
                argument(grad),
                argument(&out),
                bounds,
                bound,
                most,
                rows.bounded(),
                density,
            );
        }
    }
    out
}

/// The views of rays, `[rays · view]`, behind the features of a volume's samples, in a tensor of as
/// many rows. A volume's rows begin behind `before` samples of the layout.
pub(crate) fn with_views(
    features: &CubeTensor,
    (views, view): (&Uploaded, usize),
    layout: &Layout,
    (volume, before): (u32, usize),
) -> CubeTensor {
    let [samples, width] = [0, 1].map(|axis| features.meta.shape()[axis]);
    if samples == 0 || view == 0 || layout.rays == 0 {
        return features.clone();
    }
    let seen = empty(features, [samples, width + view]);
    // SAFETY: units look at their own ray's samples.
    unsafe {
        views_kernel::launch_unchecked(
            &features.client,
            cubes_for(layout.rays),
            cube(),
            argument(features),
            views.argument(),
            layout.spans.argument(),
            argument(&seen),
            layout.rays as u32,
            volume,
            before as u32,
            width,
            view,
        );
    }
    seen
}

/// One volume's samples on their way to colours and back.
struct Shaded {
    features: CubeTensor,
    raw: CubeTensor,
    density: CubeTensor,
    seen: CubeTensor,
    colours: CubeTensor,
}

impl Shaded {
    fn new(
        (volume, own): (&Volume<CubeTensor>, &VolumeSpec),
        views: &Uploaded,
        layout: &Layout,
        place: (u32, usize),
    ) -> Self {
        let encoded = &volume.encoded;
        let features = mlp::forward(encoded, &volume.base, &own.base);
        let raw = mlp::forward(&features, &volume.geo, &own.geo);
        let samples = features.meta.shape()[0];
        let density = empty(encoded, [samples]);
        densities(&raw, own.density, Rows::all(samples), &density);
        let view = own.app.inputs() - own.base.outputs();
        let seen = with_views(&features, (views, view), layout, place);
        let colours = mlp::forward(&seen, &volume.app, &own.app);
        Self {
            features,
            raw,
            density,
            seen,
            colours,
        }
    }

    /// Gradients of the volume's numbers, given those of its densities and colours.
    fn back(
        &self,
        (volume, own): (&Volume<CubeTensor>, &VolumeSpec),
        (density, colours): (CubeTensor, CubeTensor),
    ) -> Volume<CubeTensor> {
        let rows = Rows::all(self.features.meta.shape()[0]);
        let (seen, app) = mlp::backward(&self.seen, &volume.app, &colours, &own.app, true);
        let raw = densities_back((&self.raw, own.density), &density, rows);
        let (from_geo, geo) = mlp::backward(&self.features, &volume.geo, &raw, &own.geo, true);
        let (Some(seen), Some(from_geo)) = (seen, from_geo) else {
            unreachable!("both were asked for");
        };
        let features = joined(seen, from_geo);
        let (encoded, base) =
            mlp::backward(&volume.encoded, &volume.base, &features, &own.base, true);
        let Some(encoded) = encoded else {
            unreachable!("it was asked for");
        };
        let length = encoded.meta.num_elements();
        Volume {
            encoded: CubeBackend::float_reshape(encoded, [length].into()),
            base,
            geo,
            app,
        }
    }
}

/// The gradient of features: what `app` says of them, without that of views, and what `geo` says.
pub(crate) fn joined(seen: CubeTensor, from_geo: CubeTensor) -> CubeTensor {
    let [samples, width] = [0, 1].map(|axis| from_geo.meta.shape()[axis]);
    let of_features = [Slice::from(0..samples), Slice::from(0..width)];
    let from_app = CubeBackend::float_slice(seen, &of_features);
    whole(CubeBackend::float_add(from_app, from_geo))
}

/// Loss and error of composited pixels, each one number, and the loss's gradient for them.
/// `weights` are those of depth and distortion.
pub(crate) fn pixel_loss(
    pixels: &CubeTensor,
    targets: &Uploaded,
    [depth, distortion]: [f32; 2],
) -> ([CubeTensor; 2], CubeTensor) {
    let rays = pixels.meta.shape()[0];
    let (errors, losses) = (empty(pixels, [rays]), empty(pixels, [rays]));
    let pixel_grads = empty(pixels, [rays, 6]);
    if rays > 0 {
        // SAFETY: units look at their own ray.
        unsafe {
            loss_kernel::launch_unchecked(
                &pixels.client,
                cubes_for(rays),
                cube(),
                argument(pixels),
                targets.argument(),
                argument(&errors),
                argument(&losses),
                argument(&pixel_grads),
                depth,
                distortion,
                rays as u32,
            );
        }
    }
    let sums = [losses, errors].map(CubeBackend::float_sum);
    (sums, pixel_grads)
}

/// See [`crate::cpu::radiance::loss`]: loss, error and densities in one tensor, and gradients.
///
/// # Panics
/// If samples are not packed as stated there.
pub(crate) fn loss(
    volumes: [Volume<CubeTensor>; 2],
    spec: &RadianceSpec,
) -> (CubeTensor, [Volume<CubeTensor>; 2]) {
    let counts = spec.check([0, 1].map(|v| volumes[v].encoded.meta.num_elements()));
    let mut v = 0;
    let volumes = volumes.map(|volume| {
        let width = spec.volumes[v].base.inputs();
        let shape = [counts[v], width];
        v += 1;
        Volume {
            encoded: CubeBackend::float_reshape(whole(volume.encoded), shape.into()),
            base: whole(volume.base),
            geo: whole(volume.geo),
            app: whole(volume.app),
        }
    });
    let like = &volumes[0].base;
    let layout = Layout::of(like, &spec.layout);
    let views = Uploaded::f32(like, &spec.views);
    let shaded = [0, 1].map(|v| {
        let place = (v as u32, v * counts[0]);
        Shaded::new((&volumes[v], &spec.volumes[v]), &views, &layout, place)
    });
    let [inner, outer] = &shaded;
    let densities = CubeBackend::float_cat(vec![inner.density.clone(), outer.density.clone()], 0);
    let colours = CubeBackend::float_cat(vec![inner.colours.clone(), outer.colours.clone()], 0);
    let pixels = composite::forward(&layout, &densities, &colours);
    let targets = Uploaded::f32(like, &spec.targets);
    let weights = [spec.depth, spec.distortion];
    let ([losses, errors], pixel_grads) = pixel_loss(&pixels, &targets, weights);
    let (density_grads, colour_grads) =
        composite::backward(&layout, &densities, &colours, &pixel_grads);
    let out = CubeBackend::float_cat(vec![losses, errors, densities], 0);
    let split = |from: usize, to: usize, tensor: &CubeTensor| {
        whole(CubeBackend::float_slice(
            tensor.clone(),
            &[Slice::from(from..to)],
        ))
    };
    let all = counts[0] + counts[1];
    let parts = [(0, counts[0]), (counts[0], all)].map(|(from, to)| {
        (
            split(from, to, &density_grads),
            split(from, to, &colour_grads),
        )
    });
    let [inner_part, outer_part] = parts;
    let grads = [
        inner.back((&volumes[0], &spec.volumes[0]), inner_part),
        outer.back((&volumes[1], &spec.volumes[1]), outer_part),
    ];
    (out, grads)
}
