//! Errors of setting up a simulation.

use super::fitted::FitFault;
use deaflow_scene::Scene;

/// An error of setting up a simulation.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum SetupError {
    /// A path of rising loads without any.
    #[error("a path of the load needs a force other than 0 on a side, a bar or a body; the scene has none")]
    NoLoads,
    /// A path of given displacements without any.
    #[error("a path of the displacement needs a bar with a `displacement` other than 0; the scene has none")]
    NoDisplacements,
    /// A path of loads or displacements with a charge.
    #[error("a path of the load or displacement needs a voltage; the drive of this scene is a charge")]
    ChargedPath,
    /// Elements per cell out of range.
    #[error("elements_per_cell is {found}; allowed: 1 to 8")]
    ElementsPerCell {
        /// Requested elements per cell.
        found: usize,
    },
    /// Tolerance out of range.
    #[error("the tolerance is {found:e}; allowed: 1e-12 to 1e-2")]
    Tolerance {
        /// Requested tolerance.
        found: f64,
    },
    /// Accuracy that is not a positive length.
    #[error("the accuracy is {found} mm; allowed: positive lengths")]
    Accuracy {
        /// Requested accuracy in mm.
        found: f64,
    },
    /// The half-active membrane at rest, about which the response is linearised, is unstable.
    #[error(
        "a half-active membrane is unstable at this voltage, so there is no linear response; \
         `method: newton` reports the critical voltage of each pattern"
    )]
    Unstable,
    /// A request that needs a solution on one mesh, for an accuracy or an estimate.
    #[error("states of cells, load paths and drawn membranes need `method: newton` and a mesh instead of `accuracy`")]
    SeveralMeshes,
    /// The prestretch exceeds the limiting stretch of the elastomer.
    #[error("at a prestretch of {prestretch} the elastomer is beyond its limiting stretch: its energy is infinite")]
    LimitingStretch {
        /// The prestretch.
        prestretch: f64,
    },
    /// Stiff electrodes on unequal prestretch, whose law is anisotropic.
    #[error(
        "stiff electrodes need equal prestretch along x and y; found {} and {}",
        prestretch[0], prestretch[1]
    )]
    StiffElectrodes {
        /// Prestretch along x and y.
        prestretch: [f64; 2],
    },
    /// Stiff electrodes with several voltages: their law depends on presence, not on voltage.
    #[error("stiff electrodes need one voltage for all electrode groups; the voltages of this scene differ")]
    StiffGroups,
    /// A pattern with an electrode group that the scene does not have.
    #[error(
        "cell [y={y}][x={x}] of a pattern belongs to electrode group {group}; the scene has voltages for {groups} \
         groups"
    )]
    Group {
        /// Row of the cell.
        y: usize,
        /// Column of the cell.
        x: usize,
        /// Group of the cell.
        group: u8,
        /// Number of groups.
        groups: usize,
    },
    /// The membrane is unstable without voltage.
    #[error("at this prestretch the membrane is unstable without voltage: rank-one convexity is lost at rest")]
    UnstableAtRest,
    /// Invalid number or exponents of the terms of Ogden's law.
    #[error(
        "Ogden's law takes one to {} terms with exponents other than 0",
        super::energy::MOST_TERMS
    )]
    OgdenTerms,
    /// The fringe field reaches beyond half a cell.
    #[error(
        "the fringe field reaches {reach_mm:.3} mm beyond the edge of an electrode, more than half a cell \
         ({cell_mm:.3} mm): the membrane is too thick for its cells"
    )]
    FringeField {
        /// Displacement of the effective edge in mm.
        reach_mm: f64,
        /// Side of a cell in mm.
        cell_mm: f64,
    },
    /// A prescribed charge where a voltage is needed.
    #[error(
        "natural frequencies and frequency responses need a voltage; the drive of this scene is a charge: \
         give `voltage` instead"
    )]
    Charge,
    /// A linear response about zero voltage.
    #[error("there is no linear response about a bias of 0 V, since the force grows with the square of the voltage")]
    NoBias,
    /// Charged electrodes on a membrane with inertia and wrinkles, whose energy is not proportional to the square of a
    /// voltage.
    #[error(
        "cannot simulate `inertia` and `wrinkling` together with a conducting `charge` or a `source`: remove one of \
         them"
    )]
    MovingCharge,
    /// Electrode resistance with an incompatible setting.
    #[error("cannot simulate electrodes with a resistance together with {with}: remove one of them")]
    Resistance {
        /// The incompatible setting.
        with: &'static str,
    },
    /// Electrode resistance without leads.
    #[error("electrodes with a resistance need `leads`: add them to the scene")]
    Leads,
    /// Part of an electrode without a lead.
    #[error(
        "pattern {pattern}: an island of {cells} {} at cell [y={y}][x={x}] has no lead",
        if *cells == 1 { "cell" } else { "cells" }
    )]
    Island {
        /// Index of the pattern among the given ones.
        pattern: usize,
        /// Number of cells.
        cells: usize,
        /// Row of its lowest, then leftmost cell.
        y: usize,
        /// Column of that cell.
        x: usize,
    },
    /// Borders that elements cannot follow.
    #[error("elements cannot follow the curves of this device: {0}")]
    Borders(FitFault),
    /// Elements that follow curves, with an incompatible setting.
    #[error("elements follow no curves together with {with}: use `curves: cells` and `edges: cells`, or remove it")]
    Curves {
        /// The incompatible setting.
        with: &'static str,
    },
    /// Electrodes that cover parts of cells, with an incompatible setting.
    #[error(
        "cells that electrodes cover in part are not simulated together with {with}: use `edges: fitted` or `edges: \
         cells`, or remove it"
    )]
    Coverage {
        /// The incompatible setting.
        with: &'static str,
    },
    /// Sides that are not held, with an incompatible setting.
    #[error("sides that are not held are not simulated with {with}: hold all `sides`, or do without {with}")]
    Sides {
        /// The incompatible setting.
        with: &'static str,
    },
    /// A pressure with an incompatible setting.
    #[error("`loads` with a pressure or a volume are not simulated with {with}")]
    Pressure {
        /// The incompatible setting.
        with: &'static str,
    },
    /// A pressure where only motion in the plane is simulated.
    #[error(
        "a pressure or volume is simulated in equilibria and paths of `deaflow solve` and in stages of kind `design` \
             and `verify`, not here: remove `loads`"
    )]
    UnderPressure,
    /// Bodies that move out of the plane with an incompatible setting.
    #[error("bodies that move out of the plane are not simulated with {with}")]
    Lifted {
        /// The incompatible setting.
        with: &'static str,
    },
    /// Bodies that move out of the plane where only motion in the plane is simulated.
    #[error(
        "a `load` or `spring` of three numbers is simulated in equilibria of `deaflow solve` and in stages of kind \
             `design` and `verify`, not here: give two numbers"
    )]
    InSpace,
    /// A path that a scene with a pressure or a volume does not have.
    #[error("under the `loads` of the scene a path of the {parameter} cannot be followed")]
    PathUnderPressure {
        /// What should change along it.
        parameter: &'static str,
    },
    /// A pressure is needed.
    #[error("the scene has no pressure and no volume: add `loads: {{ pressure: 500 Pa }}`")]
    NoPressure,
    /// Memory is short.
    #[error("not enough memory")]
    Memory,
    /// Motions of the membrane as a whole that nothing resists, with an incompatible setting.
    #[error("{why}, which is not simulated with {with}: hold a side, or put sides on a `roller`")]
    Floating {
        /// The motions.
        why: String,
        /// The incompatible setting.
        with: &'static str,
    },
    /// Inertia without density.
    #[error("inertia needs a density: add `density` to `properties`")]
    Density,
    /// A mesh without free nodes.
    #[error("all nodes of this mesh are fixed: use more cells, more elements per cell, or biquadratic elements")]
    NothingMoves,
    /// Creep that three equilibria do not describe.
    #[error("cannot estimate a state at a time from three equilibria: {why}")]
    ThreeSolves {
        /// Reason.
        why: &'static str,
    },
    /// An amplitude without oscillation.
    #[error("cannot compute an amplitude at a frequency: {why}")]
    Swing {
        /// Reason.
        why: &'static str,
    },
    /// A history that cannot be estimated step by step.
    #[error("cannot estimate states step by step: {why}")]
    StepEstimates {
        /// Reason.
        why: &'static str,
    },
    /// A history of too many time steps.
    #[error("the history needs about {count:.0} steps; allowed: at most {most}. Request a shorter time or fewer times")]
    Steps {
        /// Minimum number of steps of the last pass.
        count: f64,
        /// Maximum number of steps of a pass.
        most: usize,
    },
    /// The eigenvectors of the preconditioner did not converge.
    #[error("cannot compute the eigenvectors of the preconditioner")]
    Eigenvectors,
}

impl SetupError {
    /// Returns where a scene in space is simulated; `None` for one in the plane.
    #[must_use]
    pub fn in_space(scene: &Scene) -> Option<Self> {
        match scene.is_in_space() {
            true if scene.loads.is_some() => Some(Self::UnderPressure),
            true => Some(Self::InSpace),
            false => None,
        }
    }

    /// Returns that a scene in space is not simulated with a setting.
    #[must_use]
    pub fn not_in_space(scene: &Scene, with: &'static str) -> Self {
        match scene.loads {
            Some(_) => Self::Pressure { with },
            None => Self::Lifted { with },
        }
    }

    /// Returns whether only another scene or request helps.
    #[must_use]
    pub fn is_of_the_scene(&self) -> bool {
        matches!(
            self,
            Self::ThreeSolves { .. }
                | Self::StepEstimates { .. }
                | Self::Swing { .. }
                | Self::Charge
                | Self::NoBias
                | Self::MovingCharge
                | Self::Resistance { .. }
                | Self::Leads
                | Self::Island { .. }
                | Self::Borders(_)
                | Self::Curves { .. }
                | Self::Coverage { .. }
                | Self::Sides { .. }
                | Self::Floating { .. }
                | Self::Density
                | Self::NothingMoves
                | Self::Steps { .. }
                | Self::NoLoads
                | Self::NoDisplacements
                | Self::ChargedPath
                | Self::Pressure { .. }
                | Self::UnderPressure
                | Self::Lifted { .. }
                | Self::InSpace
                | Self::PathUnderPressure { .. }
                | Self::NoPressure
        )
    }
}
