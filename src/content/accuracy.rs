//! The artifact of an accuracy stage, and the file of `deaflow accuracy`. Times are not part of it.

use super::macros::arrays;
use deaflow_pattern::Pattern;
use deaflow_scene::Scene;

arrays! {
    /// Errors of methods against a reference.
    pub struct Accuracy, AccuracyView {
        /// Settings of each method.
        methods: Vec<String> = array("methods", "", [methods]),
        /// Names of the families.
        families: Vec<String> = array("families", "", [families]),
        /// Electrode patterns, origin lower left, 1 = electrode.
        patterns: Vec<Pattern> = array("patterns", "1", [pattern, y, x]),
        /// Family of each pattern.
        family: Vec<String> = array("family", "", [pattern]),
        /// The reference.
        reference: ReferenceErrors = group("reference"),
        /// Errors by family.
        error: FamilyErrors = group("error"),
        /// Patterns on which method and reference disagree whether there is a field, by family.
        mismatch: Mismatches = group("mismatch"),
        /// Errors by pattern.
        pattern_error: PatternErrors = group("pattern_error"),
        /// The scene of the patterns.
        scene: Scene = attribute("scene"),
        /// Settings of the reference.
        settings: String = attribute("reference"),
    }
}

arrays! {
    /// Errors of the reference.
    #[derive(Default)]
    pub struct ReferenceErrors, ReferenceErrorsView {
        /// 1 if the reference has a stable solution, else 0.
        stable: Vec<u64> = array("stable", "1", [pattern]),
        /// Estimated difference of the displacement from that with the shapes of frame, bodies and electrodes, where
        /// elements follow cells instead; NaN if unknown.
        geometry_error: Option<Vec<f64>> = array("geometry_error", "mm", [pattern]),
        /// Estimated error of the mesh of the reference on each pattern; 0 if unknown.
        pattern_error: Vec<f64> = array("pattern_error", "mm", [pattern]),
        /// The largest of them in each family.
        error: Vec<f64> = array("error", "mm", [families]),
    }
}

arrays! {
    /// Errors of each method on each family.
    #[derive(Default)]
    pub struct FamilyErrors, FamilyErrorsView {
        /// Root mean square error of a component.
        rms: Vec<f64> = array("rms", "mm", [methods, families]),
        /// Largest displacement error over the corners.
        max: Vec<f64> = array("max", "mm", [methods, families]),
        /// Bound of the error for other patterns.
        bound: Vec<f64> = array("bound", "mm", [methods, families]),
    }
}

arrays! {
    /// Patterns on which a method and the reference disagree.
    #[derive(Default)]
    pub struct Mismatches, MismatchesView {
        /// Patterns with a field but no stable reference.
        missed: Vec<u64> = array("missed", "1", [methods, families]),
        /// Patterns without a field but with a stable reference.
        false_alarm: Vec<u64> = array("false_alarm", "1", [methods, families]),
    }
}

arrays! {
    /// Errors of each method on each pattern.
    #[derive(Default)]
    pub struct PatternErrors, PatternErrorsView {
        /// Root mean square error of a component; valid if `compared` is 0.
        rms: Vec<f64> = array("rms", "mm", [methods, pattern]),
        /// Largest displacement error; valid if `compared` is 0.
        max: Vec<f64> = array("max", "mm", [methods, pattern]),
        /// 0 if both have a field, 1 only the method, 2 only the reference, 3 neither.
        compared: Vec<u8> = array("compared", "1", [methods, pattern]),
    }
}
