//! Gaussians on a picture, as viewers draw them: projected to first order, then blended from front
//! to back in the order of their middles.

use glam::{Mat3, Vec2, Vec3};
use rayon::prelude::*;

use crate::splats::Splat;
use crate::views::Lens;

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
struct Blob {
    splat: u32,
    depth: f32,
    middle: Vec2,
    /// The inverse covariance: xx, xy, yy.
    conic: Vec3,
    /// Half the sides of what holds all of it that is drawn.
    reach: Vec2,
}

fn blob(lens: &Lens, splat: &Splat, index: u32) -> Option<Blob> {
    let local = lens.local(splat.position);
    if local.z < 1e-3 || splat.opacity <= FAINTEST {
        return None;
    }
    // Far outside of the picture the projection's first order runs away.
    let size = Vec2::new(lens.width as f32, lens.height as f32);
    let limit = 1.3 * 0.5 * size / lens.focal;
    let at = (local.truncate() / local.z).clamp(-limit, limit);
    let (fx, fy) = (lens.focal.x / local.z, lens.focal.y / local.z);
    let axes = lens.rotation.transpose()
        * Mat3::from_quat(splat.rotation)
        * Mat3::from_diagonal(splat.scale);
    let rows = axes.transpose();
    let across = fx * (rows.x_axis - at.x * rows.z_axis);
    let down = fy * (rows.y_axis - at.y * rows.z_axis);
    let (xx, xy, yy) = (
        across.length_squared() + BLUR,
        across.dot(down),
        down.length_squared() + BLUR,
    );
    let determinant = xx * yy - xy * xy;
    let radius = 2.0 * (splat.opacity / FAINTEST).ln();
    let reach = (radius * Vec2::new(xx, yy)).map(f32::sqrt);
    let middle = lens.onto(local);
    let seen = middle + reach;
    let outside =
        seen.x < 0.0 || seen.y < 0.0 || middle.x - reach.x > size.x || middle.y - reach.y > size.y;
    (determinant > 0.0 && !outside).then_some(Blob {
        splat: index,
        depth: local.z,
        middle,
        conic: Vec3::new(yy, -xy, xx) / determinant,
        reach,
    })
}

/// The blobs of a view from front to back.
fn blobs(lens: &Lens, splats: &[Splat]) -> Vec<Blob> {
    let numbered = splats.par_iter().enumerate();
    let found = numbered.filter_map(|(i, splat)| blob(lens, splat, i as u32));
    let mut blobs: Vec<Blob> = found.collect();
    blobs.par_sort_by(|a, b| a.depth.total_cmp(&b.depth));
    blobs
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
    fn new(lens: &Lens, top: usize) -> Self {
        let pixels = BAND.min(lens.height - top) * lens.width;
        Self {
            top,
            width: lens.width,
            colours: vec![Vec3::ZERO; pixels],
            open: vec![1.0; pixels],
        }
    }

    fn height(&self) -> usize {
        self.open.len() / self.width
    }

    /// Draws one blob and tells of each pixel: its index, how much of the blob is there, the
    /// opacity, and the share of light that was open before.
    fn draw(&mut self, blob: &Blob, splat: &Splat, mut tell: impl FnMut(usize, f32, f32, f32)) {
        let bounds = |middle: f32, reach: f32, first: usize, count: usize| {
            let low = (middle - reach - 0.5).ceil().max(first as f32) as usize;
            let high = (middle + reach - 0.5).floor() + 1.0;
            (low, (high.max(0.0) as usize).min(first + count))
        };
        let (left, right) = bounds(blob.middle.x, blob.reach.x, 0, self.width);
        let (top, bottom) = bounds(blob.middle.y, blob.reach.y, self.top, self.height());
        for y in top..bottom {
            let dy = y as f32 + 0.5 - blob.middle.y;
            for x in left..right {
                let index = (y - self.top) * self.width + x;
                let open = self.open[index];
                if open < FULL {
                    continue;
                }
                let dx = x as f32 + 0.5 - blob.middle.x;
                let c = blob.conic;
                let power = 0.5 * (c.x * dx * dx + c.z * dy * dy) + c.y * dx * dy;
                let share = (-power).exp();
                let opacity = (splat.opacity * share).min(MOST);
                if opacity < FAINTEST {
                    continue;
                }
                self.colours[index] += splat.colour * (open * opacity);
                self.open[index] = open * (1.0 - opacity);
                tell(index, share, opacity, open);
            }
        }
    }
}

/// Does something for each band of a picture with the blobs that touch it, front to back.
fn in_bands<T: Send>(
    lens: &Lens,
    splats: &[Splat],
    work: impl Fn(Band, &[Blob]) -> T + Sync,
) -> Vec<T> {
    let blobs = blobs(lens, splats);
    let count = lens.height.div_ceil(BAND);
    let mut lists = vec![Vec::new(); count];
    for blob in &blobs {
        let band = |y: f32| (y.max(0.0) as usize / BAND).min(count - 1);
        let (top, bottom) = (blob.middle.y - blob.reach.y, blob.middle.y + blob.reach.y);
        for list in &mut lists[band(top)..=band(bottom)] {
            list.push(*blob);
        }
    }
    let numbered = lists.par_iter().enumerate();
    numbered
        .map(|(i, list)| work(Band::new(lens, i * BAND), list))
        .collect()
}

/// What a picture says of the splats on it.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Advice {
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
pub(crate) fn compare(lens: &Lens, splats: &[Splat], wanted: &[Vec3]) -> (f64, Vec<(u32, Advice)>) {
    let bands = in_bands(lens, splats, |mut band, blobs| {
        for blob in blobs {
            band.draw(blob, &splats[blob.splat as usize], |_, _, _, _| {});
        }
        let first = band.top * band.width;
        let wanted = &wanted[first..first + band.colours.len()];
        let whole = band.colours;
        let lacks: Vec<Vec3> = wanted.iter().zip(&whole).map(|(w, c)| w - c).collect();
        let error: f64 = lacks.iter().map(|l| f64::from(l.length_squared())).sum();
        let mut again = Band::new(lens, band.top);
        let mut advice = Vec::with_capacity(blobs.len());
        // What has been drawn of each pixel.
        let mut drawn = vec![Vec3::ZERO; whole.len()];
        for blob in blobs {
            let splat = &splats[blob.splat as usize];
            let mut own = Advice::default();
            again.draw(blob, splat, |pixel, share, opacity, open| {
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
                advice.push((blob.splat, own));
            }
        }
        (error, advice)
    });
    let error = bands.iter().map(|(error, _)| error).sum();
    (error, bands.into_iter().flat_map(|(_, a)| a).collect())
}
