//! Derivatives with respect to voltages and parameters of the material, for patterns of whole cells.
//!
//! The electric energy of a cell is proportional to κ S, with the load κ = ε V² / (μ H²) at the largest voltage V and
//! the share S = (V_g / V)² of its electrode group. An equilibrium depends on the voltages by κ S alone, and the
//! adjoint method has dJ/dS. Without other forces it depends on permittivity ε, shear modulus μ and thickness H by κ alone:
//! dJ/d ln κ = Σ S dJ/dS.

use deaflow::cli::{CliError, Equilibria};
use deaflow::design::Goal;
use deaflow::fem::screening::resolve;
use deaflow::pattern::Pattern;
use deaflow::scene::{Body, Effects, Scene};

use super::{ValueAndGradients, check_shares, sum_of_states, value_and_slopes, values_and_gradients_in_states};

/// A parameter of a scene.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Parameter {
    /// The voltage of each electrode group, V.
    Voltage,
    /// The shear modulus, Pa.
    ShearModulus,
    /// The relative permittivity.
    RelativePermittivity,
    /// The thickness before stretching, mm.
    Thickness,
}

impl Parameter {
    /// All of them.
    const ALL: [Self; 4] = [
        Self::Voltage,
        Self::ShearModulus,
        Self::RelativePermittivity,
        Self::Thickness,
    ];

    /// The key in a scene.
    fn name(self) -> &'static str {
        match self {
            Self::Voltage => "voltage",
            Self::ShearModulus => "shear_modulus",
            Self::RelativePermittivity => "relative_permittivity",
            Self::Thickness => "thickness",
        }
    }

    /// Finds a parameter by its key in a scene.
    ///
    /// # Errors
    /// When there is no derivative with respect to it.
    pub fn find(name: &str) -> Result<Self, CliError> {
        let known = Self::ALL.into_iter().find(|parameter| parameter.name() == name);
        known.ok_or_else(|| {
            let allowed = Self::ALL.map(Self::name).join(", ");
            CliError::bad_input(format!("there is no derivative with respect to {name:?}"))
                .help(format!("allowed: coverage, {allowed}"))
        })
    }
}

/// The value of an objective, and its derivatives.
pub struct ValueAndDerivatives {
    /// The value.
    pub value: f64,
    /// With respect to each parameter. That with respect to voltages has a number for each state and electrode group,
    /// `[state][group]`, the others have one.
    pub parameters: Vec<Vec<f64>>,
    /// With respect to the covered share of each cell, `[y][x]`, if asked for.
    pub coverage: Vec<f64>,
}

/// Computes value and derivatives of an objective for each pattern; `None` for one without a stable solution. `shares`
/// are the same patterns with [shares](Pattern::of_shares), if the derivative with respect to them is wanted too: each
/// pattern is solved once for all derivatives.
///
/// # Errors
/// When a pattern has cells that are covered in part, or the scene has effects or forces with which there is no such
/// derivative.
pub fn values_and_derivatives(
    equilibria: &Equilibria,
    scene: &Scene,
    (patterns, shares): (&[Pattern], Option<&[Pattern]>),
    parameters: &[Parameter],
    goal: &Goal,
) -> Result<Vec<Option<ValueAndDerivatives>>, CliError> {
    if patterns.iter().any(|pattern| pattern.coverage().is_some()) {
        let message = "voltages and material change the state of cells that are covered in part in another way";
        return Err(CliError::bad_input(message).help("give whole cells"));
    }
    for parameter in parameters {
        check(scene, *parameter, goal)?;
    }
    let states: Vec<Scene> = scene.in_states().into_iter().map(|(_, scene)| scene).collect();
    if shares.is_some() {
        check_shares(scene)?;
    }
    let forms: Vec<&[Pattern]> = [Some(patterns), shares].into_iter().flatten().collect();
    let forms = &forms[usize::from(parameters.is_empty())..];
    let solved = shares.unwrap_or(patterns);
    let found = values_and_gradients_in_states(equilibria, solved, forms, |_, fields| value_and_slopes(goal, fields))?;
    let each = found.into_iter().zip(patterns);
    let derived = |(found, pattern): (Option<ValueAndGradients>, &Pattern)| {
        let (value, mut forms) = found?;
        let coverage = shares.and_then(|_| forms.pop()).unwrap_or_default();
        let in_states = states.iter().zip(forms.iter().flatten());
        let in_states: Vec<(&Scene, Vec<f64>)> = in_states
            .map(|(state, gradient)| (state, of_groups(pattern, gradient, state.groups())))
            .collect();
        let of = |parameter: &Parameter| derivative(*parameter, scene, &in_states);
        Some(ValueAndDerivatives {
            value,
            parameters: parameters.iter().map(of).collect(),
            coverage: sum_of_states(&coverage),
        })
    };
    Ok(each.map(derived).collect())
}

/// Sums the derivatives with respect to the cells of each electrode group.
fn of_groups(pattern: &Pattern, gradient: &[f64], groups: usize) -> Vec<f64> {
    let columns = pattern.raster().columns();
    let mut sums = vec![0.0; groups];
    for (at, of_cell) in gradient.iter().enumerate() {
        let group = usize::from(pattern.group(at % columns, at / columns));
        if let Some(sum) = group.checked_sub(1).and_then(|group| sums.get_mut(group)) {
            *sum += of_cell;
        }
    }
    sums
}

/// Returns the derivative with respect to a parameter from dJ/dS, summed over the cells of each group in each state.
fn derivative(parameter: Parameter, scene: &Scene, states: &[(&Scene, Vec<f64>)]) -> Vec<f64> {
    let of_kappa = || states.iter().map(of_logarithm).sum::<f64>();
    match parameter {
        Parameter::Voltage => states.iter().flat_map(of_voltages).collect(),
        Parameter::ShearModulus => vec![-of_kappa() / scene.shear_modulus_pa()],
        Parameter::RelativePermittivity => vec![of_kappa() / scene.material.relative_permittivity.to_f64()],
        Parameter::Thickness => vec![-2.0 * of_kappa() / scene.thickness_mm()],
    }
}

/// Returns dJ/dV of each electrode group in a state.
fn of_voltages((state, groups): &(&Scene, Vec<f64>)) -> Vec<f64> {
    let largest = state.voltage_v();
    if largest <= 0.0 {
        // Without a voltage the membrane is at rest, where the derivative is 0.
        return vec![0.0; groups.len()];
    }
    let volts = state.drive.voltages.in_volts().into_iter();
    volts
        .zip(groups)
        .map(|(volts, sum)| 2.0 * volts / largest.powi(2) * sum)
        .collect()
}

/// Returns dJ/d ln κ in a state.
fn of_logarithm((state, groups): &(&Scene, Vec<f64>)) -> f64 {
    let loads = state.group_loads();
    loads.iter().zip(groups).map(|(load, sum)| load * sum).sum()
}

/// Checks that there is a derivative with respect to a parameter.
fn check(scene: &Scene, parameter: Parameter, goal: &Goal) -> Result<(), CliError> {
    let refused = |why: String| {
        let message = format!("there is no derivative with respect to `{}` {why}", parameter.name());
        Err(CliError::bad_input(message))
    };
    if scene.drive.charge.is_some() {
        return refused("where the charge is given".to_owned());
    }
    let effects = resolve(scene)?.effects;
    let mut others = Effects {
        // Equilibria do not depend on them.
        dielectric_breakdown: None,
        viscoelasticity: None,
        inertia: None,
        electrode_resistance: None,
        electromechanical_stability: None,
        ..effects
    };
    if parameter == Parameter::Voltage {
        (others.strain_stiffening, others.stretch_dependent_permittivity) = (None, None);
    }
    if !others.is_empty() {
        return refused(format!("with the effects {}", others.to_text()));
    }
    if parameter == Parameter::Voltage {
        return Ok(());
    }
    let geometry = &scene.geometry;
    let is_pushed = |body: &Body| body.load.is_some() || body.spring.is_some();
    if geometry.sides.is_some() || geometry.bodies.iter().flatten().any(is_pushed) {
        return refused("where sides are not held, or bodies have a `load` or a `spring`".to_owned());
    }
    match goal.is_reaction() {
        true => refused("of a `reaction`".to_owned()),
        false => Ok(()),
    }
}
