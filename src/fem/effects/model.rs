//! The physical model of a scene: its law at a point of the membrane.

use super::Fringe;
use crate::composition::Composition;
use crate::energy::{Stiff, Stiffened};
use crate::error::SetupError;
use crate::grid::Grid;
use crate::material::{AnyMaterial, Material};
use crate::memory::Memory;
use crate::operator::{Activity, metrics};
use crate::sheet::Sheet;
use deaflow_field::Mesh;
use deaflow_pattern::Pattern;
use deaflow_scene::laws::StiffeningLaw;
use deaflow_scene::{Scene, Stiffening};

/// The physical model of a scene, for any pattern.
#[derive(Clone, Debug)]
pub struct Model {
    sheet: Sheet,
    /// Share of the load of each electrode group.
    loads: Vec<f64>,
    /// The law assumes the prestretch √(λ₁λ₂); [`Grid`] handles the difference of λ₁ and λ₂.
    composition: Composition,
    kappa: f64,
    fringe: Option<Fringe>,
    /// γ of branches that have no time to relax, in units of μλp².
    gamma: f64,
    /// Whether the charge is prescribed.
    has_charge: bool,
}

/// A computation that is generic over the law.
pub trait WithMaterial {
    /// Its result.
    type Output;
    /// Runs it. `material` returns the law at a share of the full load, which is proportional to V².
    fn run<L: Material, F: Fn(f64) -> L + Sync>(self, material: F) -> Self::Output;
}

/// Runs a computation with a type-erased law, so that it is compiled once.
fn run<W: WithMaterial>(work: W, material: &(dyn Fn(f64) -> AnyMaterial + Sync)) -> W::Output {
    work.run(material)
}

/// Computes the margins of finite energy and of ellipticity at rest, without voltage.
struct AtRest([f64; 2]);

impl WithMaterial for AtRest {
    type Output = [f64; 2];

    fn run<L: Material, F: Fn(f64) -> L + Sync>(self, material: F) -> [f64; 2] {
        let ([along, across], material) = (self.0, material(0.0));
        [
            material.admissible([[along - 1.0, 0.0], [0.0, across - 1.0]]),
            material.ellipticity([[along, 0.0], [0.0, across]], 0.0),
        ]
    }
}

impl Model {
    /// Creates the model of a scene.
    ///
    /// # Errors
    /// If its effects cannot be simulated together, or not with its dimensions.
    pub fn new(scene: &Scene) -> Result<Self, SetupError> {
        Self::with_law(scene, scene.effects.strain_stiffening.as_ref().map(Stiffening::law))
    }

    /// Creates the model of a scene with a custom stiffening law instead of its own.
    ///
    /// # Errors
    /// As [`Model::new`].
    pub fn with_law(scene: &Scene, law: Option<&dyn StiffeningLaw>) -> Result<Self, SetupError> {
        if let Some(error) = SetupError::in_space(scene) {
            return Err(error);
        }
        let effects = &scene.effects;
        let prestretch = scene.mean_prestretch();
        let stiffened = |law: &dyn StiffeningLaw| Stiffened::new(&law.form(scene.shear_modulus_pa()), prestretch);
        let sheet = Sheet::of(scene);
        let [along, across] = sheet.prestretch;
        if effects.electrode_stiffness.is_some() && along != across {
            return Err(SetupError::StiffElectrodes {
                prestretch: sheet.prestretch,
            });
        }
        let loads = scene.group_loads();
        if effects.electrode_stiffness.is_some() && loads.iter().any(|&load| load != 1.0) {
            return Err(SetupError::StiffGroups);
        }
        let model = Self {
            sheet,
            loads,
            composition: Composition {
                prestretch,
                stiffening: law.map(stiffened).transpose()?,
                electrode: effects.electrode_stiffness.as_ref().map(|e| Stiff::new(scene, e)),
                decay: effects.stretch_dependent_permittivity.clone(),
                wrinkles: effects.wrinkling.is_some(),
            },
            kappa: scene.kappa(),
            fringe: effects.fringe_field.as_ref().map(|_| Fringe::new(scene)).transpose()?,
            gamma: 0.0,
            has_charge: scene.drive.charge.is_some(),
        };
        let [is_finite, is_elliptic] = model.with(AtRest(model.sheet.distortion())).map(|margin| margin > 0.0);
        match (is_finite, is_elliptic) {
            (true, true) => Ok(model),
            (true, false) => Err(SetupError::UnstableAtRest),
            (false, _) => Err(SetupError::LimitingStretch {
                prestretch: along.max(across),
            }),
        }
    }

    /// Adds viscoelastic branches of a modulus γ, in units of μλp², that are relaxed without voltage and have no
    /// time to relax from there.
    #[must_use]
    pub fn with_unrelaxed(self, gamma: f64) -> Self {
        Self { gamma, ..self }
    }

    /// Runs a computation with the law of the scene.
    pub fn with<W: WithMaterial>(&self, work: W) -> W::Output {
        let gamma = if self.law_includes_unrelaxed() { self.gamma } else { 0.0 };
        run(work, &|share| self.composition.material(share * self.kappa, gamma))
    }

    /// Returns whether branches that have no time to relax are part of the law. That is possible with the base model at
    /// rest at f = I: there ½γ(tr c + j⁻²) is added to ½(tr c + a j⁻²). The law is then in units of (1 + γ)μH, while
    /// forces on bodies and charges are in units of μH.
    #[must_use]
    pub fn law_includes_unrelaxed(&self) -> bool {
        let [along, across] = self.sheet.prestretch;
        let is_plain = self.composition.is_base() && along == across;
        let is_held = self.sheet.sides.is_none();
        is_plain && is_held && self.sheet.mounts.is_empty() && !self.has_charge
    }

    /// Returns the grid of a mesh; a fringe field needs element edges at its end.
    ///
    /// # Errors
    /// If elements cannot follow the borders of the sheet.
    pub fn grid(&self, mesh: Mesh) -> Result<Grid, SetupError> {
        match &self.fringe {
            None => Grid::fitted(mesh, &self.sheet),
            Some(_) if self.sheet.borders.is_some() => Err(SetupError::Curves { with: "fringe fields" }),
            Some(fringe) => Ok(fringe.grid(mesh)),
        }
    }

    /// Returns the grid of a mesh on which scenes with and without a fringe field are compared: it follows no borders.
    #[must_use]
    pub fn grid_of_cells(&self, mesh: Mesh) -> Grid {
        match &self.fringe {
            None => Grid::uniform(mesh, &self.sheet),
            Some(fringe) => fringe.grid(mesh),
        }
    }

    /// Returns the activity of a pattern; with a fringe field the grid must be that of [`Model::grid`]. Electrodes that
    /// cover parts of cells need a scene that [`crate::check_covered_cells`] allows.
    ///
    /// # Panics
    /// If a cell belongs to an electrode group that the scene does not have.
    #[must_use]
    pub fn activity(&self, grid: &Grid, pattern: &Pattern) -> Activity {
        self.add_unrelaxed(match (&self.fringe, pattern.coverage()) {
            (None, None) => Activity::of_groups(grid, pattern, &self.loads),
            (None, Some(coverage)) => Activity::of_coverage(grid, coverage, &self.loads),
            (Some(fringe), _) => fringe.activity(grid, pattern, &self.loads),
        })
    }

    /// Adds the branches that have no time to relax to an activity, if all sides are held.
    #[must_use]
    pub fn add_unrelaxed(&self, activity: Activity) -> Activity {
        if !self.has_unrelaxed() || self.sheet.sides.is_some() || self.law_includes_unrelaxed() {
            return activity;
        }
        let mount = vec![0.0; activity.grid().layout().vector_len()];
        self.add_unrelaxed_at(activity, &mount)
    }

    /// Adds the branches that have no time to relax from a state to an activity.
    #[must_use]
    pub fn add_unrelaxed_at(&self, activity: Activity, rest: &[f64]) -> Activity {
        let values: Vec<f64> = metrics(&activity, rest)
            .iter()
            .map(|value| self.gamma * value)
            .collect();
        let memory = Memory::new(activity.grid().layout(), &values);
        activity.with_memory(memory)
    }

    /// Returns whether there are branches that have no time to relax.
    #[must_use]
    pub fn has_unrelaxed(&self) -> bool {
        self.gamma != 0.0
    }

    /// Returns the share of the load of each electrode group.
    #[must_use]
    pub fn loads(&self) -> &[f64] {
        &self.loads
    }

    /// Returns whether the energy is linear in the activity of each cell.
    #[must_use]
    pub fn is_linear_in_cells(&self) -> bool {
        self.fringe.is_none() && !self.composition.wrinkles
    }
}
