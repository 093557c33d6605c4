//! Channels-last images with a border, and 2×2 max-pooling of them.

use rayon::prelude::*;

/// A channels-last image with a border of one zero pixel.
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

    /// The first and second, third and fourth row and so on, without their borders.
    pub(crate) fn par_row_pairs_mut(
        &mut self,
    ) -> impl IndexedParallelIterator<Item = [&mut [f32]; 2]> {
        let (stride, channels) = (self.stride(), self.channels);
        let pairs = self.data[stride..].par_chunks_exact_mut(2 * stride);
        pairs
            .take(self.height / 2)
            .map(move |pair| {
                let (upper, lower) = pair.split_at_mut(stride);
                [upper, lower].map(|row| &mut row[channels..stride - channels])
            })
            .with_min_len(2)
    }

    pub(crate) fn clear_border(&mut self) {
        let stride = self.stride();
        for row in self.data.chunks_exact_mut(stride) {
            row[..self.channels].fill(0.0);
            row[stride - self.channels..].fill(0.0);
        }
    }
}

/// The largest of every 2×2 pixels; what is left over at an odd end is dropped.
pub(crate) fn pool(input: &Padded) -> Padded {
    let channels = input.channels;
    let mut out = Padded::zeros(input.height / 2, input.width / 2, channels);
    out.par_rows_mut().enumerate().for_each(|(y, out)| {
        let (top, bottom) = (input.row(2 * y), input.row(2 * y + 1));
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
            let (top, bottom) = (input.row(2 * y), input.row(2 * y + 1));
            for x in 0..grad.width {
                let from = x * channels..(x + 1) * channels;
                let (grad, pooled) = (&grad.row(y)[from.clone()], &pooled.row(y)[from]);
                let pair = 2 * x * channels..(2 * x + 2) * channels;
                let ((a, b), (c, d)) = (
                    top[pair.clone()].split_at(channels),
                    bottom[pair.clone()].split_at(channels),
                );
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
