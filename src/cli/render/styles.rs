//! The paintings to render with.

use std::collections::HashSet;
use std::fs::File;
use std::iter;
use std::path::{Path, PathBuf};
use std::time::Duration;

use image::RgbImage;
use impasto::eval::EvalError;
use impasto::scene::file::read_text;
use impasto::weights::sha256;
use impasto::{
    Budget, Device, Model, Refinement, SavedAppearance, StyleEmbedding, StyleLayer, StyleLayerSpec,
    StyleLayers, StyledAppearance,
};

use super::settings::RenderSettings;
use crate::cli::CliError;
use crate::cli::painting::{PaintingSource, StyleArg};
use crate::cli::progress::TimedBar;

/// How looks are refined.
#[derive(Clone, Copy)]
pub struct RefineRequest<'a> {
    /// How long each.
    pub time: Duration,
    /// Where the look is kept.
    pub save: Option<&'a Path>,
}

/// The paintings, read, and what to do with them.
pub struct Styles {
    /// How the scene is painted.
    pub paint: PaintMode,
    /// What is to be said of those paintings that are generated.
    pub generated: Vec<String>,
}

/// How the scene is painted.
pub enum PaintMode {
    /// In one look after the other.
    Mixtures(Vec<Mixture>),
    /// In coats, one over the other, each with its paintings.
    Layers(Vec<(StyleLayerSpec, Vec<RgbImage>)>),
    /// In a look that was saved.
    Saved(Box<SavedLook>),
}

/// A look that was saved, from its file.
pub struct SavedLook {
    /// The file's name without its ending.
    pub name: String,
    /// What the file says.
    pub appearance: SavedAppearance,
    /// Hash of the file.
    pub digest: String,
    path: PathBuf,
}

impl SavedLook {
    fn read(path: &Path) -> Result<Self, CliError> {
        let stem = path.file_stem().unwrap_or_default();
        Ok(Self {
            name: stem.to_string_lossy().into_owned(),
            appearance: SavedAppearance::load(path, &Device::flex())?,
            digest: File::open(path)
                .and_then(sha256)
                .map_err(CliError::read(path))?,
            path: path.to_owned(),
        })
    }

    fn on(&self, model: &Model) -> Result<StyledAppearance, CliError> {
        model.saved_appearance(&self.appearance).ok_or_else(|| {
            CliError::Refused(format!(
                "{}: was refined on a model that paints with other sizes; refine again on this one",
                self.path.display()
            ))
        })
    }
}

/// Paintings that make one look, each with its weight; none for the photos' own.
pub struct Mixture {
    /// What the look is called.
    pub name: String,
    /// The paintings.
    pub paintings: Vec<(RgbImage, f32)>,
}

impl Mixture {
    /// The photos' own look.
    pub fn photo() -> Self {
        Self {
            name: "photo".into(),
            paintings: Vec::new(),
        }
    }

    /// One painting.
    pub fn single(name: String, painting: RgbImage) -> Self {
        Self {
            name,
            paintings: vec![(painting, 1.0)],
        }
    }

    /// The paintings with their weights.
    pub fn weighed(&self) -> impl Iterator<Item = (&RgbImage, f32)> {
        let all = self.paintings.iter();
        all.map(|(painting, weight)| (painting, *weight))
    }

    /// The look that a model predicts; none for the photos' own.
    pub fn look(&self, model: &Model) -> Result<Option<StyledAppearance>, CliError> {
        if self.paintings.is_empty() {
            return Ok(None);
        }
        let inspirations = model.embeddings(self.weighed())?;
        let mix = StyleEmbedding::mix(&inspirations).ok_or_else(weightless)?;
        model.appearance(&mix).map(Some).ok_or(CliError::Unstyled)
    }
}

impl Styles {
    /// Reads a saved look, a file of coats, or else the paintings of arguments.
    pub fn load(
        args: &[StyleArg],
        coats: Option<&Path>,
        look: Option<&Path>,
    ) -> Result<Self, CliError> {
        match (coats, look) {
            (_, Some(path)) => Ok(Self::new(
                PaintMode::Saved(Box::new(SavedLook::read(path)?)),
                Vec::new(),
            )),
            (Some(path), None) => Self::read_coats(path),
            (None, None) => Self::read(args),
        }
    }

    /// Reads paintings. Weights belong to all of them or to none.
    pub fn read(args: &[StyleArg]) -> Result<Self, CliError> {
        let weights: Vec<f32> = args.iter().filter_map(|style| style.weight).collect();
        if !weights.is_empty() && weights.len() < args.len() {
            let problem = "give every --style a weight to mix them, or none to render each";
            return Err(CliError::Usage(problem.into()));
        }
        if !weights.is_empty() && weights.iter().all(|weight| *weight == 0.0) {
            return Err(weightless());
        }
        let images = args.iter().map(|style| style.painting.read());
        let images = images.collect::<Result<Vec<_>, _>>()?.into_iter();
        let mixtures = if args.is_empty() {
            vec![Mixture::photo()]
        } else if weights.is_empty() {
            let named = names(args).into_iter().zip(images);
            let each = named.map(|(name, image)| Mixture::single(name, image));
            each.collect()
        } else {
            vec![Mixture {
                name: "mix".into(),
                paintings: images.zip(weights).collect(),
            }]
        };
        let labels = args.iter().filter_map(|style| style.painting.label());
        Ok(Self::new(PaintMode::Mixtures(mixtures), labels.collect()))
    }

    /// Reads a file of coats and their paintings, whose paths are relative to it.
    fn read_coats(path: &Path) -> Result<Self, CliError> {
        let text = read_text(path).map_err(CliError::read(path))?;
        let wrong = |problem: String| CliError::CoatsFile {
            path: path.to_owned(),
            problem,
        };
        let coats: StyleLayers = serde_json::from_str(&text).map_err(|e| wrong(e.to_string()))?;
        coats.check().map_err(|error| wrong(error.to_string()))?;
        let folder = path.parent().unwrap_or(Path::new(""));
        let (mut read, mut labels) = (Vec::new(), Vec::new());
        for coat in coats.coats {
            let mut paintings = Vec::new();
            for one in &coat.paintings {
                let source = PaintingSource::named(&one.painting, folder).map_err(wrong)?;
                paintings.push(source.read()?);
                labels.extend(source.label());
            }
            read.push((coat, paintings));
        }
        Ok(Self::new(PaintMode::Layers(read), labels))
    }

    fn new(paint: PaintMode, mut generated: Vec<String>) -> Self {
        generated.dedup();
        Self { paint, generated }
    }

    /// Names of the variants.
    pub fn names(&self) -> Vec<String> {
        match &self.paint {
            PaintMode::Mixtures(mixtures) => mixtures.iter().map(|one| one.name.clone()).collect(),
            PaintMode::Layers(_) => vec!["coats".into()],
            PaintMode::Saved(look) => vec![look.name.clone()],
        }
    }

    /// All paintings of mixtures.
    pub fn paintings(&self) -> impl Iterator<Item = &RgbImage> {
        let mixtures = match &self.paint {
            PaintMode::Mixtures(mixtures) => mixtures.as_slice(),
            PaintMode::Layers(_) | PaintMode::Saved(_) => &[],
        };
        let paintings = mixtures.iter().flat_map(|mixture| &mixture.paintings);
        paintings.map(|(painting, _)| painting)
    }

    /// Whether the scene is left as photographed.
    pub fn is_empty(&self) -> bool {
        matches!(self.paint, PaintMode::Mixtures(_)) && self.paintings().next().is_none()
    }

    /// The coats of each variant: the looks that the model gives them, each refined for so long, put
    /// on as the settings say.
    pub fn variants(
        &self,
        model: &Model,
        refine: Option<RefineRequest<'_>>,
        settings: &RenderSettings,
    ) -> Result<Vec<Vec<StyleLayer>>, CliError> {
        let mixtures = match &self.paint {
            PaintMode::Mixtures(mixtures) => mixtures,
            PaintMode::Layers(specs) => {
                let specs = specs.iter();
                let specs = specs.map(|(spec, images)| (spec, images.iter().collect()));
                return Ok(vec![coats_of(model, specs)?]);
            }
            PaintMode::Saved(look) => {
                return Ok(vec![vec![settings.coat(model, look.on(model)?)?]]);
            }
        };
        let looks = match refine {
            Some(request) if !self.is_empty() => refined(model, mixtures, request)?,
            _ => {
                let looks = mixtures.iter().map(|mixture| mixture.look(model));
                looks.collect::<Result<_, _>>()?
            }
        };
        let variants = looks.into_iter().map(|look| {
            let coat = look.map(|look| settings.coat(model, look)).transpose()?;
            Ok(coat.into_iter().collect())
        });
        variants.collect()
    }
}

fn weightless() -> CliError {
    CliError::Usage("at least one --style needs a weight above 0".into())
}

/// Layers, each of its paintings in order.
pub fn coats_of<'a>(
    model: &Model,
    specs: impl IntoIterator<Item = (&'a StyleLayerSpec, Vec<&'a RgbImage>)>,
) -> Result<Vec<StyleLayer>, CliError> {
    let specs = specs.into_iter();
    let coats = specs.map(|(spec, images)| {
        let weights = spec.paintings.iter().map(|painting| painting.weight);
        let inspirations = model.embeddings(images.into_iter().zip(weights))?;
        Ok(model.layer(spec, &inspirations)?)
    });
    coats.collect()
}

/// The looks of mixtures after each has gone on learning for so long.
fn refined(
    model: &Model,
    mixtures: &[Mixture],
    request: RefineRequest<'_>,
) -> Result<Vec<Option<StyledAppearance>>, CliError> {
    if !model.has_style() {
        return Err(CliError::Unstyled);
    }
    let mut refinement = Refinement::new(model)?.ok_or(EvalError::NoTrainingViews)?;
    let mut bar = TimedBar::new("refine");
    let looks = mixtures.iter().enumerate().map(|(i, mixture)| {
        let paintings: Vec<_> = mixture.weighed().collect();
        let mut show = |progress: f64| {
            bar.show((i as f64 + progress) / mixtures.len() as f64, &mixture.name);
        };
        let budget = Budget::Time(request.time);
        let look = refinement.appearance(&paintings, budget, &mut show)?;
        let look = look.ok_or_else(weightless)?;
        if let Some(path) = request.save {
            save(model, mixture, &look, path)?;
        }
        Ok(Some(look))
    });
    looks.collect()
}

/// Keeps the look of a mixture.
fn save(
    model: &Model,
    mixture: &Mixture,
    look: &StyledAppearance,
    path: &Path,
) -> Result<(), CliError> {
    let embeddings = model.embeddings(mixture.weighed())?;
    let colors = StyleEmbedding::mix(&embeddings)
        .ok_or_else(weightless)?
        .colors;
    let saved = SavedAppearance::new(look, colors).ok_or_else(|| {
        CliError::Refused(
            "--save-look needs a model of the default preset: what others refine is their scene's alone"
                .into(),
        )
    })?;
    Ok(saved.save(path)?)
}

/// The paintings' names, made different by numbers where they are not.
fn names(args: &[StyleArg]) -> Vec<String> {
    let mut taken = HashSet::new();
    args.iter()
        .map(|style| {
            let stem = style.painting.stem();
            let numbered = (2..).map(|n| format!("{stem}-{n}"));
            let mut names = iter::once(stem.clone()).chain(numbered);
            let free = names.find(|name| taken.insert(name.clone()));
            // There are always more numbers.
            free.unwrap_or(stem)
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
