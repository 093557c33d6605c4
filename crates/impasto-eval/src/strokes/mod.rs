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

pub use crate::grid::Grid;

use gaussian::FeatureGaussian;
use image::RgbImage;
use impasto_style::{Perceptual, STROKE_DIRECTIONS, StyleError, square_crop, stroke_directions};
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

/// Something for each size and layer.
type BySize<T> = [[T; LAYERS]; SIDES.len()];

/// What is seen of a picture's strokes.
pub(crate) struct Strokes(Box<BySize<FeatureGaussian>>);

/// A picture's strokes that others are compared with.
struct Reference {
    strokes: Strokes,
    /// Roots of their covariances.
    roots: BySize<DMatrix<f32>>,
}

/// A painting's strokes, and how near one can come to them.
struct StrokeTarget {
    painting: Reference,
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
        let unpainted: Vec<_> = views.iter().map(|i| network.grey(&plain[*i])).collect();
        let photos = unpainted.iter().map(|grey| network.strokes_of(grey));
        let photos: Vec<Strokes> = photos.collect::<Result<_, _>>()?;
        let mut targets = Vec::with_capacity(paintings.len());
        let mut rng = Pcg64::seed_from_u64(0);
        for (_, painting) in paintings {
            let mut target = network.target(painting)?;
            let whole = network.grey(painting);
            let texture = whole
                .each_ref()
                .map(|grey| scrambled_detail(grey, &mut rng));
            for (grey, photo) in unpainted.iter().zip(&photos) {
                let mut nearest = target.painting.distances(photo);
                for strength in CHEATS {
                    let cheat = std::array::from_fn(|size| {
                        with_texture(&grey[size], &texture[size], strength).rank_matched()
                    });
                    let found = target.painting.distances(&network.strokes_of(&cheat)?);
                    nearest = std::array::from_fn(|size| nearest[size].min(found[size]));
                }
                target.cheat.push(nearest);
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
        let strokes = chosen.map(|view| self.network.strokes_of(&self.network.grey(view)));
        strokes.collect()
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
            let found = target.painting.distances(own);
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
                .any(|other| target.painting.distances(other).iter().sum::<f64>() <= distance);
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

impl Reference {
    fn new(strokes: Strokes) -> Self {
        let layers = strokes.0.each_ref();
        let roots = layers.map(|layers| layers.each_ref().map(FeatureGaussian::root));
        Self { strokes, roots }
    }

    /// By size, how far another picture's strokes are from these.
    fn distances(&self, other: &Strokes) -> [f64; SIDES.len()] {
        std::array::from_fn(|size| {
            let own = self.strokes.0[size].iter().zip(&self.roots[size]);
            let pairs = own.zip(&other.0[size]);
            pairs
                .map(|((own, root), other)| own.distance(root, other))
                .sum()
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
            let channels = rows.len() / STROKE_DIRECTIONS;
            Some(DMatrix::from_row_slice(STROKE_DIRECTIONS, channels, &rows))
        });
        Ok(Self {
            vgg: vgg.clone(),
            sides,
            directions: [None, third, fourth],
        })
    }

    /// A picture at all sizes, of one histogram.
    fn grey(&self, picture: &RgbImage) -> [Grid<f32>; SIDES.len()] {
        let at = |side| Grid::resampled(picture, side).rank_matched();
        self.sides.map(at)
    }

    /// What is seen of such a picture.
    fn strokes_of(&self, grey: &[Grid<f32>; SIDES.len()]) -> Result<Strokes, StyleError> {
        let [a, b, c] = grey.each_ref().map(|grey| self.features(grey));
        Ok(Strokes(Box::new([a?, b?, c?])))
    }

    /// What is seen of it at one size.
    fn features(&self, grey: &Grid<f32>) -> Result<[FeatureGaussian; LAYERS], StyleError> {
        let maps = self.vgg.maps(&grey.rgb(), grey.height, grey.width)?;
        Ok(std::array::from_fn(|layer| {
            let directions = self.directions[layer].as_ref();
            FeatureGaussian::of(&maps[layer + 1], directions)
        }))
    }

    /// A painting's middle square, and two of its corners.
    fn target(&self, painting: &RgbImage) -> Result<StrokeTarget, StyleError> {
        let side = painting.width().min(painting.height());
        let square = square_crop(painting, 1.0, (0.5, 0.5), side);
        let corner = |last: bool| {
            let grey = self.sides.map(|side| {
                let whole = Grid::resampled(painting, side);
                let size = [whole.width, whole.height];
                let part = size.map(|length| (CROP * length as f64) as usize);
                let place = [0, 1].map(|i| if last { size[i] - part[i] } else { 0 });
                whole.crop(place, part).rank_matched()
            });
            self.strokes_of(&grey)
        };
        Ok(StrokeTarget {
            painting: Reference::new(self.strokes_of(&self.grey(&square))?),
            own: Reference::new(corner(false)?).distances(&corner(true)?),
            cheat: Vec::new(),
        })
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
