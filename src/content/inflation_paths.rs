//! The file of `deaflow solve --path` with a pressure or a volume: the points of all patterns are concatenated. It may
//! contain NaN.

use super::element::{Packed, PerCorner};
use super::macros::arrays;
use super::samples::{CoveredCells, DrawnElectrodes};
use deaflow_pattern::Pattern;
use deaflow_scene::{Effects, Scene};

arrays! {
    /// Paths of patterns under pressure.
    pub struct InflationPaths, InflationPathsView {
        /// Electrode patterns, origin lower left, 1 = electrode.
        patterns: Vec<Pattern> = array("patterns", "1", [path, y, x]),
        /// If elements follow drawn electrodes, their shapes.
        electrodes: Option<DrawnElectrodes> = group("electrodes", [(sample, path)]),
        /// If electrodes cover parts of cells, the shares.
        covered: Option<CoveredCells> = group("covered", [(sample, path)]),
        /// Path i has the points from element i (inclusive) to element i + 1 (exclusive).
        point_offsets: Vec<u64> = array("point_offsets", "1", [path_bound]),
        /// Voltage.
        voltage: Vec<f64> = array("voltage", "V", [point]),
        /// Pressure below the membrane less that above; with a rising volume it can fall.
        pressure: Vec<f64> = array("pressure", "Pa", [point]),
        /// Volume between the membrane and its plane.
        volume: Vec<f64> = array("volume", "ml", [point]),
        /// Largest displacement magnitude over the corners.
        max_displacement: Vec<f64> = array("max_displacement", "mm", [point]),
        /// Displacement out of the plane at that corner.
        height: Vec<f64> = array("height", "mm", [point]),
        /// Displacement out of the plane at the watched corner.
        watched_height: Vec<f64> = array("watched_height", "mm", [point]),
        /// 1 if the state is stable with what the scene gives, its pressure or its volume.
        stable: Vec<u8> = array("stable", "1", [point]),
        /// 1 if the state is stable at its pressure: not beyond the largest one.
        stable_at_pressure: Vec<u8> = array("stable_at_pressure", "1", [point]),
        /// Share of the membrane that is compressed and would wrinkle.
        wrinkled_fraction: Vec<f64> = array("wrinkled_fraction", "1", [point]),
        /// Largest electric field relative to the breakdown field, by Huang's law if the scene has none.
        breakdown_ratio: Vec<f64> = array("breakdown_ratio", "1", [point]),
        /// The first maximum of the pressure over the volume; NaN if the path has none.
        largest_pressure: Vec<f64> = array("largest_pressure", "Pa", [path]),
        /// The volume at that maximum.
        largest_pressure_volume: Vec<f64> = array("largest_pressure_volume", "ml", [path]),
        /// Column and row of the corner that moves most at the last point.
        watched_corner: Vec<[u64; 2]> = array("watched_corner", "1", [path, xy]),
        /// Why the path ends; at `limit-point` its last point is the limit.
        end: Vec<String> = array("end", "", [path]),
        /// Displacement of the last point at the cell corners, along x, y and out of the plane.
        last_displacement: Packed<PerCorner<[f64; 3]>> =
            array("last_displacement", "mm", [path, corner_y, corner_x, xyz]),
        /// The scene.
        scene: Scene = attribute("scene"),
        /// The simulated effects.
        effects: Effects = attribute("effects"),
    }
}
