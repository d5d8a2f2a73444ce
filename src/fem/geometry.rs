//! The error of devices whose elements follow cells in place of the shapes of frames, bodies and electrodes.
//!
//! A finer mesh of the same cells does not reduce this error. It is estimated by the difference of two solutions on
//! meshes of equal elements: one on the cells, and one whose elements follow the shapes. Each has an error of its mesh
//! of some per cent of their difference, for which a margin is added.

use deaflow_field::Field;
use deaflow_scene::{Effects, Scene};

/// The estimate over the difference of two solutions.
const MARGIN: f64 = 1.25;

/// The largest difference between displacements on cells and on the shapes that these stand for.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum GeometryError {
    /// Its estimate over the cell corners in mm.
    Estimated(f64),
    /// Elements cannot follow the shapes, or there is no stable solution on them.
    Unknown,
}

impl GeometryError {
    /// Returns the estimate in mm, if there is one.
    #[must_use]
    pub fn mm(self) -> Option<f64> {
        match self {
            Self::Estimated(mm) => Some(mm),
            Self::Unknown => None,
        }
    }

    /// Estimates the error of a quantity, given that on cells and that on shapes.
    #[must_use]
    pub fn between(on_cells: f64, on_shapes: f64) -> f64 {
        MARGIN * (on_cells - on_shapes).abs()
    }

    /// Estimates the error of a displacement.
    pub(super) fn of_fields([on_cells, on_shapes]: [Option<&Field>; 2]) -> Self {
        match (on_cells, on_shapes) {
            (Some(on_cells), Some(on_shapes)) => Self::Estimated(MARGIN * on_cells.max_difference(on_shapes)),
            _ => Self::Unknown,
        }
    }

    /// Returns a scene on cells, and on the shapes of frame and bodies that they stand for, if there are any. Both lack
    /// effects that elements along shapes do not have: their difference is the same, up to its change by the effect.
    #[must_use]
    pub fn scenes(scene: &Scene) -> Option<[Scene; 2]> {
        Some([scene, &scene.with_fitted_curves()?].map(without_effects_of_cells))
    }

    /// Adds an estimate to another error in mm; `None` if one of them is unknown.
    #[must_use]
    pub fn added_to(geometry: Option<Self>, error_mm: Option<f64>) -> Option<f64> {
        Some(error_mm? + geometry.map_or(Some(0.0), Self::mm)?)
    }
}

/// Returns a scene without effects that elements along shapes do not have, and without searches for other voltages.
pub(super) fn without_effects_of_cells(scene: &Scene) -> Scene {
    scene.with_effects(Effects {
        fringe_field: None,
        electrode_resistance: None,
        electromechanical_stability: None,
        ..scene.effects.clone()
    })
}
