//! The file of `deaflow solve --path`: the points and events of all patterns are concatenated. It may contain NaN.

use super::element::{Packed, PerBody};
use super::macros::arrays;
use super::samples::{CoveredCells, DrawnElectrodes};
use deaflow_field::Field;
use deaflow_pattern::Pattern;
use deaflow_scene::Scene;

arrays! {
    /// Load paths of patterns to the loss of stability and beyond.
    pub struct LoadPaths, LoadPathsView {
        /// Electrode patterns, origin lower left, 1 = electrode.
        patterns: Vec<Pattern> = array("patterns", "1", [path, y, x]),
        /// If elements follow drawn electrodes, their shapes.
        electrodes: Option<DrawnElectrodes> = group("electrodes", [(sample, path)]),
        /// If electrodes cover parts of cells, the shares.
        covered: Option<CoveredCells> = group("covered", [(sample, path)]),
        /// Path i has the points from element i (inclusive) to element i + 1 (exclusive).
        point_offsets: Vec<u64> = array("point_offsets", "1", [path_bound]),
        /// Path i has the events from element i (inclusive) to element i + 1 (exclusive).
        event_offsets: Vec<u64> = array("event_offsets", "1", [path_bound]),
        /// Voltage; it falls past a fold.
        voltage: Vec<f64> = array("voltage", "V", [point]),
        /// Largest displacement magnitude over the corners; from rest if not all sides are held.
        max_displacement: Vec<f64> = array("max_displacement", "mm", [point]),
        /// Displacement magnitude at the watched corner.
        displacement: Vec<f64> = array("displacement", "mm", [point]),
        /// Smallest eigenvalue of the tangent relative to the Laplacian: near 1 at rest, 0 at the loss of stability.
        smallest_eigenvalue: Vec<f64> = array("smallest_eigenvalue", "1", [point]),
        /// Number of negative eigenvalues of the tangent.
        negative_eigenvalues: Vec<u64> = array("negative_eigenvalues", "1", [point]),
        /// 1 if the state is stable: no negative eigenvalue, and elliptic everywhere.
        stable: Vec<u8> = array("stable", "1", [point]),
        /// The event: `fold`, `bifurcation`, `not-elliptic` or `slack`.
        event_kind: Vec<String> = array("event_kind", "", [event]),
        /// Its voltage.
        event_voltage: Vec<f64> = array("event_voltage", "V", [event]),
        /// Row of the point before it.
        event_point: Vec<u64> = array("event_point", "1", [event]),
        /// The event that ends the stable part of the path: the kind of the first event, or `none`.
        limit_kind: Vec<String> = array("limit_kind", "", [path]),
        /// Highest voltage of that part, extrapolated from two meshes; NaN if it does not end.
        limit_voltage: Vec<f64> = array("limit_voltage", "V", [path]),
        /// Estimated error of the limit; NaN if unknown.
        limit_error: Vec<f64> = array("limit_error", "V", [path]),
        /// The limit on the coarser of the two meshes; NaN if there is none.
        limit_coarse: Vec<f64> = array("limit_coarse", "V", [path]),
        /// The limit on the finer mesh with elements of half the size; NaN if none was found.
        limit_fine: Vec<f64> = array("limit_fine", "V", [path]),
        /// Displacement from the mount at the cell corners at that limit, or at the last point if there is no limit.
        limit_displacement: Vec<Field> = array("limit_displacement", "mm", [path, corner_y, corner_x, xy]),
        /// Column and row of the corner that moves most at that limit.
        watched_corner: Vec<[u64; 2]> = array("watched_corner", "1", [path, xy]),
        /// Why the path ends.
        end: Vec<String> = array("end", "", [path]),
        /// Share of the loads or displacements of the scene, if these change and not the voltage.
        share: Option<Vec<f64>> = array("share", "1", [point]),
        /// That of the events.
        event_share: Option<Vec<f64>> = array("event_share", "1", [event]),
        /// Displacement of the middle of each bar from the mount, in the order left, right, bottom, top.
        bar_translation: Option<Packed<PerBody<[f64; 2]>>> = array("bar_translation", "mm", [point, bar, xy]),
        /// Rotation of each bar, from -180 to 180, counterclockwise.
        bar_rotation: Option<Packed<PerBody<f64>>> = array("bar_rotation", "deg", [point, bar]),
        /// Force of the left, right, lower and upper side on the membrane; 0 along components that a side does not
        /// hold.
        reaction: Option<Packed<PerBody<[f64; 2]>>> = array("reaction", "N", [point, side, xy]),
        /// If not all sides are held, displacement of the first point from the mount, from which `displacement` and
        /// `max_displacement` count.
        rest: Option<Vec<Field>> = array("rest", "mm", [path, corner_y, corner_x, xy]),
        /// Share of the membrane that is compressed and would wrinkle; not given if wrinkling is simulated.
        wrinkled_fraction: Option<Vec<f64>> = array("wrinkled_fraction", "1", [point]),
        /// Number of motions out of the plane in which the flat membrane is unstable: it wrinkles or buckles.
        out_of_plane_unstable: Vec<u64> = array("out_of_plane_unstable", "1", [point]),
        /// Largest electric field relative to the breakdown field, by Huang's law if the scene has none.
        breakdown_ratio: Vec<f64> = array("breakdown_ratio", "1", [point]),
        /// Displacement of the requested point along the requested direction, or its magnitude without a direction;
        /// from `rest` if there is one.
        at_point: Option<Vec<f64>> = array("at_point", "mm", [point]),
        /// The scene; where the voltage changes, its voltage is not used.
        scene: Scene = attribute("scene"),
        /// The requested point, from the lower left corner, and its direction.
        point: Option<String> = attribute("point"),
    }
}
