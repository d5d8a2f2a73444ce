//! The header of a model file: everything that another program needs to use the network.

use std::collections::{BTreeMap, BTreeSet};

use serde::{Deserialize, Serialize};

use super::corners::{Corners, HeldSides};
use deaflow_pattern::{Pattern, PatternForm, Raster};
use deaflow_scene::Scene;

/// The version of the format. It increases whenever older readers would misread a file.
pub(crate) const VERSION: u64 = 2;

/// The description of a network. In a model file it follows the digest.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Header {
    /// The version of the format.
    pub(crate) format_version: u64,
    /// Name of the network.
    pub(crate) network: String,
    /// Length in mm of one unit of the network's own output.
    pub(crate) scale_mm: f64,
    /// Input of the network.
    input: Input,
    /// Output of the network.
    output: Output,
    /// Scene of the training data, in the text form of artifacts.
    pub(crate) scene: Option<String>,
    /// Record of the training.
    pub(crate) training: Option<TrainingRecord>,
    /// Names of the tensors.
    pub(crate) tensors: Tensors,
}

#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Input {
    shape: (String, usize, usize),
    axes: String,
    values: String,
    encoding: String,
    /// Load (squared voltage) of each electrode group relative to the largest; only for several groups.
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
    /// The components along x and y that the left, right, lower and upper side hold, if not all are held.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    sides: Option<HeldSides>,
}

/// Names of the tensors of a model.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Tensors {
    /// Trained weights.
    pub(crate) trained: BTreeSet<String>,
    /// Constants.
    pub(crate) constant: BTreeSet<String>,
}

/// Record of a training.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TrainingRecord {
    /// Number of examples by split and family.
    pub examples: BTreeMap<String, BTreeMap<String, u64>>,
    /// Number of finished epochs.
    pub epochs: u32,
    /// Epoch whose weights are kept, from 1.
    pub best_epoch: u32,
    /// Root mean square error of a component in mm on the validation examples, if there are any.
    pub validation_rmse_mm: Option<f64>,
    /// Seed of the initial weights and of the order of the examples.
    pub seed: u64,
    /// Digests of the datasets.
    pub inputs: Vec<String>,
}

impl Header {
    /// Creates the header of a network for these corners and group loads whose output has the unit `scale_mm`.
    pub(crate) fn new(network: &str, corners: Corners, loads: &[f64], scale_mm: f64) -> Self {
        Self {
            format_version: VERSION,
            network: network.to_owned(),
            scale_mm,
            input: Input::on(corners.raster(), loads),
            output: Output::on(corners),
            scene: None,
            training: None,
            tensors: Tensors::default(),
        }
    }

    /// Returns the cells of its patterns; `None` when the shape is invalid.
    pub(crate) fn raster(&self) -> Option<Raster> {
        let (_, rows, columns) = self.input.shape;
        Raster::new(columns, rows)
    }

    /// Returns the corners of its output for patterns of these cells.
    pub(crate) fn corners(&self, raster: Raster) -> Corners {
        match self.output.sides {
            Some(held) => Corners::all(raster, held),
            None => Corners::inner(raster),
        }
    }

    /// Returns the form of its patterns; the scene knows the size of the membrane.
    pub(crate) fn form(&self) -> Option<PatternForm> {
        let scene = self.scene.as_deref().and_then(|text| Scene::from_text(text).ok());
        let size_mm = scene.and_then(|scene| scene.form().size_mm);
        let form = PatternForm::of_square_cells(self.raster()?, self.loads().len());
        Some(PatternForm { size_mm, ..form })
    }

    /// Returns the load of each electrode group relative to the largest.
    pub(crate) fn loads(&self) -> &[f64] {
        self.input.loads.as_deref().unwrap_or(&[1.0])
    }

    /// Returns why this program cannot use the network, if so.
    pub(crate) fn objection(&self) -> Option<String> {
        if !(self.scale_mm.is_finite() && self.scale_mm > 0.0) {
            return Some(format!("its scale is {} mm; it must be above 0", self.scale_mm));
        }
        let is_known = |raster: &Raster| self.input == Input::on(*raster, self.loads());
        let Some(raster) = self.raster().filter(is_known) else {
            return Some("unknown form of patterns".to_owned());
        };
        if !self.loads().iter().all(|load| (0.0..=1.0).contains(load)) || self.loads().len() > Pattern::MOST_GROUPS {
            return Some(format!("invalid group loads {:?}", self.loads()));
        }
        if self.output != Output::on(self.corners(raster)) {
            return Some("unknown form of displacements".to_owned());
        }
        None
    }
}

impl Input {
    fn on(raster: Raster, loads: &[f64]) -> Self {
        let several = loads.len() > 1;
        let text = |one: &str, many: &str| if several { many } else { one }.to_owned();
        Self {
            shape: ("n".into(), raster.rows(), raster.columns()),
            axes: "[pattern][y][x], origin lower left".into(),
            values: text(
                "0: no electrode, 1: electrode",
                "0: no electrode, g: electrode of group g, from 1",
            ),
            encoding: text(
                "the network sees the value less 0.5",
                "the network sees the load of the group, of a bare cell 0, less 0.5",
            ),
            loads: several.then(|| loads.to_vec()),
        }
    }
}

impl Output {
    fn on(corners: Corners) -> Self {
        let ([columns, rows], [across, up]) = (corners.sides(), corners.raster().corner_sides());
        let text = |all: &str, some: &str| if corners.held().is_none() { all } else { some }.to_owned();
        Self {
            shape: ("n".into(), up, across, 2),
            axes: "[pattern][y][x][component] at the corners of the cells, origin lower left".into(),
            unit: "mm".into(),
            components: ("x".into(), "y".into()),
            frame: text(
                "zero: the outer corners do not move",
                "zero along components that sides hold; displacements count from the state without voltage",
            ),
            network: format!(
                "[n][{rows}][{columns}][2] at the {}corners, to be multiplied by scale_mm",
                text("inner ", "")
            ),
            sides: corners.held(),
        }
    }
}
