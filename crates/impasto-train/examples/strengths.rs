//! Style gain (see `impasto_eval`) of a model's held-out views at strengths from 0 to 1, a line per
//! painting, and for neighbouring paintings the style distances of their mixes to both.
//!
//! `cargo run --release --workspace --example strengths -- MODEL PAINTING...`

use impasto_model::{
    LayerSettings, Model, STYLE_SIDE, StyleEmbedding, StyledAppearance, ViewGBuffer,
    square_statistics,
};
use impasto_scene::{Split, read_rgb};
use impasto_style::{Statistics, square_crop};
use std::error::Error;
use std::io::Write;
use std::path::Path;

type Answer<T> = Result<T, Box<dyn Error>>;

struct Gallery {
    model: Model,
    views: Vec<ViewGBuffer>,
    vgg: impasto_style::Perceptual,
}

impl Gallery {
    fn new(model: Model) -> Answer<Self> {
        let views = model.file.scene.cameras(Split::Test).into_iter();
        let views = views.map(|camera| {
            let k = &camera.intrinsics;
            let scale = f64::from(STYLE_SIDE) / f64::from(k.width.min(k.height));
            let side = |length: u32| (f64::from(length) * scale).round() as u32;
            model.gbuffer(&camera.resized(side(k.width), side(k.height)))
        });
        Ok(Self {
            views: views.collect(),
            vgg: model.file.config.style.perceptual.load()?,
            model,
        })
    }

    fn statistics(&self, view: &ViewGBuffer, pixels: &[f32]) -> Answer<Statistics> {
        let bytes = pixels.iter().map(|v| (v * 255.0).round() as u8).collect();
        let picture = image::RgbImage::from_raw(view.width as u32, view.height as u32, bytes);
        let square = square_crop(&picture.ok_or("no picture")?, 1.0, (0.5, 0.5), STYLE_SIDE);
        Ok(square_statistics(&self.vgg, &square)?)
    }

    /// Mean over the views of a number of their painted and their plain statistics.
    fn mean(
        &self,
        (appearance, strength): (&StyledAppearance, f32),
        number: impl Fn(&Statistics, &Statistics) -> f32,
    ) -> Answer<f32> {
        let settings = LayerSettings {
            strength,
            ..LayerSettings::default()
        };
        let layer = self.model.layer_of(appearance.clone(), &settings)?;
        let mut sum = 0.0;
        for view in &self.views {
            let painted = self.model.shade(view, std::slice::from_ref(&layer));
            let painted = self.statistics(view, &painted)?;
            sum += number(&painted, &self.statistics(view, &view.photo)?);
        }
        Ok(sum / self.views.len() as f32)
    }

    fn appearance(&self, mix: &[(StyleEmbedding, f32)]) -> Answer<StyledAppearance> {
        let mix = StyleEmbedding::mix(mix).ok_or("no weight")?;
        Ok(self.model.appearance(&mix).ok_or("no style stage")?)
    }
}

fn main() -> Answer<()> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let (model, paintings) = arguments
        .split_first()
        .ok_or("give a model and paintings")?;
    let gallery = Gallery::new(Model::load(Path::new(model))?)?;
    let mut out = std::io::stdout();
    let mut known: Vec<(&str, Statistics, StyleEmbedding)> = Vec::new();
    for name in paintings {
        let painting = read_rgb(Path::new(name))?;
        let wanted = square_statistics(
            &gallery.vgg,
            &square_crop(&painting, 1.0, (0.5, 0.5), STYLE_SIDE),
        )?;
        let embedding = gallery.model.embedding(&painting)?;
        let appearance = gallery.appearance(&[(embedding.clone(), 1.0)])?;
        write!(out, "{name}:")?;
        for strength in [0.0, 0.2, 0.4, 0.6, 0.8, 1.0] {
            let gain = |painted: &Statistics, plain: &Statistics| {
                1.0 - painted.distance(&wanted) / plain.distance(&wanted)
            };
            write!(out, " {:.3}", gallery.mean((&appearance, strength), gain)?)?;
        }
        writeln!(out)?;
        known.push((name, wanted, embedding));
    }
    for pair in known.windows(2) {
        let [(one, first, a), (other, second, b)] = pair else {
            continue;
        };
        write!(out, "{one} to {other}:")?;
        for share in [0.0, 0.5, 1.0] {
            let appearance = gallery.appearance(&[(a.clone(), 1.0 - share), (b.clone(), share)])?;
            let to = |wanted: &Statistics| {
                gallery.mean((&appearance, 1.0), |painted, _| painted.distance(wanted))
            };
            write!(out, " ({:.3}, {:.3})", to(first)?, to(second)?)?;
        }
        writeln!(out)?;
    }
    Ok(())
}
