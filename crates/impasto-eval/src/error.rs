//! What keeps a model from being evaluated.

use impasto_style::StyleError;

/// Why an evaluation is impossible.
#[derive(Debug, thiserror::Error)]
pub enum EvalError {
    /// The model has had no style stage.
    #[error("this model has had no style stage: train it with --stage style first")]
    Unstyled,
    /// There is no view or no painting to compare.
    #[error("there is nothing to evaluate: no held-out view or no painting")]
    Nothing,
    /// Neither the place nor a look can go on learning.
    #[error("this model knows no training views to learn from: train it again")]
    NoTrainingViews,
    /// A picture or an asset is unusable.
    #[error(transparent)]
    Style(#[from] StyleError),
}
