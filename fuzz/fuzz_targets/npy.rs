//! NumPy's array files: what is read has the size that it says, is no larger than the file, and
//! comes back when it is written and read again.
#![no_main]

use impasto_scene::npy;
use libfuzzer_sys::fuzz_target;

fuzz_target!(|bytes: &[u8]| {
    let Ok((shape, numbers)) = npy::decode(bytes) else {
        return;
    };
    assert_eq!(shape.iter().product::<usize>(), numbers.len());
    assert!(4 * numbers.len() <= bytes.len());
    let [height, width] = shape[..] else { return };
    let (Ok(height), Ok(width)) = (u32::try_from(height), u32::try_from(width)) else {
        return;
    };
    let floats: Vec<f32> = numbers.iter().map(|x| *x as f32).collect();
    let (again, same) = npy::decode(&npy::encode(&floats, width, height)).expect("ours");
    assert_eq!(again, shape);
    let bits = |x: f64| (x as f32).to_bits();
    let equal = |(a, b): (&f64, &f64)| bits(*a) == bits(*b) || (a.is_nan() && b.is_nan());
    assert!(numbers.iter().zip(&same).all(equal));
});
