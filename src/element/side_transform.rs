//! Transforms between the nodes of rows and their modes where ends of rows are free: dense products with all
//! eigenvectors, which have no symmetry about the middle if only one end is.

use std::ops::Range;

use deaflow_linalg::Mat;

use super::error::SetupError;
use super::gemm::{Layout, Product};
use super::lanes::WIDEST;
use super::layout::NodeLayout;
use super::modes::generalised_eigen;
use super::rectangle::Transform;

/// The eigenvectors of a line of nodes.
pub(super) struct SideTransform {
    layout: NodeLayout,
    width: usize,
    /// From a row of a vector to modes, `[place][mode]`.
    forward: Vec<f32>,
    /// From modes to a row of a vector, `[mode][place]`.
    backward: Vec<f32>,
    values: Vec<Option<f64>>,
}

impl SideTransform {
    /// Computes the eigenvectors for the stiffness and mass of these nodes of a row.
    pub(super) fn new(
        layout: NodeLayout,
        nodes: Range<usize>,
        (stiffness, mass): &(Mat<f64>, Mat<f64>),
    ) -> Result<Self, SetupError> {
        let (vectors, known) = generalised_eigen(stiffness, mass).ok_or(SetupError::Eigenvectors)?;
        let (width, stride) = (known.len().max(1).next_multiple_of(WIDEST), layout.stride());
        let [mut forward, mut backward] = [vec![0.0; stride * width], vec![0.0; width * stride]];
        for (at, node) in nodes.enumerate() {
            let place = layout.index(0, node, 0);
            for mode in 0..known.len() {
                let value = vectors[(at, mode)] as f32;
                forward[place * width + mode] = value;
                backward[mode * stride + place] = value;
            }
        }
        let mut values: Vec<Option<f64>> = known.into_iter().map(Some).collect();
        values.resize(width, None);
        Ok(Self {
            layout,
            width,
            forward,
            backward,
            values,
        })
    }

    fn product(&self, source: &[f32], table: &[f32], [from, to]: [usize; 2], target: &mut [f32]) {
        let layout = |stride| Layout { offset: 0, stride };
        let product = Product {
            left: source,
            left_layout: layout(from),
            right: table,
            width: to,
            inner: from,
            rows: source.len() / from,
            target,
            target_layout: layout(to),
        };
        product.run();
    }
}

impl Transform for SideTransform {
    fn width(&self) -> usize {
        self.width
    }

    fn values(&self) -> Vec<Option<f64>> {
        self.values.clone()
    }

    fn modes_at(&self, column: usize) -> Vec<f32> {
        self.forward[self.layout.index(0, column, 0) * self.width..][..self.width].to_vec()
    }

    fn forward(&self, nodes: &[f32], _spare: &mut [f32], modes: &mut [f32]) {
        self.product(nodes, &self.forward, [self.layout.stride(), self.width], modes);
    }

    fn backward(&self, modes: &mut [f32], _spare: &mut [f32], nodes: &mut [f32]) {
        self.product(modes, &self.backward, [self.width, self.layout.stride()], nodes);
    }
}
