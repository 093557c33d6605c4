//! Whether there are strokes of the painting's kind: what colour, contrast and grain cannot win.
//!
//! Pictures are compared by their luminance alone, with one histogram for all, as grey pictures of
//! several sizes in VGG-16. Two are as far apart as the normal distributions of their features
//! (mean and covariance, Wasserstein distance of order 2) at relu2_1, relu3_1 and relu4_1, summed.
//!
//! - *Stroke score*: `Σ (d₀ − d) / Σ (d₀ − d₁)` over paintings, views and sizes, with the distance
//!   `d` of a render to its painting, `d₁` of two crops of the painting to each other, and `d₀` of
//!   the nearest cheat: the unstylised view, or that view under detail of the painting with its
//!   phases scrambled, at several strengths. Terms where `d₀ ≤ d₁` say nothing and are left out. 0
//!   is no better than cheating, 1 is another piece of the painting.
//! - *Stroke retrieval*: the share of (painting, view) pairs for which, of all renders of the view,
//!   the painting's own is the nearest to it, all sizes together. Asked this way round no painting
//!   attracts by being plain.

mod gaussian;
mod luminance;
mod scrambled;

use gaussian::FeatureGaussian;
use image::RgbImage;
use impasto_style::{Perceptual, StyleError, square_crop, stroke_directions};
pub use luminance::Luminance;
use nalgebra::DMatrix;
use rand::SeedableRng;
use rand_pcg::Pcg64;
use rayon::prelude::*;
use scrambled::{scrambled_detail, with_texture};
use serde::Serialize;

/// Shorter sides that pictures are compared at, pixels.
pub const SIDES: [u32; 3] = [160, 240, 320];
/// Views that strokes are measured in, spread evenly over all.
pub const MOST_VIEWS: usize = 2;
/// Strengths of scrambled detail.
const CHEATS: [f32; 4] = [0.5, 1.0, 2.0, 4.0];
/// Layers that are compared, with the first, relu1_1, left out.
const LAYERS: usize = 3;
/// Sides of two crops of a painting that are compared, as a share of its own.
const CROP: f64 = 0.75;

/// How well strokes are met.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct StrokeResult {
    /// Stroke score; NaN (`null` in JSON) where every term says nothing.
    pub stroke_score: f64,
    /// Stroke retrieval.
    pub stroke_retrieval: f64,
}

/// A picture at all sizes: layer by layer.
type Sized<T> = [[T; LAYERS]; SIDES.len()];

/// What is seen of a render's strokes.
pub(crate) struct Strokes(Box<Sized<FeatureGaussian>>);

/// A painting's strokes, and how near one can come to them.
struct StrokeTarget {
    features: Sized<FeatureGaussian>,
    /// Roots of their covariances.
    roots: Sized<DMatrix<f32>>,
    /// By size, between two of its crops.
    own: [f64; SIDES.len()],
    /// By view and size, of the nearest cheat.
    cheat: Vec<[f64; SIDES.len()]>,
}

/// What renders of some views are measured against.
pub(crate) struct StrokeMetric {
    network: StrokeNetwork,
    /// Views that are looked at.
    views: Vec<usize>,
    targets: Vec<StrokeTarget>,
}

impl StrokeMetric {
    /// Against these paintings, in unstylised views; `tick` hears of every pair of them that is
    /// looked at.
    pub(crate) fn new(
        vgg: &Perceptual,
        paintings: &[(String, RgbImage)],
        plain: &[RgbImage],
        tick: &mut dyn FnMut(),
    ) -> Result<Self, StyleError> {
        Self::at(SIDES, vgg, paintings, plain, tick)
    }

    /// The same with pictures of other sizes.
    fn at(
        sides: [u32; SIDES.len()],
        vgg: &Perceptual,
        paintings: &[(String, RgbImage)],
        plain: &[RgbImage],
        tick: &mut dyn FnMut(),
    ) -> Result<Self, StyleError> {
        let network = StrokeNetwork::new(vgg, sides)?;
        let views = chosen(plain.len());
        let unpainted = views.iter().map(|view| network.strokes(&plain[*view]));
        let unpainted: Vec<Strokes> = unpainted.collect::<Result<_, _>>()?;
        let mut targets = Vec::with_capacity(paintings.len());
        for (i, (_, painting)) in paintings.iter().enumerate() {
            let mut target = network.target(painting)?;
            let mut rng = Pcg64::seed_from_u64(i as u64);
            for (view, plain_strokes) in views.iter().zip(&unpainted) {
                let scrambled = network.cheats(painting, &plain[*view], &mut rng)?;
                let all = scrambled.iter().chain([plain_strokes]);
                let distances: Vec<_> = all.map(|cheat| target.distances(cheat)).collect();
                target.cheat.push(std::array::from_fn(|size| {
                    let all = distances.iter().map(|d| d[size]);
                    all.fold(f64::INFINITY, f64::min)
                }));
                tick();
            }
            targets.push(target);
        }
        Ok(Self {
            network,
            views,
            targets,
        })
    }

    /// How many (painting, view) pairs [`Self::new`] looks at.
    pub(crate) fn pairs(paintings: usize, views: usize) -> usize {
        paintings * chosen(views).len()
    }

    /// What is seen of one painting's renders, of all views.
    pub(crate) fn strokes(&self, views: &[RgbImage]) -> Result<Vec<Strokes>, StyleError> {
        let chosen = self.views.iter().filter_map(|view| views.get(*view));
        chosen.map(|view| self.network.strokes(view)).collect()
    }

    /// Of all paintings together, then painting by painting; by the renders of each, as
    /// [`Self::strokes`] has seen them.
    pub(crate) fn measure(&self, renders: &[Vec<Strokes>]) -> (StrokeResult, Vec<StrokeResult>) {
        let each = |painting: usize| self.tally(painting, renders);
        let each: Vec<Tally> = (0..renders.len()).into_par_iter().map(each).collect();
        let mut all = Tally::default();
        each.iter().for_each(|one| all.add(one));
        (all.result(), each.iter().map(Tally::result).collect())
    }

    fn tally(&self, painting: usize, renders: &[Vec<Strokes>]) -> Tally {
        let target = &self.targets[painting];
        let mut tally = Tally::default();
        for (view, (own, cheat)) in renders[painting].iter().zip(&target.cheat).enumerate() {
            let found = target.distances(own);
            for size in 0..SIDES.len() {
                let room = cheat[size] - target.own[size];
                if room > 0.0 {
                    tally.gained += cheat[size] - found[size];
                    tally.room += room;
                }
            }
            let distance = found.iter().sum::<f64>();
            let others = renders.iter().enumerate().filter(|(i, _)| *i != painting);
            let nearer = others
                .filter_map(|(_, views)| views.get(view))
                .any(|other| target.distances(other).iter().sum::<f64>() <= distance);
            tally.retrieved += f64::from(u8::from(!nearer));
            tally.views += 1.0;
        }
        tally
    }
}

/// Sums over views.
#[derive(Default)]
struct Tally {
    gained: f64,
    room: f64,
    retrieved: f64,
    views: f64,
}

impl Tally {
    fn add(&mut self, other: &Self) {
        self.gained += other.gained;
        self.room += other.room;
        self.retrieved += other.retrieved;
        self.views += other.views;
    }

    fn result(&self) -> StrokeResult {
        StrokeResult {
            stroke_score: self.gained / self.room,
            stroke_retrieval: self.retrieved / self.views,
        }
    }
}

/// Evenly spread ones of so many.
fn chosen(views: usize) -> Vec<usize> {
    let count = views.min(MOST_VIEWS);
    (0..count)
        .map(|i| (2 * i + 1) * views / (2 * count))
        .collect()
}

impl StrokeTarget {
    /// By size, how far a render's strokes are from the painting's.
    fn distances(&self, other: &Strokes) -> [f64; SIDES.len()] {
        std::array::from_fn(|size| {
            let layers = 0..LAYERS;
            let each = layers.map(|layer| {
                let root = &self.roots[size][layer];
                self.features[size][layer].distance(root, &other.0[size][layer])
            });
            each.sum()
        })
    }
}

/// The network with the directions that features are compared along.
struct StrokeNetwork {
    vgg: Perceptual,
    sides: [u32; SIDES.len()],
    directions: [Option<DMatrix<f32>>; LAYERS],
}

impl StrokeNetwork {
    fn new(vgg: &Perceptual, sides: [u32; SIDES.len()]) -> Result<Self, StyleError> {
        let [third, fourth] = stroke_directions()?.map(|rows| {
            let channels = rows.len() / impasto_style::STROKE_DIRECTIONS;
            let shape = (impasto_style::STROKE_DIRECTIONS, channels);
            Some(DMatrix::from_row_slice(shape.0, shape.1, &rows))
        });
        Ok(Self {
            vgg: vgg.clone(),
            sides,
            directions: [None, third, fourth],
        })
    }

    /// One picture at one size.
    fn features(&self, picture: &Luminance) -> Result<[FeatureGaussian; LAYERS], StyleError> {
        let maps = self
            .vgg
            .maps(&picture.rgb(), picture.height, picture.width)?;
        let [_, second, third, fourth] = &maps;
        let [a, b, c] = [second, third, fourth];
        let [p, q, r] = &self.directions;
        Ok([(a, p), (b, q), (c, r)]
            .map(|(map, directions)| FeatureGaussian::of(map, directions.as_ref())))
    }

    /// A picture at all sizes, as `of` makes it.
    fn at_sizes(
        &self,
        mut of: impl FnMut(u32) -> Luminance,
    ) -> Result<Sized<FeatureGaussian>, StyleError> {
        let [a, b, c] = self
            .sides
            .map(|side| self.features(&of(side).rank_matched()));
        Ok([a?, b?, c?])
    }

    fn strokes(&self, view: &RgbImage) -> Result<Strokes, StyleError> {
        let features = self.at_sizes(|side| Luminance::of(view, side))?;
        Ok(Strokes(Box::new(features)))
    }

    /// A painting's middle square, and two of its corners.
    fn target(&self, painting: &RgbImage) -> Result<StrokeTarget, StyleError> {
        let side = painting.width().min(painting.height());
        let square = square_crop(painting, 1.0, (0.5, 0.5), side);
        let features = self.at_sizes(|side| Luminance::of(&square, side))?;
        let corner = |last: bool| {
            self.at_sizes(|side| {
                let whole = Luminance::of(painting, side);
                let size = [whole.width, whole.height];
                let part = size.map(|length| (CROP * length as f64) as usize);
                let place = [0, 1].map(|i| if last { size[i] - part[i] } else { 0 });
                whole.crop(place, part)
            })
        };
        let (first, last) = (corner(false)?, corner(true)?);
        let own = std::array::from_fn(|size| {
            let layers = first[size].iter().zip(&last[size]);
            layers.map(|(a, b)| a.distance(&a.root(), b)).sum()
        });
        let roots = features
            .each_ref()
            .map(|layers| layers.each_ref().map(FeatureGaussian::root));
        Ok(StrokeTarget {
            features,
            roots,
            own,
            cheat: Vec::new(),
        })
    }

    /// A view under scrambled detail of a painting.
    fn cheats(
        &self,
        painting: &RgbImage,
        view: &RgbImage,
        rng: &mut Pcg64,
    ) -> Result<Vec<Strokes>, StyleError> {
        let textures = self
            .sides
            .map(|side| scrambled_detail(&Luminance::of(painting, side).rank_matched(), rng));
        let cheat = |strength: &f32| {
            let mut textures = textures.iter();
            let features = self.at_sizes(|side| {
                let plain = Luminance::of(view, side).rank_matched();
                match textures.next() {
                    Some(texture) => with_texture(&plain, texture, *strength),
                    None => plain,
                }
            })?;
            Ok(Strokes(Box::new(features)))
        };
        CHEATS.iter().map(cheat).collect()
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, reason = "a test may panic")]

    use super::*;
    use image::Rgb;

    /// A place: soft shapes.
    fn place(x: f32, y: f32) -> f32 {
        0.5 + 0.25 * (x / 40.0).sin() + 0.2 * (y / 31.0 + x / 90.0).cos()
    }

    fn picture(value: impl Fn(f32, f32) -> f32, tint: [f32; 3]) -> RgbImage {
        RgbImage::from_fn(160, 120, |x, y| {
            let value = value(x as f32, y as f32).clamp(0.0, 1.0);
            Rgb(tint.map(|t| (255.0 * t * value) as u8))
        })
    }

    /// Discs, a dozen pixels apart, that are as dark as the tone asks.
    fn dots(tone: impl Fn(f32, f32) -> f32) -> impl Fn(f32, f32) -> f32 {
        move |x, y| {
            let (u, v) = (x % 12.0 - 6.0, y % 12.0 - 6.0);
            let inside = (u * u + v * v).sqrt() < 4.0;
            tone(x - u, y - v) + if inside { -0.3 } else { 0.3 }
        }
    }

    /// Slanted hatching.
    fn lines(tone: impl Fn(f32, f32) -> f32) -> impl Fn(f32, f32) -> f32 {
        move |x, y| {
            tone(x, y)
                + if (x + 2.0 * y) % 14.0 < 5.0 {
                    -0.3
                } else {
                    0.3
                }
        }
    }

    #[test]
    fn strokes_count_and_neither_colour_nor_grain_does() {
        let vgg = Perceptual::vgg16().unwrap();
        let slope = |x: f32, y: f32| 0.3 + x / 400.0 + y / 500.0;
        let paintings = [
            ("dots".to_owned(), picture(dots(slope), [0.9, 0.6, 0.2])),
            ("lines".to_owned(), picture(lines(slope), [0.3, 0.6, 0.9])),
        ];
        let plain = [picture(place, [1.0; 3])];
        let mut pairs = 0;
        let metric = StrokeMetric::at([96, 112, 120], &vgg, &paintings, &plain, &mut || pairs += 1);
        let metric = metric.unwrap();
        assert_eq!(pairs, StrokeMetric::pairs(2, 1));
        let measure = |renders: [RgbImage; 2]| {
            let seen = renders.map(|render| metric.strokes(&[render]).unwrap());
            metric.measure(&seen).0
        };
        let painted = [
            picture(dots(place), [1.0; 3]),
            picture(lines(place), [1.0; 3]),
        ];
        let [first, second] = painted.clone();
        let swapped = measure([second, first]);
        let painted = measure(painted);
        let tinted = measure([
            picture(place, [0.9, 0.6, 0.2]),
            picture(place, [0.3, 0.6, 0.9]),
        ]);
        let noise = |x: f32, y: f32| ((x * 12.98 + y * 78.23).sin() * 43_758.547).fract();
        let grain = |x: f32, y: f32| place(x, y) + 0.3 * noise(x, y);
        let grainy = measure([picture(grain, [1.0; 3]), picture(grain, [1.0; 3])]);
        assert!(painted.stroke_score > 0.3, "{painted:?}");
        assert_eq!(painted.stroke_retrieval, 1.0);
        assert_eq!(swapped.stroke_retrieval, 0.0);
        for cheat in [tinted, grainy, swapped] {
            assert!(cheat.stroke_score < 0.1, "{cheat:?}");
        }
    }

    #[test]
    fn views_are_spread_evenly() {
        assert_eq!(chosen(0), [0; 0]);
        assert_eq!(chosen(1), [0]);
        assert_eq!(chosen(2), [0, 1]);
        assert_eq!(chosen(8), [2, 6]);
    }
}
