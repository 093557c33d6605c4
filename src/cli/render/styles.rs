//! The paintings to render with.

use std::collections::HashSet;
use std::path::Path;
use std::time::Duration;

use image::RgbImage;
use impasto::eval::EvalError;
use impasto::scene::{SceneError, read_rgb};
use impasto::{Budget, Inspiration, Look, Model, Refinement};

use super::Variant;
use crate::cli::CliError;
use crate::cli::progress::Share;
use crate::cli::values::StyleArg;

/// The paintings, read, and what to do with them.
pub enum Styles {
    /// None: the photos' own look.
    Photo,
    /// Each for itself, under its name.
    Each(Vec<(String, RgbImage)>),
    /// All in one, by their weights.
    Mix(Vec<(RgbImage, f32)>),
}

impl Styles {
    /// Reads the paintings. Weights belong to all of them or to none.
    pub fn read(args: &[StyleArg]) -> Result<Self, CliError> {
        let weights: Vec<f32> = args.iter().filter_map(|style| style.weight).collect();
        if !weights.is_empty() && weights.len() < args.len() {
            let problem = "give every --style a weight to mix them, or none to render each";
            return Err(CliError::Usage(problem.into()));
        }
        if !weights.is_empty() && weights.iter().all(|weight| *weight == 0.0) {
            return Err(Self::weightless());
        }
        let images = args
            .iter()
            .map(|style| painting(&style.path))
            .collect::<Result<Vec<_>, _>>()?;
        Ok(if args.is_empty() {
            Self::Photo
        } else if weights.is_empty() {
            Self::Each(names(args).into_iter().zip(images).collect())
        } else {
            Self::Mix(images.into_iter().zip(weights).collect())
        })
    }

    fn weightless() -> CliError {
        CliError::Usage("at least one --style needs a weight above 0".into())
    }

    /// Whether the scene is left as photographed.
    pub fn is_empty(&self) -> bool {
        matches!(self, Self::Photo)
    }

    /// The looks that the model gives them, each refined for so long.
    pub fn variants(
        &self,
        model: &Model,
        refine: Option<Duration>,
    ) -> Result<Vec<Variant>, CliError> {
        let wanted = self.wanted();
        if self.is_empty() {
            let named = wanted.into_iter().map(|(name, _)| Variant {
                name,
                look: model.photo_look(),
            });
            return Ok(named.collect());
        }
        let looks = match refine {
            Some(time) => refined(model, &wanted, time)?,
            None => {
                let looks = wanted.iter().map(|(_, paintings)| look(model, paintings));
                looks.collect::<Result<_, _>>()?
            }
        };
        let names = wanted.into_iter().map(|(name, _)| name);
        let variants = names.zip(looks);
        Ok(variants
            .map(|(name, look)| Variant { name, look })
            .collect())
    }

    /// Names of the variants, each with the paintings that it is made from by weight; the photos'
    /// own look is made from none.
    pub fn wanted(&self) -> Vec<(String, Vec<(&RgbImage, f32)>)> {
        match self {
            Self::Photo => vec![("photo".into(), Vec::new())],
            Self::Each(images) => {
                let all = images.iter();
                all.map(|(name, image)| (name.clone(), vec![(image, 1.0)]))
                    .collect()
            }
            Self::Mix(images) => {
                let all = images.iter().map(|(image, weight)| (image, *weight));
                vec![("mix".into(), all.collect())]
            }
        }
    }
}

/// The look that a model predicts for paintings mixed by weight.
fn look(model: &Model, paintings: &[(&RgbImage, f32)]) -> Result<Look, CliError> {
    let inspirations = paintings
        .iter()
        .map(|(image, weight)| Ok((model.inspiration(image)?, *weight)))
        .collect::<Result<Vec<_>, CliError>>()?;
    let mix = Inspiration::mix(&inspirations).ok_or_else(Styles::weightless)?;
    model.look(&mix).ok_or(CliError::Unstyled)
}

/// The same after each has gone on learning for so long.
fn refined(
    model: &Model,
    wanted: &[(String, Vec<(&RgbImage, f32)>)],
    time: Duration,
) -> Result<Vec<Look>, CliError> {
    if !model.has_style() {
        return Err(CliError::Unstyled);
    }
    let mut refinement = Refinement::new(model)?.ok_or(EvalError::NoTrainingViews)?;
    let mut bar = Share::new("refine");
    let mut looks = Vec::with_capacity(wanted.len());
    for (i, (name, paintings)) in wanted.iter().enumerate() {
        let mut show = |progress: f64| {
            bar.show((i as f64 + progress) / wanted.len() as f64, name);
        };
        let look = refinement.look(paintings, Budget::Time(time), &mut show)?;
        looks.push(look.ok_or_else(Styles::weightless)?);
    }
    Ok(looks)
}

/// Reads one style image.
pub fn painting(path: &Path) -> Result<RgbImage, CliError> {
    read_rgb(path).map_err(|error| match error {
        SceneError::Photo { path, problem } => CliError::Painting { path, problem },
        SceneError::Io { path, source } => CliError::Read { path, source },
        other => CliError::Scene(other),
    })
}

/// File names without their endings, made different by numbers where they are not.
fn names(args: &[StyleArg]) -> Vec<String> {
    let mut taken = HashSet::new();
    args.iter()
        .map(|style| {
            let stem = style
                .path
                .file_stem()
                .map_or("style".into(), |s| s.to_string_lossy());
            let numbered = |n: usize| {
                if n == 1 {
                    stem.to_string()
                } else {
                    format!("{stem}-{n}")
                }
            };
            let mut n = 1;
            while !taken.insert(numbered(n)) {
                n += 1;
            }
            numbered(n)
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn args(styles: &[&str]) -> Vec<StyleArg> {
        styles.iter().map(|s| s.parse().unwrap()).collect()
    }

    #[test]
    fn names_are_different() {
        assert_eq!(
            names(&args(&["a/x.png", "b/x.jpg", "y.png"])),
            ["x", "x-2", "y"]
        );
    }

    #[test]
    fn weights_are_for_all_or_none() {
        for wrong in [["a.png:0.5", "b.png"], ["a.png:0", "b.png:0"]] {
            assert!(
                matches!(Styles::read(&args(&wrong)), Err(CliError::Usage(_))),
                "{wrong:?}"
            );
        }
    }
}
