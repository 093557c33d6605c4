//! The paintings to render with.

use std::collections::HashSet;
use std::path::Path;
use std::time::Duration;

use image::RgbImage;
use impasto::eval::EvalError;
use impasto::scene::file::read_text;
use impasto::{Budget, Coat, CoatSpec, Coats, Inspiration, Look, Model, Refinement};

use super::{RenderSettings, Variant};
use crate::cli::CliError;
use crate::cli::painting::{PaintingSource, StyleArg};
use crate::cli::progress::Share;

/// The paintings, read, and what to do with them.
pub enum Styles {
    /// None: the photos' own look.
    Photo,
    /// Each for itself, under its name.
    Each(Vec<(String, RgbImage)>),
    /// All in one, by their weights.
    Mix(Vec<(RgbImage, f32)>),
    /// One over the other, each with its paintings.
    Coats(Vec<(CoatSpec, Vec<RgbImage>)>),
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
            .map(|style| style.painting.read())
            .collect::<Result<Vec<_>, _>>()?;
        Ok(if args.is_empty() {
            Self::Photo
        } else if weights.is_empty() {
            Self::Each(names(args).into_iter().zip(images).collect())
        } else {
            Self::Mix(images.into_iter().zip(weights).collect())
        })
    }

    /// Reads a file of coats and their paintings, whose paths are relative to it.
    pub fn read_coats(path: &Path) -> Result<Self, CliError> {
        let text = read_text(path).map_err(CliError::read(path))?;
        let wrong = |problem: String| CliError::CoatsFile {
            path: path.to_owned(),
            problem,
        };
        let coats: Coats = serde_json::from_str(&text).map_err(|e| wrong(e.to_string()))?;
        coats.check().map_err(|error| wrong(error.to_string()))?;
        let folder = path.parent().unwrap_or(Path::new(""));
        let read = |coat: CoatSpec| {
            let paintings = coat.paintings.iter();
            let paintings = paintings.map(|one| {
                let source = PaintingSource::named(&one.painting, folder);
                source.map_err(&wrong)?.read()
            });
            Ok((coat.clone(), paintings.collect::<Result<_, CliError>>()?))
        };
        Ok(Self::Coats(
            coats
                .coats
                .into_iter()
                .map(read)
                .collect::<Result<_, CliError>>()?,
        ))
    }

    /// What is to be said of those paintings that `args` or the coats have generated.
    pub fn generated(&self, args: &[StyleArg]) -> Vec<String> {
        let named = |name: &str| PaintingSource::named(name, Path::new("")).ok();
        let mut labels: Vec<String> = match self {
            Self::Coats(specs) => specs
                .iter()
                .flat_map(|(spec, _)| &spec.paintings)
                .filter_map(|one| named(&one.painting)?.label())
                .collect(),
            Self::Photo | Self::Each(_) | Self::Mix(_) => {
                let labels = args.iter().map(|style| style.painting.label());
                labels.flatten().collect()
            }
        };
        labels.dedup();
        labels
    }

    fn weightless() -> CliError {
        CliError::Usage("at least one --style needs a weight above 0".into())
    }

    /// Whether the scene is left as photographed.
    pub fn is_empty(&self) -> bool {
        matches!(self, Self::Photo)
    }

    /// The looks that the model gives them, each refined for so long, put on as the settings say.
    pub fn variants(
        &self,
        model: &Model,
        refine: Option<Duration>,
        settings: &RenderSettings,
    ) -> Result<Vec<Variant>, CliError> {
        if let Self::Coats(specs) = self {
            let specs = specs.iter();
            let specs = specs.map(|(spec, images)| (spec, images.iter().collect()));
            return Ok(vec![Variant {
                name: "coats".into(),
                coats: coats_of(model, specs)?,
            }]);
        }
        let variants = self.looks(model, refine)?.into_iter().map(|(name, look)| {
            let coat = look.map(|look| settings.coat(model, look)).transpose()?;
            Ok(Variant {
                name,
                coats: coat.into_iter().collect(),
            })
        });
        variants.collect()
    }

    /// The names of the variants, and the looks that the model gives them; none for the photos' own.
    pub fn looks(
        &self,
        model: &Model,
        refine: Option<Duration>,
    ) -> Result<Vec<(String, Option<Look>)>, CliError> {
        let wanted = self.wanted();
        if self.is_empty() {
            return Ok(wanted.into_iter().map(|(name, _)| (name, None)).collect());
        }
        let looks = match refine {
            Some(time) => refined(model, &wanted, time)?,
            None => {
                let looks = wanted.iter().map(|(_, paintings)| look(model, paintings));
                looks.collect::<Result<_, _>>()?
            }
        };
        let names = wanted.into_iter().map(|(name, _)| name);
        Ok(names.zip(looks.into_iter().map(Some)).collect())
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
            Self::Coats(specs) => {
                let all = specs.iter().flat_map(|(spec, images)| {
                    let weights = spec.paintings.iter().map(|painting| painting.weight);
                    images.iter().zip(weights)
                });
                vec![("coats".into(), all.collect())]
            }
        }
    }
}

/// Coats, each of its paintings in order.
pub fn coats_of<'a>(
    model: &Model,
    specs: impl IntoIterator<Item = (&'a CoatSpec, Vec<&'a RgbImage>)>,
) -> Result<Vec<Coat>, CliError> {
    let specs = specs.into_iter();
    let coats = specs.map(|(spec, images)| {
        let weights = spec.paintings.iter().map(|painting| painting.weight);
        let inspirations = model.inspirations(images.into_iter().zip(weights))?;
        Ok(model.coat(spec, &inspirations)?)
    });
    coats.collect()
}

/// The look that a model predicts for paintings mixed by weight.
fn look(model: &Model, paintings: &[(&RgbImage, f32)]) -> Result<Look, CliError> {
    let inspirations = model.inspirations(paintings.iter().copied())?;
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

impl RenderSettings {
    /// A look, put on as they say.
    pub fn coat(&self, model: &Model, look: Look) -> Result<Coat, CliError> {
        Ok(model.coat_of(look, self.strength, self.keep, self.mask.as_ref())?)
    }
}

/// The paintings' names, made different by numbers where they are not.
fn names(args: &[StyleArg]) -> Vec<String> {
    let mut taken = HashSet::new();
    args.iter()
        .map(|style| {
            let stem = style.painting.stem();
            let numbered = |n: usize| {
                if n == 1 {
                    stem.clone()
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
