//! The artifacts of stages about measurements: what was measured, a scene that was fitted to it, and measured beside
//! simulated numbers. Numbers that a file does not have are 0.

use super::error::ElementError;
use super::macros::arrays;
use super::part::LongTexts;
use super::samples::{CoveredCells, DrawnElectrodes, drawn_patterns};
use deaflow_pattern::Pattern;
use deaflow_scene::{Scene, Tolerances};

arrays! {
    /// Measurements in base units.
    pub struct Measurements, MeasurementsView {
        /// The files.
        files: MeasuredFiles = group("files"),
        /// Their rows.
        rows: MeasuredRows = group("rows"),
        /// Electrode patterns of the devices, origin lower left, 1 = electrode.
        patterns: Option<Vec<Pattern>> = array("patterns", "1", [pattern, y, x]),
        /// If elements follow drawn electrodes, their shapes.
        electrodes: Option<DrawnElectrodes> = group("electrodes", [(sample, pattern)]),
        /// If electrodes cover parts of cells, the shares.
        covered: Option<CoveredCells> = group("covered", [(sample, pattern)]),
    }
}

impl Measurements {
    /// Returns the patterns with their drawn electrodes and covered shares of cells.
    ///
    /// # Errors
    /// If these are invalid.
    pub fn drawn_patterns(&self) -> Result<Vec<Pattern>, ElementError> {
        let patterns = self.patterns.clone().unwrap_or_default();
        drawn_patterns(patterns, self.electrodes.as_ref(), self.covered.as_ref())
    }
}

arrays! {
    /// Files of measurements.
    #[derive(Default)]
    pub struct MeasuredFiles, MeasuredFilesView {
        /// Name of each file.
        name: LongTexts = array("name", "", [file]),
        /// What was measured.
        test: Vec<String> = array("test", "", [file]),
        /// What else is known about each, in JSON and base units.
        settings: LongTexts = array("settings", "", [file]),
        /// How the noise is known: `stated`, `share`, `relative` or `absolute`.
        noise: Vec<String> = array("noise", "", [file]),
        /// The standard deviation as a share of the measured values, if the noise is such a `share`.
        share: Vec<f64> = array("share", "1", [file]),
        /// Number of the pattern from 1; 0 if the file is not of a device.
        pattern: Vec<u64> = array("pattern", "1", [file]),
    }
}

arrays! {
    /// Rows of files of measurements.
    #[derive(Default)]
    pub struct MeasuredRows, MeasuredRowsView {
        /// Number of the file from 0.
        file: Vec<u64> = array("file", "1", [row]),
        /// Number of the row in the file from 1.
        number: Vec<u64> = array("number", "1", [row]),
        /// Time.
        time: Vec<f64> = array("time", "s", [row]),
        /// Voltage.
        voltage: Vec<f64> = array("voltage", "V", [row]),
        /// Stretch.
        stretch: Vec<f64> = array("stretch", "1", [row]),
        /// Nominal stress.
        stress: Vec<f64> = array("stress", "Pa", [row]),
        /// Point on the membrane at rest, from its lower left corner.
        position: Vec<[f64; 2]> = array("position", "mm", [row, xy]),
        /// Displacement; of one point against the voltage or the time, the first number is that along its direction, and
        /// its amplitude in a frequency response.
        displacement: Vec<[f64; 2]> = array("displacement", "mm", [row, xy]),
        /// Frequency, if a file has a frequency response.
        frequency: Option<Vec<f64>> = array("frequency", "Hz", [row]),
        /// Phase of the displacement relative to the voltage, if a file has a frequency response.
        phase: Option<Vec<f64>> = array("phase", "deg", [row]),
        /// Standard deviation in the unit of what was measured, if it is `stated`.
        sigma: Vec<f64> = array("sigma", "", [row]),
    }
}

arrays! {
    /// Measured beside simulated numbers.
    pub struct Comparison, ComparisonView {
        /// The files.
        files: ComparedFiles = group("files"),
        /// Their numbers.
        rows: ComparedRows = group("rows"),
        /// How a simulation with one more effect agrees.
        effects: Option<ComparedEffects> = group("effects"),
        /// The mesh of devices.
        mesh: Option<String> = attribute("mesh"),
        /// The scene.
        scene: Scene = attribute("scene"),
    }
}

arrays! {
    /// How well a simulation agrees with files; all differences are measured minus simulated.
    #[derive(Default)]
    pub struct ComparedFiles, ComparedFilesView {
        /// Name of each file.
        name: LongTexts = array("name", "", [file]),
        /// What is compared with what: `field`, `displacement-voltage`, `displacement-time`, `amplitude-frequency`,
        /// `phase-frequency`, `stretch-voltage`, `stretch-time`, `stress-stretch` or `stress-time`.
        quantities: Vec<String> = array("quantities", "", [file]),
        /// Compared points.
        points: Vec<u64> = array("points", "1", [file]),
        /// Rows at which the simulation has no stable equilibrium; they are not compared.
        without_equilibrium: Vec<u64> = array("without_equilibrium", "1", [file]),
        /// Mean difference, in the unit of what was measured; 0 for fields.
        bias: Vec<f64> = array("bias", "", [file]),
        /// Root mean square of the difference; of fields, of its components.
        rms: Vec<f64> = array("rms", "", [file]),
        /// Largest difference.
        largest: Vec<f64> = array("largest", "", [file]),
        /// Its row in the file from 1.
        largest_row: Vec<u64> = array("largest_row", "1", [file]),
        /// 1 if the measured numbers differ, so that there is an R².
        has_r_squared: Vec<u64> = array("has_r_squared", "1", [file]),
        /// Share of the variance that the simulation explains, R².
        r_squared: Vec<f64> = array("r_squared", "1", [file]),
        /// 1 if standard deviations are stated, so that there is a chi².
        has_chi2: Vec<u64> = array("has_chi2", "1", [file]),
        /// Chi² per degree of freedom.
        chi2_per_dof: Vec<f64> = array("chi2_per_dof", "1", [file]),
        /// Translation of the camera that the measured fields contain.
        translation: Vec<[f64; 2]> = array("translation", "mm", [file, xy]),
        /// Rotation of the camera.
        rotation: Vec<f64> = array("rotation", "rad", [file]),
    }
}

arrays! {
    /// Measured and simulated numbers, in V, s, Hz, mm, deg and Pa.
    #[derive(Default)]
    pub struct ComparedRows, ComparedRowsView {
        /// Number of the file from 0.
        file: Vec<u64> = array("file", "1", [row]),
        /// Number of the row in the file from 1.
        number: Vec<u64> = array("number", "1", [row]),
        /// What the numbers are measured against: voltage, time, frequency or stretch.
        at: Vec<f64> = array("at", "", [row]),
        /// Point on the membrane at rest, of fields.
        position: Vec<[f64; 2]> = array("position", "mm", [row, xy]),
        /// 1 for the second component of a displacement, else 0.
        component: Vec<u64> = array("component", "1", [row]),
        /// Measured number; of fields without the motion of the camera.
        measured: Vec<f64> = array("measured", "", [row]),
        /// Simulated number.
        simulated: Vec<f64> = array("simulated", "", [row]),
    }
}

arrays! {
    /// Root mean squares with one more effect each.
    #[derive(Default)]
    pub struct ComparedEffects, ComparedEffectsView {
        /// Name of the effect.
        name: Vec<String> = array("name", "", [effect]),
        /// 1 if there is a simulation with it.
        simulated: Vec<u64> = array("simulated", "1", [effect]),
        /// Root mean square of the difference, in the unit of what was measured.
        rms: Vec<f64> = array("rms", "", [effect, file]),
    }
}

arrays! {
    /// A scene that was fitted to measurements.
    pub struct FittedScene, FittedSceneView {
        /// The fitted parameters.
        parameters: FittedParameters = group("parameters"),
        /// Chi² if all standard deviations are stated, else the sum of the squares of the residuals.
        sum_of_squares: [f64; 1] = array("sum_of_squares", "1", [single]),
        /// 1 if all standard deviations are stated.
        stated: [u64; 1] = array("stated", "1", [single]),
        /// Numbers less parameters and motions of cameras.
        degrees_of_freedom: [u64; 1] = array("degrees_of_freedom", "1", [single]),
        /// What the measurements determine: `determined`, `open` (a parameter is bounded on one side at most),
        /// `not-determined`, `reduces` (to a law with fewer parameters), `unstable` or `not-converged`.
        verdict: String = attribute("verdict"),
        /// The laws or numbers of branches that were compared, the best first.
        candidates: Option<FitCandidates> = group("candidates"),
        /// How well the fitted scene agrees with the files.
        files: ComparedFiles = group("files"),
        /// Their numbers.
        rows: ComparedRows = group("rows"),
        /// The mesh of devices.
        mesh: Option<String> = attribute("mesh"),
        /// The fitted scene; its numbers are rounded to a thousandth of their standard errors.
        scene: Scene = attribute("scene"),
        /// The tolerances of the scene, if it has any.
        tolerances: Option<Tolerances> = attribute("tolerances"),
    }
}

arrays! {
    /// Fitted parameters in base units.
    #[derive(Default)]
    pub struct FittedParameters, FittedParametersView {
        /// Name.
        name: LongTexts = array("name", "", [parameter]),
        /// Value.
        value: Vec<f64> = array("value", "", [parameter]),
        /// Base unit.
        unit: Vec<String> = array("unit", "", [parameter]),
        /// 1 if the standard error is that of the logarithm, as of all positive parameters.
        logarithmic: Vec<u64> = array("logarithmic", "1", [parameter]),
        /// 1 if the measurements determine the parameter, so that it has a standard error.
        determined: Vec<u64> = array("determined", "1", [parameter]),
        /// 1 if the parameter is at a bound.
        at_bound: Vec<u64> = array("at_bound", "1", [parameter]),
        /// Standard error.
        standard_error: Vec<f64> = array("standard_error", "", [parameter]),
        /// Ends of the interval of 95 %.
        interval: Vec<[f64; 2]> = array("interval", "", [parameter, end]),
        /// 1 for each end that is known and finite.
        bounded: Vec<[u64; 2]> = array("bounded", "1", [parameter, end]),
        /// Covariance, of the logarithms where they are logarithmic.
        covariance: Vec<f64> = array("covariance", "", [parameter, other_parameter]),
    }
}

arrays! {
    /// Laws or numbers of branches that were compared.
    #[derive(Default)]
    pub struct FitCandidates, FitCandidatesView {
        /// Name of the law, or number of branches.
        name: Vec<String> = array("name", "", [candidate]),
        /// 1 if it could be fitted.
        fitted: Vec<u64> = array("fitted", "1", [candidate]),
        /// 1 for the one of the scene.
        chosen: Vec<u64> = array("chosen", "1", [candidate]),
        /// Akaike's criterion for few points; 0 if it is not known.
        aicc: Vec<f64> = array("aicc", "1", [candidate]),
        /// Sum of the squares of the residuals.
        sum_of_squares: Vec<f64> = array("sum_of_squares", "1", [candidate]),
        /// Tests of specimens that were left out in turn; none if there is one test only.
        left_out_test: Vec<String> = array("left_out/test", "", [test]),
        /// Root mean square of the residuals at a test after a fit to the others; 0 if it is not known.
        left_out_rms: Vec<f64> = array("left_out/rms", "", [candidate, test]),
    }
}
