//! Splats that give their pictures back.

use glam::Vec3;

use crate::ExportError;
use crate::raster::{Correction, compare};
use crate::splats::Splat;
use crate::views::{Views, Watch, share};

/// Times that all views are gone through.
const ROUNDS: usize = 4;
/// Share of what a view says that is done about it: of colours, in the first round and later, and
/// of opacities, which all splats on a pixel change at once.
const COLOUR_STEP: f32 = 0.7;
const OPACITY_STEP: f32 = 0.15;
/// Light, and square of a derivative, of as much say as a splat has for itself.
const COLOUR_DOUBT: f32 = 0.05;
const OPACITY_DOUBT: f32 = 0.02;
/// Range of opacities.
const LEAST: f32 = 0.01;
const MOST: f32 = 0.98;
/// What has become fainter than this in the end is left out.
const FAINT: f32 = 0.03;

/// Corrects colours and opacities by what the views' pictures lack; returns the mean PSNR, in dB,
/// that the pictures had in the last round, each before its own correction.
pub(crate) fn fit(
    splats: &mut Vec<Splat>,
    views: &Views,
    part: [f64; 2],
    watch: &mut Watch<'_>,
) -> Result<f64, ExportError> {
    let count = views.len();
    let mut psnr = 0.0;
    let mut corrections = vec![Correction::default(); splats.len()];
    for round in 0..ROUNDS {
        psnr = 0.0;
        let ease = 1.0 / (1.0 + round as f32);
        for turn in 0..count {
            watch.at("fit", share(part, round * count + turn, ROUNDS * count))?;
            let view = &views.posed[turn_of(turn, count)];
            let (error, found) = compare(&view.camera, splats, &view.colours);
            let channels = 3.0 * view.colours.len() as f64;
            psnr -= 10.0 * (error / channels).max(1e-10).log10() / count as f64;
            for (splat, more) in &found {
                corrections[*splat as usize].add(more);
            }
            for (splat, _) in &found {
                let index = *splat as usize;
                let own = std::mem::take(&mut corrections[index]);
                correct(&mut splats[index], &own, ease);
            }
        }
    }
    splats.retain(|splat| splat.opacity > FAINT);
    Ok(psnr)
}

/// Views in an order in which neighbours do not follow each other.
fn turn_of(turn: usize, count: usize) -> usize {
    // Coprime with the count, and near the golden section of it.
    let ideal = (count as f64 * 0.618) as usize;
    let coprime = |step: &usize| gcd(*step, count) == 1;
    let step = (ideal.max(1)..=count.max(1)).find(coprime).unwrap_or(1);
    turn * step % count
}

fn gcd(a: usize, b: usize) -> usize {
    if b == 0 { a } else { gcd(b, a % b) }
}

impl Correction {
    fn add(&mut self, more: &Self) {
        self.light += more.light;
        self.lack += more.lack;
        self.square += more.square;
        self.product += more.product;
    }
}

fn correct(splat: &mut Splat, correction: &Correction, ease: f32) {
    if correction.light <= 0.0 {
        return;
    }
    let colour = correction.lack / (correction.light + COLOUR_DOUBT);
    splat.colour = (splat.colour + COLOUR_STEP * ease * colour).clamp(Vec3::ZERO, Vec3::ONE);
    let opacity = correction.product / (correction.square + OPACITY_DOUBT);
    splat.opacity = (splat.opacity + OPACITY_STEP * ease * opacity).clamp(LEAST, MOST);
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_view_has_its_turn() {
        for count in 1..40 {
            let mut turns: Vec<usize> = (0..count).map(|i| turn_of(i, count)).collect();
            turns.sort_unstable();
            assert!(turns.iter().copied().eq(0..count), "{count}");
        }
    }
}
