//! One serial matrix product for narrow matrices whose right side lies in cache row by row: no
//! packing, tiles of the result in registers, whatever vector instructions the machine has.

use pulp::{MemMask, Simd, WithSimd};

/// The left side: element `(r, s · columns + c)` is
/// `data[r · row_stride + s · segment_stride + c · column_stride]`.
///
/// Rows may overlap and segments may lie apart, which turns a padded image into its patch matrix
/// without copying.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Left<'a> {
    data: &'a [f32],
    rows: usize,
    row_stride: usize,
    segments: usize,
    segment_stride: usize,
    columns: usize,
    column_stride: usize,
}

impl<'a> Left<'a> {
    /// Row-major `rows × columns`.
    pub(crate) fn new(data: &'a [f32], rows: usize, columns: usize) -> Self {
        Self::overlapping(data, rows, columns, 1, 0, columns)
    }

    /// The transpose of a row-major `columns × rows` matrix.
    pub(crate) fn transposed(data: &'a [f32], columns: usize, rows: usize) -> Self {
        let left = Self {
            data,
            rows,
            row_stride: 1,
            segments: 1,
            segment_stride: 0,
            columns,
            column_stride: rows,
        };
        left.checked()
    }

    /// `rows` overlapping rows, one starting every `row_stride` numbers, each of `segments` runs of
    /// `columns` numbers that start every `segment_stride`.
    pub(crate) fn overlapping(
        data: &'a [f32],
        rows: usize,
        row_stride: usize,
        segments: usize,
        segment_stride: usize,
        columns: usize,
    ) -> Self {
        let left = Self {
            data,
            rows,
            row_stride,
            segments,
            segment_stride,
            columns,
            column_stride: 1,
        };
        left.checked()
    }

    /// # Panics
    /// If the matrix is empty or passes its slice.
    fn checked(self) -> Self {
        assert!(
            self.rows > 0 && self.columns > 0 && self.segments > 0,
            "matrices of a product are never empty"
        );
        let last = (self.rows - 1) * self.row_stride
            + (self.segments - 1) * self.segment_stride
            + (self.columns - 1) * self.column_stride;
        let length = self.data.len();
        assert!(
            last < length,
            "matrix ends at {last}, its slice has {length}"
        );
        self
    }
}

/// What a product is added to.
#[derive(Debug, Clone, Copy)]
pub(crate) enum Start<'a> {
    /// What is there.
    Sum,
    /// Nothing: what was there is forgotten.
    Zero,
    /// This row, for every row.
    Row(&'a [f32]),
}

/// Where a product goes: the first `width` numbers of rows that are `stride` apart.
pub(crate) struct ProductTarget<'a> {
    pub(crate) out: &'a mut [f32],
    pub(crate) start: Start<'a>,
    pub(crate) width: usize,
    pub(crate) stride: usize,
}

impl<'a> ProductTarget<'a> {
    /// Row-major with `width` columns.
    pub(crate) fn new(out: &'a mut [f32], start: Start<'a>, width: usize) -> Self {
        Self {
            out,
            start,
            width,
            stride: width,
        }
    }
}

/// `out = start + left · right`, `right` row-major and as wide as the target. Runs on the calling
/// thread.
#[inline(always)]
pub(crate) fn product<S: Simd>(simd: S, target: ProductTarget<'_>, left: Left<'_>, right: &[f32]) {
    let ProductTarget {
        out,
        start,
        width,
        stride,
    } = target;
    if let Start::Row(row) = start {
        assert_eq!(row.len(), width, "row that a matrix product starts from");
    }
    assert!(
        width <= stride && out.len() >= (left.rows - 1) * stride + width,
        "result of a matrix product is too short"
    );
    assert!(
        right.len() >= left.segments * left.columns * width,
        "right side of a matrix product is too short"
    );
    let product = Product {
        out: out.as_mut_ptr(),
        start,
        stride,
        left,
        right: right.as_ptr(),
        width,
    };
    vectorized(simd, product);
}

/// A call, so that its tiles exist once and not at every place that multiplies.
#[inline(never)]
fn vectorized<S: Simd>(simd: S, product: Product<'_>) {
    simd.vectorize(product);
}

/// Checked by [`product`]: `out` has `left.rows` rows of `width` numbers, `stride`
/// apart, and nobody else writes them; `right` has `left.segments · left.columns × width`.
struct Product<'a> {
    out: *mut f32,
    start: Start<'a>,
    stride: usize,
    left: Left<'a>,
    right: *const f32,
    width: usize,
}

impl WithSimd for Product<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let wide = if S::REGISTER_COUNT >= 32 { 4 } else { 2 };
        let mut column = 0;
        while column < self.width {
            let left = self.width - column;
            let vectors = left.div_ceil(S::F32_LANES).min(wide);
            let masked = left < vectors * S::F32_LANES;
            // SAFETY: columns `column..column + vectors · lanes` are inside the matrices, or the
            // last vector is masked to `width`.
            unsafe {
                match (vectors, masked) {
                    (1, false) => self.strip::<S, 1, 8, false>(simd, column),
                    (1, true) => self.strip::<S, 1, 8, true>(simd, column),
                    (2, false) => self.strip::<S, 2, 6, false>(simd, column),
                    (2, true) => self.strip::<S, 2, 6, true>(simd, column),
                    (3, false) => self.strip::<S, 3, 8, false>(simd, column),
                    (3, true) => self.strip::<S, 3, 8, true>(simd, column),
                    (_, false) => self.strip::<S, 4, 6, false>(simd, column),
                    (_, true) => self.strip::<S, 4, 6, true>(simd, column),
                }
            }
            column += vectors * S::F32_LANES;
        }
    }
}

impl Product<'_> {
    /// `V` vectors of columns from `column` on, `R` rows at a time.
    ///
    /// # Safety
    /// `column + V · lanes` is at most `width`, or `MASKED` and only the last vector passes it.
    #[inline(always)]
    unsafe fn strip<S: Simd, const V: usize, const R: usize, const MASKED: bool>(
        &self,
        simd: S,
        column: usize,
    ) {
        let inside = (self.width - column).saturating_sub((V - 1) * S::F32_LANES);
        let mask = simd.mask_between_m32s(0, inside.min(S::F32_LANES) as u32);
        let mut row = 0;
        // SAFETY: as stated above, and `row + its count` never passes `left.rows`.
        unsafe {
            while row + R <= self.left.rows {
                self.tile::<S, V, R, MASKED>(simd, row, column, mask);
                row += R;
            }
            while row + 4 <= self.left.rows {
                self.tile::<S, V, 4, MASKED>(simd, row, column, mask);
                row += 4;
            }
            while row < self.left.rows {
                self.tile::<S, V, 1, MASKED>(simd, row, column, mask);
                row += 1;
            }
        }
    }

    /// # Safety
    /// As for [`Self::strip`], and `row + R` is at most `left.rows`.
    #[inline(always)]
    unsafe fn tile<S: Simd, const V: usize, const R: usize, const MASKED: bool>(
        &self,
        simd: S,
        row: usize,
        column: usize,
        mask: MemMask<S::m32s>,
    ) {
        let left = &self.left;
        let mut sums = [[simd.splat_f32s(0.0); V]; R];
        // SAFETY: `Left::checked` showed that every element of the left side is inside its slice;
        // rows of `right`, `out` and `start` have `width` numbers, and what passes `width` is masked.
        unsafe {
            let mut right = self.right.add(column);
            let first = left.data.as_ptr().add(row * left.row_stride);
            for segment in 0..left.segments {
                let mut at = first.add(segment * left.segment_stride);
                for _ in 0..left.columns {
                    let vectors: [S::f32s; V] =
                        std::array::from_fn(|v| load::<S, MASKED>(simd, right, v, V, mask));
                    for (r, sums) in sums.iter_mut().enumerate() {
                        let x = simd.splat_f32s(*at.add(r * left.row_stride));
                        for (sum, vector) in sums.iter_mut().zip(vectors) {
                            *sum = simd.mul_add_e_f32s(x, vector, *sum);
                        }
                    }
                    at = at.wrapping_add(left.column_stride);
                    right = right.wrapping_add(self.width);
                }
            }
            for (r, sums) in sums.iter().enumerate() {
                let out = self.out.add((row + r) * self.stride + column);
                let before: Option<*const f32> = match self.start {
                    Start::Sum => Some(out),
                    Start::Zero => None,
                    Start::Row(row) => Some(row.as_ptr().add(column)),
                };
                for (v, sum) in sums.iter().enumerate() {
                    let after = match before {
                        Some(at) => simd.add_f32s(load::<S, MASKED>(simd, at, v, V, mask), *sum),
                        None => *sum,
                    };
                    let at = out.wrapping_add(v * S::F32_LANES);
                    if MASKED && v + 1 == V {
                        simd.mask_store_ptr_f32s(mask, at, after);
                    } else {
                        at.cast::<S::f32s>().write_unaligned(after);
                    }
                }
            }
        }
    }
}

/// The `v`th of `count` vectors that start at `from`, the last one masked where asked for.
///
/// # Safety
/// The vector, or its unmasked part, is readable.
#[inline(always)]
unsafe fn load<S: Simd, const MASKED: bool>(
    simd: S,
    from: *const f32,
    v: usize,
    count: usize,
    mask: MemMask<S::m32s>,
) -> S::f32s {
    let at = from.wrapping_add(v * S::F32_LANES);
    // SAFETY: the caller's.
    unsafe {
        if MASKED && v + 1 == count {
            simd.mask_load_ptr_f32s(mask, at)
        } else {
            at.cast::<S::f32s>().read_unaligned()
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use pulp::Arch;
    use rand::{RngExt, SeedableRng};
    use rand_pcg::Pcg64;

    struct Run<'a>(&'a mut [f32], Start<'a>, Left<'a>, &'a [f32], usize);

    impl WithSimd for Run<'_> {
        type Output = ();
        #[inline(always)]
        fn with_simd<S: Simd>(self, simd: S) {
            product(
                simd,
                ProductTarget::new(self.0, self.1, self.4),
                self.2,
                self.3,
            );
        }
    }

    fn numbers(count: usize) -> Vec<f32> {
        let mut rng = Pcg64::seed_from_u64(count as u64);
        (0..count).map(|_| rng.random_range(-1.0..1.0)).collect()
    }

    /// Every instruction set of this machine, and none.
    fn architectures() -> Vec<fn(Run<'_>)> {
        let mut all: Vec<fn(Run<'_>)> = vec![|run| Arch::new().dispatch(run), |run| {
            Simd::vectorize(pulp::Scalar, run);
        }];
        #[cfg(target_arch = "x86_64")]
        if pulp::x86::V3::try_new().is_some() {
            all.push(|run| {
                if let Some(v3) = pulp::x86::V3::try_new() {
                    Simd::vectorize(v3, run);
                }
            });
        }
        all
    }

    /// Compares with three loops, for a left side whose element `(r, k)` is `left[at(r, k)]`.
    fn check(left: Left<'_>, at: impl Fn(usize, usize) -> usize, width: usize) {
        let inner = left.segments * left.columns;
        let right = numbers(inner * width);
        let before = numbers(left.rows * width + 5);
        let row = numbers(width);
        for start in [Start::Sum, Start::Zero, Start::Row(&row)] {
            let mut expected = before.clone();
            for r in 0..left.rows {
                for c in 0..width {
                    let terms = (0..inner).map(|k| left.data[at(r, k)] * right[k * width + c]);
                    let first = match start {
                        Start::Sum => before[r * width + c],
                        Start::Zero => 0.0,
                        Start::Row(row) => row[c],
                    };
                    expected[r * width + c] = first + terms.sum::<f32>();
                }
            }
            for run in architectures() {
                let mut out = before.clone();
                run(Run(&mut out, start, left, &right, width));
                for (i, (a, b)) in out.iter().zip(&expected).enumerate() {
                    assert!((a - b).abs() < 1e-4, "{left:?} × {width} at {i}: {a} {b}");
                }
                let rest = left.rows * width..;
                assert_eq!(out[rest.clone()], before[rest], "nothing is written behind");
            }
        }
    }

    #[test]
    fn equals_three_loops_for_all_shapes_of_tiles() {
        for rows in [1, 3, 4, 6, 7, 13, 24] {
            for inner in [1, 2, 9] {
                let data = numbers(rows * inner);
                for width in [1, 3, 15, 16, 17, 33, 47, 48, 64, 65, 100] {
                    let plain = Left::new(&data, rows, inner);
                    check(plain, |r, k| r * inner + k, width);
                    let transposed = Left::transposed(&data, inner, rows);
                    check(transposed, |r, k| k * rows + r, width);
                }
            }
        }
    }

    #[test]
    fn equals_three_loops_for_overlapping_rows() {
        let data = numbers(2 * 40 + 9 * 3 + 6);
        let patches = Left::overlapping(&data, 9, 3, 3, 40, 6);
        check(patches, |r, k| r * 3 + k / 6 * 40 + k % 6, 20);
    }

    #[test]
    #[should_panic(expected = "matrix ends at")]
    fn refuses_a_matrix_that_passes_its_slice() {
        Left::new(&[0.0; 11], 3, 4);
    }
}
