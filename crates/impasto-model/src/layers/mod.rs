//! How a scene is painted: layers of paint, one over the other, each with its paintings, its strength,
//! whose colours it has and where it goes.

mod layer;
mod mask;
mod region;
mod spec;

pub(crate) use layer::BlendTarget;
pub use layer::StyleLayer;
pub(crate) use mask::LayerMask;
pub use mask::{MaskShape, MaskSpec};
pub use spec::{
    ColorPreservation, LayerError, LayerSettings, PaintingSpec, STROKE_SIZES, StyleLayerSpec,
    StyleLayers,
};

pub(crate) use region::SurfaceCells;
