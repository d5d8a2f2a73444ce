//! Transforms between the nodes of rows and their modes by dense products with the eigenvectors of a line.
//!
//! Modes are even or odd about the middle of the membrane, which halves the cost.

use std::ops::Range;

use deaflow_linalg::Mat;

use crate::registers::dispatch_widest;

use super::error::SetupError;
use super::gemm::{Layout, Product};
use super::lanes::WIDEST;
use super::layout::NodeLayout;
use super::modes::half_modes;
use super::rectangle::Transform;

/// The eigenvectors of a line of nodes.
pub(super) struct LineTransform {
    layout: NodeLayout,
    /// Half the interior nodes of a row, including a middle node; also the number of even modes.
    half: usize,
    /// `half` with padding.
    width: usize,
    /// Transforms from folded rows to modes, even then odd: `[position][mode]`.
    forward: [Vec<f32>; 2],
    /// Transforms from modes to folded rows: `[mode][position]`.
    backward: [Vec<f32>; 2],
    /// Eigenvalues of the even modes, then of the odd ones.
    values: [Vec<f64>; 2],
}

impl LineTransform {
    /// Computes the eigenvectors for the stiffness and mass of the interior nodes of a row.
    pub(super) fn new(layout: NodeLayout, stiffness: &Mat<f64>, mass: &Mat<f64>) -> Result<Self, SetupError> {
        let half = (layout.nodes()[0] - 1) / 2;
        let width = half.max(1).next_multiple_of(WIDEST);
        let [even, odd] = [false, true].map(|odd| half_modes(stiffness, mass, odd));
        let modes = [
            even.ok_or(SetupError::Eigenvectors)?,
            odd.ok_or(SetupError::Eigenvectors)?,
        ];
        let order = folded_order(layout);
        let middle = layout.nodes()[0] / 2 - 1;
        let table = |entry: &dyn Fn(usize, usize) -> f64| -> Vec<f32> {
            (0..half * width)
                .map(|at| entry(at / width, at % width) as f32)
                .collect()
        };
        let entry = |parity: usize, position: usize, mode: usize| {
            let (vectors, _): &(Mat<f64>, Vec<f64>) = &modes[parity];
            let node = order[position];
            if node < vectors.nrows() && mode < vectors.ncols() {
                vectors[(node, mode)]
            } else {
                0.0
            }
        };
        // Folding counts a node in the middle twice.
        let is_shared = layout.nodes()[0] % 2 == 1;
        let share = |position: usize| {
            if is_shared && order[position] == middle {
                0.5
            } else {
                1.0
            }
        };
        Ok(Self {
            layout,
            half,
            width,
            forward: [0, 1].map(|parity| table(&|position, mode| share(position) * entry(parity, position, mode))),
            backward: [0, 1].map(|parity| {
                table(&|mode, position| {
                    if position < half {
                        entry(parity, position, mode)
                    } else {
                        0.0
                    }
                })
            }),
            values: modes.map(|(_, values)| values),
        })
    }

    fn transform(&self, tables: &[Vec<f32>; 2], source: &[f32], target: &mut [f32]) {
        for (parity, table) in tables.iter().enumerate() {
            let layout = Layout {
                offset: parity * self.width,
                stride: 2 * self.width,
            };
            let product = Product {
                left: source,
                left_layout: layout,
                right: table,
                width: self.width,
                inner: self.half,
                rows: 2 * self.layout.nodes()[1],
                target,
                target_layout: layout,
            };
            product.run();
        }
    }

    /// Writes sums and differences of the two halves of each row.
    fn fold(&self, r: &[f32], folded: &mut [f32]) {
        let part = self.layout.part();
        dispatch_widest(
            #[inline(always)]
            || {
                let rows = r.chunks_exact(self.layout.stride());
                for (row, target) in rows.zip(folded.chunks_exact_mut(2 * self.width)) {
                    let (even, odd) = target.split_at_mut(self.width);
                    let mut start = 0;
                    for (inner, nodes) in row.chunks_exact(part).enumerate() {
                        let [left, right] = halves(self.layout, inner);
                        let span = start..start + left.len();
                        start = span.end;
                        let (left, right) = (&nodes[left], &nodes[right]);
                        let targets = even[span.clone()].iter_mut().zip(&mut odd[span]);
                        for ((even, odd), (a, b)) in targets.zip(left.iter().zip(right.iter().rev())) {
                            *even = a + b;
                            *odd = a - b;
                        }
                    }
                }
            },
        );
    }

    /// Writes rows from the sums and differences of their halves.
    fn unfold(&self, folded: &[f32], z: &mut [f32]) {
        let part = self.layout.part();
        let [_, nodes] = self.layout.nodes();
        dispatch_widest(
            #[inline(always)]
            || {
                let rows = z
                    .chunks_exact_mut(self.layout.stride())
                    .zip(folded.chunks_exact(2 * self.width));
                for (at, (row, source)) in rows.enumerate() {
                    if at % nodes == 0 || at % nodes == nodes - 1 {
                        continue;
                    }
                    let (even, odd) = source.split_at(self.width);
                    let mut start = 0;
                    for (inner, line) in row.chunks_exact_mut(part).enumerate() {
                        let [left, right] = halves(self.layout, inner);
                        let span = start..start + left.len();
                        start = span.end;
                        let (even, odd) = (&even[span.clone()], &odd[span]);
                        line[left]
                            .iter_mut()
                            .zip(even.iter().zip(odd))
                            .for_each(|(z, (e, o))| *z = e + o);
                        line[right]
                            .iter_mut()
                            .rev()
                            .zip(even.iter().zip(odd))
                            .for_each(|(z, (e, o))| *z = e - o);
                    }
                }
            },
        );
    }
}

impl Transform for LineTransform {
    fn width(&self) -> usize {
        2 * self.width
    }

    fn values(&self) -> Vec<Option<f64>> {
        let mut values = vec![None; 2 * self.width];
        for (values, known) in values.chunks_exact_mut(self.width).zip(&self.values) {
            values
                .iter_mut()
                .zip(known)
                .for_each(|(value, known)| *value = Some(*known));
        }
        values
    }

    fn modes_at(&self, column: usize) -> Vec<f32> {
        let last = self.layout.nodes()[0] - 1;
        let (node, sign) = if 2 * column <= last {
            (column - 1, 1.0)
        } else {
            (last - column - 1, -1.0)
        };
        let position = folded_order(self.layout).iter().position(|at| *at == node);
        let position = position.expect("the node is not on the frame");
        let mut modes = vec![0.0; 2 * self.width];
        for mode in 0..self.half {
            modes[mode] = self.backward[0][mode * self.width + position];
            modes[self.width + mode] = sign * self.backward[1][mode * self.width + position];
        }
        modes
    }

    fn forward(&self, nodes: &[f32], spare: &mut [f32], modes: &mut [f32]) {
        self.fold(nodes, spare);
        self.transform(&self.forward, spare, modes);
    }

    fn backward(&self, modes: &mut [f32], spare: &mut [f32], nodes: &mut [f32]) {
        self.transform(&self.backward, modes, spare);
        self.unfold(spare, nodes);
    }
}

/// Returns the interior nodes of a part of a row in the left half, and their mirror images in the right one. A node in
/// the middle is the last of the left half and its own image.
#[inline(always)]
fn halves(layout: NodeLayout, inner: usize) -> [Range<usize>; 2] {
    let elements = layout.columns();
    let (first, count) = match inner {
        0 => (1, elements / 2),
        _ => (0, elements.div_ceil(2)),
    };
    [first..first + count, elements - count..elements]
}

/// Returns the index of the interior node for each position of a folded row.
fn folded_order(layout: NodeLayout) -> Vec<usize> {
    let degree = layout.degree();
    let parts = (0..degree).flat_map(|inner| {
        let [left, _] = halves(layout, inner);
        left.map(move |at| at * degree + inner - 1)
    });
    parts.collect()
}
