//! Safe face of the `gemm` crate: one serial matrix product over bounds-checked strided views.

use gemm::Parallelism;

/// A strided matrix inside a slice. Element `(r, c)` is `data[r * row_stride + c * col_stride]`;
/// rows may overlap, which turns a padded image into its patch matrix without copying.
#[derive(Clone, Copy)]
pub(crate) struct View<'a> {
    data: &'a [f32],
    rows: usize,
    cols: usize,
    row_stride: usize,
    col_stride: usize,
}

impl<'a> View<'a> {
    pub(crate) fn strided(
        data: &'a [f32],
        (rows, cols): (usize, usize),
        (row_stride, col_stride): (usize, usize),
    ) -> Self {
        assert!(rows > 0 && cols > 0, "matrix views are never empty");
        let last = (rows - 1) * row_stride + (cols - 1) * col_stride;
        assert!(
            last < data.len(),
            "matrix view ends at {last}, slice has {}",
            data.len()
        );
        Self {
            data,
            rows,
            cols,
            row_stride,
            col_stride,
        }
    }

    /// Row-major `rows × cols`.
    pub(crate) fn new(data: &'a [f32], rows: usize, cols: usize) -> Self {
        Self::strided(data, (rows, cols), (cols, 1))
    }

    pub(crate) fn transposed(self) -> Self {
        Self {
            rows: self.cols,
            cols: self.rows,
            row_stride: self.col_stride,
            col_stride: self.row_stride,
            ..self
        }
    }
}

/// `out += a · b`, with `out` row-major `a.rows × b.cols`. Runs on the calling thread.
pub(crate) fn add_product(out: &mut [f32], a: View<'_>, b: View<'_>) {
    assert_eq!(a.cols, b.rows, "inner sizes of a matrix product");
    assert!(
        out.len() >= a.rows * b.cols,
        "output of a matrix product is too short"
    );
    // SAFETY: `View::strided` checked that every element of `a` and `b` lies inside its slice,
    // the assertion above does so for `out`, and `out` is an exclusive borrow.
    unsafe {
        gemm::gemm(
            a.rows,
            b.cols,
            a.cols,
            out.as_mut_ptr(),
            1,
            b.cols as isize,
            true,
            a.data.as_ptr(),
            a.col_stride as isize,
            a.row_stride as isize,
            b.data.as_ptr(),
            b.col_stride as isize,
            b.row_stride as isize,
            1.0,
            1.0,
            false,
            false,
            false,
            Parallelism::None,
        );
    }
}
