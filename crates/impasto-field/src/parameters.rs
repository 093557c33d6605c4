//! Sets of named parameters. Their names and their order are said once, by the set itself; the
//! optimiser, checkpoints, GPUs and model files go by them.

use burn::tensor::Tensor;

/// A set of flat parameter vectors with names.
pub trait Parameters: Sized {
    /// The same set of what `f` makes of each vector and its name, in the set's order. The first
    /// error ends it.
    ///
    /// # Errors
    /// Those of `f`.
    fn try_map<E>(
        &self,
        f: &mut dyn FnMut(&str, &Tensor<1>) -> Result<Tensor<1>, E>,
    ) -> Result<Self, E>;

    /// [`Self::try_map`] that cannot fail.
    #[must_use]
    fn map(&self, mut f: impl FnMut(&str, &Tensor<1>) -> Tensor<1>) -> Self {
        let mapped = self.try_map::<std::convert::Infallible>(&mut |name, t| Ok(f(name, t)));
        mapped.unwrap_or_else(|never| match never {})
    }

    /// All vectors with their names, in the set's order.
    fn named(&self) -> Vec<(String, Tensor<1>)> {
        let mut all = Vec::new();
        let _ = self.map(|name, tensor| {
            all.push((name.to_owned(), tensor.clone()));
            tensor.clone()
        });
        all
    }

    /// How many numbers there are.
    fn count(&self) -> usize {
        self.named()
            .iter()
            .map(|(_, tensor)| tensor.dims()[0])
            .sum()
    }
}
