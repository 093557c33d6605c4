//! Patches of photos with their frozen geometry, drawn again and again.

use crate::geometry::PhotoRays;
use burn::tensor::Tensor;
use impasto_field::encoding::matrix;
use impasto_field::{
    Appearance, AppearanceConfig, Field, GBuffer, GBufferOptions, RayBatch, Renderer,
};
use impasto_model::config::{ContentTarget, StyleConfig};
use impasto_model::{CameraRays, ColorStatistics, Model};
use impasto_scene::Split;
use impasto_style::{PatchSampler, Perceptual, StyleError};
use rand::RngExt;
use rand_pcg::Pcg64;
use serde::{Deserialize, Serialize};
use std::sync::Arc;

/// One patch: all that a style update needs and that no style changes, constants of an autodiff
/// graph.
#[derive(Debug)]
pub struct FrozenPatch {
    /// Samples with features and densities: of the first field of a cascade, where there is one,
    /// then of the field. Each in parts, ray after ray.
    pub levels: Vec<Vec<GBuffer>>,
    /// The perceptual network's content feature of the unstylised patch, and its statistics.
    pub content: Tensor<1>,
    pub statistics: Tensor<1>,
    /// The unstylised patch, `[height, width, 3]`.
    pub pixels: Tensor<3>,
}

impl FrozenPatch {
    /// Number of rays.
    pub fn rays(&self) -> usize {
        let field = self.levels.last().into_iter().flatten();
        field.map(GBuffer::rays).sum()
    }
}

/// One pixel in this many is enough to know the photos' colours.
const PALETTE_STEP: usize = 17;

/// Marching rays through the field costs more than a style update does, so each patch is used
/// several times, with other patches in between.
pub struct PatchPool {
    renderer: Renderer,
    photo_app: Appearance,
    photos: Vec<PhotoRays>,
    /// The nearest other photos of each.
    neighbours: Vec<Vec<usize>>,
    novel_views: f64,
    target: ContentTarget,
    supersampling: usize,
    rays_at_once: usize,
    sampler: PatchSampler,
    app: AppearanceConfig,
    least_weight: f32,
    capacity: usize,
    uses: u64,
    colors: ColorStatistics,
    kept: Vec<Kept>,
    drawn: u64,
    made: u64,
}

/// A patch with the random numbers that it was made from.
#[derive(Debug, Clone)]
struct Kept {
    origin: Pcg64,
    patch: Arc<FrozenPatch>,
}

/// What a pool can be filled again from: a patch is too large to be stored, and is made of nothing
/// but the frozen field and random numbers.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub(crate) struct PoolProgress {
    origins: Vec<Pcg64>,
    drawn: u64,
    made: u64,
}

impl PatchPool {
    /// An empty pool.
    pub fn new(
        settings: &StyleConfig,
        app: AppearanceConfig,
        renderer: Renderer,
        photo_app: Appearance,
        photos: Vec<PhotoRays>,
    ) -> Self {
        let all = photos.iter().flat_map(PhotoRays::used_colours);
        Self {
            colors: ColorStatistics::of(all.step_by(PALETTE_STEP)),
            neighbours: neighbours(&photos),
            novel_views: settings.novel_views.into(),
            target: settings.content_target,
            supersampling: settings.supersampling,
            rays_at_once: settings.rays_at_once,
            renderer,
            photo_app,
            photos,
            sampler: PatchSampler {
                size: settings.patch,
                strides: settings.strides,
                reference: settings.pictures.side as usize,
            },
            app,
            least_weight: settings.least_weight,
            capacity: settings.pool,
            uses: settings.patch_uses,
            kept: Vec::new(),
            drawn: 0,
            made: 0,
        }
    }

    /// Patches of a model's views: it holds no photos, so that its renders are all there is to go by.
    pub(crate) fn of_model(model: &Model, settings: &StyleConfig, app: AppearanceConfig) -> Self {
        let file = &model.file;
        let photos = file.scene.cameras(Split::Train).into_iter();
        let photos = photos.map(|camera| PhotoRays::new(camera, Vec::new(), None, None));
        let field = Field::new(file.config.field.clone());
        let (weights, grids) = (file.radiance.weights.clone(), file.grids.clone());
        let photo = file.photo_app().clone();
        let renderer = Renderer::open(field, weights, grids, file.ground(), &app);
        Self {
            colors: model.photo_colors(),
            ..Self::new(settings, app, renderer, photo, photos.collect())
        }
    }

    /// The colours of all photos together.
    pub fn colors(&self) -> &ColorStatistics {
        &self.colors
    }

    /// A new patch when the ones made so far have been used often enough, else a kept one.
    ///
    /// # Errors
    /// If a photo is smaller than a patch, or the patch too small for the perceptual network.
    pub fn draw(
        &mut self,
        vgg: &Perceptual,
        rng: &mut Pcg64,
    ) -> Result<Arc<FrozenPatch>, StyleError> {
        self.drawn += 1;
        if self.made * self.uses >= self.drawn {
            let at = rng.random_range(0..self.kept.len());
            return Ok(Arc::clone(&self.kept[at].patch));
        }
        // Gone before its successor is made: one of the paper's is more than a gigabyte.
        if self.kept.len() == self.capacity {
            let at = rng.random_range(0..self.capacity);
            self.kept.swap_remove(at);
        }
        let kept = self.kept_of(rng.clone(), vgg, rng)?;
        self.made += 1;
        let patch = Arc::clone(&kept.patch);
        self.kept.push(kept);
        Ok(patch)
    }

    fn kept_of(
        &self,
        origin: Pcg64,
        vgg: &Perceptual,
        rng: &mut Pcg64,
    ) -> Result<Kept, StyleError> {
        let patch = Arc::new(self.make(vgg, rng)?);
        Ok(Kept { origin, patch })
    }

    /// What [`Self::restore`] needs.
    pub(crate) fn progress(&self) -> PoolProgress {
        PoolProgress {
            origins: self.kept.iter().map(|kept| kept.origin.clone()).collect(),
            drawn: self.drawn,
            made: self.made,
        }
    }

    /// Makes the patches of another pool of the same field and photos again.
    pub(crate) fn restore(
        &mut self,
        progress: &PoolProgress,
        vgg: &Perceptual,
    ) -> Result<(), StyleError> {
        let origins = progress.origins.iter();
        let kept = origins.map(|origin| self.kept_of(origin.clone(), vgg, &mut origin.clone()));
        self.kept = kept.collect::<Result<_, _>>()?;
        (self.drawn, self.made) = (progress.drawn, progress.made);
        Ok(())
    }

    fn make(&self, vgg: &Perceptual, rng: &mut Pcg64) -> Result<FrozenPatch, StyleError> {
        let (rays, photo) = self.draw_view(rng);
        let (width, height) = rays.size();
        let [rows, columns] = self.sampler.size;
        let patch = self
            .sampler
            .draw(height, width, rng)
            .ok_or(StyleError::TooSmall {
                width,
                height,
                least: rows.max(columns),
            })?;
        // What a mask hides must not be repainted; the field has never seen it.
        let target = match self.photos[photo].used {
            Some(_) => ContentTarget::Render,
            None => self.target,
        };
        let mut batch = RayBatch::default();
        let mut wanted = Vec::new();
        for point in patch.points(self.supersampling) {
            match target {
                ContentTarget::Render => rays.push_at(point, &mut batch),
                ContentTarget::Photo => {
                    let pixel = rays.pixel_at(point);
                    rays.push(pixel, &mut batch);
                    wanted.extend_from_slice(&self.photos[photo].pixels[3 * pixel..][..3]);
                }
            }
        }
        let options = GBufferOptions {
            config: &self.app,
            photo: (target == ContentTarget::Render).then_some(&self.photo_app),
            seed: Some(rng.random()),
            least_weight: self.least_weight,
            rays_at_once: Some(self.rays_at_once),
        };
        let buffers = self.renderer.gbuffer(&batch, &options);
        let wanted = buffers
            .photo
            .unwrap_or_else(|| matrix(wanted, 3, &self.renderer.device()));
        let pixels = self.averaged(wanted).clamp(0.0, 1.0);
        let [content, statistics] = vgg.features_of(pixels.clone())?.map(Tensor::from_inner);
        Ok(FrozenPatch {
            levels: lifted(buffers.levels),
            content,
            statistics,
            pixels: Tensor::from_inner(pixels),
        })
    }

    /// Colours of a patch's rays, averaged over each pixel.
    ///
    /// # Shapes
    /// `composite`: `[rays, 3 or more]`; result: `[height, width, 3]`.
    pub fn averaged(&self, composite: Tensor<2>) -> Tensor<3> {
        let ([height, width], n) = (self.sampler.size, self.supersampling);
        let colours = composite.slice_dim(1, 0..3);
        if n == 1 {
            return colours.reshape([height, width, 3]);
        }
        colours
            .reshape([height, n, width, n, 3])
            .mean_dim(3)
            .mean_dim(1)
            .reshape([height, width, 3])
    }

    /// Mean squared second difference of the rays' colours along rows and columns of a patch.
    ///
    /// # Shapes
    /// `composite`: `[rays, 3 or more]`; result: one number.
    pub fn smoothness(&self, composite: Tensor<2>) -> Tensor<1> {
        let [height, width] = self.sampler.size.map(|side| side * self.supersampling);
        let colours = composite.slice_dim(1, 0..3).reshape([height, width, 3]);
        let along = |axis: usize, length: usize| {
            let from = |start: usize| colours.clone().slice_dim(axis, start..start + length - 2);
            (from(0) + from(2) - from(1) * 2.0).square().mean()
        };
        along(0, height) + along(1, width)
    }

    /// A photo's view, or one between two neighbouring photos: paint must hold where nobody stood.
    /// With it the number of the photo.
    fn draw_view(&self, rng: &mut Pcg64) -> (CameraRays, usize) {
        let photo = rng.random_range(0..self.photos.len());
        let rays = &self.photos[photo].rays;
        let near = &self.neighbours[photo];
        if near.is_empty() || !rng.random_bool(self.novel_views) {
            return (rays.clone(), photo);
        }
        let other = near[rng.random_range(0..near.len())];
        (rays.towards(&self.photos[other].rays, rng.random()), photo)
    }
}

/// The same as constants of an autodiff graph.
fn lifted(levels: Vec<Vec<GBuffer>>) -> Vec<Vec<GBuffer>> {
    let turns = |level: Vec<GBuffer>| level.into_iter().map(GBuffer::lifted).collect();
    levels.into_iter().map(turns).collect()
}

/// Most neighbours of a photo.
const NEIGHBOURS: usize = 4;
/// Neighbours look the same way, within about 45°: between two that do not lies what nobody saw.
const LEAST_ALIGNMENT: f32 = 0.7;
/// They stand no more than this many times as far away as the nearest that looks the same way.
const FARTHEST: f32 = 3.0;

/// For each photo the other photos that views may lie between.
fn neighbours(photos: &[PhotoRays]) -> Vec<Vec<usize>> {
    photos
        .iter()
        .enumerate()
        .map(|(i, photo)| {
            let mut others: Vec<(f32, usize)> = photos
                .iter()
                .enumerate()
                .filter(|(j, other)| i != *j && photo.rays.alignment(&other.rays) > LEAST_ALIGNMENT)
                .map(|(j, other)| (photo.rays.distance(&other.rays), j))
                .collect();
            others.sort_by(|a, b| a.0.total_cmp(&b.0));
            let reach = others
                .first()
                .map_or(0.0, |(nearest, _)| nearest * FARTHEST);
            let near = others.into_iter().take_while(|(far, _)| *far <= reach);
            near.take(NEIGHBOURS).map(|(_, j)| j).collect()
        })
        .collect()
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, reason = "a test may panic")]

    use super::*;
    use crate::geometry::tests::sized_camera;
    use burn::tensor::Device;
    use glam::DVec3;
    use impasto_field::{EncodingConfig, Field, OccupancyGrids, host};
    use impasto_model::TrainConfig;
    use impasto_style::PatchStrides;
    use rand::SeedableRng;

    fn photo(x: f64, yaw: f64) -> PhotoRays {
        let camera = sized_camera(DVec3::X * x, yaw, [24, 20]);
        PhotoRays::new(camera, vec![0.5; 24 * 20 * 3], None, None)
    }

    #[test]
    fn neighbours_look_the_same_way_and_stand_near() {
        let photos = [
            photo(0.0, 0.0),
            photo(0.1, 0.0),
            photo(0.25, 0.0),
            // Farther than three times the nearest, then one that looks away.
            photo(0.9, 0.0),
            photo(0.05, 2.0),
        ];
        let near = neighbours(&photos);
        assert_eq!(near[0], [1, 2]);
        assert_eq!(near[1], [0, 2]);
        assert!(near[4].is_empty(), "nobody looks where photo 4 looks");
        let crowd: Vec<PhotoRays> = (0..9).map(|i| photo(0.01 * f64::from(i), 0.0)).collect();
        assert_eq!(neighbours(&crowd)[0].len(), 3, "0.01 to 0.03");
        assert_eq!(neighbours(&crowd)[4].len(), NEIGHBOURS);
    }

    fn pool(photos: Vec<PhotoRays>, patch: [usize; 2]) -> PatchPool {
        let mut config = TrainConfig::fast();
        for volume in [&mut config.field.inner, &mut config.field.outer] {
            volume.encoding = EncodingConfig::Frequency { bands: 2 };
        }
        let spec = config.field.occupancy_mut().expect("the preset has grids");
        (spec.inner_grid, spec.outer_grid) = (8, 8);
        let grids = OccupancyGrids::uniform(spec, 1.0);
        config.style.patch = patch;
        config.style.supersampling = 2;
        config.style.patch_uses = 3;
        config.style.pool = 2;
        let field = Field::new(config.field.clone());
        let (mut rng, device) = (Pcg64::seed_from_u64(1), Device::flex());
        let weights = field.init(&mut rng, &device);
        let photo_app = config.photo_appearance();
        let photo_app = Appearance::init(photo_app, field.features(), &mut rng, &device);
        let renderer = Renderer::reference(field, weights, Some(grids), photo_app.clone());
        let app = config.style_appearance();
        PatchPool::new(&config.style, app, renderer, photo_app, photos)
    }

    #[test]
    fn patches_are_used_several_times_and_replaced() {
        let vgg = Perceptual::vgg16().unwrap();
        let mut rng = Pcg64::seed_from_u64(2);
        let mut pool = pool(vec![photo(0.0, 0.0), photo(0.1, 0.0)], [16, 16]);
        let drawn: Vec<_> = (0..12)
            .map(|_| pool.draw(&vgg, &mut rng).unwrap())
            .collect();
        assert_eq!(pool.made, 4, "one of three draws makes a patch");
        assert_eq!(pool.kept.len(), 2, "of which the pool keeps two");
        assert!(
            Arc::ptr_eq(&drawn[0], &drawn[1]) && Arc::ptr_eq(&drawn[0], &drawn[2]),
            "until the second is due there is one patch"
        );
        assert!(!Arc::ptr_eq(&drawn[2], &drawn[3]));
        assert_eq!(drawn[0].pixels.dims(), [16, 16, 3]);
        let pixels = host(drawn[0].pixels.clone().inner());
        assert!(pixels.iter().all(|x| (0.0..=1.0).contains(x)));
    }

    #[test]
    fn a_patch_of_a_photo_has_its_pixels() {
        let mut one = photo(0.0, 0.0);
        let shade = |pixel: usize| (pixel % 24) as f32 / 48.0 + (pixel / 24) as f32 / 100.0;
        let pixels = one.pixels.chunks_exact_mut(3).enumerate();
        pixels.for_each(|(i, colour)| colour.fill(shade(i)));
        let vgg = Perceptual::vgg16().unwrap();
        let mut pool = pool(vec![one], [8, 8]);
        pool.target = ContentTarget::Photo;
        pool.novel_views = 0.0;
        pool.supersampling = 1;
        pool.rays_at_once = 32;
        pool.sampler.strides = PatchStrides::Paper([2, 3]);
        for seed in 0..4 {
            let patch = pool.make(&vgg, &mut Pcg64::seed_from_u64(seed)).unwrap();
            assert_eq!(patch.rays(), 64);
            // Neighbours are a whole number of pixels apart.
            let pixels = host(patch.pixels.clone().inner());
            let at = |row: usize, column: usize| pixels[3 * (8 * row + column)];
            let across = (at(0, 1) - at(0, 0)) * 48.0;
            let down = (at(1, 0) - at(0, 0)) * 100.0;
            for step in [across, down] {
                assert!(step > 0.5 && (step - step.round()).abs() < 1e-3, "{step}");
            }
        }
    }

    #[test]
    fn ramps_are_smooth_and_stripes_are_rough() {
        let pool = pool(vec![photo(0.0, 0.0)], [4, 5]);
        let rows = 2 * 4;
        let columns = 2 * 5;
        let smoothness = |shade: fn(usize, usize) -> f32| {
            let rays = (0..rows * columns).flat_map(|i| {
                let shade = shade(i / columns, i % columns);
                // What comes after the colours does not count.
                [shade, shade, shade, i as f32]
            });
            let rays = matrix(rays.collect(), 4, &Device::flex());
            pool.smoothness(rays).into_scalar::<f32>()
        };
        assert!(smoothness(|y, x| 0.02 * x as f32 + 0.05 * y as f32) < 1e-9);
        // From 0 to 1 and back is a second difference of 2, in one direction.
        for stripes in [
            smoothness(|_, x| (x % 2) as f32),
            smoothness(|y, _| (y % 2) as f32),
        ] {
            assert!((stripes - 4.0).abs() < 1e-5, "{stripes}");
        }
        let coarse = smoothness(|_, x| (x / 2 % 2) as f32);
        assert!((coarse - 1.0).abs() < 1e-5, "{coarse}");
    }

    #[test]
    fn a_photo_smaller_than_a_patch_is_refused() {
        let vgg = Perceptual::vgg16().unwrap();
        let mut pool = pool(vec![photo(0.0, 0.0)], [32, 16]);
        let error = pool.draw(&vgg, &mut Pcg64::seed_from_u64(3)).unwrap_err();
        assert!(
            matches!(error, StyleError::TooSmall { least: 32, .. }),
            "{error}"
        );
    }
}
