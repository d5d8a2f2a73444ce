//! What a model file says about itself: everything that is needed to use the network without this program.

use std::collections::{BTreeMap, BTreeSet};

use serde::{Deserialize, Serialize};

use super::encode::inner_sides;
use crate::pattern::Raster;

/// The version of the format. It is raised whenever a reader of the one before would misunderstand a file.
pub(crate) const VERSION: u64 = 2;

/// The description of a network, as it stands in a model file after the digest.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Header {
    /// The version of the format.
    pub(crate) format_version: u64,
    /// Name of the network.
    pub(crate) network: String,
    /// Length in mm of one unit of the network's own output.
    pub(crate) scale_mm: f64,
    /// What goes in.
    input: Input,
    /// What comes out.
    output: Output,
    /// The scene that the training data was simulated in, as artifacts carry it.
    pub(crate) scene: Option<String>,
    /// How it was trained.
    pub(crate) training: Option<Record>,
    /// Which tensor is what.
    pub(crate) tensors: Tensors,
}

#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Input {
    shape: (String, usize, usize),
    axes: String,
    values: String,
    encoding: String,
}

#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Output {
    shape: (String, usize, usize, usize),
    axes: String,
    unit: String,
    components: (String, String),
    frame: String,
    network: String,
}

/// Names of the tensors of a model.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Tensors {
    /// Those that were trained.
    pub(crate) trained: BTreeSet<String>,
    /// Those that are part of the network and were not trained.
    pub(crate) constant: BTreeSet<String>,
}

/// How a network was trained.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Record {
    /// Examples by part of the dataset and family.
    pub examples: BTreeMap<String, BTreeMap<String, u64>>,
    /// Passes over the training examples that were made.
    pub epochs: u32,
    /// The pass whose weights are kept, from 1.
    pub best_epoch: u32,
    /// Root mean square error of a component in mm on the validation examples; none where there are none.
    pub validation_rmse_mm: Option<f64>,
    /// Seed of the weights and of the order of the examples.
    pub seed: u64,
    /// Digests of the datasets.
    pub inputs: Vec<String>,
}

impl Header {
    /// The header of a network for these cells whose answers are in units of `scale_mm`.
    pub(crate) fn new(network: &str, raster: Raster, scale_mm: f64) -> Self {
        Self {
            format_version: VERSION,
            network: network.to_owned(),
            scale_mm,
            input: Input::on(raster),
            output: Output::on(raster),
            scene: None,
            training: None,
            tensors: Tensors::default(),
        }
    }

    /// The cells of its patterns; none where no membrane has so many.
    pub(crate) fn raster(&self) -> Option<Raster> {
        let (_, rows, columns) = self.input.shape;
        Raster::new(columns, rows)
    }

    /// What it says that this program cannot honour, if anything.
    pub(crate) fn objection(&self) -> Option<String> {
        if !(self.scale_mm.is_finite() && self.scale_mm > 0.0) {
            return Some(format!("its scale is {} mm", self.scale_mm));
        }
        let Some(raster) = self.raster().filter(|raster| self.input == Input::on(*raster)) else {
            return Some("it takes patterns in another form".to_owned());
        };
        if self.output != Output::on(raster) {
            return Some("it gives displacements in another form".to_owned());
        }
        None
    }
}

impl Input {
    fn on(raster: Raster) -> Self {
        Self {
            shape: ("n".into(), raster.rows(), raster.columns()),
            axes: "[pattern][y][x], origin lower left".into(),
            values: "0: no electrode, 1: electrode".into(),
            encoding: "the network sees the value less 0.5".into(),
        }
    }
}

impl Output {
    fn on(raster: Raster) -> Self {
        let ([columns, rows], [across, up]) = (inner_sides(raster), raster.corner_sides());
        Self {
            shape: ("n".into(), up, across, 2),
            axes: "[pattern][y][x][component] at the corners of the cells, origin lower left".into(),
            unit: "mm".into(),
            components: ("x".into(), "y".into()),
            frame: "zero: the outer corners do not move".into(),
            network: format!("[n][{rows}][{columns}][2] at the inner corners, to be multiplied by scale_mm"),
        }
    }
}
