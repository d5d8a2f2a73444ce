//! The artifact of an accuracy stage, and the file of `deaflow accuracy`. Times are no content.

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
    /// What is known of the reference.
    #[derive(Default)]
    pub struct ReferenceErrors, ReferenceErrorsView {
        /// 1 where the reference has a stable solution, else 0.
        stable: Vec<u64> = array("stable", "1", [pattern]),
        /// Error that the reference may have on each pattern; 0 where that is not known.
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
        /// Bound of that for patterns that were not measured.
        bound: Vec<f64> = array("bound", "mm", [methods, families]),
    }
}

arrays! {
    /// Patterns on which a method and the reference disagree.
    #[derive(Default)]
    pub struct Mismatches, MismatchesView {
        /// Patterns with a field and no stable reference.
        missed: Vec<u64> = array("missed", "1", [methods, families]),
        /// Patterns without a field and a stable reference.
        false_alarm: Vec<u64> = array("false_alarm", "1", [methods, families]),
    }
}

arrays! {
    /// Errors of each method on each pattern.
    #[derive(Default)]
    pub struct PatternErrors, PatternErrorsView {
        /// Root mean square error of a component, 0 where `compared` is not.
        rms: Vec<f64> = array("rms", "mm", [methods, pattern]),
        /// Largest displacement error, 0 where `compared` is not.
        max: Vec<f64> = array("max", "mm", [methods, pattern]),
        /// 0 both have a field, 1 the method alone, 2 the reference alone, 3 neither.
        compared: Vec<u8> = array("compared", "1", [methods, pattern]),
    }
}
