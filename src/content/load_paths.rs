//! The file of `deaflow solve --path`: points and events of all patterns stand one after the other. It may hold NaN.

use super::macros::arrays;
use deaflow_field::Field;
use deaflow_pattern::Pattern;
use deaflow_scene::Scene;

arrays! {
    /// How patterns get from rest to the loss of stability, and what lies beyond.
    pub struct LoadPaths, LoadPathsView {
        /// Electrode patterns, origin lower left, 1 = electrode.
        patterns: Vec<Pattern> = array("patterns", "1", [path, y, x]),
        /// The points of path i are those from element i up to, but without, element i + 1.
        point_offsets: Vec<u64> = array("point_offsets", "1", [path_bound]),
        /// The events of path i are those from element i up to, but without, element i + 1.
        event_offsets: Vec<u64> = array("event_offsets", "1", [path_bound]),
        /// Voltage; it falls past a fold.
        voltage: Vec<f64> = array("voltage", "V", [point]),
        /// Largest displacement magnitude over the corners.
        max_displacement: Vec<f64> = array("max_displacement", "mm", [point]),
        /// Displacement magnitude at the watched corner.
        displacement: Vec<f64> = array("displacement", "mm", [point]),
        /// Smallest eigenvalue of the tangent against the Laplacian: near 1 at rest, zero where stability is lost.
        smallest_eigenvalue: Vec<f64> = array("smallest_eigenvalue", "1", [point]),
        /// Negative eigenvalues of the tangent.
        negative_eigenvalues: Vec<u64> = array("negative_eigenvalues", "1", [point]),
        /// 1 where a membrane can be found in this state: no negative eigenvalue, and elliptic everywhere.
        stable: Vec<u8> = array("stable", "1", [point]),
        /// What happens: `fold`, `bifurcation` or `not-elliptic`.
        event_kind: Vec<String> = array("event_kind", "", [event]),
        /// Where it happens.
        event_voltage: Vec<f64> = array("event_voltage", "V", [event]),
        /// Row of the point just before it.
        event_point: Vec<u64> = array("event_point", "1", [event]),
        /// What ends the stable part that begins at rest: the kind of the first event, or `none`.
        limit_kind: Vec<String> = array("limit_kind", "", [path]),
        /// Highest voltage of that part, extrapolated from two meshes; NaN where it has no end.
        limit_voltage: Vec<f64> = array("limit_voltage", "V", [path]),
        /// How far the truth may lie on either side of it; NaN where that is not known.
        limit_error: Vec<f64> = array("limit_error", "V", [path]),
        /// The limit on the coarser of the two meshes; NaN where there is none.
        limit_coarse: Vec<f64> = array("limit_coarse", "V", [path]),
        /// The limit on the finer one, half as wide; NaN where none was found.
        limit_fine: Vec<f64> = array("limit_fine", "V", [path]),
        /// Displacement at that limit, at the cell corners; that of the last point where there is no limit.
        limit_displacement: Vec<Field> = array("limit_displacement", "mm", [path, corner_y, corner_x, xy]),
        /// Column and row of the corner that moves most at that limit.
        watched_corner: Vec<[u64; 2]> = array("watched_corner", "1", [path, xy]),
        /// Why the path ends.
        end: Vec<String> = array("end", "", [path]),
        /// The scene, whose voltage does not matter.
        scene: Scene = attribute("scene"),
    }
}
