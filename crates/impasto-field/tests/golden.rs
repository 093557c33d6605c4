//! The paper's embedding and sphere against stored numbers of an independent implementation
//! (`golden/`, float32).
#![allow(clippy::unwrap_used, reason = "a test may panic")]

use impasto_field::encoding::frequencies;
use impasto_field::sampling::hierarchical::resample;
use impasto_field::sphere::{exit, outer_point};
use safetensors::SafeTensors;

fn read(name: &str) -> Vec<u8> {
    let path = format!(
        "{}/tests/golden/{name}.safetensors",
        env!("CARGO_MANIFEST_DIR")
    );
    std::fs::read(path).unwrap()
}

fn floats(file: &SafeTensors<'_>, name: &str) -> Vec<f32> {
    let bytes = file.tensor(name).unwrap().data().to_vec();
    bytes
        .as_chunks::<4>()
        .0
        .iter()
        .map(|b| f32::from_le_bytes(*b))
        .collect()
}

/// `‖a − b‖ / ‖b‖`.
fn difference(a: &[f32], b: &[f32]) -> f64 {
    assert_eq!(a.len(), b.len());
    let square = |v: f32| f64::from(v).powi(2);
    let error: f64 = a.iter().zip(b).map(|(a, b)| square(a - b)).sum();
    (error / b.iter().map(|b| square(*b)).sum::<f64>()).sqrt()
}

#[test]
fn frequencies_agree() {
    let bytes = read("embedding");
    let file = SafeTensors::deserialize(&bytes).unwrap();
    for (input, output, dimensions, bands) in [
        ("position3", "position3_bands10", 3, 10),
        ("position4", "position4_bands10", 4, 10),
        ("view", "view_bands4", 3, 4),
    ] {
        let ours = frequencies(&floats(&file, input), dimensions, bands);
        let error = difference(&ours, &floats(&file, output));
        assert!(error < 1e-5, "{output}: {error:e}");
    }
}

#[test]
fn sphere_agrees() {
    let bytes = read("sphere");
    let file = SafeTensors::deserialize(&bytes).unwrap();
    let rows = |name: &str| floats(&file, name).as_chunks::<3>().0.to_vec();
    let (origins, directions) = (rows("origin"), rows("direction"));
    let far: Vec<f32> = origins
        .iter()
        .zip(&directions)
        .map(|(o, d)| exit(*o, *d).unwrap())
        .collect();
    assert!(difference(&far, &floats(&file, "foreground_far")) < 1e-5);

    let radii = floats(&file, "inverse_radius");
    let per_ray = radii.len() / origins.len();
    let (mut points, mut depths) = (Vec::new(), Vec::new());
    for (i, s) in radii.iter().enumerate() {
        let (point, depth) = outer_point(origins[i / per_ray], directions[i / per_ray], *s);
        points.extend(point);
        depths.push(depth);
    }
    assert!(difference(&points, &floats(&file, "background_points")) < 1e-5);
    // Infinite depths have no norm; compare what is finite.
    let truth = floats(&file, "background_real_depth");
    let finite = |values: &[f32]| -> Vec<f32> {
        let pairs = values.iter().zip(radii.iter().zip(&truth));
        pairs
            .filter(|(_, (s, t))| **s > 1e-3 && t.is_finite())
            .map(|(v, _)| *v)
            .collect()
    };
    assert!(difference(&finite(&depths), &finite(&truth)) < 1e-4);
}

#[test]
fn resampling_agrees() {
    let bytes = read("sample_pdf");
    let file = SafeTensors::deserialize(&bytes).unwrap();
    let (edges, weights) = (floats(&file, "bins"), floats(&file, "weights"));
    let rows = edges.chunks_exact(63).zip(weights.chunks_exact(62));
    let shares = || (0..128).map(|i| i as f32 / 127.0);
    let ours: Vec<f32> = rows
        .flat_map(|(edges, weights)| resample(edges, weights, shares()))
        .collect();
    let error = difference(&ours, &floats(&file, "samples_deterministic_128"));
    assert!(error < 1e-5, "{error:e}");
}
