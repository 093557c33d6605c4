//! From encoded samples to a photometric loss and back, out of the other kernels.

use super::launch::{Uploaded, argument, cube, cubes_for, empty, whole};
use super::{composite, mlp};
use crate::cpu::radiance::LIMIT;
use crate::{Density, RadianceSpec, Volume, VolumeSpec};
use burn::backend::ops::FloatTensorOps;
use burn::tensor::Slice;
use burn_cubecl::CubeBackend;
use burn_cubecl::cubecl::{self, prelude::*};
use burn_cubecl::tensor::CubeTensor;

#[cube(launch_unchecked)]
fn density_kernel(raw: &[f32], out: &mut [f32], count: u32, #[comptime] density: Density) {
    let i = ABSOLUTE_POS;
    if i < count as usize {
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
    count: u32,
    #[comptime] density: Density,
) {
    let i = ABSOLUTE_POS;
    if i < count as usize {
        let x = raw[i];
        let slope = match comptime!(density) {
            Density::Exp => select(f32::abs(x) <= LIMIT, f32::exp(x), 0.0f32),
            Density::Abs => select(x > 0.0, 1.0f32, select(x < 0.0, -1.0f32, 0.0f32)),
        };
        out[i] = grad[i] * slope;
    }
}

/// Puts the view of its ray behind the features of every sample, one unit a ray.
#[cube(launch_unchecked)]
fn views_kernel(
    features: &[f32],
    views: &[f32],
    starts: &[u32],
    out: &mut [f32],
    rays: u32,
    #[comptime] width: usize,
    #[comptime] view: usize,
) {
    let ray = ABSOLUTE_POS;
    if ray < rays as usize {
        for sample in starts[ray] as usize..starts[ray + 1] as usize {
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
        spec: &RadianceSpec,
        (volume, own): (&Volume<CubeTensor>, &VolumeSpec),
        views: &Uploaded,
        starts: &[u32],
    ) -> Self {
        let encoded = &volume.encoded;
        let features = mlp::forward(encoded, &volume.base, &own.base);
        let raw = mlp::forward(&features, &volume.geo, &own.geo);
        let samples = features.meta.shape()[0];
        let density = empty(encoded, [samples]);
        let (width, view) = (own.base.outputs(), own.app.inputs() - own.base.outputs());
        let mut seen = features.clone();
        // SAFETY: units look at their own sample, or at those of their ray.
        unsafe {
            if samples > 0 {
                density_kernel::launch_unchecked(
                    &encoded.client,
                    cubes_for(samples),
                    cube(),
                    argument(&raw),
                    argument(&density),
                    samples as u32,
                    own.density,
                );
            }
            if samples > 0 && view > 0 {
                seen = empty(encoded, [samples, width + view]);
                let rays = spec.layout.rays.len();
                views_kernel::launch_unchecked(
                    &encoded.client,
                    cubes_for(rays),
                    cube(),
                    argument(&features),
                    views.argument(),
                    Uploaded::u32(encoded, starts).argument(),
                    argument(&seen),
                    rays as u32,
                    width,
                    view,
                );
            }
        }
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
        let samples = self.features.meta.shape()[0];
        let (seen, app) = mlp::backward(&self.seen, &volume.app, &colours, &own.app, true);
        let raw = empty(&density, [samples, 1]);
        if samples > 0 {
            // SAFETY: units look at their own sample.
            unsafe {
                slope_kernel::launch_unchecked(
                    &density.client,
                    cubes_for(samples),
                    cube(),
                    argument(&self.raw),
                    argument(&density),
                    argument(&raw),
                    samples as u32,
                    own.density,
                );
            }
        }
        let (from_geo, geo) = mlp::backward(&self.features, &volume.geo, &raw, &own.geo, true);
        let width = own.base.outputs();
        let from_app = seen.map(|seen| {
            let all = Slice::from(0..samples);
            CubeBackend::float_slice(seen, &[all, Slice::from(0..width)])
        });
        let features = match (from_app, from_geo) {
            (Some(a), Some(b)) => whole(CubeBackend::float_add(a, b)),
            _ => unreachable!("both were asked for"),
        };
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

/// Loss and error of composited pixels, and the loss's gradient for them.
fn pixel_loss(pixels: &CubeTensor, spec: &RadianceSpec) -> ([CubeTensor; 2], CubeTensor) {
    let rays = spec.layout.rays.len();
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
                Uploaded::f32(pixels, &spec.targets).argument(),
                argument(&errors),
                argument(&losses),
                argument(&pixel_grads),
                spec.depth,
                spec.distortion,
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
    let views = Uploaded::f32(like, &spec.views);
    let starts = spec.starts();
    let shaded =
        [0, 1].map(|v| Shaded::new(spec, (&volumes[v], &spec.volumes[v]), &views, &starts[v]));
    let [inner, outer] = &shaded;
    let densities = CubeBackend::float_cat(vec![inner.density.clone(), outer.density.clone()], 0);
    let colours = CubeBackend::float_cat(vec![inner.colours.clone(), outer.colours.clone()], 0);
    let pixels = composite::forward(&spec.layout, &densities, &colours);
    let ([losses, errors], pixel_grads) = pixel_loss(&pixels, spec);
    let (density_grads, colour_grads) =
        composite::backward(&spec.layout, &densities, &colours, &pixel_grads);
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
