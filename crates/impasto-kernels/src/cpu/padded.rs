//! Channels-last images, those with a border, and 2×2 max-pooling of them.

use rayon::prelude::*;

/// What a convolution sees around its input.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Border {
    /// Zeros.
    #[default]
    Zeros,
    /// The input mirrored at its outermost pixels, which are not repeated (PyTorch's
    /// `ReflectionPad2d(1)`). Needs inputs of at least two pixels a side.
    Mirrored,
}

/// What 2×2 pooling does with the last row or column of an odd size.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum OddEnd {
    /// Drops it.
    #[default]
    Dropped,
    /// Pools over what is there (PyTorch's `ceil_mode`).
    Kept,
}

impl OddEnd {
    /// What pooling leaves of a side.
    pub(crate) fn pooled(self, size: usize) -> usize {
        match self {
            Self::Dropped => size / 2,
            Self::Kept => size.div_ceil(2),
        }
    }
}

/// A channels-last image.
#[derive(Debug, Clone, PartialEq)]
pub struct FeatureMap {
    /// Rows.
    pub height: usize,
    /// Columns.
    pub width: usize,
    /// Numbers a pixel.
    pub channels: usize,
    /// `height × width × channels`.
    pub data: Vec<f32>,
}

impl FeatureMap {
    /// An image without its border.
    pub(crate) fn of(image: &Padded) -> Self {
        let mut data = Vec::with_capacity(image.pixels() * image.channels);
        (0..image.height).for_each(|y| data.extend_from_slice(image.row(y)));
        Self {
            height: image.height,
            width: image.width,
            channels: image.channels,
            data,
        }
    }
}

/// A channels-last image with a border of one pixel, zero unless it was filled.
#[derive(Debug, Clone)]
pub(crate) struct Padded {
    pub(crate) height: usize,
    pub(crate) width: usize,
    pub(crate) channels: usize,
    pub(crate) data: Vec<f32>,
}

impl Padded {
    pub(crate) fn zeros(height: usize, width: usize, channels: usize) -> Self {
        Self {
            height,
            width,
            channels,
            data: vec![0.0; (height + 2) * (width + 2) * channels],
        }
    }

    /// Pads `image · scale − offset`; the border is zero, not `−offset`.
    pub(crate) fn from_image(image: &[f32], width: usize, scale: f32, offset: [f32; 3]) -> Self {
        let mut padded = Self::zeros(image.len() / (width * 3), width, 3);
        for (y, row) in image.chunks_exact(width * 3).enumerate() {
            let start = padded.at(y, 0);
            let target = &mut padded.data[start..start + row.len()];
            for (to, from) in target.chunks_exact_mut(3).zip(row.chunks_exact(3)) {
                for c in 0..3 {
                    to[c] = from[c] * scale - offset[c];
                }
            }
        }
        padded
    }

    /// An image in a border of zeros.
    pub(crate) fn of(image: &FeatureMap) -> Self {
        Self::from_rows(&image.data, image.height, image.width, image.channels)
    }

    /// The same of `height × width × channels` numbers.
    pub(crate) fn from_rows(numbers: &[f32], height: usize, width: usize, channels: usize) -> Self {
        let mut padded = Self::zeros(height, width, channels);
        let rows = numbers.par_chunks_exact(width * channels);
        padded
            .par_rows_mut()
            .zip(rows)
            .for_each(|(to, from)| to.copy_from_slice(from));
        padded
    }

    pub(crate) fn at(&self, y: usize, x: usize) -> usize {
        ((y + 1) * (self.width + 2) + x + 1) * self.channels
    }

    pub(crate) fn row(&self, y: usize) -> &[f32] {
        &self.data[self.at(y, 0)..][..self.width * self.channels]
    }

    /// Numbers in a row, border included.
    pub(crate) fn stride(&self) -> usize {
        (self.width + 2) * self.channels
    }

    /// A pixel of the padded image, or `None` behind its border.
    #[inline(always)]
    pub(crate) fn bordered(&self, y: usize, x: usize) -> Option<&[f32]> {
        (y < self.height + 2 && x < self.width + 2)
            .then(|| &self.data[y * self.stride() + x * self.channels..][..self.channels])
    }

    pub(crate) fn pixels(&self) -> usize {
        self.height * self.width
    }

    /// Rows without their borders.
    pub(crate) fn par_rows_mut(&mut self) -> impl IndexedParallelIterator<Item = &mut [f32]> {
        let (stride, channels) = (self.stride(), self.channels);
        let rows = self.data[stride..].par_chunks_exact_mut(stride);
        rows.take(self.height)
            .map(move |row| &mut row[channels..stride - channels])
            .with_min_len(4)
    }

    /// From the gradient of a relu's result to that of what it was applied to.
    pub(crate) fn back_through_relu(&mut self, result: &Self) {
        self.par_rows_mut().enumerate().for_each(|(y, row)| {
            for (g, y) in row.iter_mut().zip(result.row(y)) {
                *g = if *y > 0.0 { *g } else { 0.0 };
            }
        });
    }

    /// The first and second, third and fourth row and so on, without their left borders. With an
    /// odd height the lower border is the last one's second row.
    pub(crate) fn par_row_pairs_mut(
        &mut self,
    ) -> impl IndexedParallelIterator<Item = [&mut [f32]; 2]> {
        let (stride, channels) = (self.stride(), self.channels);
        let pairs = self.data[stride..].par_chunks_exact_mut(2 * stride);
        pairs
            .map(move |pair| {
                let (upper, lower) = pair.split_at_mut(stride);
                [upper, lower].map(|row| &mut row[channels..])
            })
            .with_min_len(2)
    }

    /// Fills the border with what lies two pixels further inside: corners too, and without
    /// repeating the outermost pixels. Both sides are at least 2.
    pub(crate) fn mirror_border(&mut self) {
        let (stride, channels) = (self.stride(), self.channels);
        for y in 0..self.height {
            let start = self.at(y, 0) - channels;
            let row = &mut self.data[start..start + stride];
            row.copy_within(2 * channels..3 * channels, 0);
            let inner = stride - 3 * channels;
            row.copy_within(inner..inner + channels, stride - channels);
        }
        self.data.copy_within(2 * stride..3 * stride, 0);
        let inner = (self.height - 1) * stride;
        self.data
            .copy_within(inner..inner + stride, (self.height + 1) * stride);
    }

    /// The same image with its zero border as part of it, inside another one.
    pub(crate) fn widened(&self) -> Self {
        let mut wide = Self::zeros(self.height + 2, self.width + 2, self.channels);
        for y in 0..self.height {
            let (at, row) = (wide.at(y + 1, 1), self.row(y));
            wide.data[at..at + row.len()].copy_from_slice(row);
        }
        wide
    }

    /// What is left when the outermost pixels are added to those that [`Padded::mirror_border`]
    /// fills them from: its transpose, for an image that has its border inside.
    pub(crate) fn folded_back(&self) -> Self {
        let (height, width, channels) = (self.height - 2, self.width - 2, self.channels);
        let mut folded = Self::zeros(height, width, channels);
        folded.par_rows_mut().enumerate().for_each(|(y, out)| {
            let mirrored = [(y == 1, 0), (y + 2 == height, height + 1)];
            let others = mirrored
                .into_iter()
                .filter_map(|(is, row)| is.then_some(row));
            for from in std::iter::once(y + 1).chain(others) {
                let row = self.row(from);
                let mut add = |x: usize, from: usize| {
                    let from = &row[from * channels..][..channels];
                    let to = &mut out[x * channels..][..channels];
                    to.iter_mut().zip(from).for_each(|(to, from)| *to += from);
                };
                (0..width).for_each(|x| add(x, x + 1));
                add(1, 0);
                add(width - 2, width + 1);
            }
        });
        folded
    }

    pub(crate) fn clear_border(&mut self) {
        let stride = self.stride();
        for row in self.data.chunks_exact_mut(stride) {
            row[..self.channels].fill(0.0);
            row[stride - self.channels..].fill(0.0);
        }
    }
}

/// The rows under a pooled one; an odd last row stands for both.
fn rows_under(input: &Padded, y: usize) -> (&[f32], &[f32]) {
    let below = (2 * y + 1).min(input.height - 1);
    (input.row(2 * y), input.row(below))
}

/// The largest of every 2×2 pixels.
pub(crate) fn pool(input: &Padded, odd_end: OddEnd) -> Padded {
    let channels = input.channels;
    let (height, width) = (odd_end.pooled(input.height), odd_end.pooled(input.width));
    let mut out = Padded::zeros(height, width, channels);
    out.par_rows_mut().enumerate().for_each(|(y, out)| {
        let (top, bottom) = rows_under(input, y);
        if 2 * width > input.width {
            let (last, single) = ((width - 1) * channels, (input.width - 1) * channels);
            for i in 0..channels {
                out[last + i] = top[single + i].max(bottom[single + i]);
            }
        }
        let pixels = out.chunks_exact_mut(channels);
        let pairs = top
            .chunks_exact(2 * channels)
            .zip(bottom.chunks_exact(2 * channels));
        for (out, (top, bottom)) in pixels.zip(pairs) {
            let ((a, b), (c, d)) = (top.split_at(channels), bottom.split_at(channels));
            for i in 0..channels {
                out[i] = a[i].max(b[i]).max(c[i].max(d[i]));
            }
        }
    });
    out
}

/// Hands each pooled gradient to the first of the (up to four) inputs that reached the maximum.
pub(crate) fn pool_backward(input: &Padded, pooled: &Padded, grad: &Padded) -> Padded {
    let channels = input.channels;
    let mut out = Padded::zeros(input.height, input.width, channels);
    let grads = grad.height;
    out.par_row_pairs_mut()
        .take(grads)
        .enumerate()
        .for_each(|(y, [upper, lower])| {
            let (top, bottom) = rows_under(input, y);
            for x in 0..grad.width {
                let from = x * channels..(x + 1) * channels;
                let (grad, pooled) = (&grad.row(y)[from.clone()], &pooled.row(y)[from]);
                // A row or column that stands for two takes the gradient as the first of them,
                // and the border pixel in the second one's place gets zero.
                let left = 2 * x * channels;
                let right = (2 * x + 1).min(input.width - 1) * channels;
                let (a, b) = (&top[left..][..channels], &top[right..][..channels]);
                let (c, d) = (&bottom[left..][..channels], &bottom[right..][..channels]);
                let pair = left..left + 2 * channels;
                let (to_a, to_b) = upper[pair.clone()].split_at_mut(channels);
                let (to_c, to_d) = lower[pair].split_at_mut(channels);
                for i in 0..channels {
                    let mut left = grad[i];
                    for (to, from) in [
                        (&mut to_a[i], a[i]),
                        (&mut to_b[i], b[i]),
                        (&mut to_c[i], c[i]),
                        (&mut to_d[i], d[i]),
                    ] {
                        let wins = from == pooled[i];
                        *to = if wins { left } else { 0.0 };
                        left = if wins { 0.0 } else { left };
                    }
                }
            }
        });
    out
}
