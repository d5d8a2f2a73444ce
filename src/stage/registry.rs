//! The table of all kinds of stages.

use crate::{
    accuracy, audit, balance, calibrate, compare, design, evaluate, fit, import, measure, patterns, sample, scene,
    solve, table, train, verify, yields,
};
use deaflow_orchestrator::{Kind, MOST_STAGES, Registry};
use deaflow_scene::Scene;

/// The kinds whose results a table may collect: all others.
static COLLECTED: [&dyn Kind; 16] = [
    &sample::SampleKind,
    &patterns::PatternsKind,
    &solve::SolveKind,
    &import::ImportKind,
    &balance::BalanceKind,
    &train::TrainKind,
    &design::DesignKind,
    &verify::VerifyKind,
    &yields::YieldKind,
    &accuracy::AccuracyKind,
    &audit::AuditKind,
    &calibrate::CalibrateKind,
    &evaluate::EvaluateKind,
    &measure::MeasureKind,
    &fit::FitKind,
    &compare::CompareKind,
];

static TABLE: table::TableKind = table::TableKind { collected: &COLLECTED };

/// All kinds of stages, and how a scene is checked.
#[must_use]
pub fn registry() -> Registry {
    Registry {
        kinds: COLLECTED.into_iter().chain([&TABLE as &dyn Kind]).collect(),
        complete_scene: scene::complete,
        check_scene: |node| scene::read(node).map(|_| ()),
        scene_schema: Scene::schema,
        most_stages: MOST_STAGES,
    }
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use super::*;
    use deaflow_content::ArtifactKind;

    #[test]
    fn every_kind_has_an_artifact_kind_and_a_table_collects_all_others() {
        let names = |kinds: &[&dyn Kind]| kinds.iter().map(|kind| kind.name()).collect::<BTreeSet<_>>();
        let known: BTreeSet<&str> = ArtifactKind::WORDS.iter().copied().collect();
        assert_eq!(names(&registry().kinds), known);
        let collected: BTreeSet<&str> = TABLE.needs().kinds.iter().copied().collect();
        assert_eq!(names(&COLLECTED), collected);
    }
}
