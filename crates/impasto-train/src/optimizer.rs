//! Adam over a set of named parameters: what every stage descends with.

use burn::tensor::{Gradients, Tensor};
use impasto_field::Parameters;
use impasto_kernels::Sparse;
use impasto_kernels::ops::AdamParam;
use impasto_model::tensors::{Entry, TensorReader};

/// How far a parameter moves in a step.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Rate {
    pub(crate) rate: f32,
    /// For tables of which a step touches little: their moments forget sooner.
    pub(crate) sparse: Option<Sparse>,
}

impl Rate {
    /// That of a parameter which every step touches all of.
    pub(crate) fn dense(rate: f32) -> Self {
        Self { rate, sparse: None }
    }
}

/// A set of parameters in training.
pub(crate) struct Adam<P> {
    /// The set without its numbers: only Adam may hold those, or it could not work in place.
    shape: P,
    names: Vec<String>,
    params: Vec<AdamParam>,
}

impl<P: Parameters> Adam<P> {
    /// Starts with zero moments.
    pub(crate) fn new(set: &P) -> Self {
        let (names, tensors): (Vec<_>, Vec<_>) = set.named().into_iter().unzip();
        Self {
            shape: set.map(|_, tensor| Tensor::empty([1], &tensor.device())),
            params: tensors.into_iter().map(AdamParam::new).collect(),
            names,
        }
    }

    fn set(&self, number: impl Fn(&AdamParam) -> Tensor<1>) -> P {
        let mut params = self.params.iter();
        self.shape
            .map(|_, empty| params.next().map_or_else(|| empty.clone(), &number))
    }

    /// The current values.
    pub(crate) fn values(&self) -> P {
        self.set(AdamParam::value)
    }

    /// The current values as leaves of a new autodiff graph.
    pub(crate) fn leaves(&self) -> P {
        self.set(AdamParam::tracked)
    }

    /// One step along gradients in the set's order, as far as there are any: not every loss depends
    /// on every parameter. Works in place only where nobody else holds the values.
    pub(crate) fn step(
        &mut self,
        gradients: impl IntoIterator<Item = Option<Tensor<1>>>,
        rate: impl Fn(&str) -> Rate,
    ) {
        let params = self.params.iter_mut().zip(&self.names);
        for ((param, name), gradient) in params.zip(gradients) {
            if let Some(gradient) = gradient {
                let Rate { rate, sparse } = rate(name);
                param.step(gradient, rate, sparse);
            }
        }
    }

    /// Values and moments as tensors, with `prefix` before their names, and each parameter's steps.
    pub(crate) fn entries(&self, prefix: &str) -> (Vec<u32>, Vec<Entry>) {
        let (mut steps, mut entries) = (Vec::new(), Vec::new());
        for (param, name) in self.params.iter().zip(&self.names) {
            let (tensors, taken) = param.state();
            steps.push(taken);
            let parts = PARTS.into_iter().zip(tensors);
            let named =
                parts.map(|(part, t)| Entry::tensor(format!("adam.{prefix}{name}.{part}"), t));
            entries.extend(named);
        }
        (steps, entries)
    }

    /// Goes on from what [`Self::entries`] has kept.
    pub(crate) fn restore(
        &mut self,
        prefix: &str,
        steps: &[u32],
        from: &TensorReader<'_>,
    ) -> Result<(), String> {
        if self.params.len() != steps.len() {
            let (ours, theirs) = (self.params.len(), steps.len());
            return Err(format!("holds {theirs} parameters, {ours} were expected"));
        }
        for ((param, name), steps) in self.params.iter_mut().zip(&self.names).zip(steps) {
            let [length] = param.value().dims();
            let [value, first, second] =
                PARTS.map(|part| from.floats(&format!("adam.{prefix}{name}.{part}"), length));
            *param = AdamParam::resumed([value?, first?, second?], *steps);
        }
        Ok(())
    }
}

const PARTS: [&str; 3] = ["value", "first", "second"];

/// Adds the gradients of leaves, in the set's order, to sums of them, as far as there are any.
pub(crate) fn add_gradients<P: Parameters>(
    sums: &mut Vec<Option<Tensor<1>>>,
    leaves: &P,
    mut gradients: Gradients,
) {
    let named = leaves.named();
    sums.resize(named.len(), None);
    for (sum, (_, leaf)) in sums.iter_mut().zip(&named) {
        *sum = match (sum.take(), leaf.grad_remove(&mut gradients)) {
            (Some(sum), Some(own)) => Some(sum + own),
            (sum, own) => sum.or(own),
        };
    }
}
