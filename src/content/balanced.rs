//! The artifact of a balance stage.

use super::attribute::Lines;
use super::dropped::DroppedRows;
use super::element::Packed;
use super::macros::arrays;
use deaflow_field::Field;
use deaflow_pattern::Pattern;
use deaflow_scene::Scene;

arrays! {
    /// A balanced, augmented and split training set.
    pub struct Balanced, BalancedView {
        /// Electrode patterns, origin lower left, 1 = electrode.
        patterns: Vec<Pattern> = array("patterns", "1", [row, y, x]),
        /// Displacement at the cell corners.
        displacement: Packed<Field> = array("displacement", "mm", [row, corner_y, corner_x, xy]),
        /// Family of the sample.
        family: Vec<String> = array("family", "", [row]),
        /// `train`, `validation` or `test`; one for all images of a pattern.
        split: Vec<String> = array("split", "", [row]),
        /// Digest shared by a pattern and its images under symmetry.
        orbit: Vec<String> = array("orbit", "", [row]),
        /// Row of the solved sample.
        source: Vec<u64> = array("source", "1", [row]),
        /// Symmetry applied: quarter turns, plus 4 when mirrored first.
        symmetry: Vec<u64> = array("symmetry", "1", [row]),
        /// Bin of the histogram.
        bin: Vec<u64> = array("bin", "1", [row]),
        /// Largest displacement magnitude over the corners.
        max_displacement: Vec<f64> = array("max_displacement", "mm", [row]),
        /// The histograms before and after balancing.
        histogram: Histograms = group("histogram"),
        /// Numbers of samples that were left out.
        counts: BalanceCounts = group("counts"),
        /// Rows that `without` dropped.
        dropped: Option<DroppedRows> = group("dropped"),
        /// What `without` dropped, one line per audit or list of marked rows.
        without: Option<Lines> = attribute("without"),
        /// The scene of the samples.
        scene: Scene = attribute("scene"),
    }
}

arrays! {
    /// Histograms of the largest displacement.
    #[derive(Default)]
    pub struct Histograms, HistogramsView {
        /// Edges of the bins of the largest displacement.
        edges: Vec<f64> = array("edges", "mm", [histogram_edge]),
        /// Samples in each bin before balancing.
        before: Vec<u64> = array("before", "1", [histogram_bin]),
        /// Rows available in each bin after augmentation.
        augmented: Vec<u64> = array("augmented", "1", [histogram_bin]),
        /// Rows in each bin after balancing.
        after: Vec<u64> = array("after", "1", [histogram_bin]),
        /// Samples below and above the range.
        outside: [u64; 2] = array("outside", "1", [side]),
        /// Uniform level: rows in each bin that has enough.
        level: [f64; 1] = array("level", "1", [single]),
    }
}

arrays! {
    /// Numbers of samples that were left out.
    #[derive(Default)]
    pub struct BalanceCounts, BalanceCountsView {
        /// Bins without any sample.
        empty_bins: [u64; 1] = array("empty_bins", "1", [single]),
        /// Samples left out as images of earlier samples.
        repeats: [u64; 1] = array("repeats", "1", [single]),
        /// Samples left out because they have no stable solution.
        unstable: [u64; 1] = array("unstable", "1", [single]),
    }
}
