//! How far apart two clouds of features are.

use impasto_kernels::FeatureMap;
use nalgebra::{DMatrix, DVector, Dyn, SymmetricEigen};

/// Mean and covariance of a layer's features over a picture, along some of their directions.
#[derive(Debug, Clone)]
pub(super) struct FeatureGaussian {
    mean: DVector<f32>,
    covariance: DMatrix<f32>,
}

impl FeatureGaussian {
    /// Along the rows of `directions`, or along all channels.
    pub(super) fn of(map: &FeatureMap, directions: Option<&DMatrix<f32>>) -> Self {
        let pixels = map.height * map.width;
        // A column a pixel, as they lie in memory.
        let all = DMatrix::from_column_slice(map.channels, pixels, &map.data);
        let mut rows = match directions {
            Some(directions) => directions * all,
            None => all,
        };
        let mean = rows.column_mean();
        rows.column_iter_mut().for_each(|mut pixel| pixel -= &mean);
        let covariance = &rows * rows.transpose() / pixels as f32;
        Self { mean, covariance }
    }

    /// The symmetric root of the covariance.
    pub(super) fn root(&self) -> DMatrix<f32> {
        let SymmetricEigen {
            eigenvalues,
            eigenvectors,
        }: SymmetricEigen<f32, Dyn> = self.covariance.clone().symmetric_eigen();
        let mut scaled = eigenvectors.clone();
        for (mut column, value) in scaled.column_iter_mut().zip(&eigenvalues) {
            column *= value.max(0.0).sqrt();
        }
        scaled * eigenvectors.transpose()
    }

    /// Wasserstein distance of order 2 to another one (Dowson & Landau 1982); `root` is that of
    /// this one's covariance.
    pub(super) fn distance(&self, root: &DMatrix<f32>, other: &Self) -> f64 {
        let between = root * &other.covariance * root;
        let common: f64 = between
            .symmetric_eigenvalues()
            .iter()
            .map(|value| f64::from(value.max(0.0)).sqrt())
            .sum();
        let spread = f64::from(self.covariance.trace() + other.covariance.trace()) - 2.0 * common;
        let shift = f64::from((&self.mean - &other.mean).norm_squared());
        (shift + spread).max(0.0).sqrt()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A cloud of two features.
    fn cloud(points: &[[f32; 2]]) -> FeatureGaussian {
        let map = FeatureMap {
            height: 1,
            width: points.len(),
            channels: 2,
            data: points.as_flattened().to_vec(),
        };
        FeatureGaussian::of(&map, None)
    }

    fn apart(a: &FeatureGaussian, b: &FeatureGaussian) -> f64 {
        a.distance(&a.root(), b)
    }

    #[test]
    fn it_is_the_distance_of_gaussians() {
        let round = cloud(&[[1.0, 0.0], [-1.0, 0.0], [0.0, 1.0], [0.0, -1.0]]);
        assert!(apart(&round, &round) < 1e-3);
        let moved = cloud(&[[4.0, 4.0], [2.0, 4.0], [3.0, 5.0], [3.0, 3.0]]);
        assert!((apart(&round, &moved) - 5.0).abs() < 1e-3, "3 and 4 away");
        // Variances ½ and ½; 2 and ½: the difference of deviations is √½.
        let wide = cloud(&[[2.0, 0.0], [-2.0, 0.0], [0.0, 1.0], [0.0, -1.0]]);
        let wanted = 0.5f64.sqrt();
        assert!((apart(&round, &wide) - wanted).abs() < 1e-3);
        assert!((apart(&wide, &round) - wanted).abs() < 1e-3);
        // The same means and variances, turned by a right angle: only the covariance tells.
        let [rising, falling] = [1.0, -1.0].map(|s| {
            let line = [[1.0, s], [-1.0, -s], [2.0, 2.0 * s], [-2.0, -2.0 * s]];
            cloud(&line)
        });
        assert!(apart(&rising, &falling) > 1.0);
    }
}
