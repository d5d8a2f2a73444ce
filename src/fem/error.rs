//! Why a membrane cannot be simulated.

/// Options that no solver can be made of.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum SetupError {
    /// Elements per cell out of range.
    #[error("elements_per_cell is {found}; it lies between 1 and 8")]
    ElementsPerCell {
        /// What was asked for.
        found: usize,
    },
    /// Tolerance out of range.
    #[error("the tolerance is {found:e}; it lies between 1e-12 and 1e-2")]
    Tolerance {
        /// What was asked for.
        found: f64,
    },
    /// Accuracy that no mesh can have.
    #[error("the accuracy is {found} mm; it is a positive length")]
    Accuracy {
        /// What was asked for.
        found: f64,
    },
    /// The half-active membrane at rest, about which a response is linearised, is not stable.
    #[error(
        "a half-active membrane is not stable at this voltage: there is no linear response; `method: newton` says how far each pattern gets"
    )]
    Unstable,
    /// What looks into a solution was asked of an accuracy, or of an estimate.
    #[error("states of cells, load paths and drawn membranes need Newton's method on one mesh, not an accuracy")]
    SeveralMeshes,
    /// The prestretch is beyond what the elastomer can be stretched.
    #[error("at a prestretch of {prestretch} the elastomer is beyond its limiting stretch: its energy is infinite")]
    LimitingStretch {
        /// The prestretch.
        prestretch: f64,
    },
    /// Electrodes that were laid on a membrane with unequal prestretch have an anisotropic law.
    #[error(
        "stiff electrodes are simulated on membranes with equal prestretch alone, and this one is stretched by {} and {}",
        prestretch[0], prestretch[1]
    )]
    StiffElectrodes {
        /// Along x and y.
        prestretch: [f64; 2],
    },
    /// The law of an electrode knows whether it is there, not what voltage it has.
    #[error(
        "stiff electrodes are simulated where all groups of electrodes have one voltage, and those of this scene differ"
    )]
    StiffGroups,
    /// A pattern of another scene.
    #[error(
        "cell [y={y}][x={x}] of a pattern belongs to group {group} of electrodes, and the scene has voltages of {groups}"
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
    #[error("at this prestretch the membrane is not stable even without voltage: rank-one convexity is lost at rest")]
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
        "natural frequencies and frequency responses are those of a voltage, and the drive of this scene is a charge: give `voltage` in its place"
    )]
    Charge,
    /// A response to changes of a voltage that is zero.
    #[error(
        "the force grows with the square of the voltage: about a bias of 0 V it does not change to first order, so there is no linear response"
    )]
    NoBias,
    /// Electrodes with a charge on a membrane that moves and wrinkles, whose energy is not in proportion to the square of a voltage.
    #[error(
        "motion with inertia at a conducting `charge` or behind a `source` is simulated without wrinkles: leave out `inertia`, `wrinkling`, or what feeds \
         the electrodes"
    )]
    MovingCharge,
    /// Electrodes with a resistance, and what they are not simulated with.
    #[error("electrodes with a resistance are not simulated together with {with}: leave out one of the two")]
    Resistance {
        /// What it is.
        with: &'static str,
    },
    /// Electrodes with a resistance that nothing feeds.
    #[error("electrodes with a resistance need `leads`, and the scene has none")]
    Leads,
    /// A part of an electrode that no lead reaches.
    #[error("pattern {pattern}: an island of {cells} {} at cell [y={y}][x={x}] is reached by no lead", if *cells == 1 { "cell" } else { "cells" })]
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
    #[error("inertia needs a density, and the scene has none: give `density` in `properties`")]
    Density,
    /// A mesh of which nothing moves.
    #[error(
        "no node of this mesh is free to move, so there are no natural frequencies: give more cells, more elements in each, or biquadratic ones"
    )]
    NothingMoves,
    /// Creep that is no matter of three equilibria.
    #[error("a state at a time is found from three equilibria for {why}")]
    ThreeSolves {
        /// What it is for, and what the scene has.
        why: &'static str,
    },
    /// Nothing that swings.
    #[error("an amplitude at a frequency is that of {why}")]
    Swing {
        /// What it is of, and what the scene has.
        why: &'static str,
    },
    /// A history whose states are no matter of estimates.
    #[error("states are estimated step by step for {why}")]
    StepEstimates {
        /// What it is for, and what the scene has.
        why: &'static str,
    },
    /// A drive that changes too often within the time that is asked for.
    #[error(
        "the history takes some {count:.0} steps, and {most} are the most: ask for a shorter time, or for fewer times"
    )]
    Steps {
        /// Steps of its last pass at least.
        count: f64,
        /// Steps of a pass at most.
        most: usize,
    },
    /// The eigenvectors of the preconditioner did not converge.
    #[error("the eigenvectors of the preconditioner could not be computed")]
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
