//! Elementary functions that compile to vector instructions inside loops.

/// `e^x`, relative error below 2e-7 for `x` in −87.3 to 88; 0 and infinity beyond. NaN stays NaN.
#[inline(always)]
pub(crate) fn exp(x: f32) -> f32 {
    const LOWEST: f32 = -88.0;
    const HIGHEST: f32 = 89.0;
    /// Adding it to a small number leaves that number, rounded, in the last bits.
    const ROUND: f32 = 12_582_912.0;
    const LN2_HIGH: f32 = 0.693_359_4;
    const LN2_LOW: f32 = -2.121_944_4e-4;
    // Comparisons in this order keep NaN.
    let x = if x < LOWEST { LOWEST } else { x };
    let x = if x > HIGHEST { HIGHEST } else { x };
    let shifted = x * std::f32::consts::LOG2_E + ROUND;
    let power = shifted - ROUND;
    let r = x - power * LN2_HIGH - power * LN2_LOW;
    // Taylor series on ±ln(2)/2.
    let mut series = 1.0 / 5040.0;
    for term in [
        1.0 / 720.0,
        1.0 / 120.0,
        1.0 / 24.0,
        1.0 / 6.0,
        0.5,
        1.0,
        1.0,
    ] {
        series = series * r + term;
    }
    let scale = f32::from_bits((shifted.to_bits() << 23).wrapping_add(1.0f32.to_bits()));
    series * scale
}

/// `ln x` of a positive, normal number, absolute error below 1e-6 near 1 and relative elsewhere.
#[inline(always)]
pub(crate) fn ln(x: f32) -> f32 {
    let bits = x.to_bits();
    // Mantissa in [√½, √2).
    let shifted = bits.wrapping_sub(std::f32::consts::FRAC_1_SQRT_2.to_bits());
    let power = (shifted as i32 >> 23) as f32;
    let mantissa =
        f32::from_bits((shifted & 0x007f_ffff) + std::f32::consts::FRAC_1_SQRT_2.to_bits());
    // ln m = 2 atanh((m − 1) / (m + 1)).
    let t = (mantissa - 1.0) / (mantissa + 1.0);
    let square = t * t;
    let mut series = 2.0 / 9.0;
    for term in [2.0 / 7.0, 2.0 / 5.0, 2.0 / 3.0, 2.0] {
        series = series * square + term;
    }
    power * std::f32::consts::LN_2 + series * t
}

#[cfg(test)]
mod tests {
    use super::{exp, ln};

    #[test]
    fn logarithm_equals_the_library() {
        for i in 1..200_000 {
            for x in [i as f32 * 1e-5, i as f32 * 37.7, 1.0 / i as f32] {
                let (found, wanted) = (f64::from(ln(x)), f64::from(x).ln());
                let error = (found - wanted).abs();
                assert!(
                    error < 1e-6 * wanted.abs().max(1.0),
                    "{x}: {found} {wanted}"
                );
            }
        }
    }

    #[test]
    fn equals_the_library() {
        for i in -870_000..=880_000 {
            let x = i as f32 * 1e-4;
            let (found, wanted) = (f64::from(exp(x)), f64::from(x).exp());
            assert!((found / wanted - 1.0).abs() < 2e-7, "{x}: {found} {wanted}");
        }
    }

    #[test]
    fn extremes_saturate_and_nan_stays_nan() {
        for x in [89.0, 1e3, f32::MAX, f32::INFINITY] {
            assert_eq!([exp(-x), exp(x)], [0.0, f32::INFINITY], "{x}");
        }
        assert!(exp(f32::NAN).is_nan());
        assert_eq!(exp(0.0), 1.0);
    }
}
