//! What a model file is, in numbers.

use crate::config::TrainConfig;
use crate::model_file::ModelFile;
use crate::style_stage::{hypernetworks, levels};
use burn::tensor::Tensor;
use impasto_field::{Branch, EncodingConfig, Field};
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
        let levels = levels(self);
        let branch = |branch: &Branch, encoding: &EncodingConfig| {
            let app = self
                .photo_app
                .network(branch.features(), branch.dimensions());
            let [_, base, geo] = branch.lengths();
            let table = encoding.hash_grid().map_or(0, |grid| grid.params());
            table + base + geo + app.params()
        };
        let level = branch(&field.inner, &self.field.inner.encoding)
            + branch(&field.outer, &self.field.outer.encoding)
            + self.field.inner.latent.unwrap_or(0);
        let hypernetworks = hypernetworks(&field, self);
        let hypernetworks = hypernetworks.map(|net| net.lengths().into_iter().sum::<usize>());
        json!({
            "levels": levels,
            "parameters": {
                "per_level": level,
                "all_levels": levels * level,
                "hypernetwork_inner": hypernetworks[0],
                "hypernetwork_outer": hypernetworks[1],
                "hypernetworks": levels * (hypernetworks[0] + hypernetworks[1]),
            },
            "config": self,
        })
    }
}

impl ModelFile {
    /// Facts about the model: its scene, measured quality (dB; SSIM), numbers of parameters and
    /// whole configuration.
    pub fn info(&self) -> Value {
        let (inner, outer) = (&self.weights.inner, &self.weights.outer);
        let of = |split| {
            self.scene
                .photos
                .iter()
                .filter(|photo| photo.split == split)
                .count()
        };
        let coarse = self.weights.coarse.iter();
        let coarse = coarse
            .flat_map(|c| [&c.inner, &c.outer])
            .flat_map(|w| [&w.base, &w.geo]);
        let canvas = self.style.as_ref().and_then(|style| style.canvas.as_ref());
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
                "photo_app": count([&self.photo_app.inner, &self.photo_app.outer]),
                "hypernetworks": count(hypernetworks),
                "canvas": count(canvas.iter().flat_map(|c| [&c.inner, &c.outer])),
            },
            "normalisation": self.scene.normalisation,
            "seed": self.seed,
            "config": self.config,
        })
    }
}
