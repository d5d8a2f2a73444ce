//! What a model file says about itself: everything that is needed to use the network without this program.

use std::collections::{BTreeMap, BTreeSet};

use serde::{Deserialize, Serialize};

use super::encode::inner_sides;
use deaflow_pattern::{Pattern, PatternForm, Raster};

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
    /// Of each of several groups of electrodes the share of the largest load, the squared voltage.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    loads: Option<Vec<f64>>,
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
    /// The header of a network for these cells and groups of electrodes whose answers are in units of `scale_mm`.
    pub(crate) fn new(network: &str, raster: Raster, loads: &[f64], scale_mm: f64) -> Self {
        Self {
            format_version: VERSION,
            network: network.to_owned(),
            scale_mm,
            input: Input::on(raster, loads),
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

    /// What its patterns are.
    pub(crate) fn form(&self) -> Option<PatternForm> {
        let groups = self.loads().len();
        self.raster().map(|raster| PatternForm { raster, groups })
    }

    /// The share of the largest load that each group of electrodes has.
    pub(crate) fn loads(&self) -> &[f64] {
        self.input.loads.as_deref().unwrap_or(&[1.0])
    }

    /// What it says that this program cannot honour, if anything.
    pub(crate) fn objection(&self) -> Option<String> {
        if !(self.scale_mm.is_finite() && self.scale_mm > 0.0) {
            return Some(format!("its scale is {} mm", self.scale_mm));
        }
        let is_known = |raster: &Raster| self.input == Input::on(*raster, self.loads());
        let Some(raster) = self.raster().filter(is_known) else {
            return Some("it takes patterns in another form".to_owned());
        };
        if !self.loads().iter().all(|load| (0.0..=1.0).contains(load)) || self.loads().len() > Pattern::MOST_GROUPS {
            return Some(format!("its groups have the loads {:?}", self.loads()));
        }
        if self.output != Output::on(raster) {
            return Some("it gives displacements in another form".to_owned());
        }
        None
    }
}

impl Input {
    fn on(raster: Raster, loads: &[f64]) -> Self {
        let several = loads.len() > 1;
        let said = |one: &str, many: &str| if several { many } else { one }.to_owned();
        Self {
            shape: ("n".into(), raster.rows(), raster.columns()),
            axes: "[pattern][y][x], origin lower left".into(),
            values: said(
                "0: no electrode, 1: electrode",
                "0: no electrode, g: electrode of group g, from 1",
            ),
            encoding: said(
                "the network sees the value less 0.5",
                "the network sees the load of the group, of a bare cell 0, less 0.5",
            ),
            loads: several.then(|| loads.to_vec()),
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
