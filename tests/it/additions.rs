//! A family of patterns, a material law, an effect and a kind of stage that a program adds through the public
//! interface. figure.rs adds a figure.

use std::path::Path;

use deaflow::base::{Canonical, Declared, Document, Fields, InputError, Node, Stream};
use deaflow::fem::effects::{EFFECTS, Effect, Significance, Solutions};
use deaflow::fem::screening::{Status, TestPattern, screen_for};
use deaflow::fem::{MembraneSolver, SolveOptions};
use deaflow::field::{Mesh, Simulator};
use deaflow::orchestrator::{
    Environment, Input, Job, Kind, Needs, Outcome, Pipeline, Plan, Registry, RunOptions, Stage, StageError,
    pipeline_schema, run,
};
use deaflow::parameters;
use deaflow::pattern::{Pattern, Raster};
use deaflow::sample::{
    Canvas, FAMILIES, Family, FamilyEntry, FamilyOf, FamilyParameters, ParameterError, SampleGroup, read_family,
};
use deaflow::scene::Scene;
use deaflow::scene::laws::{Form, Response, StiffeningLaw};
use deaflow::stage::registry;
use deaflow::store::{Data, Dataset, Object, Store};

use super::common::snapshot;

parameters! {
    /// Bars of one width.
    struct Bars as "a bars sample" {
        /// Patterns to draw.
        count: u64 [1..=10],
        /// Width of a bar in cells.
        width: u64 [1..=25] = 5,
    }
}

impl FamilyParameters for Bars {
    const NAME: &'static str = "bars";

    fn groups(&self, _: Canvas) -> Result<Vec<SampleGroup>, ParameterError> {
        Ok(self.one_group(self.count, Box::new(BarsOf(self.width as usize))))
    }
}

#[derive(Debug)]
struct BarsOf(usize);

impl Family for BarsOf {
    fn name(&self) -> &'static str {
        Bars::NAME
    }

    fn draw(&self, stream: &mut Stream) -> Pattern {
        let shift = stream.index(2 * self.0);
        Pattern::from_fn(Raster::PAPER, |x, _| ((x + shift) / self.0).is_multiple_of(2))
    }
}

#[test]
fn a_family_is_added_to_the_table_by_value() {
    let table: Vec<&dyn FamilyEntry> = FAMILIES.iter().copied().chain([&FamilyOf::<Bars>::NEW as _]).collect();
    let read = |text: &str| {
        let document = Document::from_text(Path::new("bars"), text).unwrap();
        let read = read_family(&table, &document.root, "a sample", &["seed"], Canvas::PAPER);
        read.map(|(_, groups)| groups).map_err(|e| e.to_string())
    };
    let groups = read("{ family: bars, count: 3, width: 10, seed: 1 }").unwrap();
    let pattern = groups[0].family.sample(1, 2).unwrap();
    assert_eq!((groups[0].count, groups[0].family.name()), (3, "bars"));
    assert!((0..50).all(|x| pattern.is_active(x, 0) == pattern.is_active(x, 49)));
    assert_eq!(
        read("{ family: blobs, count: 3, seed: 1 }").unwrap()[0].family.name(),
        "blobs"
    );
    assert!(
        read("{ family: bras, count: 3, seed: 1 }")
            .unwrap_err()
            .contains("bras")
    );
}

/// A law that stiffens with the square of I₁ − 3: 2ψ′/μ = 1 + c(I₁ − 3)².
struct Cubic(f64);

impl StiffeningLaw for Cubic {
    fn form(&self, _shear_modulus_pa: f64) -> Form {
        Form::FirstInvariant(Response::polynomial([1.0, 0.0, self.0]))
    }
}

#[test]
fn a_law_is_handed_to_the_solver_by_value() {
    let scene = Scene::vhb4910();
    let options = SolveOptions::on(Mesh::bilinear(1));
    let half = [Pattern::from_fn(Raster::PAPER, |x, _| x < 25)];
    let moved = |c: f64| {
        let solver = MembraneSolver::with_law(&scene, &Cubic(c), options).unwrap();
        solver.simulate(&half).remove(0).field.unwrap().max_magnitude()
    };
    let base = MembraneSolver::new(&scene, options).unwrap();
    let base = base.simulate(&half).remove(0).field.unwrap().max_magnitude();
    assert!((moved(0.0) / base - 1.0).abs() < 1e-6, "{} {base}", moved(0.0));
    assert!(moved(1e-3) < 0.9 * base && moved(1e-2) < moved(1e-3));
}

/// A membrane that sags under its weight: ρgL/μ, and by a solution whether it is stable.
struct Sag;

impl Effect for Sag {
    fn name(&self) -> &'static str {
        "sag_under_weight"
    }

    fn cost(&self) -> &'static str {
        "one more solve"
    }

    fn assess_solutions(&self, scene: &Scene, solutions: &Solutions<'_>) -> Option<Significance> {
        let stable = solutions.examined.iter().all(|one| one.outcome.is_converged());
        let number = 1000.0 * 9.81 * 1e-3 * scene.side_mm() / scene.shear_modulus_pa();
        Some(Significance::known(
            "ρgL/μ",
            number,
            if stable { 0.01 } else { 0.0 },
            "the membrane would sag".to_owned(),
        ))
    }
}

#[test]
fn an_effect_is_screened_beside_those_of_the_table() {
    let table: Vec<&dyn Effect> = EFFECTS.iter().copied().chain([&Sag as _]).collect();
    let scene = Scene::vhb4910();
    let half = TestPattern {
        find_critical_voltage: false,
        ..TestPattern::new("half", Pattern::from_fn(Raster::PAPER, |x, _| x < 25))
    };
    let screening = screen_for(&table, &scene, &[half]).unwrap();
    assert_eq!(screening.rows.len(), EFFECTS.len() + 1);
    let row = screening.rows.last().unwrap();
    assert_eq!((row.effect, row.status), ("sag_under_weight", Status::NotAvailable));
    let warnings = screening.warnings();
    let warning = warnings.last().unwrap();
    for part in ["sag under weight", "ρgL/μ", "0.011", "0.01"] {
        assert!(warning.contains(part), "{warning}");
    }
    snapshot!(warning);
}

parameters! {
    /// Counts up.
    struct CountParameters as "a count stage" {
        /// The last number.
        to: u64 [1..=100],
    }
}

struct CountKind;

impl Kind for CountKind {
    fn name(&self) -> &'static str {
        "count"
    }

    fn recipe(&self) -> u32 {
        1
    }

    fn needs(&self) -> Needs {
        Needs {
            kinds: &[],
            least: 0,
            most: 0,
        }
    }

    fn schema(&self) -> Vec<Fields> {
        vec![CountParameters::fields()]
    }

    fn read(&self, stage: &Node, _scene: Option<&Node>) -> Result<Box<dyn Stage>, InputError> {
        Ok(Box::new(CountParameters::read_with(stage, &["kind", "needs"])?))
    }
}

impl Stage for CountParameters {
    fn parameters(&self) -> Canonical {
        self.to_canonical()
    }

    fn plan(&self, _inputs: &[Input]) -> Plan {
        Plan::Whole { steps: 1 }
    }

    fn build(&self, _job: &Job<'_>) -> Result<Object, StageError> {
        let numbers: Vec<u64> = (1..=self.to).collect();
        let shape = [numbers.len()];
        Ok(Object::default().with("numbers", Dataset::new("1", "Numbers", &shape, Data::U64(numbers))))
    }
}

#[test]
fn a_kind_of_stage_is_read_run_stored_and_listed_in_the_schema() {
    let mut kinds = registry();
    kinds.kinds.push(&CountKind);
    let folder = tempfile::tempdir().unwrap();
    let store = Store::open(folder.path()).unwrap();
    let read = |kinds: &Registry, stage: &str| {
        let text = format!("version: 1\nname: counting\nstages:\n  mine: {stage}\n");
        let document = Document::from_text(Path::new("counting.yaml"), &text).unwrap();
        Pipeline::read(document, &[], kinds).map_err(|e| e.to_string())
    };
    let built = |stage: &str| {
        let pipeline = read(&kinds, stage).unwrap();
        let (options, environment) = (RunOptions::default(), Environment::system());
        let report = run(&pipeline, &store, &options, &environment, &|_| {}).unwrap();
        assert!(report.failures.is_empty(), "{:?}", report.failures);
        report.stages[0].clone()
    };
    let first = built("{ kind: count, to: 3 }");
    let numbers = store.artifact(&first.digest.unwrap()).unwrap().read("numbers").unwrap();
    assert_eq!(numbers.data, Data::U64(vec![1, 2, 3]));
    let again = built("{ kind: count, to: 3 }");
    assert_eq!((again.digest, again.outcome), (first.digest, Outcome::Reused));
    assert_ne!(built("{ kind: count, to: 4 }").digest, first.digest);
    let refused = read(&kinds, "{ kind: count, too: 4 }").err().unwrap();
    assert!(refused.contains("too"), "{refused}");
    assert!(read(&registry(), "{ kind: count, to: 3 }").is_err());
    assert!(pipeline_schema(&kinds).to_string().contains("The last number."));
}
