//! What a model file is, in numbers.

use crate::config::TrainConfig;
use crate::file::ModelFile;
use crate::hypernetworks::hypernetworks;
use burn::tensor::{Device, Tensor};
use impasto_field::{Field, Parameters, RadianceField};
use impasto_scene::Split;
use serde_json::{Value, json};

fn count<'a>(tensors: impl IntoIterator<Item = &'a Tensor<1>>) -> usize {
    tensors.into_iter().map(|tensor| tensor.dims()[0]).sum()
}

impl TrainConfig {
    /// Facts about a model of this configuration that is still to be trained: numbers of
    /// parameters by level of the cascade, and the whole configuration.
    pub fn info(&self) -> Value {
        let field = Field::new(self.field.clone());
        let levels = self.field.levels();
        let zeros = RadianceField::zeros(&field, self.photo_appearance(), &Device::flex());
        // Frequency encodings learn nothing, but have a number each.
        let tables = [&self.field.inner, &self.field.outer].map(|v| v.encoding.hash_grid());
        let unused = tables.iter().filter(|table| table.is_none()).count();
        let coarse = zeros
            .weights
            .coarse
            .as_ref()
            .map_or(0, |coarse| coarse.count());
        let level = zeros.count() - coarse - unused;
        let hypernetworks = hypernetworks(&field, self);
        let lengths = hypernetworks.iter().map(|net| net.lengths().iter().sum());
        let lengths: Vec<usize> = lengths.collect();
        json!({
            "levels": levels,
            "parameters": {
                "per_level": level,
                "all_levels": levels * level,
                "hypernetwork_by_volume": lengths,
                "hypernetworks": levels * lengths.iter().sum::<usize>(),
            },
            "config": self,
        })
    }
}

impl ModelFile {
    /// Facts about the model: its scene, measured quality (dB; SSIM), numbers of parameters and
    /// whole configuration.
    pub fn info(&self) -> Value {
        let (weights, app) = (&self.radiance.weights, &self.radiance.app);
        let (inner, outer) = (&weights.inner, &weights.outer);
        let of = |split| {
            self.scene
                .photos
                .iter()
                .filter(|photo| photo.split == split)
                .count()
        };
        let coarse = weights.coarse.iter();
        let coarse = coarse
            .flat_map(|c| [&c.inner, &c.outer])
            .flat_map(|w| [&w.base, &w.geo]);
        let hypernetworks = self
            .style
            .iter()
            .flat_map(|style| style.levels.iter().flatten().flat_map(|w| &w.0));
        json!({
            "name": self.scene.name,
            "synthetic": self.scene.synthetic,
            "has_style": self.style.is_some(),
            "encoder": self.encoder.as_ref().map_or_else(
                || json!("built-in"),
                |encoder| json!({"own": true, "input": encoder.input()}),
            ),
            "photos": {"train": of(Split::Train), "test": of(Split::Test)},
            "quality": self.quality,
            "parameters": {
                "encodings": count([&inner.encoding, &outer.encoding]),
                "base": count([&inner.base, &outer.base]),
                "geo": count([&inner.geo, &outer.geo]),
                "first_field": count(coarse),
                "photo_app": count([&app.inner, &app.outer]),
                "hypernetworks": count(hypernetworks),
                "distilled": count(self.features.iter().flat_map(|f| [&f.encoding, &f.readout])),
            },
            "normalisation": self.scene.normalisation,
            "seed": self.seed,
            "config": self.config,
        })
    }
}
