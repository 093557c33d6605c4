//! The kernels as burn operations.
//!
//! [`KernelOps`] is what callers use, through the functions here; [`KernelGrad`] is what a device
//! must additionally provide for gradients. `autodiff` wires the two; `flex` is the CPU, `cube` are GPUs.

mod autodiff;
#[cfg(feature = "gpu")]
mod cube;
mod flex;

pub use flex::OnHost;

use crate::{
    AdamStep, CompositeLayout, HashGridSpec, MlpSpec, PerceptualStack, RadianceSpec, Sparse, Volume,
};
use burn::backend::tensor::FloatTensor;
use burn::backend::{Backend, Dispatch, ExtensionType, backend_extension};
use burn::tensor::Tensor;
use std::fmt::Debug;
use std::sync::Arc;

/// Forward operations, dispatched to the tensors' device.
#[backend_extension(Autodiff, Flex, Cube: cfg(feature = "gpu"))]
pub trait KernelOps: Backend {
    /// See [`hash_encode`].
    fn hash_encode(
        points: FloatTensor<Self>,
        table: FloatTensor<Self>,
        spec: HashGridSpec,
    ) -> FloatTensor<Self>;
    /// See [`exemplar`].
    fn exemplar(
        places: FloatTensor<Self>,
        normals: FloatTensor<Self>,
        table: FloatTensor<Self>,
    ) -> FloatTensor<Self>;
    /// See [`mlp`].
    fn mlp(x: FloatTensor<Self>, params: FloatTensor<Self>, spec: MlpSpec) -> FloatTensor<Self>;
    /// See [`mlp_again`].
    fn mlp_again(
        x: FloatTensor<Self>,
        params: FloatTensor<Self>,
        out: FloatTensor<Self>,
        spec: MlpSpec,
    ) -> FloatTensor<Self>;
    /// See [`composite`].
    fn composite(
        sigma: FloatTensor<Self>,
        colours: FloatTensor<Self>,
        layout: Arc<CompositeLayout>,
    ) -> FloatTensor<Self>;
    /// See [`perceptual`].
    fn perceptual(image: FloatTensor<Self>, stack: Arc<PerceptualStack>) -> FloatTensor<Self>;
    /// See [`radiance_loss`].
    fn radiance_loss(
        #[extension_type] volumes: RadianceVolumes<Self>,
        spec: Arc<RadianceSpec>,
    ) -> FloatTensor<Self>;
    /// See [`AdamParam::step`].
    fn adam(
        #[extension_type] state: AdamState<Self>,
        grad: FloatTensor<Self>,
        step: AdamStep,
    ) -> AdamState<Self>;
}

/// Gradients of [`KernelOps`] on a concrete device.
pub trait KernelGrad: Backend {
    /// What the perceptual stack keeps for its backward pass.
    type PerceptualTape: Clone + Send + Debug + 'static;

    /// Gradient for the table.
    fn hash_encode_backward(
        points: FloatTensor<Self>,
        grad: FloatTensor<Self>,
        spec: HashGridSpec,
    ) -> FloatTensor<Self>;
    /// Gradient for the table.
    fn exemplar_backward(
        places: FloatTensor<Self>,
        normals: FloatTensor<Self>,
        grad: FloatTensor<Self>,
    ) -> FloatTensor<Self>;
    /// Gradients for the input (if needed) and the parameters.
    fn mlp_backward(
        x: FloatTensor<Self>,
        params: FloatTensor<Self>,
        grad: FloatTensor<Self>,
        spec: MlpSpec,
        need_input: bool,
    ) -> (Option<FloatTensor<Self>>, FloatTensor<Self>);
    /// Gradients for densities and colours.
    fn composite_backward(
        sigma: FloatTensor<Self>,
        colours: FloatTensor<Self>,
        grad: FloatTensor<Self>,
        layout: Arc<CompositeLayout>,
    ) -> (FloatTensor<Self>, FloatTensor<Self>);
    /// Loss and densities as [`radiance_loss`] returns them, with the loss's gradients.
    fn radiance_loss_with_gradients(
        volumes: [Volume<FloatTensor<Self>>; 2],
        spec: &RadianceSpec,
    ) -> (FloatTensor<Self>, [Volume<FloatTensor<Self>>; 2]);
    /// `tensor` times the only number of `factor`.
    fn scaled(tensor: FloatTensor<Self>, factor: FloatTensor<Self>) -> FloatTensor<Self>;
    /// Forward pass that keeps its activations.
    fn perceptual_taped(
        image: FloatTensor<Self>,
        stack: &Arc<PerceptualStack>,
    ) -> (FloatTensor<Self>, Self::PerceptualTape);
    /// Gradient for the image.
    fn perceptual_backward(
        tape: Self::PerceptualTape,
        grad: FloatTensor<Self>,
        stack: &PerceptualStack,
    ) -> FloatTensor<Self>;
}

/// A parameter with Adam's two moments, as device tensors of one shape.
#[derive(ExtensionType)]
pub struct AdamState<B: Backend> {
    /// The parameter.
    pub param: FloatTensor<B>,
    /// Running mean of gradients.
    pub first: FloatTensor<B>,
    /// Running mean of squared gradients.
    pub second: FloatTensor<B>,
}

impl<B: Backend> AdamState<B> {
    /// From parameter, first and second moment.
    fn from_array([param, first, second]: [FloatTensor<B>; 3]) -> Self {
        Self {
            param,
            first,
            second,
        }
    }

    fn into_array(self) -> [FloatTensor<B>; 3] {
        [self.param, self.first, self.second]
    }
}

/// What a radiance loss depends on, in the order inner, outer volume.
#[derive(ExtensionType)]
pub struct RadianceVolumes<B: Backend> {
    /// Encoded samples, `[n · inputs of base]`.
    pub inner_encoded: FloatTensor<B>,
    /// Parameters of `base`, flat.
    pub inner_base: FloatTensor<B>,
    /// Parameters of `geo`, flat.
    pub inner_geo: FloatTensor<B>,
    /// Parameters of `app`, flat.
    pub inner_app: FloatTensor<B>,
    /// As above.
    pub outer_encoded: FloatTensor<B>,
    /// As above.
    pub outer_base: FloatTensor<B>,
    /// As above.
    pub outer_geo: FloatTensor<B>,
    /// As above.
    pub outer_app: FloatTensor<B>,
}

impl<B: Backend> RadianceVolumes<B> {
    fn new([inner, outer]: [Volume<FloatTensor<B>>; 2]) -> Self {
        Self {
            inner_encoded: inner.encoded,
            inner_base: inner.base,
            inner_geo: inner.geo,
            inner_app: inner.app,
            outer_encoded: outer.encoded,
            outer_base: outer.base,
            outer_geo: outer.geo,
            outer_app: outer.app,
        }
    }

    fn volumes(self) -> [Volume<FloatTensor<B>>; 2] {
        [
            [
                self.inner_encoded,
                self.inner_base,
                self.inner_geo,
                self.inner_app,
            ],
            [
                self.outer_encoded,
                self.outer_base,
                self.outer_geo,
                self.outer_app,
            ],
        ]
        .map(Volume::from_array)
    }
}

/// Photometric loss of encoded samples, as [`crate::cpu::radiance::loss`] defines it;
/// differentiable in encodings and parameters of both volumes.
///
/// # Shapes
/// Per volume: `encoded`: `[n, inputs of base]`, passed as `[n · inputs]`; parameters flat; result:
/// `[2 + samples]` = loss, its mean squared difference of colours, densities in layout order. Only
/// the first has gradients.
pub fn radiance_loss(volumes: [Volume<Tensor<1>>; 2], spec: Arc<RadianceSpec>) -> Tensor<1> {
    let volumes = RadianceVolumes::new(volumes.map(|v| v.map(Tensor::into_dispatch)));
    Tensor::from_dispatch(<Dispatch as KernelOps>::radiance_loss(volumes, spec))
}

/// Hash-grid encoding of points in the unit cube.
///
/// # Shapes
/// `points`: `[n, 3]`, not differentiable; `table`: `[spec.params()]`; result:
/// `[n, spec.outputs()]`.
pub fn hash_encode(points: Tensor<2>, table: Tensor<1>, spec: HashGridSpec) -> Tensor<2> {
    Tensor::from_dispatch(<Dispatch as KernelOps>::hash_encode(
        points.into_dispatch(),
        table.into_dispatch(),
        spec,
    ))
}

/// A picture's detail laid over surfaces; differentiable in the table.
///
/// # Shapes
/// `places`: `[n, 4]`, coordinates and footprint; `normals`: `[n, 3]`; neither is differentiable; `table`:
/// [`PARAMS`](crate::cpu::exemplar::PARAMS); result: `[n, 12]`, see [`crate::cpu::exemplar::forward`].
pub fn exemplar(places: Tensor<2>, normals: Tensor<2>, table: Tensor<1>) -> Tensor<2> {
    Tensor::from_dispatch(<Dispatch as KernelOps>::exemplar(
        places.into_dispatch(),
        normals.into_dispatch(),
        table.into_dispatch(),
    ))
}

/// A small MLP applied to rows; differentiable in its input and its parameters.
///
/// # Shapes
/// `x`: `[n, inputs]`; `params`: `[spec.params()]`; result: `[n, outputs]`.
pub fn mlp(x: Tensor<2>, params: Tensor<1>, spec: &MlpSpec) -> Tensor<2> {
    Tensor::from_dispatch(<Dispatch as KernelOps>::mlp(
        x.into_dispatch(),
        params.into_dispatch(),
        spec.clone(),
    ))
}

/// [`mlp`] whose result is known from another graph: `out` comes back, with the gradients that
/// computing it would have.
///
/// # Shapes
/// As of [`mlp`]; `out`: `[n, outputs]`, of the same `x` and `params`.
pub fn mlp_again(x: Tensor<2>, params: Tensor<1>, spec: &MlpSpec, out: Tensor<2>) -> Tensor<2> {
    Tensor::from_dispatch(<Dispatch as KernelOps>::mlp_again(
        x.into_dispatch(),
        params.into_dispatch(),
        out.into_dispatch(),
        spec.clone(),
    ))
}

/// Composites packed samples along their rays; differentiable in densities and colours.
///
/// # Shapes
/// `sigma`: `[n]`, non-negative; `colours`: `[n, c]`; result: `[rays, c + 3]` = colours, opacity,
/// Σ weight·depth, distortion.
pub fn composite(sigma: Tensor<1>, colours: Tensor<2>, layout: Arc<CompositeLayout>) -> Tensor<2> {
    Tensor::from_dispatch(<Dispatch as KernelOps>::composite(
        sigma.into_dispatch(),
        colours.into_dispatch(),
        layout,
    ))
}

/// Features of a frozen perceptual stack; differentiable in the image.
///
/// # Shapes
/// `image`: `[height, width, 3]` RGB in `[0, 1]`; result: one vector, the content feature
/// (channels-last) followed by the statistics, see [`PerceptualStack::forward`].
pub fn perceptual(image: Tensor<3>, stack: Arc<PerceptualStack>) -> Tensor<1> {
    Tensor::from_dispatch(<Dispatch as KernelOps>::perceptual(
        image.into_dispatch(),
        stack,
    ))
}

/// A trainable flat parameter with its Adam moments, all in place on the device.
#[derive(Debug, Clone)]
pub struct AdamParam {
    param: Tensor<1>,
    first: Tensor<1>,
    second: Tensor<1>,
    steps: u32,
}

impl AdamParam {
    /// Starts with zero moments.
    pub fn new(param: Tensor<1>) -> Self {
        Self {
            first: param.zeros_like(),
            second: param.zeros_like(),
            param,
            steps: 0,
        }
    }

    /// Continues with a value, its first and second moment, after so many [`Self::step`]s.
    ///
    /// # Panics
    /// If the moments are of another length than the value.
    pub fn resumed([param, first, second]: [Tensor<1>; 3], steps: u32) -> Self {
        let lengths = [&first, &second].map(Tensor::dims);
        assert_eq!(lengths, [param.dims(); 2], "moments of a value");
        Self {
            param,
            first,
            second,
            steps,
        }
    }

    /// What [`Self::resumed`] continues from.
    pub fn state(&self) -> ([&Tensor<1>; 3], u32) {
        ([&self.param, &self.first, &self.second], self.steps)
    }

    /// The current value, outside any autodiff graph.
    pub fn value(&self) -> Tensor<1> {
        self.param.clone()
    }

    /// The current value as a leaf of a new autodiff graph.
    pub fn tracked(&self) -> Tensor<1> {
        Tensor::from_inner(self.param.clone()).require_grad()
    }

    /// One Adam step (β = 0.9, 0.99, ε = 1e-15 when `sparse`, β₂ = 0.999, ε = 1e-8 otherwise).
    ///
    /// In place if no graph still holds the parameter.
    pub fn step(&mut self, grad: Tensor<1>, rate: f32, sparse: Option<Sparse>) {
        self.steps += 1;
        let step = AdamStep {
            rate,
            beta1: 0.9,
            beta2: if sparse.is_some() { 0.99 } else { 0.999 },
            eps: if sparse.is_some() { 1e-15 } else { 1e-8 },
            step: self.steps,
            sparse,
        };
        let device = grad.device();
        let state = [&mut self.param, &mut self.first, &mut self.second]
            .map(|own| std::mem::replace(own, Tensor::empty([1], &device)).into_dispatch());
        let state = AdamState::<Dispatch>::from_array(state);
        let state = <Dispatch as KernelOps>::adam(state, grad.into_dispatch(), step);
        [self.param, self.first, self.second] = state.into_array().map(Tensor::from_dispatch);
    }
}
