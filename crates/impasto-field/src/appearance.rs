//! `app`: from what it sees of samples to colour, with weights that are data.

use crate::branch::kaiming;
use crate::config::AppearanceConfig;
use crate::distilled::DistilledFeatures;
use crate::encoding::vector;
use crate::parameters::Parameters;
use burn::tensor::{Device, Tensor};
use impasto_kernels::cpu::exemplar;
use rand::RngExt;
use rand_pcg::Pcg64;

/// What an appearance is painted with, beside W^app.
#[derive(Debug, Clone)]
pub struct Brushwork {
    /// The painting's own detail, whitened, see [`ops::exemplar`](impasto_kernels::ops::exemplar).
    pub exemplar: Tensor<1>,
    /// Where colours come from and go to.
    pub palette: Palette,
    /// How large and how strong strokes are.
    pub strokes: StrokeSettings,
}

/// What strokes are made of what was learned: nothing that is trained.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct StrokeSettings {
    /// How many times as large as they were learned, 0.5 to 2.
    pub size: f32,
    /// From the scene in the painting's colours (0) to all strokes (1).
    pub strength: f32,
}

impl Default for StrokeSettings {
    fn default() -> Self {
        Self {
            size: 1.0,
            strength: 1.0,
        }
    }
}

impl Brushwork {
    /// Detail of random waves; colours stay as they are.
    fn init(rng: &mut Pcg64, device: &Device) -> Self {
        let waves: [[f32; 3]; exemplar::FEATURES] = std::array::from_fn(|_| {
            [0.2, 0.2, std::f32::consts::TAU].map(|most| rng.random_range(0.0..most))
        });
        let texels = (0..exemplar::SIDE).flat_map(|y| (0..exemplar::SIDE).map(move |x| [x, y]));
        let entries = texels.flat_map(|at| {
            let [x, y] = at.map(|at| at as f32);
            waves.map(|[across, down, phase]| (across * x + down * y + phase).sin())
        });
        Self {
            exemplar: vector(entries.collect(), device),
            ..Self::none(device)
        }
    }

    /// No detail; colours stay as they are.
    pub fn none(device: &Device) -> Self {
        Self {
            exemplar: Tensor::zeros([exemplar::PARAMS], device),
            palette: Palette::NONE,
            strokes: StrokeSettings::default(),
        }
    }
}

/// The way into a painting's whitened colours and back: affine maps, row by row, what is added last.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Palette {
    /// From the scene's unstylised colours, through the painting's, to whitened ones.
    pub whitened: [[f32; 4]; 3],
    /// From whitened colours to the painting's.
    pub coloured: [[f32; 4]; 3],
}

/// Whitened colours farther out than this many deviations are drawn in: a linear map overshoots.
const FARTHEST_COLOUR: f32 = 2.5;
/// What is left of the slope where a colour leaves `[0, 1]`, so that gradients bring it back.
const OUTSIDE: f32 = 0.02;

impl Palette {
    /// Colours as they are.
    pub const NONE: Self = {
        let identity = [
            [1.0, 0.0, 0.0, 0.0],
            [0.0, 1.0, 0.0, 0.0],
            [0.0, 0.0, 1.0, 0.0],
        ];
        Self {
            whitened: identity,
            coloured: identity,
        }
    };

    /// Unstylised colours, `[n, 3]`, as the painting's before anything is painted, in `[0, 1]`.
    pub fn recoloured(&self, colours: Tensor<2>) -> Tensor<2> {
        self.colour(self.whiten(colours)).clamp(0.0, 1.0)
    }

    /// Unstylised colours, `[n, 3]`, as whitened ones.
    pub(crate) fn whiten(&self, colours: Tensor<2>) -> Tensor<2> {
        let far = affine(colours, &self.whitened) / FARTHEST_COLOUR;
        far.tanh() * FARTHEST_COLOUR
    }

    /// Whitened colours, `[n, 3]`, as the painting's: beyond `[0, 1]` compressed, not cut.
    pub(crate) fn colour(&self, whitened: Tensor<2>) -> Tensor<2> {
        let colours = affine(whitened, &self.coloured);
        let inside = colours.clone().clamp(0.0, 1.0);
        inside.clone() + (colours - inside) * OUTSIDE
    }
}

fn affine(rows: Tensor<2>, map: &[[f32; 4]; 3]) -> Tensor<2> {
    let device = rows.device();
    let column = |input: usize| map.map(|row| row[input]);
    let matrix = [0, 1, 2].map(column).concat();
    let matrix = Tensor::<1>::from_data(matrix.as_slice(), &device).reshape([3, 3]);
    let added = Tensor::<1>::from_data(column(3).as_slice(), &device).reshape([1, 3]);
    rows.matmul(matrix) + added
}

/// Everything that turns what is seen of samples into colours: W^app of both volumes, and paint.
#[derive(Debug, Clone)]
pub struct Appearance {
    /// Sizes.
    pub config: AppearanceConfig,
    /// W^app of the inner volume, flat.
    pub inner: Tensor<1>,
    /// W^app of the outer volume, flat.
    pub outer: Tensor<1>,
    /// What it is painted with, where the configuration paints.
    pub paint: Option<Brushwork>,
    /// The field's learned vector, where the configuration asks for one. The field's, no parameter
    /// of the appearance.
    pub latent: Option<Tensor<1>>,
}

impl Appearance {
    /// Random weights and detail; no learned vector, which belongs to the field.
    pub fn init(
        config: AppearanceConfig,
        features: [usize; 2],
        rng: &mut Pcg64,
        device: &Device,
    ) -> Self {
        let mut app = |width| kaiming(config.network(width).layers(), rng, device);
        let [inner, outer] = [app(features[0]), app(features[1])];
        let paint = config.shading.paint();
        Self {
            paint: paint.map(|_| Brushwork::init(rng, device)),
            config,
            inner,
            outer,
            latent: None,
        }
    }

    /// Zero weights, for reading.
    pub fn zeros(config: AppearanceConfig, features: [usize; 2], device: &Device) -> Self {
        let app = |width| Tensor::zeros([config.network(width).params()], device);
        Self {
            inner: app(features[0]),
            outer: app(features[1]),
            paint: config.shading.paint().map(|_| Brushwork::none(device)),
            latent: None,
            config,
        }
    }
}

/// What is painted on: all that is known of a scene's surfaces before any style.
#[derive(Debug, Clone)]
pub struct Ground {
    /// The unstylised appearance.
    pub photo: Appearance,
    /// What is around places; zeros where nothing was distilled.
    pub features: Option<DistilledFeatures>,
}

impl From<Appearance> for Ground {
    fn from(photo: Appearance) -> Self {
        let features = None;
        Self { photo, features }
    }
}

impl Parameters for Brushwork {
    fn try_map<E>(
        &self,
        f: &mut dyn FnMut(&str, &Tensor<1>) -> Result<Tensor<1>, E>,
    ) -> Result<Self, E> {
        Ok(Self {
            exemplar: f("exemplar", &self.exemplar)?,
            ..*self
        })
    }
}

impl Parameters for Appearance {
    fn try_map<E>(
        &self,
        f: &mut dyn FnMut(&str, &Tensor<1>) -> Result<Tensor<1>, E>,
    ) -> Result<Self, E> {
        Ok(Self {
            config: self.config.clone(),
            inner: f("inner.app", &self.inner)?,
            outer: f("outer.app", &self.outer)?,
            paint: self.paint.as_ref().map(|p| p.try_map(f)).transpose()?,
            latent: self.latent.clone(),
        })
    }
}
