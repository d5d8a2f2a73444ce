//! A device whose scene has free parameters: displacements at points for their values, with derivatives.

use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

use rayon::prelude::*;

use super::free::{FreeKey, VOLTAGE_OFFSET};
use crate::scene;
use deaflow_base::{Document, InputError, Node, Override, four_digits};
use deaflow_fem::screening::resolve;
use deaflow_fem::{MembraneSolver, SolveOptions, Weights};
use deaflow_field::Mesh;
use deaflow_fit::{Elastomer, LawKind, Simulated, ViscousLaw};
use deaflow_pattern::Pattern;
use deaflow_scene::effects::Stiffening;
use deaflow_scene::{Scene, Viscoelasticity};

/// Relative half of the difference of a parameter between the neighbours whose residuals give a derivative: the error
/// of the derivative is about 1e-8.
const STEP: f64 = 1e-4;
/// The same half of a voltage offset, in V.
const VOLTAGE_STEP: f64 = 1.0;

/// A device whose scene has free parameters.
#[derive(Clone)]
pub struct Device {
    /// The scene with its effects decided, as a document.
    root: Node,
    keys: Vec<FreeKey>,
    options: SolveOptions,
    /// The scene as it was given, if its effects are decided.
    auto: Option<Scene>,
    /// The names of the simulated effects.
    effects: Vec<String>,
    /// The number of simulations of sets of data, on all meshes.
    simulations: Arc<AtomicU64>,
}

/// Where displacements are simulated: points of one pattern at one voltage.
#[derive(Clone, Debug)]
pub struct Load {
    /// The voltage in V; that of the scene if it is not given.
    pub voltage_v: Option<f64>,
    /// Points of the prestretched membrane in mm from its lower left corner.
    pub points_mm: Vec<[f64; 2]>,
}

/// Displacements in mm at the points of a load, and their derivatives with respect to each parameter.
#[derive(Clone, Debug, PartialEq)]
pub struct Displacements {
    /// The displacement of each point.
    pub values: Vec<[f64; 2]>,
    /// For each parameter, the derivative at each point.
    pub by_parameter: Vec<Vec<[f64; 2]>>,
}

/// A scene for values of the parameters, and its neighbours along each parameter with the difference between them.
struct Scenes {
    scene: Scene,
    neighbours: Vec<([Scene; 2], f64)>,
    /// The value of [`VOLTAGE_OFFSET`] in V.
    offset_v: f64,
}

impl Device {
    /// Prepares a scene, whose effects are decided first with `effects: auto`.
    ///
    /// # Errors
    /// When a parameter is not a number of the scene, the scene has several states or a prescribed charge, or it cannot
    /// be simulated with the first values of the parameters.
    pub fn new(scene: &Scene, keys: &[String], options: SolveOptions) -> Result<Self, InputError> {
        let refused = |why: &str, help: &str| InputError::new(why.to_owned()).help(help.to_owned());
        if !scene.states.is_empty() {
            return Err(refused(
                "the scene has several states, and a fit needs one",
                "give each file its voltage, and remove `states` from the scene",
            ));
        }
        if scene.drive.charge.is_some() {
            return Err(refused(
                "the charge of the scene is prescribed; a fit needs a voltage",
                "give the scene a `voltage` in place of the `charge`",
            ));
        }
        let decided = resolve(scene).map_err(|error| InputError::new(error.to_string()))?;
        let root = Document::from_text(Path::new("scene"), &decided.to_text())?.root;
        let keys = keys
            .iter()
            .map(|key| FreeKey::find(&root, key))
            .collect::<Result<_, _>>()?;
        let device = Self {
            effects: effects_of(&root),
            root,
            keys,
            options,
            auto: scene.auto.then(|| scene.clone()),
            simulations: Arc::default(),
        };
        let first = device.scene(&device.first_values())?;
        MembraneSolver::new(&first, options).map_err(|error| InputError::new(error.to_string()))?;
        Ok(device)
    }

    /// Returns the free parameters.
    #[must_use]
    pub fn keys(&self) -> &[FreeKey] {
        &self.keys
    }

    /// Returns the first values of the free parameters.
    #[must_use]
    pub fn first_values(&self) -> Vec<f64> {
        self.keys.iter().map(|key| key.start).collect()
    }

    /// Returns the voltage in V that is added to all voltages; 0 if it is not free.
    #[must_use]
    pub fn voltage_offset(&self, values: &[f64]) -> f64 {
        let mut pairs = self.keys.iter().zip(values);
        pairs
            .find(|(key, _)| key.path == VOLTAGE_OFFSET)
            .map_or(0.0, |(_, value)| *value)
    }

    /// Returns the same device on another mesh.
    #[must_use]
    pub fn on(&self, mesh: Mesh) -> Self {
        Self {
            options: SolveOptions { mesh, ..self.options },
            ..self.clone()
        }
    }

    /// Returns the counter of simulations of sets of data, to show progress.
    #[must_use]
    pub fn simulations(&self) -> Arc<AtomicU64> {
        Arc::clone(&self.simulations)
    }

    /// Counts a simulation of a set of data.
    pub(super) fn count(&self) {
        self.simulations.fetch_add(1, Ordering::Relaxed);
    }

    /// Returns the names of the simulated effects.
    #[must_use]
    pub fn effects(&self) -> &[String] {
        &self.effects
    }

    /// Returns the effects that `effects: auto` chooses for values of the parameters, if they are others than those
    /// that are simulated.
    ///
    /// # Errors
    /// When they cannot be decided.
    pub fn other_effects(&self, values: &[f64]) -> Result<Option<Vec<String>>, InputError> {
        let Some(given) = &self.auto else { return Ok(None) };
        let mut root = Document::from_text(Path::new("scene"), &given.to_text())?.root;
        for (key, value) in self.keys.iter().zip(values) {
            // Keys of decided effects are not in it.
            if FreeKey::find(&root, &key.path).is_ok() && key.path != VOLTAGE_OFFSET {
                Override::of_scene(&format!("{}={}", key.path, key.written(*value)))?.apply(&mut root)?;
            }
        }
        let decided = resolve(&scene::read(&root)?).map_err(|error| InputError::new(error.to_string()))?;
        let effects = effects_of(&Document::from_text(Path::new("scene"), &decided.to_text())?.root);
        Ok((effects != self.effects).then_some(effects))
    }

    /// Returns mesh and tolerance.
    #[must_use]
    pub fn options(&self) -> SolveOptions {
        self.options
    }

    /// Returns the scene for values of the parameters, without the voltage offset.
    ///
    /// # Errors
    /// When a value is not allowed in a scene.
    pub fn scene(&self, values: &[f64]) -> Result<Scene, InputError> {
        let mut root = self.root.clone();
        for (key, value) in self
            .keys
            .iter()
            .zip(values)
            .filter(|(key, _)| key.path != VOLTAGE_OFFSET)
        {
            Override::of_scene(&format!("{}={}", key.path, key.written(*value)))?.apply(&mut root)?;
        }
        scene::read(&root)
    }

    /// Returns the elastomer of the scene, and the numbers by which specimens and sheets of it are described, with the
    /// values of the free parameters.
    ///
    /// # Errors
    /// When its law is unknown.
    pub(super) fn elastomer(&self, values: &[f64]) -> Result<(Elastomer, Vec<(String, f64)>), InputError> {
        let known = [
            LawKind::NeoHookean,
            LawKind::Gent,
            LawKind::Yeoh,
            LawKind::MooneyRivlin,
            LawKind::ArrudaBoyce,
        ];
        let effects = self.root.peek("effects");
        let law = match effects.and_then(|effects| effects.peek("strain_stiffening")?.peek("model")) {
            Some(model) => model.text("model")?,
            None => LawKind::NeoHookean.name(),
        };
        let scene = self.scene(&self.first_values())?;
        // Its parameters are in a list, and none of them is free.
        let terms = match &scene.effects.strain_stiffening {
            Some(Stiffening::Ogden(law)) => law.terms.as_slice(),
            _ => &[],
        };
        let known = known.into_iter().find(|kind| kind.name() == law);
        let Some(kind) = known.or((!terms.is_empty()).then_some(LawKind::Ogden(terms.len()))) else {
            return Err(InputError::new(format!(
                "curves cannot be compared with a scene whose law is `{law}`"
            )));
        };
        let viscous = scene.effects.viscoelasticity.as_ref();
        let branches = viscous.map_or(&[][..], |viscous| &viscous.branches);
        let elastomer = Elastomer {
            law: kind,
            branches: branches.len(),
            viscous: viscous_law(viscous),
        };
        let of_branches = branches.iter().flat_map(|own| [own.modulus.value(), own.time.value()]);
        let (of_law, names) = (kind.parameters().len(), elastomer.parameters());
        let mut all: Vec<(String, f64)> = names[of_law..].iter().cloned().zip(of_branches).collect();
        let of_terms = terms.iter().flat_map(|term| {
            let alpha = term.alpha.to_f64();
            [0.5 * term.mu.value() * alpha, alpha]
        });
        all.extend(names[..of_law].iter().cloned().zip(of_terms));
        let scalars = names[..of_law].iter().filter(|_| terms.is_empty()).map(String::as_str);
        for name in scalars.chain(["relative_permittivity"]) {
            let section = match name {
                "shear_modulus" | "relative_permittivity" => "material",
                _ => "effects.strain_stiffening",
            };
            let path = format!("{section}.{name}");
            all.push((name.to_owned(), FreeKey::find(&self.root, &path)?.start));
        }
        all.push((VOLTAGE_OFFSET.to_owned(), 0.0));
        for (key, value) in self.keys.iter().zip(values) {
            if let Some((_, own)) = all.iter_mut().find(|(name, _)| *name == key.name) {
                *own = *value;
            }
        }
        Ok((elastomer, all))
    }

    /// Returns the scene for values of the parameters with its neighbours.
    ///
    /// # Errors
    /// When a value is not allowed.
    fn scenes(&self, values: &[f64]) -> Result<Scenes, InputError> {
        let neighbour = |at: usize, by: f64| {
            let mut values = values.to_vec();
            values[at] += by;
            self.scene(&values)
        };
        let scene = self.scene(values)?;
        let mut neighbours = Vec::with_capacity(values.len());
        let mut offset_v = 0.0;
        for (at, (key, value)) in self.keys.iter().zip(values).enumerate() {
            if key.path == VOLTAGE_OFFSET {
                offset_v = *value;
                neighbours.push(([scene.clone(), scene.clone()], 2.0 * VOLTAGE_STEP));
                continue;
            }
            let step = STEP * if *value == 0.0 { 1.0 } else { value.abs() };
            neighbours.push(([neighbour(at, -step)?, neighbour(at, step)?], 2.0 * step));
        }
        Ok(Scenes {
            scene,
            neighbours,
            offset_v,
        })
    }

    /// Returns the points of a load that are on the membrane, for the first values of the parameters.
    ///
    /// # Errors
    /// When the elements cannot follow drawn electrodes.
    pub fn on_membrane(&self, pattern: &Pattern, points_mm: &[[f64; 2]]) -> Result<Vec<bool>, InputError> {
        let scene = self.scene(&self.first_values())?;
        let solver = MembraneSolver::new(&scene.with_electrodes_of(pattern), self.options);
        let solver = solver.map_err(|error| InputError::new(error.to_string()))?;
        Ok(points_mm
            .iter()
            .map(|point| solver.grid().weights_at(*point).is_some())
            .collect())
    }

    /// Returns the displacements of a load for the first values of the parameters; `None` if there is no state.
    pub(super) fn first_displacements(&self, pattern: &Pattern, load: &Load) -> Option<Vec<[f64; 2]>> {
        let fixed = Self {
            keys: Vec::new(),
            ..self.clone()
        };
        let found = fixed.simulate(pattern, std::slice::from_ref(load), &[]).ok()?;
        found.into_iter().next().map(|found| found.values)
    }

    /// Simulates loads of a pattern side by side.
    ///
    /// # Errors
    /// When one has no stable equilibrium, or a value is not allowed, with the reason.
    pub fn simulate(&self, pattern: &Pattern, loads: &[Load], values: &[f64]) -> Result<Vec<Displacements>, String> {
        let scenes = self.scenes(values).map_err(|error| error.to_string())?;
        loads
            .par_iter()
            .map(|load| self.displacements(pattern, load, &scenes))
            .collect()
    }

    fn displacements(&self, pattern: &Pattern, load: &Load, scenes: &Scenes) -> Result<Displacements, String> {
        let voltage_of = |scene: &Scene| load.voltage_v.unwrap_or_else(|| scene.voltage_v());
        let solver = |scene: &Scene, offset: f64| {
            // The force is that of V², so its sign does not matter.
            let scene = scene.at_voltage((voltage_of(scene) + offset).abs());
            let solver = MembraneSolver::new(&scene.with_electrodes_of(pattern), self.options);
            solver.map_err(|error| error.to_string())
        };
        let middle = solver(&scenes.scene, scenes.offset_v)?;
        let solution = middle.solve(pattern);
        let at_voltage = || {
            let kilovolts = four_digits(1e-3 * voltage_of(&scenes.scene));
            format!("at {kilovolts} kV: {}", solution.outcome)
        };
        if !solution.outcome.is_converged() {
            return Err(at_voltage());
        }
        let weights = load.points_mm.iter().map(|point| middle.grid().weights_at(*point));
        let Some(weights) = weights.collect::<Option<Vec<Weights>>>() else {
            return Err("a point is not on the membrane".to_owned());
        };
        let at_points = |nodal: &[f64], factor: f64| -> Vec<[f64; 2]> {
            let at = |weights| middle.displacement_at(weights, nodal).map(|u| factor * u);
            weights.iter().map(at).collect()
        };
        let derivative = |(key, (scenes_of, difference)): (&FreeKey, &([Scene; 2], f64))| {
            let offsets = match key.path == VOLTAGE_OFFSET {
                true => [-VOLTAGE_STEP, VOLTAGE_STEP],
                false => [0.0; 2],
            };
            let [first, second] = [0, 1].map(|side: usize| solver(&scenes_of[side], scenes.offset_v + offsets[side]));
            let change = middle.change(pattern, &solution, [&first?, &second?]);
            let change = change.ok_or_else(|| format!("no derivative by {} {}", key.name, at_voltage()))?;
            Ok(at_points(&change, difference.recip()))
        };
        let by_parameter = self.keys.iter().zip(&scenes.neighbours).map(derivative);
        Ok(Displacements {
            values: at_points(&solution.displacement, 1.0),
            by_parameter: by_parameter.collect::<Result<_, String>>()?,
        })
    }
}

/// Returns the flow law of branches as fits name it; the linear one without branches.
#[must_use]
pub fn viscous_law(viscous: Option<&Viscoelasticity>) -> ViscousLaw {
    match viscous.map(|viscous| viscous.law) {
        Some(deaflow_scene::ViscousLaw::Finite) => ViscousLaw::Finite,
        Some(deaflow_scene::ViscousLaw::Linear) | None => ViscousLaw::Linear,
    }
}

/// Returns the effects of a scene.
fn effects_of(root: &Node) -> Vec<String> {
    root.peek("effects").map(Node::keys).unwrap_or_default()
}

impl Displacements {
    /// Joins the displacements of several loads as the numbers of a data set: both components of each point in turn, or
    /// their part along a direction.
    #[must_use]
    pub fn joined(all: &[Self], direction: Option<[f64; 2]>) -> Simulated {
        let numbers = |u: &[f64; 2]| match direction {
            Some([along, across]) => vec![along * u[0] + across * u[1]],
            None => u.to_vec(),
        };
        let join =
            |of: &dyn Fn(&Self) -> &[[f64; 2]]| all.iter().flat_map(|one| of(one).iter().flat_map(numbers)).collect();
        let parameters = all.first().map_or(0, |first| first.by_parameter.len());
        Simulated {
            values: join(&|one| &one.values),
            by_parameter: (0..parameters).map(|at| join(&|one| &one.by_parameter[at])).collect(),
        }
    }
}
