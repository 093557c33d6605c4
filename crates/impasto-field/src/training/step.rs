//! What goes into a step of training and what comes out of it.

use crate::rays::RayBatch;
use burn::tensor::Tensor;

/// Rays and what was seen along them.
#[derive(Debug, Clone, Default)]
pub struct TargetRays {
    /// Rays; directions have any length.
    pub rays: RayBatch,
    /// `rays × 3`.
    pub colours: Vec<f32>,
    /// Distance (scene units along the ray) of a known surface, for rays that have one.
    pub distances: Vec<Option<f32>>,
}

/// How many rays a step takes.
#[derive(Debug, Clone, Copy)]
pub struct BatchSize {
    /// Samples of all its rays together, about.
    pub samples: usize,
    /// Fewest and most rays.
    pub rays: [usize; 2],
    /// Rays evaluated together.
    pub rays_at_once: usize,
}

/// What counts beside the mean squared difference of colours.
#[derive(Debug, Clone, Copy)]
pub struct LossWeights {
    /// Weight of the mean `Σ weight · |distance − surface|`, contracted, over all rays; a ray whose
    /// surface is unknown has none.
    pub surface: f32,
    /// Weight of the mean distortion (Barron et al. 2022).
    pub distortion: f32,
    /// Distance from the camera, scene units, from which on samples get their whole gradient; nearer
    /// ones get less of it (Philip & Deschaintre 2023).
    pub learned_from: f32,
}

/// What a step of training found.
#[derive(Debug, Clone)]
pub struct StepGradients {
    /// Mean squared difference of the last level's colours, `[1]`.
    pub error: Tensor<1>,
    /// Gradients level by level, in the order of a level's parameters, as far as there are any.
    pub gradients: Vec<Vec<Option<Tensor<1>>>>,
}
