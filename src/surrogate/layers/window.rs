//! The geometry of a convolution as the two data movements "unfold" (im2col) and "fold" (col2im).
//!
//! A convolution is then one matrix product per image (Chellapilla, Puri & Simard, "High performance convolutional
//! neural networks for document processing", 2006). Its two gradients, the transposed convolution and its gradients
//! are the same product with a factor transposed. Images have channels last, so that a row of the window is contiguous
//! in memory.

use std::ops::Range;

/// A square window moved over an image.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Window {
    /// Side of the window.
    pub(super) kernel: usize,
    /// Step between neighbouring outputs.
    pub(super) stride: usize,
    /// Zeros around the image.
    pub(super) padding: usize,
}

/// The part of one row of a window that lies inside the image: its start in the unfolded matrix, its start in the
/// image and its length, in pixels.
struct Run {
    unfolded: usize,
    image: usize,
    length: usize,
}

impl Window {
    /// Returns the side of the output for an image of side `n`. The padded image must hold at least one window.
    pub(super) fn output(&self, n: usize) -> usize {
        (n + 2 * self.padding - self.kernel) / self.stride + 1
    }

    /// Writes the window of every output: `(rows, columns, channels)` to `(outputs, kernel² · channels)`.
    pub(super) fn unfold(&self, image: &[f32], channels: usize, sides: [usize; 2], unfolded: &mut [f32]) {
        // Values between two runs are outside the image.
        let mut end = 0;
        self.for_each_run(sides, |run| {
            let start = run.unfolded * channels;
            unfolded[end..start].fill(0.0);
            end = start + run.length * channels;
            unfolded[start..end].copy_from_slice(&image[run.image * channels..][..run.length * channels]);
        });
        unfolded[end..].fill(0.0);
    }

    /// Computes the transpose of [`Window::unfold`]: adds every value to its pixel.
    pub(super) fn fold(&self, unfolded: &[f32], channels: usize, sides: [usize; 2], image: &mut [f32]) {
        image.fill(0.0);
        self.for_each_run(sides, |run| {
            let from = &unfolded[run.unfolded * channels..][..run.length * channels];
            let to = &mut image[run.image * channels..][..run.length * channels];
            to.iter_mut().zip(from).for_each(|(to, from)| *to += from);
        });
    }

    /// Returns the taps of the window of output `o` that lie inside an image of side `n`, and the pixel of the first
    /// tap.
    fn inside(&self, o: usize, n: usize) -> (Range<usize>, usize) {
        let start = o * self.stride;
        let first = self.padding.saturating_sub(start);
        let end = (n + self.padding).saturating_sub(start).min(self.kernel);
        (first..end.max(first), (start + first).saturating_sub(self.padding))
    }

    fn for_each_run(&self, sides: [usize; 2], mut visit: impl FnMut(Run)) {
        let [up, across]: [Vec<_>; 2] =
            sides.map(|n| (0..self.output(n)).map(|output| self.inside(output, n)).collect());
        let mut output = 0;
        for (rows, y) in &up {
            for (columns, x) in &across {
                for (line, row) in rows.clone().enumerate() {
                    visit(Run {
                        unfolded: (output * self.kernel + row) * self.kernel + columns.start,
                        image: (y + line) * sides[1] + x,
                        length: columns.len(),
                    });
                }
                output += 1;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const WINDOWS: [(usize, usize, usize, usize, usize); 4] = [
        (10, 2, 4, 50, 25),
        (7, 2, 3, 25, 13),
        (5, 1, 2, 13, 13),
        (3, 1, 0, 4, 2),
    ];

    /// Irregular integers, exact in f32.
    fn numbers(count: usize) -> Vec<f32> {
        (0..count).map(|i| ((i * 7919 + 13) % 257) as f32 - 128.0).collect()
    }

    #[test]
    fn unfolding_writes_the_window_of_each_output() {
        for (kernel, stride, padding, n, out) in WINDOWS {
            let window = Window {
                kernel,
                stride,
                padding,
            };
            assert_eq!(window.output(n), out);
            let image = numbers(2 * n * n);
            let mut unfolded = vec![f32::NAN; 2 * kernel * kernel * out * out];
            window.unfold(&image, 2, [n, n], &mut unfolded);
            let pixel = |y: isize, x: isize, channel: usize| {
                let inside = (0..n as isize).contains(&y) && (0..n as isize).contains(&x);
                if inside {
                    image[(y as usize * n + x as usize) * 2 + channel]
                } else {
                    0.0
                }
            };
            for (at, value) in unfolded.iter().enumerate() {
                let (channel, tap, output) = (at % 2, at / 2 % (kernel * kernel), at / 2 / (kernel * kernel));
                let place = |o: usize, tap: usize| (o * stride + tap) as isize - padding as isize;
                let (y, x) = (place(output / out, tap / kernel), place(output % out, tap % kernel));
                assert_eq!(*value, pixel(y, x, channel));
            }
        }
    }

    #[test]
    fn folding_is_the_transpose_of_unfolding() {
        for (kernel, stride, padding, n, out) in WINDOWS {
            let window = Window {
                kernel,
                stride,
                padding,
            };
            let (image, columns) = (numbers(3 * n * n), numbers(3 * kernel * kernel * out * out));
            let (mut unfolded, mut folded) = (vec![0.0; columns.len()], vec![f32::NAN; image.len()]);
            window.unfold(&image, 3, [n, n], &mut unfolded);
            window.fold(&columns, 3, [n, n], &mut folded);
            let dot =
                |a: &[f32], b: &[f32]| -> f64 { a.iter().zip(b).map(|(a, b)| f64::from(*a) * f64::from(*b)).sum() };
            assert_eq!(dot(&unfolded, &columns), dot(&image, &folded));
        }
    }
}
