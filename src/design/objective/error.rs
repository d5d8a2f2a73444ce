//! Errors of goals.

use deaflow_pattern::Raster;

/// Why a goal is invalid.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum GoalError {
    /// There is no point and no body.
    #[error("a design needs at least one point")]
    NoAim,
    /// The masks of a robust objective.
    #[error("{0}")]
    Masks(String),
    /// The side of the membrane is not a length.
    #[error("the side of the membrane must be positive, found {0} mm")]
    Side(f64),
    /// The point is on a side or outside.
    #[error("the point ({} mm, {} mm) is not inside the membrane of {size}; allowed: 0 mm < x < {} mm and 0 mm < y < \
             {} mm", point[0], point[1], size_mm[0], size_mm[1])]
    Point {
        /// The point in mm.
        point: [f64; 2],
        /// The sides of the membrane.
        size: String,
        /// The sides of the membrane in mm.
        size_mm: [f64; 2],
    },
    /// Only bodies rotate.
    #[error("a point cannot rotate; a rotation needs a rigid body")]
    PointTurns,
    /// There is no such body.
    #[error("there is no body {found}; number of bodies in the scene: {count}, numbered from 0")]
    Body {
        /// The number.
        found: usize,
        /// The number of bodies.
        count: usize,
    },
    /// Too few corners of cells lie in a body.
    #[error("body {body} is too small: fewer than two corners of cells lie inside of its border; use more `cells`")]
    SmallBody {
        /// The number.
        body: usize,
    },
    /// There is no bar on a side.
    #[error("there is no bar on the {side} side of the membrane")]
    Bar {
        /// The side.
        side: &'static str,
    },
    /// A side does not hold the membrane along a component of the direction.
    #[error(
        "{what} along {axis}, so its force along {axis} is only its load: use a bar that is blocked or has a \
             `spring`, or another direction"
    )]
    Reaction {
        /// The side, and that it does not hold the membrane.
        what: String,
        /// The axis.
        axis: &'static str,
    },
    /// All sides are held.
    #[error("a `reaction` needs `sides` that are not all held")]
    ReactionOfHeld,
    /// The drive is a charge.
    #[error("a `reaction` needs a drive by a voltage; this one is a charge")]
    ReactionOfCharge,
    /// The region contains no cell.
    #[error("the `region` contains no cell centre of the membrane of {size}")]
    Region {
        /// The sides of the membrane.
        size: String,
    },
    /// The mask of the region has other cells.
    #[error("the mask of the `region` has {found} cells, but the membrane has {raster}")]
    RegionMask {
        /// The cells of the mask.
        found: Raster,
        /// The cells of the membrane.
        raster: Raster,
    },
    /// Displacements of membranes with sides that are not held count from rest.
    #[error("an `area_strain` needs a membrane whose sides are all held")]
    RegionOfSides,
    /// The membrane stays in its plane.
    #[error(
        "a `height` or a `volume` needs a membrane that leaves its plane: a scene with `loads`, or a body with three \
             numbers in its `load` or `spring`"
    )]
    StaysInPlane,
    /// Forces and motions have no mean.
    #[error("an objective has either motions, in mm, or reactions, in mN")]
    Units,
    /// There is no such state.
    #[error("there is no state `{found}`: the scene has {}", if states.is_empty() { "none" } else { states.as_str() })]
    State {
        /// The name.
        found: String,
        /// The states of the scene.
        states: String,
    },
    /// The scene has several states, and none is given.
    #[error("a point or body needs a `state`; the scene has {states}")]
    NoState {
        /// The states of the scene.
        states: String,
    },
    /// The direction is not finite.
    #[error("a direction must be finite, found {0} deg")]
    Direction(f64),
    /// The weight of a point is out of range.
    #[error("the weight of a point must be finite and positive, found {0}")]
    Weight(f64),
    /// The target displacement is not finite.
    #[error("a target displacement must be finite, found ({} mm, {} mm)", _0[0], _0[1])]
    Displacement([f64; 2]),
    /// There is no target displacement to which a distance is measured.
    #[error("a distance needs a target displacement for each point")]
    NoDistance,
    /// The area fraction is out of range.
    #[error("an area fraction must lie between 0 and 1, found {0}")]
    Area(f64),
    /// The weight of the area is out of range.
    #[error("the weight of the area must be finite and not negative, found {0}")]
    Penalty(f64),
}
