//! The sets of data that can be fitted together.

use crate::creep::CreepCurve;
use crate::curve::{Curve, FitError, Points, Row, Sigma, noise_kind, scales};
use crate::elastomer::{Need, Number, Response};
use crate::field::{FieldData, FieldModel};
use crate::history::HistoryCurve;
use crate::law::LawKind;
use crate::sheet::SheetCurve;
use crate::simulation::{NumberData, Simulator};

/// A set of data with the model to which it belongs. Parameters of equal name are the same in all sets.
#[derive(Clone)]
pub enum DataSet<'a> {
    /// Nominal stress against stretch at equilibrium. The parameters are those of [`LawKind::parameters`].
    Curve(LawKind, Curve),
    /// Nominal stress along a history of stretch, with the parameters of [`crate::Elastomer::parameters`].
    History(HistoryCurve),
    /// Stretch over time at a load, with the parameters of [`crate::Elastomer::parameters`]; with a voltage also
    /// `relative_permittivity` and `voltage_offset` in V, which is 0 if it is not given.
    Creep(CreepCurve),
    /// Stretch against voltage at equilibrium, with the parameters of the law, `relative_permittivity` and
    /// `voltage_offset`.
    Sheet(SheetCurve),
    /// Numbers of a model of the caller.
    Numbers(NumberData<'a>),
    /// Displacements at scattered points with a model of the caller.
    Field(FieldData<'a>),
}

impl DataSet<'_> {
    /// Returns the name.
    #[must_use]
    pub fn name(&self) -> &str {
        match self {
            Self::Curve(_, curve) => &curve.name,
            Self::History(curve) => &curve.name,
            Self::Creep(curve) => &curve.name,
            Self::Sheet(curve) => &curve.name,
            Self::Numbers(data) => &data.name,
            Self::Field(data) => &data.name,
        }
    }
}

/// The noise of a set. Sets of different noise can be fitted together only if both state it.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum Noise {
    Stated,
    Relative,
    /// Equal for all numbers, in this unit.
    Absolute(String),
}

impl Noise {
    fn of(sigma: &Sigma, unit: &str) -> Self {
        match noise_kind(sigma) {
            0 => Self::Stated,
            1 => Self::Relative,
            _ => Self::Absolute(unit.to_owned()),
        }
    }
}

/// The numbers of a set beside its model.
pub(crate) enum Numbers<'a> {
    /// Numbers that are compared one by one.
    Single {
        response: Box<dyn Response + 'a>,
        /// The index of the row of each number.
        rows: Vec<usize>,
        data: Vec<f64>,
        /// The residual is (model − data)/scale.
        scale: Vec<f64>,
        /// The number of rows, those included that say nothing.
        total: usize,
    },
    /// Displacements.
    Field(FieldModel<'a>),
}

/// A set that has been checked.
pub(crate) struct Prepared<'a> {
    pub name: &'a str,
    pub noise: Noise,
    pub numbers: Numbers<'a>,
}

/// The stresses of a law at the rows of a curve.
struct AtEquilibrium {
    law: LawKind,
    rows: Vec<Row>,
}

impl Response for AtEquilibrium {
    fn needs(&self) -> Vec<Need> {
        Need::all(self.law.parameters())
    }

    fn respond(&self, values: &[f64]) -> Option<Vec<Number>> {
        let law = self.law.with(values)?;
        let rows = self.rows.iter();
        rows.map(|row| law.stress_and_gradient(row.test, row.stretch)).collect()
    }
}

impl<'a> Prepared<'a> {
    /// Checks a set.
    ///
    /// # Errors
    /// When a column or a setting of the set is not valid.
    pub fn new(set: &'a DataSet<'a>, is_free: &dyn Fn(&str) -> bool) -> Result<Self, FitError> {
        let law = match set {
            DataSet::Curve(law, _) => Some(*law),
            DataSet::History(HistoryCurve { elastomer, .. }) | DataSet::Creep(CreepCurve { elastomer, .. }) => {
                Some(elastomer.law)
            }
            DataSet::Sheet(curve) => Some(curve.law),
            DataSet::Numbers(_) | DataSet::Field(_) => None,
        };
        if law == Some(LawKind::Ogden(0)) {
            return Err(FitError::NoTerms {
                law: LawKind::Ogden(0).name(),
            });
        }
        match set {
            DataSet::Curve(law, curve) => Self::curve(*law, curve),
            DataSet::History(curve) => {
                let data = (&curve.stress_pa[..], &curve.sigma);
                Self::single(&curve.name, "Pa", "stress", data, Box::new(curve.response()?))
            }
            DataSet::Creep(curve) => {
                let data = (&curve.stretch[..], &curve.sigma);
                Self::single(&curve.name, "1", "stretch", data, Box::new(curve.response()?))
            }
            DataSet::Sheet(curve) => {
                let data = (&curve.stretch[..], &curve.sigma);
                Self::single(&curve.name, "1", "stretch", data, Box::new(curve.response()?))
            }
            DataSet::Numbers(data) => {
                let simulator = Simulator::new(&data.name, &data.simulation, data.measured.len(), is_free);
                // Their unit is not known, so that no other set has it.
                let numbers = (&data.measured[..], &data.sigma);
                Self::single(&data.name, &data.name, "number", numbers, Box::new(simulator))
            }
            DataSet::Field(data) => {
                let model = FieldModel::new(data, is_free)?;
                let noise = match model.stated() {
                    true => Noise::Stated,
                    false => Noise::Absolute("mm".to_owned()),
                };
                let numbers = Numbers::Field(model);
                Ok(Self {
                    name: &data.name,
                    noise,
                    numbers,
                })
            }
        }
    }

    fn single(
        name: &'a str,
        unit: &str,
        column: &'static str,
        (data, sigma): (&[f64], &Sigma),
        response: Box<dyn Response + 'a>,
    ) -> Result<Self, FitError> {
        if data.is_empty() {
            return Err(FitError::NoPoints { set: name.to_owned() });
        }
        Ok(Self {
            name,
            noise: Noise::of(sigma, unit),
            numbers: Numbers::Single {
                response,
                rows: (0..data.len()).collect(),
                data: data.to_vec(),
                scale: scales(name, column, data, sigma)?,
                total: data.len(),
            },
        })
    }

    /// Prepares a curve; rows at stretch 1 say nothing.
    fn curve(law: LawKind, curve: &'a Curve) -> Result<Self, FitError> {
        let points = Points::new(std::slice::from_ref(curve))?;
        let counted: Vec<(usize, Row)> = points
            .rows
            .into_iter()
            .enumerate()
            .filter(|(_, row)| row.counts())
            .collect();
        Ok(Self {
            name: &curve.name,
            noise: Noise::of(&curve.sigma, "Pa"),
            numbers: Numbers::Single {
                rows: counted.iter().map(|(at, _)| *at).collect(),
                data: counted.iter().map(|(_, row)| row.stress).collect(),
                scale: counted.iter().map(|(_, row)| row.scale).collect(),
                response: Box::new(AtEquilibrium {
                    law,
                    rows: counted.into_iter().map(|(_, row)| row).collect(),
                }),
                total: curve.stretch.len(),
            },
        })
    }

    /// Returns the parameters that the set needs.
    pub fn needs(&self) -> Vec<Need> {
        match &self.numbers {
            Numbers::Single { response, .. } => response.needs(),
            Numbers::Field(model) => model.needs(),
        }
    }

    /// Returns the error of a simulation.
    pub fn failure(&self) -> Option<FitError> {
        match &self.numbers {
            Numbers::Single { response, .. } => response.failure(),
            Numbers::Field(model) => model.failure(),
        }
    }

    /// Returns the numbers of the model, without those of curves at rest; none of fields.
    pub fn simulated(&self, values: &[f64]) -> Option<Vec<f64>> {
        match &self.numbers {
            Numbers::Single { response, .. } => Some(
                response
                    .respond(values)?
                    .into_iter()
                    .map(|(number, _)| number)
                    .collect(),
            ),
            Numbers::Field(_) => Some(Vec::new()),
        }
    }

    /// Returns the residuals with their derivatives; `None` without a state.
    pub fn residuals(&self, values: &[f64]) -> Option<Vec<Number>> {
        match &self.numbers {
            Numbers::Field(model) => model.respond(values),
            Numbers::Single {
                response, data, scale, ..
            } => {
                let numbers = response.respond(values)?.into_iter().zip(data.iter().zip(scale));
                let residual = |((value, gradient), (data, scale)): (Number, (&f64, &f64))| {
                    let gradient = gradient.into_iter().map(|slope| slope / scale).collect();
                    ((value - data) / scale, gradient)
                };
                Some(numbers.map(residual).collect())
            }
        }
    }

    /// Returns the sum of the squares of the data in units of the residuals.
    pub fn squares(&self) -> f64 {
        match &self.numbers {
            Numbers::Field(model) => model.squares(),
            Numbers::Single { data, scale, .. } => data.iter().zip(scale).map(|(d, s)| (d / s).powi(2)).sum(),
        }
    }

    /// Returns the number of residuals.
    pub fn count(&self) -> usize {
        match &self.numbers {
            Numbers::Field(model) => model.count(),
            Numbers::Single { data, .. } => data.len(),
        }
    }

    /// Returns how many numbers the model fits by itself.
    pub fn nuisance(&self) -> usize {
        match &self.numbers {
            Numbers::Field(model) => model.motions(),
            Numbers::Single { .. } => 0,
        }
    }
}
