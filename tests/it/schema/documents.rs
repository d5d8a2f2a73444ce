//! Documents that together have every key of both schemas, and how documents are read.

use std::path::Path;

use deaflow::base::{Document, InputError, Node, NodeValue};
use deaflow::orchestrator::{Pipeline, pipeline_schema, scene_schema};
use deaflow::scene::{Scene, Stiffening, splice_material};
use deaflow::stage::registry;
use serde_json::{Map, Value};

/// What a document is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Kind {
    Pipeline,
    Scene,
}

impl Kind {
    pub fn file(self) -> &'static str {
        match self {
            Self::Pipeline => "pipeline.json",
            Self::Scene => "scene.json",
        }
    }

    pub fn schema(self) -> Value {
        match self {
            Self::Pipeline => pipeline_schema(&registry()),
            Self::Scene => scene_schema(&registry()),
        }
    }

    /// Reads a document as deaflow does.
    pub fn read(self, document: &Value) -> Result<(), InputError> {
        let mut document = Document::from_text(Path::new("document.yaml"), &document.to_string())?;
        match self {
            Self::Pipeline => Pipeline::read(document, &[], &registry()).map(|_| ()),
            Self::Scene => {
                splice_material(&mut document.root)?;
                Scene::read(&document.root).map(|_| ())
            }
        }
    }
}

/// A YAML text as JSON.
pub fn json(text: &str) -> Value {
    fn value(node: &Node) -> Value {
        match node.value() {
            NodeValue::Null => Value::Null,
            NodeValue::Bool(on) => Value::Bool(*on),
            NodeValue::Number(text) => serde_json::from_str(text).unwrap(),
            NodeValue::Text(text) => Value::String(text.clone()),
            NodeValue::List(items) => items.iter().map(value).collect(),
            NodeValue::Map(entries) => {
                let entry = |(key, item): &(Node, Node)| (key.text("a key").unwrap().to_owned(), value(item));
                Value::Object(entries.iter().map(entry).collect::<Map<_, _>>())
            }
        }
    }
    value(&Document::from_text(Path::new("text.yaml"), text).unwrap().root)
}

const PIPELINE: &str = "
version: 1
name: complete
scene:
  geometry: { side: 50 mm, thickness: 1.0 mm, prestretch: 3.0, cells: 50 }
  material: { model: neo-hookean, shear_modulus: 45 kPa, relative_permittivity: 4.7 }
  drive: { voltage: 5.25 kV }
  properties: { dielectric_breakdown: { law: constant, field: 120 MV/m } }
stages:
  small: { kind: sample, groups: 1, family: small-grid, count: 2, area: 0.5, seed: 1 }
  large: { kind: sample, groups: 1, family: large-grid, units: [4, 5], count_per_units: 2, seed: 2 }
  bezier: { kind: sample, groups: 1, family: bezier, count: 2, area: 0.5, ends: any, seed: 3 }
  sweep: { kind: sample, groups: 1, family: area-sweep, count: 2, area: [0.05, 0.95], seed: 4 }
  stripes: { kind: sample, groups: 1, family: stripes, count: 2, area: 0.4, seed: 5 }
  blobs: { kind: sample, groups: 1, family: blobs, count: 2, area: [0.05, 0.95], seed: 6 }
  curves: { kind: sample, groups: 1, family: curves, count: 2, area: [0.3, 0.7], seed: 7 }
  checker: { kind: sample, groups: 1, family: checker, count: 2, area: 0.5, seed: 8 }
  dithers: { kind: sample, groups: 1, family: dithers, count: 2, area: [0.4, 0.6], seed: 9 }
  mazes: { kind: sample, groups: 1, family: mazes, count: 2, seed: 10 }
  diagonals: { kind: sample, groups: 1, family: diagonals, count: 2, seed: 11 }
  spirals: { kind: sample, groups: 1, family: spirals, count: 2, area: 0.3, seed: 12 }
  glyphs: { kind: sample, groups: 1, family: glyphs, count: 2, seed: 13 }
  solved: { kind: solve, needs: [small, large, bezier], method: newton, elements_per_cell: 2, order: 1, tolerance: 1e-6, time_limit: 60 s }
  spread: { foreach: { area: [0.2, 0.4], zip: { seed: [1, 2], count: [2, 3] } }, kind: sample, groups: 1, family: blobs, count: '${count}',
    area: '${area}', seed: '${seed}' }
  together: { kind: solve, needs: [spread], gather: [seed, count] }
  grown: { kind: table, needs: [together], columns: [area, max_displacement], plot: { x: area, y: max_displacement, series: area } }
  own: { kind: patterns, files: [tests/it/schema/own.csv] }
  labels: { kind: import, files: [tests/it/schema/labels.npz], scene: { from: law } }
  refined: { kind: solve, needs: [small], accuracy: 0.01 mm, history: { at: [0 s, 10 min] } }
  finest: { kind: solve, needs: [small], elements_per_cell: 4, order: 2 }
  guessed: { kind: solve, needs: [small], method: chord:2, order: 2 }
  balanced: { kind: balance, needs: [solved], without: [searched], bins: 20, range: [0 mm, 2.5 mm], target: 60, symmetry: d4, seed: 4 }
  audited: { kind: audit, needs: [balanced], samples: 8, seed: 1, accuracy: 0.01 mm, fail_on: never }
  searched: { kind: audit, needs: [solved], samples: all, fail_on: never }
  surrogate: { kind: train, needs: [balanced, searched], without: [audited], network: qin2024, epochs: 1, batch: 8, learning_rate: 0.002, max_weight: 0.1,
    auxiliary_weight: 0.2, seed: 5 }
  patient: { kind: train, needs: [balanced, solved], network: qin2024, epochs: 40, patience: 5, optimizer: adamw, weight_decay: 1e-4,
    gradient_norm: 5, symmetry: d4, verified_weight: 4, seed: 5 }
  intervals: { kind: calibrate, needs: [surrogate, refined, balanced], without: [audited], seed: 8 }
  evaluated: { kind: evaluate, needs: [surrogate, intervals, refined], estimates: [linear, 'chord:2'] }
  design: { kind: design, needs: [surrogate], evaluator: auto, evaluator_accuracy: 0.01 mm, objective: { point: [25 mm, 25 mm], direction: 0 deg, measure: qin2024 },
    area: 0.5, area_penalty: 5, population: 20, generations: 2, elite: 0.02, crossover: 0.7, mutation: 0.3,
    stagnation: 5, judged: 0.5, seed: 6 }
  judged: { kind: design, needs: [surrogate, intervals], evaluator: surrogate, objective: { point: [20, 20], direction: 0 }, seed: 8 }
  rotation: { kind: design, evaluator: chord:2, seed: 7, objective: { points: [{ point: [12, 25], direction: 90 },
    { point: [38, 25], direction: -90 }], measure: displacement } }
  wanted: { kind: design, case: 'IV, 1 mm', evaluator: linear, seed: 9, designs: 3, distance: 0.05, refine: true, units: 50, area_tolerance: 0.01,
    area: free, constraints: { min_feature: 2 mm, islands: 2, leads: [left, top], pull_in_margin: 1.2,
      keep_out: [{ mask: { columns: 50, rows: 50, runs: [0, 3, 2497] } }, { rectangle: [[0 mm, 0 mm], [5 mm, 5 mm]] }, { disc: { centre: [25 mm, 25 mm], radius: 3 mm } },
        { polygon: [[20 mm, 45 mm], [22 mm, 45 mm], [22 mm, 47 mm]] }] },
    targets: [{ name: one, objective: { point: [25, 25], direction: 0, value: 1 mm, weight: 2 } },
      { name: two, area: 0.3, objective: { points: [{ point: [20, 20], displacement: [0.1, 0.2], weight: 2 }] } },
      { name: three, area: free, objective: { point: [20, 20], displacement: [0.1, 0.2], measure: distance } },
      { name: four, objective: { points: [{ point: [20, 20], direction: 0 }], value: 1 mm, measure: distance } },
      { name: five, objective: { field: pipelines/fields/pinch.csv } }] }
  pinch: { kind: design, seed: 1, objective: { field: pipelines/fields/pinch.csv }, scene: { from: law } }
  vector: { kind: design, seed: 1, objective: { point: [25, 25], displacement: [0.1 mm, 0.2 mm], weight: 2 } }
  value: { kind: design, seed: 1, objective: { point: [25, 25], direction: 0, value: 1 mm } }
  vectors: { kind: design, seed: 1, objective: { points: [{ point: [25, 25], displacement: [0.1 mm, 0.2 mm], weight: 2 }] } }
  values: { kind: design, seed: 1, objective: { points: [{ point: [25, 25], direction: 0 }], value: 1 mm },
    constraints: { breakdown_margin: 1.5 } }
  highest: { kind: design, case: best, method: adjoint, units: 20, starts: 2, seed: 1, objective: { point: [25, 25], direction: 0 },
    constraints: { leads: true } }
  padded: { kind: design, method: adjoint, seed: 1, objective: { point: [25, 25], direction: 0 }, constraints: {
    keep_in: [{ rectangle: [[0, 20 mm], [4 mm, 30 mm]] }, { group: 1, shapes: [{ disc: { centre: [30, 25], radius: 2 } }] }], leads: { shapes: [{ disc: { centre: [2, 25], radius: 3 } }] } } }
  wired: { kind: design, method: adjoint, seed: 1, objective: { point: [25, 25], direction: 0 }, constraints: { leads: { cells: [[0, 25]] } } }
  verified: { kind: verify, needs: [design, highest], method: newton, elements_per_cell: 1, order: 2, tolerance: 1e-6, time_limit: 60 s }
  taught: { kind: verify, needs: [judged], rounds: 3, update: { network: qin2024, epochs: 2, patience: 1, batch: 4, optimizer: muon,
    learning_rate: 0.001, weight_decay: 0, gradient_norm: 1, symmetry: none, max_weight: 0.2, auxiliary_weight: 0.1, verified_weight: 16, without: [audited], seed: 9 } }
  exact: { kind: verify, needs: [rotation, own], accuracy: 10 um, history: { at: [1 s] }, scene: { from: law } }
  made: { kind: yield, needs: [design, highest], samples: 20, wanted: 2 mm, seed: 1, elements_per_cell: 2, order: 2,
    tolerances: { voltage: 1 %, shear_modulus: { relative: 5 %, distribution: lognormal },
      thickness: { relative: 3 %, distribution: normal }, mask: 0.1 mm, misregistration: [0.1 mm, 0.1 mm],
      lost_cells: 0.2 % }, scene: { from: law } }
  masks: { kind: yield, needs: [own], point: [25 mm, 25 mm], direction: 0 deg, wanted: 90 %, seed: 1,
    tolerances: { voltage: { relative: 1 %, distribution: normal }, shear_modulus: 5 %, thickness: 3 %,
      misregistration: 0.1 mm, permittivity: { relative: 2 %, distribution: normal },
      prestretch: { relative: 1 %, distribution: normal } } }
  shifted: { kind: yield, needs: [own], point: [25 mm, 25 mm], direction: 0 deg, seed: 1,
    tolerances: { permittivity: 2 %, prestretch: 1 % } }
  pulled: { kind: measure, absolute: true, files: [{ file: tests/it/schema/pulled.csv, test: uniaxial, sigma: 3 % }] }
  seen: { kind: measure, files: [
    { file: tests/it/schema/field.csv, test: field, pattern: tests/it/schema/own.csv, voltage: 4 kV, coordinates: deformed, scale: 21.3 um/px,
      origin: [1 mm, 2 mm], turn: 1 deg, y: down, correlated_within: 5 mm, sigma: 5 um },
    { file: tests/it/schema/travel.csv, test: voltage-displacement, pattern: tests/it/schema/own.csv, edges: cells, point: [25 mm, 25 mm], direction: 0 deg },
    { file: tests/it/schema/motion.csv, test: time-displacement, pattern: tests/it/schema/own.csv, point: [25 mm, 25 mm], direction: 0 deg, voltage: 4 kV },
    { file: tests/it/schema/response.csv, test: frequency-response, pattern: tests/it/schema/own.csv, point: [25 mm, 25 mm], direction: 0 deg, alternating: 50 V },
    { file: tests/it/schema/sheet.csv, test: voltage-stretch, sheet: pure-shear, load: 30 kPa },
    { file: tests/it/schema/creep.csv, test: creep, sheet: equibiaxial, force: 1 N, width: 10 mm, voltage: 1 kV }] }
  law: { kind: fit, needs: [pulled], laws: [gent, 'ogden:2'], branches: 2 }
  fitted: { kind: fit, needs: [seen], free: { shear_modulus: 1 kPa..1 MPa, voltage_offset: auto }, elements_per_cell: 1, order: 1, scene: { from: law } }
  late: { kind: solve, needs: [small], scene: { from: fitted } }
  beside: { kind: compare, needs: [seen], voltage_offset: -0.1 kV, effects: true, elements_per_cell: 2, order: 2, scene: { from: law } }
  accuracy: { kind: accuracy, needs: [finest, surrogate], methods: [linear, history, history+linear, history+chord:1, creep:3+chord:2, { method: creep:3, order: 2 }, { method: chord:3, elements_per_cell: 1, order: 2 },
    { accuracy: 0.03 mm }] }
";

/// Designs for rigid bodies and the states of a device with several groups of electrodes.
const DEVICE: &str = "
version: 1
name: device
scene:
  geometry: { side: 50 mm, thickness: 1.0 mm, prestretch: 3.0, cells: 50, bodies: [{ rectangle: [[20 mm, 20 mm], [30 mm, 30 mm]] }],
    sides: { right: { bar: { load: [0.1 N, 0 N], at: 1 mm, spring: 2 N/m, moves: [x, y, turn], mass: 20 g } },
      left: { bar: { displacement: [0 mm, 0 mm] } }, top: free, bottom: { load: [0 N, 0.1 N] } } }
  material: { model: neo-hookean, shear_modulus: 45 kPa, relative_permittivity: 4.7 }
  states: { push: { voltages: [5 kV, 0 V] }, pull: { voltages: [0 V, 5 kV] } }
stages:
  moved: { kind: design, seed: 1, constraints: { min_feature: 2 mm, gap: 3 mm },
    targets: [{ name: one, objective: { body: 0, direction: 0, weight: 2, state: push, value: 1 mm } },
      { name: two, objective: { body: 0, translation: [0.1 mm, 0.2 mm], state: push, weight: 2 } },
      { name: three, objective: { body: 0, rotation: clockwise, state: pull, measure: displacement } },
      { name: four, objective: { body: 0, rotation: -5 deg, state: pull, measure: distance } },
      { name: five, objective: { points: [{ body: 0, direction: 0, weight: 2, state: push }, { body: 0, rotation: counterclockwise, state: pull },
        { point: [10, 10], direction: 0, weight: 2, state: pull }] } },
      { name: six, objective: { points: [{ body: 0, translation: [0.1, 0.2], state: push }, { point: [10, 10], displacement: [0.1, 0.2], state: pull }] } },
      { name: seven, objective: { point: [10, 10], direction: 0, state: pull } },
      { name: eight, objective: { bar: right, direction: 0, weight: 2, state: push, value: 1 mm } },
      { name: nine, objective: { bar: right, translation: [0.1 mm, 0.2 mm], state: push, measure: distance } },
      { name: ten, objective: { bar: right, rotation: clockwise, state: pull } },
      { name: eleven, objective: { points: [{ bar: right, direction: 0, weight: 2, state: push }, { bar: right, rotation: clockwise, state: pull }] } },
      { name: twelve, objective: { points: [{ bar: right, translation: [0.1, 0.2], state: push }] } }] }
  pulled: { kind: design, seed: 1, objective: { bar: right, direction: 0, weight: 2, state: push, value: 1 mm } }
  hauled: { kind: design, seed: 1, objective: { bar: right, translation: [0.1 mm, 0.2 mm], state: push } }
  swung: { kind: design, seed: 1, objective: { bar: right, rotation: clockwise, state: pull, measure: displacement } }
  blocked: { kind: design, seed: 1, objective: { reaction: right, direction: 0, weight: 2, state: push } }
  gripping: { kind: design, seed: 1, targets: [{ name: one, objective: { reaction: right, direction: 0, weight: 2, state: push } },
      { name: two, objective: { points: [{ reaction: right, direction: 0, weight: 2, state: push }, { reaction: left, direction: 0, state: pull }] } }] }
  gripped: { kind: design, seed: 1, objective: { points: [{ reaction: right, direction: 0, weight: 2, state: push }, { reaction: left, direction: 0, state: pull }] } }
  both: { kind: design, seed: 1, objective: { points: [{ bar: right, direction: 0, weight: 2, state: push }, { bar: right, rotation: clockwise, state: pull }] } }
  far: { kind: design, seed: 1, objective: { points: [{ bar: right, translation: [0.1, 0.2], state: push }] } }
  alone: { kind: design, seed: 1, objective: { body: 0, direction: 0, weight: 2, state: push, value: 1 mm } }
  shifted: { kind: design, seed: 1, objective: { body: 0, translation: [0.1 mm, 0.2 mm], state: push } }
  turned: { kind: design, seed: 1, objective: { body: 0, rotation: clockwise, state: pull, measure: displacement } }
  point: { kind: design, seed: 1, objective: { point: [10, 10], direction: 0, state: pull } }
  stroke: { kind: design, seed: 1, objective: { points: [{ body: 0, direction: 0, weight: 2, state: push }, { body: 0, rotation: counterclockwise, state: pull },
    { point: [10, 10], direction: 0, weight: 2, state: pull }] } }
  grip: { kind: design, seed: 1, objective: { points: [{ body: 0, translation: [0.1, 0.2], state: push }, { point: [10, 10], displacement: [0.1, 0.2], state: pull }] } }
  checked: { kind: verify, needs: [moved] }
  drawn: { kind: sample, family: blobs, groups: 2, count: 4, seed: 1 }
  pushed: { kind: solve, needs: [drawn], state: push }
  labels: { kind: import, files: [tests/it/schema/labels.npz], state: pull }
";

/// Designs for a time.
const CREEP: &str = "
version: 1
name: creep
scene:
  geometry: { side: 50 mm, thickness: 1.0 mm, prestretch: 3.0, cells: 50, bodies: [{ rectangle: [[20 mm, 20 mm], [30 mm, 30 mm]] }],
    sides: { right: { bar: {} }, top: free, bottom: free } }
  material: { model: neo-hookean, shear_modulus: 45 kPa, relative_permittivity: 4.7 }
  drive: { voltage: 5 kV }
  effects: { viscoelasticity: { law: linear, branches: [{ modulus: 20 kPa, time: 30 s }] } }
stages:
  several: { kind: design, seed: 1, targets: [{ name: one, objective: { point: [10, 10], direction: 0, time: 1 s } },
      { name: two, objective: { body: 0, direction: 0, time: 0 s } },
      { name: three, objective: { points: [{ point: [10, 10], direction: 0 }], time: 10 min } },
      { name: four, objective: { field: pipelines/fields/pinch.csv, time: 1 h } },
      { name: five, objective: { bar: right, direction: 0, time: 0 s } }] }
  point: { kind: design, seed: 1, objective: { point: [10, 10], direction: 0, time: 1 s } }
  body: { kind: design, seed: 1, objective: { body: 0, direction: 0, time: 1 s } }
  bar: { kind: design, seed: 1, objective: { bar: right, direction: 0, time: 1 s } }
  points: { kind: design, seed: 1, objective: { points: [{ point: [10, 10], direction: 0 }], time: 1 s } }
  field: { kind: design, seed: 1, objective: { field: pipelines/fields/pinch.csv, time: 1 s } }
";

/// Designs for an amplitude.
const SWING: &str = "
version: 1
name: swing
scene:
  geometry: { side: 50 mm, thickness: 1.0 mm, prestretch: 3.0, cells: 50 }
  material: { model: neo-hookean, shear_modulus: 45 kPa, relative_permittivity: 4.7 }
  drive: { voltage: 100 V, waveform: { sine: { frequency: 1 Hz, bias: 4 kV } } }
stages:
  several: { kind: design, seed: 1, targets: [{ name: one, objective: { point: [10, 10], direction: 0, frequency: 1 Hz } },
      { name: two, objective: { points: [{ point: [10, 10], direction: 0 }], measure: displacement, frequency: 10 Hz } }] }
  point: { kind: design, seed: 1, objective: { point: [10, 10], direction: 0, frequency: 1 Hz } }
  points: { kind: design, seed: 1, objective: { points: [{ point: [10, 10], direction: 0 }], frequency: 1 kHz } }
";

/// Designs for areas of regions.
const REGIONS: &str = "
version: 1
name: regions
scene:
  geometry: { side: 50 mm, thickness: 1.0 mm, prestretch: 3.0, cells: 50 }
  material: { model: neo-hookean, shear_modulus: 45 kPa, relative_permittivity: 4.7 }
  states: { push: { voltages: [5 kV, 0 V] }, pull: { voltages: [0 V, 5 kV] } }
stages:
  grown: { kind: design, seed: 1, objective: { region: { disc: { centre: [25 mm, 25 mm], radius: 4 mm } }, area_strain: largest, weight: 2, state: push } }
  several: { kind: design, seed: 1, targets: [{ name: one, objective: { region: { disc: { centre: [25 mm, 25 mm], radius: 4 mm } }, area_strain: smallest, weight: 2, state: push } },
      { name: three, objective: { region: { disc: { centre: [25 mm, 25 mm], radius: 4 mm } }, area_strain: largest, state: push, measure: displacement } },
      { name: two, objective: { points: [{ region: { disc: { centre: [25 mm, 25 mm], radius: 4 mm } }, area_strain: 5 %, weight: 2, state: pull }] } }] }
  together: { kind: design, seed: 1, objective: { points: [{ region: { disc: { centre: [25 mm, 25 mm], radius: 4 mm } }, area_strain: 0.05, weight: 2, state: pull }] } }
  measured: { kind: design, seed: 1, objective: { region: { disc: { centre: [25 mm, 25 mm], radius: 4 mm } }, area_strain: largest, state: push, measure: displacement } }
";

/// Designs for heights and volumes.
const INFLATED: &str = "
version: 1
name: inflated
scene:
  geometry: { side: 50 mm, thickness: 1.0 mm, prestretch: 3.0, cells: 50,
    bodies: [{ rectangle: [[20 mm, 20 mm], [30 mm, 30 mm]], load: [0 N, 0 N, 0.2 N] }] }
  material: { model: neo-hookean, shear_modulus: 45 kPa, relative_permittivity: 4.7 }
  loads: { pressure: 500 Pa }
  states: { push: { voltages: [5 kV, 0 V] }, pull: { voltages: [0 V, 5 kV] } }
stages:
  raised: { kind: design, seed: 1, objective: { point: [10, 10], height: up, weight: 2, state: push, measure: displacement } }
  met: { kind: design, seed: 1, objective: { point: [10, 10], height: 1 mm, state: push } }
  hub: { kind: design, seed: 1, objective: { body: 0, height: down, weight: 2, state: pull, measure: displacement } }
  filled: { kind: design, seed: 1, objective: { volume: largest, weight: 2, state: push, measure: displacement } }
  given: { kind: design, seed: 1, objective: { volume: 0.1 ml, state: push } }
  several: { kind: design, seed: 1, targets: [{ name: one, objective: { volume: smallest, weight: 2, state: push, measure: displacement } },
      { name: two, objective: { body: 0, height: 1 mm, state: push } }, { name: three, objective: { point: [10, 10], height: down, state: push } },
      { name: four, objective: { points: [{ volume: 0.1 ml, weight: 2, state: push }, { body: 0, height: 1 mm, state: pull },
        { point: [10, 10], height: -1 mm, state: pull }] } }] }
  together: { kind: design, seed: 1, objective: { points: [{ volume: largest, weight: 2, state: push }, { body: 0, height: up, state: pull },
    { point: [10, 10], height: up, state: pull }] } }
  checked: { kind: verify, needs: [raised] }
";

/// Designs for areas at a time.
const GROWTH: &str = "
version: 1
name: growth
scene:
  geometry: { side: 50 mm, thickness: 1.0 mm, prestretch: 3.0, cells: 50 }
  material: { model: neo-hookean, shear_modulus: 45 kPa, relative_permittivity: 4.7 }
  drive: { voltage: 5 kV }
  effects: { viscoelasticity: { law: linear, branches: [{ modulus: 20 kPa, time: 30 s }] } }
stages:
  several: { kind: design, seed: 1, targets: [{ name: one, objective: { region: { disc: { centre: [25 mm, 25 mm], radius: 4 mm } }, area_strain: largest, time: 1 s } }] }
  grown: { kind: design, seed: 1, objective: { region: { disc: { centre: [25 mm, 25 mm], radius: 4 mm } }, area_strain: largest, time: 1 s } }
";

/// A word that tells mappings apart may be the value of an axis too.
pub const SWEPT_WORDS: &str = "
version: 1
name: swept
scene: pipelines/scenes/vhb4910.yaml
stages:
  drawn: { foreach: { family: [blobs, curves] }, kind: sample, groups: 1, family: '${family}', count: 2, area: 0.5, seed: 1 }
";

/// Shapes of patterns.
const SHAPES: [&str; 13] = [
    "rectangle: [[5 mm, 5 mm], [45 mm, 40 mm]]",
    "rectangle: { corners: [[5 mm, 5 mm], [45 mm, 40 mm]], angle: 5 deg, corner: 3 mm }",
    "disc: { centre: [25 mm, 25 mm], radius: 4 mm }",
    "ellipse: { centre: [25 mm, 25 mm], semiaxes: [5 mm, 4 mm], angle: 20 deg }",
    "ring: { centre: [25 mm, 25 mm], radii: [2 mm, 4 mm] }",
    "polygon: [[5 mm, 5 mm], [45 mm, 5 mm], [25 mm, 40 mm]], without: [{ rectangle: [[20 mm, 6 mm], [22 mm, 9 mm]] }]",
    "path: { from: [5 mm, 5 mm], to: [{ line: [45 mm, 5 mm] }, { arc: [[48 mm, 25 mm], [45 mm, 45 mm]] },
      { cubic: [[30 mm, 50 mm], [20 mm, 50 mm], [5 mm, 45 mm]] }] }",
    "mask: { columns: 50, rows: 50, runs: [100, 50, 2350] }",
    "union: [{ rectangle: [[5 mm, 5 mm], [45 mm, 40 mm]] }]",
    "intersect: [{ rectangle: [[5 mm, 5 mm], [45 mm, 40 mm]] }]",
    "contours: [{ rule: even-odd, curves: [{ from: [35 mm, 25 mm], to: [{ line: [30 mm, 20 mm] },
      { arc: { centre: [25 mm, 25 mm], axes: [[5 mm, 0 mm], [0 mm, 5 mm]], start: 0, sweep: 3 } },
      { cubic: [[30 mm, 50 mm], [20 mm, 50 mm], [5 mm, 45 mm]] }] }] }]",
    "file: tests/it/schema/own.png, threshold: 0.4",
    "file: tests/it/schema/own.dxf, layer: E, unit: mm, origin: [20 mm, 20 mm], scale: 2, angle: 10 deg, join: 1 um,
      without: [{ rectangle: [[20 mm, 20 mm], [22 mm, 22 mm]] }]",
];

const GEOMETRIES: [&str; 10] = [
    "{ side: 50 mm, thickness: 1.0 mm, prestretch: 3.0, cells: 50, frame: { opening: { contours: [{ rule: even-odd, curves: [{ from: [45 mm, 25 mm],
      to: [{ arc: { centre: [25 mm, 25 mm], axes: [[20 mm, 0 mm], [0 mm, 20 mm]], start: 0, sweep: 6 } }, { line: [45 mm, 25 mm] },
      { cubic: [[46 mm, 25 mm], [46 mm, 26 mm], [45 mm, 25 mm]] }] }] }] },
      held: [{ file: tests/it/schema/own.dxf, layer: E, unit: mm, origin: [12 mm, 12 mm], scale: 0.8, angle: 10 deg, join: 1 um }] },
      bodies: [{ file: tests/it/schema/own.dxf, layer: E, unit: mm, origin: [30 mm, 30 mm], scale: 0.8, angle: 10 deg, join: 1 um },
      { contours: [{ rule: nonzero, curves: [{ from: [36 mm, 18 mm], to: [{ line: [37 mm, 18 mm] },
        { arc: { centre: [35 mm, 18 mm], axes: [[2 mm, 0 mm], [0 mm, 2 mm]], start: 0, sweep: 3 } },
        { cubic: [[34 mm, 16 mm], [35 mm, 16 mm], [36 mm, 18 mm]] }] }] }] }] }",
    "{ side: 50 mm, thickness: 1.0 mm, prestretch: 3.0, cells: 4, frame: { opening: { mask: { columns: 4, rows: 4, runs: [0, 16] } },
      held: [{ mask: { columns: 4, rows: 4, runs: [0, 1, 15] } }] }, bodies: [{ mask: { columns: 4, rows: 4, runs: [10, 1, 5] } }] }",
    "{ side: 50 mm, thickness: 1.0 mm, prestretch: 3.0, cells: 50 }",
    "{ size: [60 mm, 30 mm], thickness: 1.0 mm, prestretch: [3.0, 4], cells: [120, 60] }",
    "{ size: [60 mm, 30 mm], thickness: 1.0 mm, prestretch: [3.0, 4], cells: [120, 60], sides: { left: held, right: { bar: { load: [0.5 N, 0 N], at: 4 mm, spring: 20 N/m,
      moves: [x, y, turn], mass: 20 g } }, top: free, bottom: { load: [0 N, -0.1 N] } } }",
    "{ size: [60 mm, 30 mm], thickness: 1.0 mm, prestretch: [3.0, 4], cells: [120, 60], sides: { right: { bar: { displacement: [3 mm, 0 mm] } }, top: free, bottom: roller } }",
    "{ side: 50 mm, thickness: 1.0 mm, prestretch: 3.0, cells: 50, frame: { opening: { disc: { centre: [25 mm, 25 mm], radius: 24 mm } }, curves: fitted,
      held: [{ rectangle: [[24 mm, 24 mm], [26 mm, 26 mm]] }, { disc: { centre: [25 mm, 25 mm], radius: 1 mm } },
      { polygon: [[25 mm, 25 mm], [27 mm, 25 mm], [25 mm, 27 mm]] },
      { ellipse: { centre: [31 mm, 39 mm], semiaxes: [2 mm, 1 mm], angle: 20 deg } },
      { ring: { centre: [40 mm, 34 mm], radii: [1 mm, 2.5 mm] } }, { rectangle: { corners: [[8 mm, 30 mm], [12 mm, 33 mm]], angle: 10 deg, corner: 0.5 mm } },
      { path: { from: [38 mm, 8 mm], to: [{ line: [42 mm, 8 mm] }, { arc: [[43 mm, 9 mm], [42 mm, 10 mm]] },
        { cubic: [[41 mm, 12 mm], [39 mm, 12 mm], [38 mm, 10 mm]] }] }, without: [{ disc: { centre: [40 mm, 9 mm], radius: 0.4 mm } }] },
      { union: [{ disc: { centre: [20 mm, 38 mm], radius: 1.5 mm } }] }, { intersect: [{ disc: { centre: [26 mm, 33 mm], radius: 1.5 mm } }] }] },
      bodies: [{ rectangle: [[10 mm, 20 mm], [16 mm, 26 mm]], load: [0.01 N, 0 N], spring: 2 N/m, curves: cells },
      { disc: { centre: [35 mm, 25 mm], radius: 4 mm }, load: [0 N, 0 N, 0.2 N], spring: [0 N/m, 2 N/m, 40 N/m],
        tilt: false }, { polygon: [[20 mm, 10 mm], [30 mm, 10 mm], [25 mm, 16 mm]] }] }",
    "{ side: 50 mm, thickness: 1.0 mm, prestretch: 3.0, cells: 50, bodies: [{ ellipse: { centre: [31 mm, 39 mm], semiaxes: [2 mm, 1 mm], angle: 20 deg } },
      { ring: { centre: [40 mm, 34 mm], radii: [1 mm, 2.5 mm] } }, { rectangle: { corners: [[8 mm, 30 mm], [12 mm, 33 mm]], angle: 10 deg, corner: 0.5 mm } },
      { path: { from: [38 mm, 8 mm], to: [{ line: [42 mm, 8 mm] }, { arc: [[43 mm, 9 mm], [42 mm, 10 mm]] },
        { cubic: [[41 mm, 12 mm], [39 mm, 12 mm], [38 mm, 10 mm]] }] }, without: [{ disc: { centre: [40 mm, 9 mm], radius: 0.4 mm } }] },
      { union: [{ disc: { centre: [20 mm, 38 mm], radius: 1.5 mm } }] }, { intersect: [{ disc: { centre: [26 mm, 33 mm], radius: 1.5 mm } }] }] }",
    "{ side: 50 mm, thickness: 1.0 mm, prestretch: 3.0, cells: 50, frame: { opening: { rectangle: [[5 mm, 5 mm], [45 mm, 40 mm]] } } }",
    "{ side: 50 mm, thickness: 1.0 mm, prestretch: 3.0, cells: 50, frame: { opening: { polygon: [[0 mm, 0 mm], [50 mm, 0 mm], [25 mm, 50 mm]] } } }",
];

const BASE: &str = "
material: { model: neo-hookean, shear_modulus: 45 kPa, relative_permittivity: 4.7 }
";

/// Materials in files, with values that replace those of the file.
const NAMED: [&str; 2] = [
    "material: { from: pipelines/materials/vhb4910-hossain.yaml, model: neo-hookean, shear_modulus: 45 kPa }",
    "material: { from: pipelines/materials/natural-rubber-treloar.yaml, relative_permittivity: 2.7 }",
];

/// What stands beside geometry and material: every effect. Each law of stiffening is added, as an effect and as a
/// property.
const SCENES: [&str; 18] = [
    "drive: { voltage: 5 kV }\nloads: { pressure: -500 Pa }",
    "drive: { voltage: 5 kV }\nloads: { volume: 2 ml }",
    "drive: { voltages: [5 kV, 3 kV] }\nstates: { push: { voltages: [5 kV, 0 V] }, pull: { voltages: [0 V, 5 kV] } }",
    "states: { on: { voltage: 5 kV }, off: { voltage: 0 V } }",
    "drive: { voltage: 5.25 kV, frequency: 2 Hz, duration: 30 s }\neffects: auto",
    "drive: { voltage: 5 kV }
effects: { strain_stiffening: { model: gent, jm: 125 }, electrode_stiffness: { shear_modulus: 1 MPa, thickness: 5 um },
  stretch_dependent_permittivity: { exponent: 0.1, reference: undeformed }, fringe_field: { }, wrinkling: true,
  dielectric_breakdown: { law: constant, field: 90 MV/m }, electromechanical_stability: }
properties: { strain_stiffening: { model: yeoh, c2: -1 kPa, c3: 20 Pa }, density: 960, sheet_resistance: 10 kOhm,
  viscoelasticity: [ { modulus: 20 kPa, time: 30 s } ] }",
    "drive: { voltage: 5 kV }
effects: { strain_stiffening: { model: yeoh, c2: -1 kPa, c3: 20 Pa }, fringe_field: true, wrinkling: { },
  electromechanical_stability: { }, dielectric_breakdown: { law: huang } }
properties: { strain_stiffening: { model: gent, jm: 125 }, electrode_stiffness: { shear_modulus: 1 MPa, thickness: 5 um },
  stretch_dependent_permittivity: { exponent: 0.1, reference: prestretched }, dielectric_breakdown: { law: constant, field: 1e8 } }",
    "drive: { voltage: 5 kV }
effects: { strain_stiffening: { }, dielectric_breakdown: true, electrode_stiffness: false }
properties: { strain_stiffening: { model: gent, jm: 125 }, dielectric_breakdown: { law: huang } }",
    "drive: { voltage: 5 kV, waveform: { step: { } }, rest: 10 min, duration: 1 h }
effects: { viscoelasticity: { law: linear, branches: [ { modulus: 20 kPa, time: 30 s } ] }, inertia: { density: 960 kg/m3 } }",
    "drive: { voltage: 5 kV, waveform: { ramp: { time: 2 s } }, source: { resistance: 1 MOhm, current_limit: 1 mA } }
effects: { viscoelasticity: { }, inertia: true }
properties: { viscoelasticity: { law: finite, branches: [ { modulus: 20 kPa, time: 30 s } ] }, density: 960 }",
    "drive: { voltages: [5 kV, 1 kV], waveform: { sine: { frequency: 2 Hz, bias: 1 kV } } }",
    "drive: { charge: { total: 2.8 uC } }\neffects: { charge_control: { } }",
    "drive: { charge: { immobile: 2.8 uC } }",
    "drive: { voltage: 5 kV }\nleads: [left, top]\neffects: { electrode_resistance: { sheet_resistance: 50 kOhm } }",
    "drive: { voltage: 5 kV }\nleads: { cells: [ [0, 0], [1, 0] ] }\neffects: { electrode_resistance: { } }
properties: { sheet_resistance: 50 kOhm }",
    "drive: { waveform: { table: [ [0 s, 0 V], [1 s, 5 kV], [1 s, -5 kV] ] } }",
    "drive: { voltage: 5 kV }\ntolerances: { voltage: { relative: 1 %, distribution: normal },
  shear_modulus: { relative: 5 %, distribution: lognormal }, thickness: { relative: 3 %, distribution: normal },
  permittivity: { relative: 2 %, distribution: normal }, prestretch: { relative: 1 %, distribution: normal },
  mask: 0.15 mm, misregistration: [0.1 mm, 0.2 mm], lost_cells: 0.2 % }",
    "drive: { voltage: 5 kV }\ntolerances: { voltage: 1 %, shear_modulus: 5 %, thickness: 0.03, permittivity: 2 %,
  prestretch: 1 %, misregistration: 0.1 mm }",
];

/// Adds robust objectives of forms.
fn with_robust(mut document: Value, forms: [&str; 2]) -> Value {
    let stages = document["stages"].as_object_mut().unwrap();
    let designs = stages.values().filter(|stage| stage["kind"] == "design");
    let of_targets = |stage: &Value| stage["targets"].as_array().cloned().unwrap_or_default();
    let all = designs.flat_map(|stage| std::iter::once(stage.clone()).chain(of_targets(stage)));
    let objectives: Vec<Value> = all.filter_map(|of| of.get("objective").cloned()).collect();
    for form in forms {
        let Some(objective) = objectives.iter().find(|objective| objective.get(form).is_some()) else {
            continue;
        };
        let robust = [
            "{ worst: [-0.3 mm, { mask: 0.1 mm, misregistration: [0.1 mm, 0.2 mm] }] }",
            "{ mean_minus: 2, mask: 0.15 mm, misregistration: 0.1 mm }",
        ];
        let both = robust.map(|robust| {
            let mut objective = objective.clone();
            objective["robust"] = json(robust);
            objective
        });
        for (at, objective) in both.iter().enumerate() {
            let stage = serde_json::json!({ "kind": "design", "seed": 1, "objective": objective });
            stages.insert(format!("{form}_robust{at}"), stage);
        }
        let targets = (0..2).map(|at| serde_json::json!({ "name": format!("t{at}"), "objective": both[at] }));
        let targets: Vec<Value> = targets.collect();
        let stage = serde_json::json!({ "kind": "design", "seed": 1, "targets": targets });
        stages.insert(format!("{form}_robust"), stage);
    }
    document
}

/// Adds a front of each objective, so that all kinds of objectives are among two.
fn with_fronts(mut document: Value) -> Value {
    let stages = document["stages"].as_object_mut().unwrap();
    let designs = stages.values().filter(|stage| stage["kind"] == "design");
    let of_targets = |stage: &Value| stage["targets"].as_array().cloned().unwrap_or_default();
    let all = designs.flat_map(|stage| std::iter::once(stage.clone()).chain(of_targets(stage)));
    let objectives: Vec<Value> = all.filter_map(|of| of.get("objective").cloned()).collect();
    for (at, objective) in objectives.into_iter().enumerate() {
        let mut front = json(
            "{ kind: design, seed: 1, method: adjoint, units: 20, starts: 1, pareto: { points: 3, method: epsilon },
              objectives: [{ area: least, within: [0.1, 20 %], reference: 0.5 }] }",
        );
        front["objectives"].as_array_mut().unwrap().insert(at % 2, objective);
        stages.insert(format!("front{at}"), front);
    }
    if stages.contains_key("highest") {
        let charge = "{ kind: design, seed: 1, pareto: { points: 3 }, objectives: [{ point: [25, 25], direction: 0 },
          { charge: least, within: [1 uC, 2 uC], reference: 3 uC }] }";
        stages.insert("charges".to_owned(), json(charge));
        let largest = "{ kind: design, seed: 1, area: { at_most: 30 % },
          targets: [{ name: a, area: { at_most: 0.2 }, objective: { point: [25, 25], direction: 0 } }] }";
        stages.insert("largest".to_owned(), json(largest));
        let genetic = "{ kind: design, seed: 1, method: ga, population: 20, generations: 3, crossover: 0.5, mutation: 0.2,
          evaluator: auto, evaluator_accuracy: 0.01 mm, pareto: { points: 3, method: nsga2 },
          objectives: [{ area: least }, { point: [25, 25], direction: 0 }, { point: [12.5, 25], displacement: [0, 0] }] }";
        stages.insert("genetic".to_owned(), json(genetic));
    }
    document
}

/// The documents of a kind.
pub fn of(kind: Kind) -> Vec<Value> {
    match kind {
        Kind::Pipeline => {
            // A stage for each shape, which are read for each fault.
            let stages = (1..).zip(SHAPES).map(|(at, shape)| {
                let edges = ["cells", "fitted", "coverage"][at % 3];
                format!("  shaped{at}: {{ kind: patterns, edges: {edges}, shapes: [{{ group: 1, {shape} }}] }}\n")
            });
            let pipeline = PIPELINE.to_owned() + &stages.collect::<String>();
            let of_points = with_robust(json(&pipeline), ["point", "points"]);
            let of_bodies = with_robust(json(DEVICE), ["body", "bar"]);
            let of_regions = with_robust(json(REGIONS), ["region", "points"]);
            let others = [GROWTH, CREEP, SWING, INFLATED].map(json);
            let all = [of_points, of_bodies, of_regions].into_iter().chain(others);
            all.map(with_fronts).collect()
        }
        Kind::Scene => {
            let laws = Stiffening::EXAMPLES.iter().map(|law| {
                format!(
                    "drive: {{ voltage: 5 kV }}\neffects: {{ strain_stiffening: {law} }}\nproperties: {{ strain_stiffening: {law} }}"
                )
            });
            let scenes = SCENES.iter().map(ToString::to_string).chain(laws);
            let numbered = scenes.enumerate();
            let written = numbered
                .map(|(at, rest)| json(&format!("geometry: {}{BASE}{rest}", GEOMETRIES[at % GEOMETRIES.len()])));
            let named = NAMED.iter().map(|material| {
                json(&format!(
                    "geometry: {}\n{material}\ndrive: {{ voltage: 5 kV }}",
                    GEOMETRIES[1]
                ))
            });
            written.chain(named).collect()
        }
    }
}
