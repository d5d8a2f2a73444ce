//! Names of the constants of a network in a model file.

/// The response, by the parity of the pattern under the mirrors along x (bit 0) and y (bit 1).
pub(super) const BLOCKS: [&str; 4] = ["response.even", "response.odd-x", "response.odd-y", "response.odd"];
/// The displacement that loads of bodies cause, where there are such.
pub(super) const LOADED: &str = "response.loaded";
/// The size of strain and the unit of length.
pub(super) const STRAIN: &str = "response.strain";
/// The stiffness of a cell along x over the geometric mean of both, where the membrane differs along x and y.
pub(super) const RATIO: &str = "green.ratio";
/// The places among the inner corners where frames and bodies meet the membrane.
pub(super) const NODES: &str = "green.nodes";
/// The forces with which these resist.
pub(super) const STIFFNESS: &str = "green.stiffness";
/// Which cells are membrane, where not all are.
pub(super) const CELLS: &str = "device.cells";
