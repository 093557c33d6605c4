//! The field: two branches, their sizes and weights.

use crate::appearance::Appearance;
use crate::branch::{Branch, BranchWeights};
use crate::config::{AppearanceConfig, FieldConfig};
use crate::encoding::vector;
use crate::parameters::Parameters;
use burn::tensor::{Device, Tensor};
use rand::RngExt;
use rand_pcg::Pcg64;

/// Sizes of a field. Holds no weights.
#[derive(Debug, Clone)]
pub struct Field {
    /// The configuration it was made from.
    pub config: FieldConfig,
    /// Unit ball.
    pub inner: Branch,
    /// Beyond.
    pub outer: Branch,
}

/// Weights of both branches.
#[derive(Debug, Clone)]
pub struct FieldWeights {
    /// The learned vector that both volumes share, where the configuration has one.
    pub latent: Option<Tensor<1>>,
    /// Unit ball.
    pub inner: BranchWeights,
    /// Beyond.
    pub outer: BranchWeights,
    /// The cascade's first field, of the same sizes, where there is a cascade.
    pub coarse: Option<Box<FieldWeights>>,
}

impl Field {
    /// A field of the given sizes.
    pub fn new(config: FieldConfig) -> Self {
        Self {
            inner: Branch::new(config.inner.clone(), 3, config.latent),
            outer: Branch::new(config.outer.clone(), 4, config.latent),
            config,
        }
    }

    /// Widths of the features of both volumes.
    pub fn features(&self) -> [usize; 2] {
        [self.inner.features(), self.outer.features()]
    }

    /// Random weights.
    pub fn init(&self, rng: &mut Pcg64, device: &Device) -> FieldWeights {
        let coarse = self
            .is_cascade()
            .then(|| Box::new(self.init_level(rng, device)));
        FieldWeights {
            coarse,
            ..self.init_level(rng, device)
        }
    }

    /// Zero weights, for reading.
    pub fn zeros(&self, device: &Device) -> FieldWeights {
        let level = || FieldWeights {
            latent: self.config.latent.map(|n| Tensor::zeros([n], device)),
            inner: self.inner.zeros(device),
            outer: self.outer.zeros(device),
            coarse: None,
        };
        FieldWeights {
            coarse: self.is_cascade().then(|| Box::new(level())),
            ..level()
        }
    }

    fn is_cascade(&self) -> bool {
        self.config.levels() > 1
    }

    fn init_level(&self, rng: &mut Pcg64, device: &Device) -> FieldWeights {
        let latent = self.config.latent.map(|length| {
            // Of length one at first, however long.
            let size = (3.0 / length as f32).sqrt();
            let numbers = (0..length).map(|_| rng.random_range(-size..size));
            vector(numbers.collect(), device)
        });
        FieldWeights {
            latent,
            inner: self.inner.init(rng, device),
            outer: self.outer.init(rng, device),
            coarse: None,
        }
    }
}

impl Parameters for FieldWeights {
    fn try_map<E>(
        &self,
        f: &mut dyn FnMut(&str, &Tensor<1>) -> Result<Tensor<1>, E>,
    ) -> Result<Self, E> {
        let latent = self.latent.as_ref().map(|z| f("latent", z)).transpose()?;
        let mut branch = |volume: &str, w: &BranchWeights| -> Result<BranchWeights, E> {
            Ok(BranchWeights {
                encoding: f(&format!("{volume}.encoding"), &w.encoding)?,
                base: f(&format!("{volume}.base"), &w.base)?,
                geo: f(&format!("{volume}.geo"), &w.geo)?,
            })
        };
        let (inner, outer) = (branch("inner", &self.inner)?, branch("outer", &self.outer)?);
        let coarse = self
            .coarse
            .as_ref()
            .map(|coarse| coarse.try_map(&mut |name, t| f(&format!("coarse.{name}"), t)));
        Ok(Self {
            latent,
            inner,
            outer,
            coarse: coarse.transpose()?.map(Box::new),
        })
    }
}

/// A field with the colours that photos show: what the geometry stage trains, one level of a cascade
/// at a time.
#[derive(Debug, Clone)]
pub struct RadianceField {
    /// The field.
    pub weights: FieldWeights,
    /// Its colours.
    pub app: Appearance,
}

impl RadianceField {
    /// A field with its photos' appearance, which gets the field's learned vector if it wants it.
    pub fn new(weights: FieldWeights, app: Appearance) -> Self {
        let latent = app.config.latent.and(weights.latent.clone());
        let app = Appearance { latent, ..app };
        Self { weights, app }
    }

    /// Zero weights, for reading.
    pub fn zeros(field: &Field, app: AppearanceConfig, device: &Device) -> Self {
        let app = Appearance::zeros(app, field.features(), device);
        Self::new(field.zeros(device), app)
    }
}

impl Parameters for RadianceField {
    fn try_map<E>(
        &self,
        f: &mut dyn FnMut(&str, &Tensor<1>) -> Result<Tensor<1>, E>,
    ) -> Result<Self, E> {
        let weights = self.weights.try_map(f)?;
        let app = self
            .app
            .try_map(&mut |name, t| f(&name.replace("app", "photo_app"), t))?;
        Ok(Self::new(weights, app))
    }
}
