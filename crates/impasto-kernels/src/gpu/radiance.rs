//! From encoded samples to a photometric loss and back, out of the other kernels.

use super::composite::DeviceLayout;
use super::launch::{Rows, Uploaded, argument, cube, cubes_for, empty, extent, whole};
use super::{composite, mlp};
use crate::cpu::radiance::spec::{CHANNELS, DEPTH, DISTORTION, LIMIT, OUTPUTS};
use crate::{Density, MlpSpec, RadianceSpec, Volume, VolumeSpec};
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
        let at = ray * OUTPUTS;
        let mut error = 0.0f32;
        #[unroll]
        for c in 0..CHANNELS {
            let off = pixels[at + c] - targets[ray * CHANNELS + c];
            error += off * off / 3.0f32;
            grad[at + c] = off * share * 2.0f32 / 3.0f32;
        }
        // Of the opacity.
        grad[at + CHANNELS] = 0.0f32;
        grad[at + DEPTH] = depth * share;
        grad[at + DISTORTION] = distortion * share;
        errors[ray] = error * share;
        let with_depth = error + depth * pixels[at + DEPTH];
        losses[ray] = (with_depth + distortion * pixels[at + DISTORTION]) * share;
    }
}

/// Densities of some rows of what `geo` says.
fn densities(raw: &CubeTensor, density: Density, rows: Rows<'_>, out: &CubeTensor) {
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
fn densities_back(
    raw: &CubeTensor,
    density: Density,
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
    views: &Uploaded,
    view: usize,
    layout: &DeviceLayout,
    volume: usize,
    before: usize,
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
            volume as u32,
            before as u32,
            width,
            view,
        );
    }
    seen
}

/// One volume's samples on their way to features and densities, and back.
pub(crate) struct TrunkTape {
    encoded: CubeTensor,
    pub(crate) features: CubeTensor,
    raw: CubeTensor,
}

impl TrunkTape {
    /// Some rows of encoded samples, whose densities go to the same rows of `density`.
    pub(crate) fn new(
        encoded: CubeTensor,
        own: &VolumeSpec,
        weights: &Volume<CubeTensor>,
        rows: Rows<'_>,
        density: &CubeTensor,
    ) -> Self {
        let features = empty(&encoded, [rows.most(), own.base.outputs()]);
        mlp::forward_into(&encoded, &weights.base, &own.base, rows, &features);
        let raw = empty(&encoded, [rows.most(), 1]);
        mlp::forward_into(&features, &weights.geo, &own.geo, rows, &raw);
        densities(&raw, own.density, rows, density);
        Self {
            encoded,
            features,
            raw,
        }
    }

    /// Gradients of a volume's numbers by those of its densities and colours; `seen` is the input
    /// of `app`.
    pub(crate) fn back(
        &self,
        own: &VolumeSpec,
        weights: &Volume<CubeTensor>,
        seen: &CubeTensor,
        rows: Rows<'_>,
        [density, colours]: [&CubeTensor; 2],
    ) -> Volume<CubeTensor> {
        let back = |x: &CubeTensor, params: &CubeTensor, grad: &CubeTensor, spec: &MlpSpec| {
            let input_grad = empty(x, x.meta.shape().clone());
            let params_grad = mlp::backward_into(x, params, grad, spec, rows, Some(&input_grad));
            (input_grad, params_grad)
        };
        let (from_app, app) = back(seen, &weights.app, colours, &own.app);
        let raw = densities_back(&self.raw, own.density, density, rows);
        let (from_geo, geo) = back(&self.features, &weights.geo, &raw, &own.geo);
        let of_features = joined(from_app, from_geo);
        let (encoded, base) = back(&self.encoded, &weights.base, &of_features, &own.base);
        Volume {
            encoded,
            base,
            geo,
            app,
        }
    }
}

/// The gradient of features: what `app` says of them, without that of views, and what `geo` says.
fn joined(seen: CubeTensor, from_geo: CubeTensor) -> CubeTensor {
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
    let pixel_grads = empty(pixels, [rays, OUTPUTS]);
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
    let layout = DeviceLayout::of(like, &spec.layout);
    let views = Uploaded::f32(like, &spec.views);
    let [inner, outer] = [0, 1].map(|v| {
        let (volume, own) = (&volumes[v], &spec.volumes[v]);
        let density = empty(like, [counts[v]]);
        let encoded = volume.encoded.clone();
        let trunk = TrunkTape::new(encoded, own, volume, Rows::all(counts[v]), &density);
        let view = own.app.inputs() - own.base.outputs();
        let seen = with_views(&trunk.features, &views, view, &layout, v, v * counts[0]);
        let colours = mlp::forward(&seen, &volume.app, &own.app);
        (trunk, seen, density, colours)
    });
    let densities = CubeBackend::float_cat(vec![inner.2, outer.2], 0);
    let colours = CubeBackend::float_cat(vec![inner.3, outer.3], 0);
    let pixels = composite::forward(&layout, &densities, &colours);
    let targets = Uploaded::f32(like, &spec.targets);
    let weights = [spec.depth, spec.distortion];
    let ([losses, errors], pixel_grads) = pixel_loss(&pixels, &targets, weights);
    let (density_grads, colour_grads) = composite::backward(
        &layout,
        &densities,
        &colours,
        &pixel_grads,
        spec.learned_from,
    );
    let out = CubeBackend::float_cat(vec![losses, errors, densities], 0);
    let trunks = [(inner.0, inner.1), (outer.0, outer.1)];
    let grads = [0, 1].map(|v| {
        let own_rows = Slice::from(v * counts[0]..v * counts[0] + counts[v]);
        let part = |all: &CubeTensor| whole(CubeBackend::float_slice(all.clone(), &[own_rows]));
        let parts = [part(&density_grads), part(&colour_grads)];
        let (trunk, seen) = &trunks[v];
        let rows = Rows::all(counts[v]);
        let grads = trunk.back(&spec.volumes[v], &volumes[v], seen, rows, parts.each_ref());
        let length = grads.encoded.meta.num_elements();
        Volume {
            encoded: CubeBackend::float_reshape(grads.encoded, [length].into()),
            ..grads
        }
    });
    (out, grads)
}
