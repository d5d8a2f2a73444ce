//! Transforms between the nodes of rows and their modes that make use of the period of the cells.
//!
//! All cells have the same elements, symmetric about the middle of the cell, so modes of N cells are waves: for k = 0 to
//! N, sin πkj/N at the left corner of cell j, sin πk(j + ½)/N in the sum of each inner node and its mirror image in the
//! cell, and cos πk(j + ½)/N in their difference. These classes of nodes are transformed one by one. For each k a small
//! eigenproblem between the classes gives the modes: as many as a cell has nodes. With n nodes along a cell, transforms
//! take n times fewer operations than a product with all eigenvectors, which are not computed.

use std::f64::consts::PI;

use deaflow_linalg::Mat;

use crate::registers::dispatch_widest;

use super::error::SetupError;
use super::gemm::{Layout, Product};
use super::lanes::WIDEST;
use super::layout::NodeLayout;
use super::modes::generalised_eigen;
use super::rectangle::Transform;

/// The modes of a row of cells.
pub(super) struct CellTransform {
    layout: NodeLayout,
    cells: usize,
    /// Nodes along a cell: its left corner and those inside.
    nodes: usize,
    classes: Vec<Class>,
    /// Waves of one parity, and positions in half of the cells, with padding.
    width: usize,
    waves: [Wave; 3],
    /// Eigenvectors, `[parity][mode][class][wave]`.
    vectors: Vec<f32>,
    /// Eigenvalues, `[parity][mode][wave]`; `None` in the padding.
    values: Vec<Option<f64>>,
}

/// A class of nodes with the same place in all cells.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Class {
    /// The left corners.
    Corner,
    /// The sum of a node, counted from the left corner, and its mirror image.
    Sum(usize),
    /// The difference of the two.
    Difference(usize),
}

impl Class {
    /// Returns the index of its wave.
    fn wave(self) -> usize {
        match self {
            Self::Corner => 0,
            Self::Sum(_) => 1,
            Self::Difference(_) => 2,
        }
    }

    /// Returns the value at a cell of a wave of N cells.
    fn value(self, wave: usize, cell: usize, cells: usize) -> f64 {
        // Exact multiples of a quarter of a period for large numbers.
        let angle = |halves: usize| PI * ((wave * halves) % (4 * cells)) as f64 / (2 * cells) as f64;
        match self {
            Self::Corner => angle(2 * cell).sin(),
            Self::Sum(_) => angle(2 * cell + 1).sin(),
            Self::Difference(_) => angle(2 * cell + 1).cos(),
        }
    }

    /// Returns whether a wave of N cells has a part in it.
    fn takes(self, wave: usize, cells: usize) -> bool {
        match self {
            Self::Corner => 0 < wave && wave < cells,
            Self::Sum(_) => 0 < wave,
            Self::Difference(_) => wave < cells,
        }
    }

    /// Returns the first cell, the cells up to the middle, and the sum of the numbers of two that are mirror images.
    fn half(self, cells: usize) -> (usize, usize, usize) {
        match self {
            Self::Corner => (1, cells / 2, cells),
            Self::Sum(_) | Self::Difference(_) => (0, cells.div_ceil(2), cells - 1),
        }
    }

    /// Returns the factor of the mirror image in waves of a parity.
    fn sign(self, parity: usize) -> f32 {
        let is_even = (parity == 0) != (self.wave() == 2);
        if is_even { 1.0 } else { -1.0 }
    }
}

/// Values of the waves of a kind of class, by parity.
struct Wave {
    /// `[position][wave]`
    forward: [Vec<f32>; 2],
    /// `[wave][position]`
    backward: [Vec<f32>; 2],
}

/// Returns the number of the wave at an index; even modes have odd numbers.
fn wave_at(parity: usize, index: usize) -> usize {
    2 * index + 1 - parity
}

impl CellTransform {
    /// Computes the modes for the stiffness and mass of the interior nodes of a row of equal cells.
    pub(super) fn new(
        layout: NodeLayout,
        cells: usize,
        stiffness: &Mat<f64>,
        mass: &Mat<f64>,
    ) -> Result<Self, SetupError> {
        let nodes = (layout.nodes()[0] - 1) / cells;
        let mut classes = vec![Class::Corner];
        classes.extend((1..=nodes / 2).map(Class::Sum));
        classes.extend((1..=(nodes - 1) / 2).map(Class::Difference));
        let width = (cells / 2 + 1).next_multiple_of(WIDEST);
        let mut transform = Self {
            layout,
            cells,
            nodes,
            width,
            waves: [Class::Corner, Class::Sum(1), Class::Difference(1)].map(|class| Wave::new(class, cells, width)),
            vectors: vec![0.0; 2 * nodes * nodes * width],
            values: vec![None; 2 * nodes * width],
            classes,
        };
        for (parity, index) in [0, 1]
            .into_iter()
            .flat_map(|parity| (0..width).map(move |index| (parity, index)))
        {
            if wave_at(parity, index) <= cells {
                transform.add_wave(parity, index, [stiffness, mass])?;
            }
        }
        Ok(transform)
    }

    /// Solves the eigenproblem of a wave.
    fn add_wave(&mut self, parity: usize, index: usize, matrices: [&Mat<f64>; 2]) -> Result<(), SetupError> {
        let (wave, count) = (wave_at(parity, index), matrices[0].nrows());
        let classes = self.classes.iter().enumerate();
        let taken: Vec<(usize, Class)> = classes
            .filter(|(_, class)| class.takes(wave, self.cells))
            .map(|(at, class)| (at, *class))
            .collect();
        let column = |class: Class| -> Vec<f64> {
            let value =
                |node: usize| self.part(class, node + 1) * class.value(wave, (node + 1) / self.nodes, self.cells);
            (0..count).map(value).collect()
        };
        let columns: Vec<Vec<f64>> = taken.iter().map(|(_, class)| column(*class)).collect();
        let band = self.layout.degree();
        let reduced = matrices.map(|matrix| {
            let image = |column: &Vec<f64>| -> Vec<f64> {
                let row = |i: usize| -> f64 {
                    let near = i.saturating_sub(band)..(i + band + 1).min(count);
                    near.map(|k| matrix[(i, k)] * column[k]).sum()
                };
                (0..count).map(row).collect()
            };
            let images: Vec<Vec<f64>> = columns.iter().map(image).collect();
            let entry = |i: usize, k: usize| columns[i].iter().zip(&images[k]).map(|(a, b)| a * b).sum();
            Mat::from_fn(columns.len(), columns.len(), entry)
        });
        let [stiffness, mass] = &reduced;
        let (vectors, values) = generalised_eigen(stiffness, mass).ok_or(SetupError::Eigenvectors)?;
        for (mode, value) in values.iter().enumerate() {
            let place = parity * self.nodes + mode;
            self.values[place * self.width + index] = Some(*value);
            for (row, (class, _)) in taken.iter().enumerate() {
                self.vectors[(place * self.nodes + class) * self.width + index] = vectors[(row, mode)] as f32;
            }
        }
        Ok(())
    }

    /// Returns the factor of a class at a column of nodes.
    fn part(&self, class: Class, column: usize) -> f64 {
        let (inner, mirror) = (column % self.nodes, self.nodes - column % self.nodes);
        match class {
            Class::Corner => f64::from(u8::from(inner == 0)),
            Class::Sum(node) => f64::from(u8::from(node == inner || node == mirror)),
            Class::Difference(node) => f64::from(u8::from(node == inner)) - f64::from(u8::from(node == mirror)),
        }
    }

    /// Returns the offset in a row of a vector of a node of the first cell, counted from its left corner, and the
    /// distance from cell to cell.
    fn offset(&self, node: usize) -> (usize, usize) {
        let degree = self.layout.degree();
        (node % degree * self.layout.part() + node / degree, self.nodes / degree)
    }

    /// Writes sums and differences of the two halves of each class in each row.
    fn fold(&self, r: &[f32], folded: &mut [f32]) {
        let rows = r.chunks_exact(self.layout.stride());
        for (row, target) in rows.zip(folded.chunks_exact_mut(self.width())) {
            let (even, odd) = target.split_at_mut(self.nodes * self.width);
            let targets = even.chunks_exact_mut(self.width).zip(odd.chunks_exact_mut(self.width));
            for (class, (even, odd)) in self.classes.iter().zip(targets) {
                match *class {
                    Class::Corner => {
                        let (start, step) = self.offset(0);
                        self.fold_class(*class, |cell| row[start + step * cell], even, odd);
                    }
                    Class::Sum(node) if 2 * node == self.nodes => {
                        let (start, step) = self.offset(node);
                        self.fold_class(*class, |cell| row[start + step * cell], even, odd);
                    }
                    Class::Sum(node) | Class::Difference(node) => {
                        let ((start, step), (mirror, _)) = (self.offset(node), self.offset(self.nodes - node));
                        let sign = if matches!(class, Class::Sum(_)) { 1.0 } else { -1.0 };
                        let value = |cell| row[start + step * cell] + sign * row[mirror + step * cell];
                        self.fold_class(*class, value, even, odd);
                    }
                }
            }
        }
    }

    #[inline(always)]
    fn fold_class(&self, class: Class, value: impl Fn(usize) -> f32, even: &mut [f32], odd: &mut [f32]) {
        let ((first, count, mirror), signs) = (class.half(self.cells), [0, 1].map(|parity| class.sign(parity)));
        for (at, (even, odd)) in even.iter_mut().zip(odd).enumerate().take(count) {
            let cell = first + at;
            // A cell in the middle is its own mirror image.
            let (a, b) = (value(cell), if 2 * cell == mirror { 0.0 } else { value(mirror - cell) });
            (*even, *odd) = (a + signs[0] * b, a + signs[1] * b);
        }
    }

    /// Writes rows from the sums and differences of the halves of their classes.
    fn unfold(&self, folded: &[f32], z: &mut [f32]) {
        let [_, rows] = self.layout.nodes();
        let pairs = z
            .chunks_exact_mut(self.layout.stride())
            .zip(folded.chunks_exact(self.width()));
        for (at, (row, source)) in pairs.enumerate() {
            if at % rows == 0 || at % rows == rows - 1 {
                continue;
            }
            let (even, odd) = source.split_at(self.nodes * self.width);
            let of = |class: usize| [even, odd].map(|half| &half[class * self.width..][..self.width]);
            for (at, class) in self.classes.iter().enumerate() {
                match *class {
                    Class::Corner => self.unfold_class(*class, of(at), |cell, value| {
                        let (start, step) = self.offset(0);
                        row[start + step * cell] = value;
                    }),
                    Class::Sum(node) => {
                        let ((start, step), (mirror, _)) = (self.offset(node), self.offset(self.nodes - node));
                        self.unfold_class(*class, of(at), |cell, value| {
                            row[start + step * cell] = value;
                            row[mirror + step * cell] = value;
                        });
                    }
                    // Sums come before differences.
                    Class::Difference(node) => {
                        let ((start, step), (mirror, _)) = (self.offset(node), self.offset(self.nodes - node));
                        self.unfold_class(*class, of(at), |cell, value| {
                            row[start + step * cell] += value;
                            row[mirror + step * cell] -= value;
                        });
                    }
                }
            }
        }
    }

    /// Passes the value of a class in each cell.
    #[inline(always)]
    fn unfold_class(&self, class: Class, [even, odd]: [&[f32]; 2], mut put: impl FnMut(usize, f32)) {
        let ((first, count, mirror), signs) = (class.half(self.cells), [0, 1].map(|parity| class.sign(parity)));
        for (at, (even, odd)) in even.iter().zip(odd).enumerate().take(count) {
            let cell = first + at;
            put(cell, even + odd);
            if 2 * cell != mirror {
                put(mirror - cell, signs[0] * even + signs[1] * odd);
            }
        }
    }

    /// Multiplies the classes of all rows by tables of their waves.
    fn multiply<'a>(&'a self, source: &[f32], target: &mut [f32], tables: impl Fn(Class, usize) -> (&'a [f32], usize)) {
        for (parity, (at, class)) in [0, 1]
            .into_iter()
            .flat_map(|parity| self.classes.iter().enumerate().map(move |class| (parity, class)))
        {
            let (table, inner) = tables(*class, parity);
            let layout = Layout {
                offset: (parity * self.nodes + at) * self.width,
                stride: self.width(),
            };
            let product = Product {
                left: source,
                left_layout: layout,
                right: table,
                width: self.width,
                inner,
                rows: 2 * self.layout.nodes()[1],
                target,
                target_layout: layout,
            };
            product.run();
        }
    }

    /// Replaces the classes of each row by modes, or the reverse.
    fn mix(&self, rows: &mut [f32], is_forward: bool) {
        let mut mixed = vec![0.0_f32; self.nodes * self.width];
        let parts = rows.chunks_exact_mut(self.nodes * self.width);
        for (part, parity) in parts.zip([0, 1].into_iter().cycle()) {
            dispatch_widest(
                #[inline(always)]
                || {
                    for (to, mixed) in mixed.chunks_exact_mut(self.width).enumerate() {
                        mixed.fill(0.0);
                        for (from, source) in part.chunks_exact(self.width).enumerate() {
                            let (mode, class) = if is_forward { (to, from) } else { (from, to) };
                            let place = (parity * self.nodes + mode) * self.nodes + class;
                            let factors = &self.vectors[place * self.width..][..self.width];
                            let terms = source.iter().zip(factors);
                            mixed.iter_mut().zip(terms).for_each(|(sum, (a, b))| *sum += a * b);
                        }
                    }
                },
            );
            part.copy_from_slice(&mixed);
        }
    }
}

impl Transform for CellTransform {
    fn width(&self) -> usize {
        2 * self.nodes * self.width
    }

    fn values(&self) -> Vec<Option<f64>> {
        self.values.clone()
    }

    fn modes_at(&self, column: usize) -> Vec<f32> {
        let mut modes = vec![0.0_f32; self.width()];
        let cell = column / self.nodes;
        let classes = self
            .classes
            .iter()
            .enumerate()
            .map(|(at, class)| (at, *class, self.part(*class, column)));
        for (at, class, part) in classes.filter(|(.., part)| *part != 0.0) {
            for (place, modes) in modes.chunks_exact_mut(self.width).enumerate() {
                let factors = &self.vectors[(place * self.nodes + at) * self.width..];
                for (index, (mode, factor)) in modes.iter_mut().zip(factors).enumerate() {
                    let value = part * class.value(wave_at(place / self.nodes, index), cell, self.cells);
                    *mode += value as f32 * factor;
                }
            }
        }
        modes
    }

    fn forward(&self, nodes: &[f32], spare: &mut [f32], modes: &mut [f32]) {
        self.fold(nodes, spare);
        self.multiply(spare, modes, |class, parity| {
            (&self.waves[class.wave()].forward[parity], class.half(self.cells).1)
        });
        self.mix(modes, true);
    }

    fn backward(&self, modes: &mut [f32], spare: &mut [f32], nodes: &mut [f32]) {
        self.mix(modes, false);
        self.multiply(modes, spare, |class, parity| {
            (&self.waves[class.wave()].backward[parity], self.cells / 2 + 1)
        });
        self.unfold(spare, nodes);
    }
}

impl Wave {
    fn new(class: Class, cells: usize, width: usize) -> Self {
        let (first, count, _) = class.half(cells);
        let value = |parity: usize, index: usize, position: usize| {
            let wave = wave_at(parity, index);
            match wave <= cells && position < count {
                true => class.value(wave, first + position, cells) as f32,
                false => 0.0,
            }
        };
        let table = |rows: usize, entry: &dyn Fn(usize, usize) -> f32| -> Vec<f32> {
            (0..rows * width).map(|at| entry(at / width, at % width)).collect()
        };
        Self {
            forward: [0, 1].map(|parity| table(count, &|position, index| value(parity, index, position))),
            backward: [0, 1].map(|parity| table(cells / 2 + 1, &|index, position| value(parity, index, position))),
        }
    }
}
