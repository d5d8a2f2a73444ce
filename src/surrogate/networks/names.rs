//! Names of the constants in a model file.

/// The linear response for each parity of the pattern under the mirrors along x (bit 0) and y (bit 1).
pub(super) const BLOCKS: [&str; 4] = ["response.even", "response.odd-x", "response.odd-y", "response.odd"];
/// The displacement by loads on bodies, if there are any.
pub(super) const LOADED: &str = "response.loaded";
/// Typical strain ε and unit of length L in mm.
pub(super) const STRAIN: &str = "response.strain";
/// The stiffness of a cell along x over the geometric mean of both directions, if the membrane is anisotropic.
pub(super) const RATIO: &str = "green.ratio";
/// Indices of the inner corners at which the frame and the bodies touch the membrane.
pub(super) const NODES: &str = "green.nodes";
/// Stiffness of these corners.
pub(super) const STIFFNESS: &str = "green.stiffness";
/// Mask of the membrane cells, if not all cells are membrane.
pub(super) const CELLS: &str = "device.cells";
