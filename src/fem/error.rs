//! Why a membrane cannot be simulated.

/// Options that no solver can be made of.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum SetupError {
    /// Elements per cell out of range.
    #[error("elements_per_cell is {found}; allowed: 1 to 8")]
    ElementsPerCell {
        /// What was asked for.
        found: usize,
    },
    /// Tolerance out of range.
    #[error("the tolerance is {found:e}; allowed: 1e-12 to 1e-2")]
    Tolerance {
        /// What was asked for.
        found: f64,
    },
    /// Accuracy that no mesh can have.
    #[error("the accuracy is {found} mm; allowed: positive lengths")]
    Accuracy {
        /// What was asked for.
        found: f64,
    },
    /// The half-active membrane at rest, about which a response is linearised, is not stable.
    #[error(
        "a half-active membrane is unstable at this voltage, so there is no linear response; \
         `method: newton` reports the critical voltage of each pattern"
    )]
    Unstable,
    /// What looks into a solution was asked of an accuracy, or of an estimate.
    #[error("states of cells, load paths and drawn membranes need `method: newton` and a mesh instead of `accuracy`")]
    SeveralMeshes,
    /// The prestretch is beyond what the elastomer can be stretched.
    #[error("at a prestretch of {prestretch} the elastomer is beyond its limiting stretch: its energy is infinite")]
    LimitingStretch {
        /// The prestretch.
        prestretch: f64,
    },
    /// Electrodes that were laid on a membrane with unequal prestretch have an anisotropic law.
    #[error(
        "stiff electrodes need equal prestretch along x and y; found {} and {}",
        prestretch[0], prestretch[1]
    )]
    StiffElectrodes {
        /// Along x and y.
        prestretch: [f64; 2],
    },
    /// The law of an electrode knows whether it is there, not what voltage it has.
    #[error("stiff electrodes need one voltage for all electrode groups; the voltages of this scene differ")]
    StiffGroups,
    /// A pattern of another scene.
    #[error(
        "cell [y={y}][x={x}] of a pattern belongs to electrode group {group}; the scene has voltages for {groups} groups"
    )]
    Group {
        /// Row of the cell.
        y: usize,
        /// Its column.
        x: usize,
        /// Its group.
        group: u8,
        /// How many there are.
        groups: usize,
    },
    /// The membrane is not stable before any voltage is applied.
    #[error("at this prestretch the membrane is unstable without voltage: rank-one convexity is lost at rest")]
    UnstableAtRest,
    /// A term of Ogden's law that is none, or too many of them.
    #[error(
        "Ogden's law takes one to {} terms with exponents other than 0",
        super::energy::MOST_TERMS
    )]
    OgdenTerms,
    /// The fringe field reaches too far to be a matter of the edges of cells.
    #[error(
        "the fringe field reaches {reach_mm:.3} mm beyond the edge of an electrode, more than half a cell \
         ({cell_mm:.3} mm): the membrane is too thick for its cells"
    )]
    FringeField {
        /// How far the effective edge moves, in mm.
        reach_mm: f64,
        /// Side of a cell in mm.
        cell_mm: f64,
    },
    /// A drive by charge where a voltage is needed.
    #[error(
        "natural frequencies and frequency responses need a voltage; the drive of this scene is a charge: \
         give `voltage` instead"
    )]
    Charge,
    /// A response to changes of a voltage that is zero.
    #[error("there is no linear response about a bias of 0 V, since the force grows with the square of the voltage")]
    NoBias,
    /// Electrodes with a charge on a membrane that moves and wrinkles, whose energy is not in proportion to the square of a voltage.
    #[error(
        "cannot simulate `inertia` and `wrinkling` together with a conducting `charge` or a `source`: remove one of them"
    )]
    MovingCharge,
    /// Electrodes with a resistance, and what they are not simulated with.
    #[error("cannot simulate electrodes with a resistance together with {with}: remove one of them")]
    Resistance {
        /// What it is.
        with: &'static str,
    },
    /// Electrodes with a resistance that nothing feeds.
    #[error("electrodes with a resistance need `leads`: add them to the scene")]
    Leads,
    /// A part of an electrode that no lead reaches.
    #[error("pattern {pattern}: an island of {cells} {} at cell [y={y}][x={x}] has no lead", if *cells == 1 { "cell" } else { "cells" })]
    Island {
        /// The pattern, counted from 0 among those that were given.
        pattern: usize,
        /// How many cells it has.
        cells: usize,
        /// Row of its lowest, then leftmost cell.
        y: usize,
        /// The column.
        x: usize,
    },
    /// A density that nothing says.
    #[error("inertia needs a density: add `density` to `properties`")]
    Density,
    /// A mesh of which nothing moves.
    #[error(
        "there are no natural frequencies, since all nodes of this mesh are fixed: use more cells, more elements per \
         cell, or biquadratic elements"
    )]
    NothingMoves,
    /// Creep that is no matter of three equilibria.
    #[error("cannot estimate a state at a time from three equilibria: {why}")]
    ThreeSolves {
        /// What it is for, and what the scene has.
        why: &'static str,
    },
    /// Nothing that swings.
    #[error("cannot compute an amplitude at a frequency: {why}")]
    Swing {
        /// What it is of, and what the scene has.
        why: &'static str,
    },
    /// A history whose states are no matter of estimates.
    #[error("cannot estimate states step by step: {why}")]
    StepEstimates {
        /// What it is for, and what the scene has.
        why: &'static str,
    },
    /// A drive that changes too often within the time that is asked for.
    #[error("the history needs about {count:.0} steps; allowed: at most {most}. Request a shorter time or fewer times")]
    Steps {
        /// Steps of its last pass at least.
        count: f64,
        /// Steps of a pass at most.
        most: usize,
    },
    /// The eigenvectors of the preconditioner did not converge.
    #[error("cannot compute the eigenvectors of the preconditioner")]
    Eigenvectors,
}

impl SetupError {
    /// Whether another scene or request is all that helps.
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
                | Self::Density
                | Self::NothingMoves
                | Self::Steps { .. }
        )
    }
}
