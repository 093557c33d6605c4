//! Gaussians on a picture, as viewers draw them: projected to first order, then blended from front
//! to back in the order of their means.

use glam::{Mat3, Vec2, Vec3};
use rayon::prelude::*;

use crate::splats::Splat;
use crate::views::Pinhole;

/// Added to a projected Gaussian's variances, in square pixels, as the first 3DGS program did and
/// viewers do.
const BLUR: f32 = 0.3;
/// Less opacity than this is not drawn.
const FAINTEST: f32 = 1.0 / 255.0;
/// Opacity of a splat is cut off here.
const MOST: f32 = 0.99;
/// A pixel with less than this left to fill is full.
const FULL: f32 = 1e-4;
/// Rows that one task draws.
const BAND: usize = 16;

/// A Gaussian on the picture.
#[derive(Debug, Clone, Copy)]
struct ProjectedGaussian {
    splat: u32,
    depth: f32,
    mean: Vec2,
    /// The inverse covariance: xx, xy, yy.
    conic: Vec3,
    /// Half the sides of what holds all of it that is drawn.
    reach: Vec2,
}

fn projected(camera: &Pinhole, splat: &Splat, index: u32) -> Option<ProjectedGaussian> {
    let local = camera.local(splat.position);
    if local.z < 1e-3 || splat.opacity <= FAINTEST {
        return None;
    }
    // Far outside of the picture the projection's first order runs away.
    let size = Vec2::new(camera.width as f32, camera.height as f32);
    let limit = 1.3 * 0.5 * size / camera.focal;
    let at = (local.truncate() / local.z).clamp(-limit, limit);
    let (fx, fy) = (camera.focal.x / local.z, camera.focal.y / local.z);
    let axes = camera.rotation.transpose()
        * Mat3::from_quat(splat.rotation)
        * Mat3::from_diagonal(splat.scale);
    let rows = axes.transpose();
    let across = fx * (rows.x_axis - at.x * rows.z_axis);
    let down = fy * (rows.y_axis - at.y * rows.z_axis);
    let variance = |axis: Vec3| axis.length_squared() + BLUR;
    let (xx, xy, yy) = (variance(across), across.dot(down), variance(down));
    let determinant = xx * yy - xy * xy;
    let radius = 2.0 * (splat.opacity / FAINTEST).ln();
    let reach = (radius * Vec2::new(xx, yy)).map(f32::sqrt);
    let mean = camera.project(local);
    let outside = (mean + reach).cmplt(Vec2::ZERO) | (mean - reach).cmpgt(size);
    (determinant > 0.0 && !outside.any()).then_some(ProjectedGaussian {
        splat: index,
        depth: local.z,
        mean,
        conic: Vec3::new(yy, -xy, xx) / determinant,
        reach,
    })
}

/// The Gaussians of a view from front to back.
fn sorted(camera: &Pinhole, splats: &[Splat]) -> Vec<ProjectedGaussian> {
    let numbered = splats.par_iter().enumerate();
    let found = numbered.filter_map(|(i, splat)| projected(camera, splat, i as u32));
    let mut gaussians: Vec<ProjectedGaussian> = found.collect();
    gaussians.par_sort_by(|a, b| a.depth.total_cmp(&b.depth));
    gaussians
}

/// Rows of a picture in the making.
struct Band {
    top: usize,
    width: usize,
    colours: Vec<Vec3>,
    /// What share of each pixel's light is still open.
    open: Vec<f32>,
}

impl Band {
    fn new(camera: &Pinhole, top: usize) -> Self {
        let pixels = BAND.min(camera.height - top) * camera.width;
        Self {
            top,
            width: camera.width,
            colours: vec![Vec3::ZERO; pixels],
            open: vec![1.0; pixels],
        }
    }

    /// Draws one Gaussian and passes on each pixel: its index, the Gaussian's value there, the
    /// opacity, and the share of light that was open before.
    fn draw(
        &mut self,
        gaussian: &ProjectedGaussian,
        splat: &Splat,
        mut visit: impl FnMut(usize, f32, f32, f32),
    ) {
        let ProjectedGaussian {
            mean, conic, reach, ..
        } = *gaussian;
        let bounds = |mean: f32, reach: f32, first: usize, count: usize| {
            let low = (mean - reach - 0.5).ceil().max(first as f32) as usize;
            let high = (mean + reach - 0.5).floor() + 1.0;
            (low, (high.max(0.0) as usize).min(first + count))
        };
        let (left, right) = bounds(mean.x, reach.x, 0, self.width);
        let (top, bottom) = bounds(mean.y, reach.y, self.top, self.open.len() / self.width);
        for y in top..bottom {
            let dy = y as f32 + 0.5 - mean.y;
            for x in left..right {
                let index = (y - self.top) * self.width + x;
                let open = self.open[index];
                if open < FULL {
                    continue;
                }
                let dx = x as f32 + 0.5 - mean.x;
                let power = 0.5 * (conic.x * dx * dx + conic.z * dy * dy) + conic.y * dx * dy;
                let share = (-power).exp();
                let opacity = (splat.opacity * share).min(MOST);
                if opacity < FAINTEST {
                    continue;
                }
                self.colours[index] += splat.colour * (open * opacity);
                self.open[index] = open * (1.0 - opacity);
                visit(index, share, opacity, open);
            }
        }
    }
}

/// Does something for each band of a picture with the Gaussians that touch it, front to back.
fn in_bands<T: Send>(
    camera: &Pinhole,
    splats: &[Splat],
    work: impl Fn(Band, &[ProjectedGaussian]) -> T + Sync,
) -> Vec<T> {
    let gaussians = sorted(camera, splats);
    let count = camera.height.div_ceil(BAND);
    let mut lists = vec![Vec::new(); count];
    for gaussian in &gaussians {
        let band = |y: f32| (y.max(0.0) as usize / BAND).min(count - 1);
        let (mean, reach) = (gaussian.mean.y, gaussian.reach.y);
        let (top, bottom) = (mean - reach, mean + reach);
        for list in &mut lists[band(top)..=band(bottom)] {
            list.push(*gaussian);
        }
    }
    let numbered = lists.par_iter().enumerate();
    numbered
        .map(|(i, list)| work(Band::new(camera, i * BAND), list))
        .collect()
}

/// What a picture says of the splats on it.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Correction {
    /// Sum of shares of light, and of what the picture lacks, weighed with them.
    pub light: f32,
    pub lack: Vec3,
    /// Sum of squares of the picture's derivative by the opacity, and of its products with what
    /// the picture lacks: a Gauss–Newton step is their quotient.
    pub square: f32,
    pub product: f32,
}

/// Compares the picture with the one that was wanted: sum of squared differences of all channels,
/// and each drawn splat with what the differences say of it.
pub(crate) fn compare(
    camera: &Pinhole,
    splats: &[Splat],
    wanted: &[Vec3],
) -> (f64, Vec<(u32, Correction)>) {
    let bands = in_bands(camera, splats, |mut band, gaussians| {
        for gaussian in gaussians {
            band.draw(gaussian, &splats[gaussian.splat as usize], |_, _, _, _| {});
        }
        let first = band.top * band.width;
        let wanted = &wanted[first..first + band.colours.len()];
        let whole = band.colours;
        let lacks: Vec<Vec3> = wanted.iter().zip(&whole).map(|(w, c)| w - c).collect();
        let error: f64 = lacks.iter().map(|l| f64::from(l.length_squared())).sum();
        let mut again = Band::new(camera, band.top);
        let mut corrections = Vec::with_capacity(gaussians.len());
        // What has been drawn of each pixel.
        let mut drawn = vec![Vec3::ZERO; whole.len()];
        for gaussian in gaussians {
            let splat = &splats[gaussian.splat as usize];
            let mut own = Correction::default();
            again.draw(gaussian, splat, |pixel, share, opacity, open| {
                let (lack, light) = (lacks[pixel], open * opacity);
                drawn[pixel] += splat.colour * light;
                own.light += light;
                own.lack += lack * light;
                let behind = (whole[pixel] - drawn[pixel]) / (1.0 - opacity);
                let derivative = share * (splat.colour * open - behind);
                own.square += derivative.length_squared();
                own.product += derivative.dot(lack);
            });
            if own.light > 0.0 {
                corrections.push((gaussian.splat, own));
            }
        }
        (error, corrections)
    });
    let error = bands.iter().map(|(error, _)| error).sum();
    (error, bands.into_iter().flat_map(|(_, a)| a).collect())
}
