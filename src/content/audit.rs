//! The artifact of an audit stage.

use super::attribute::Json;
use super::macros::arrays;
use deaflow_scene::Scene;

arrays! {
    /// The results of an audit.
    pub struct Audit, AuditView {
        /// Electrode area, a share of the free membrane.
        area: AreaHistogram = group("area"),
        /// Largest displacement.
        displacement: DisplacementHistogram = group("displacement"),
        /// Largest displacement magnitude of each row; 0 without a field.
        max_displacement: Vec<f64> = array("max_displacement", "mm", [row]),
        /// Rows that were simulated on a finer mesh.
        resimulated: ResimulatedRows = group("resimulated"),
        /// Rows with errors.
        wrong: WrongRows = group("wrong"),
        /// 0 no field, 1 equal to a new solution, 2 compared with an estimate, 3 wrong, 4 no stable solution, 5 no
        /// field although there is a stable solution.
        label_state: Vec<u8> = array("label/state", "1", [row]),
        /// Ratio to the estimate, and the relative residual of the best ratio; 0 if not compared.
        label_compared: Vec<[f64; 2]> = array("label/compared", "1", [row, comparison]),
        /// The findings, as JSON.
        findings: Json = attribute("findings"),
        /// The summary, as JSON.
        summary: Json = attribute("summary"),
        /// The artifact of the dataset; none for a file.
        dataset: Option<String> = attribute("dataset"),
        /// The scene of the dataset.
        scene: Scene = attribute("scene"),
    }
}

arrays! {
    /// Rows with errors: all rows of all findings that are errors. `without` drops them.
    #[derive(Default)]
    pub struct WrongRows, WrongRowsView {
        /// Row of the dataset, from 0.
        row: Vec<u64> = array("row", "1", [wrong_row]),
        /// The check that found it.
        check: Vec<String> = array("check", "", [wrong_row]),
    }
}

arrays! {
    /// A histogram of the electrode area, a share of the free membrane.
    #[derive(Default)]
    pub struct AreaHistogram, AreaHistogramView {
        /// Edges of the bins of the area, shares of the free membrane.
        edges: Vec<f64> = array("edges", "1", [area_edge]),
        /// Rows in each bin.
        counts: Vec<u64> = array("counts", "1", [area_bin]),
    }
}

arrays! {
    /// A histogram of the largest displacement.
    #[derive(Default)]
    pub struct DisplacementHistogram, DisplacementHistogramView {
        /// Edges of the bins of the largest displacement.
        edges: Vec<f64> = array("edges", "mm", [displacement_edge]),
        /// Rows in each bin.
        counts: Vec<u64> = array("counts", "1", [displacement_bin]),
    }
}

arrays! {
    /// Rows that were simulated on a finer mesh.
    #[derive(Default)]
    pub struct ResimulatedRows, ResimulatedRowsView {
        /// Number of the row.
        row: Vec<u64> = array("row", "1", [finer_row]),
        /// Largest difference from the finer mesh; -1 if that has no solution.
        error: Vec<f64> = array("error", "mm", [finer_row]),
        /// Declared error; -1 if none.
        allowed: Vec<f64> = array("allowed", "mm", [finer_row]),
    }
}
