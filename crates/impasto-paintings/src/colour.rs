//! Colours as `Vec3` of sRGB values, nominally in `[0, 1]`, and the mixed pigments of one picture.

use crate::dice::Dice;
use crate::maths::{direction, mix};
use crate::palettes::NamedPalette;
use glam::Vec3;

/// Perceived lightness of a colour, `[0, 1]`.
pub(crate) fn lightness(c: Vec3) -> f32 {
    c.dot(Vec3::new(0.299, 0.587, 0.114))
}

/// Moves a colour away from (`k > 1`) or towards (`k < 1`) the grey of the same lightness.
pub(crate) fn saturated(c: Vec3, k: f32) -> Vec3 {
    let grey = Vec3::splat(lightness(c));
    grey + (c - grey) * k
}

/// Turns a colour's hue by an angle in turns, keeping its lightness.
pub(crate) fn hue_turned(c: Vec3, turns: f32) -> Vec3 {
    let y = lightness(c);
    let i = c.dot(Vec3::new(0.596, -0.274, -0.322));
    let q = c.dot(Vec3::new(0.211, -0.523, 0.312));
    let d = direction(turns);
    let (i, q) = (i * d.x - q * d.y, i * d.y + q * d.x);
    Vec3::new(
        y + 0.956 * i + 0.621 * q,
        y - 0.272 * i - 0.647 * q,
        y - 1.106 * i + 1.703 * q,
    )
}

/// How colourful a colour is: the spread of its channels.
pub(crate) fn chroma(c: Vec3) -> f32 {
    c.max_element() - c.min_element()
}

/// A palette as mixed for one picture: hue, saturation and contrast shifted by chance.
pub(crate) struct Pigments {
    ramp: Vec<Vec3>,
    accent: Vec3,
}

impl Pigments {
    /// Mixes `palette` for one picture.
    pub(crate) fn mixed(palette: &NamedPalette, dice: &Dice) -> Self {
        let hue = dice.bell() * 0.035;
        let saturation = dice.range(0.55, 1.15);
        let contrast = dice.range(0.8, 1.2);
        let lift = dice.bell() * 0.06;
        let mut ramp: Vec<Vec3> = palette
            .colours
            .iter()
            .map(|&[r, g, b]| {
                let c = Vec3::new(f32::from(r), f32::from(g), f32::from(b)) / 255.0;
                let own = hue_turned(c, hue + dice.bell() * 0.012);
                let c = saturated(own, saturation) - 0.5;
                (c * contrast + 0.5 + lift).clamp(Vec3::ZERO, Vec3::ONE)
            })
            .collect();
        ramp.sort_by(|a, b| lightness(*a).total_cmp(&lightness(*b)));
        let accent = ramp
            .iter()
            .copied()
            .max_by(|a, b| chroma(*a).total_cmp(&chroma(*b)))
            .unwrap_or(Vec3::splat(0.5));
        Self { ramp, accent }
    }

    /// The colour at rank `t` in `[0, 1]` from the darkest pigment to the lightest.
    pub(crate) fn tone(&self, t: f32) -> Vec3 {
        let last = self.ramp.len().saturating_sub(1);
        let x = t.clamp(0.0, 1.0) * last as f32;
        let i = (x as usize).min(last);
        let j = (i + 1).min(last);
        match (self.ramp.get(i), self.ramp.get(j)) {
            (Some(a), Some(b)) => a.lerp(*b, x - i as f32),
            _ => self.accent,
        }
    }

    /// The darkest pigment.
    pub(crate) fn dark(&self) -> Vec3 {
        self.tone(0.0)
    }

    /// The lightest pigment.
    pub(crate) fn light(&self) -> Vec3 {
        self.tone(1.0)
    }

    /// The most colourful pigment.
    pub(crate) fn accent(&self) -> Vec3 {
        self.accent
    }

    /// A pigment at random.
    pub(crate) fn pick(&self, dice: &Dice) -> Vec3 {
        self.ramp
            .get(dice.index(self.ramp.len()))
            .copied()
            .unwrap_or(self.accent)
    }

    /// The pigment nearest to `c`.
    pub(crate) fn nearest(&self, c: Vec3) -> Vec3 {
        self.ramp
            .iter()
            .copied()
            .min_by(|a, b| a.distance_squared(c).total_cmp(&b.distance_squared(c)))
            .unwrap_or(c)
    }

    /// A darkness for lines and ink: the darkest pigment, pushed to at most `limit` lightness.
    pub(crate) fn ink(&self, limit: f32) -> Vec3 {
        let c = self.dark();
        c * (limit / lightness(c).max(1e-3)).min(1.0)
    }

    /// A paper or ground: the lightest pigment, raised towards white to at least `floor` lightness.
    pub(crate) fn paper(&self, floor: f32) -> Vec3 {
        let c = self.light();
        let need = (floor - lightness(c)) / (1.0 - lightness(c)).max(1e-3);
        c.lerp(Vec3::ONE, need.clamp(0.0, 1.0))
    }

    /// `c` broken as on a palette knife: lightness, hue and saturation shifted by chance, and pulled
    /// towards a random pigment, each in proportion to `amount` (0 = unchanged, 1 = strong).
    pub(crate) fn broken(&self, c: Vec3, amount: f32, dice: &Dice) -> Vec3 {
        let shifted = hue_turned(c, dice.bell() * 0.08 * amount);
        let shifted = saturated(shifted, 1.0 + dice.range(-0.2, 0.5) * amount);
        let pulled = shifted.lerp(self.pick(dice), dice.unit() * dice.unit() * 0.55 * amount);
        (pulled * mix(1.0, dice.range(0.75, 1.3), amount)).clamp(Vec3::ZERO, Vec3::ONE)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::palettes::PALETTES;

    #[test]
    fn hue_turns_keep_lightness_and_come_back() {
        let c = Vec3::new(0.7, 0.3, 0.2);
        assert!((lightness(hue_turned(c, 0.3)) - lightness(c)).abs() < 0.01);
        assert!(hue_turned(c, 1.0).distance(c) < 0.02);
        assert!(hue_turned(c, 0.5).distance(c) > 0.3);
    }

    #[test]
    fn every_palette_mixes_to_a_rising_ramp() {
        for (i, palette) in PALETTES.iter().enumerate() {
            let pigments = Pigments::mixed(palette, &Dice::new(i as u64, 0));
            for pair in pigments.ramp.windows(2) {
                assert!(lightness(pair[0]) <= lightness(pair[1]));
            }
            assert!(
                lightness(pigments.light()) - lightness(pigments.dark()) > 0.25,
                "{}",
                palette.name
            );
        }
    }
}
