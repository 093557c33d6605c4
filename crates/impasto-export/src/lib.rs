//! What a model's surfaces are for other programs: stylised point clouds and Gaussian splats.
