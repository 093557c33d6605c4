//! The only source of chance: a PCG stream read through fixed conversions, so that pictures do not
//! change when a distribution of the `rand` crate does.

use crate::maths::direction;
use glam::Vec2;
use rand::{Rng, SeedableRng};
use rand_pcg::Pcg32;
use std::cell::RefCell;

/// A seeded stream of random choices. Shared by reference: no borrow outlives one draw.
pub(crate) struct Dice(RefCell<Pcg32>);

impl Dice {
    /// A stream determined by `seed` and by what it is used for.
    pub(crate) fn new(seed: u64, purpose: u64) -> Self {
        let mixed = seed ^ purpose.wrapping_mul(0x9e37_79b9_7f4a_7c15);
        Self(RefCell::new(Pcg32::seed_from_u64(mixed)))
    }

    /// 32 random bits.
    pub(crate) fn bits(&self) -> u32 {
        self.0.borrow_mut().next_u32()
    }

    /// Uniform in `[0, 1)`.
    pub(crate) fn unit(&self) -> f32 {
        (self.bits() >> 8) as f32 / 16_777_216.0
    }

    /// Uniform between `a` and `b`.
    pub(crate) fn range(&self, a: f32, b: f32) -> f32 {
        a + (b - a) * self.unit()
    }

    /// Uniform in `[-1, 1)`.
    pub(crate) fn sway(&self) -> f32 {
        self.range(-1.0, 1.0)
    }

    /// Bell-shaped around 0, standard deviation about ½, never beyond ±1.5.
    pub(crate) fn bell(&self) -> f32 {
        self.unit() + self.unit() + self.unit() - 1.5
    }

    /// True with probability `p`.
    pub(crate) fn chance(&self, p: f32) -> bool {
        self.unit() < p
    }

    /// A whole number in `a..=b`.
    pub(crate) fn count(&self, a: usize, b: usize) -> usize {
        a + self.index(b.saturating_sub(a) + 1)
    }

    /// An index below `n`; 0 when `n` is 0.
    pub(crate) fn index(&self, n: usize) -> usize {
        ((u64::from(self.bits()) * n as u64) >> 32) as usize
    }

    /// A uniform direction.
    pub(crate) fn heading(&self) -> Vec2 {
        direction(self.unit())
    }

    /// Reorders `items` at random.
    pub(crate) fn shuffle<T>(&self, items: &mut [T]) {
        for i in (1..items.len()).rev() {
            items.swap(i, self.index(i + 1));
        }
    }
}
