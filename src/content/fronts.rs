//! The search of a front in the artifact of a design stage, whose rows are the points of the front.

use super::element::Packed;
use super::macros::arrays;
use super::part::LongTexts;
use deaflow_field::CHARGE_UNIT;

arrays! {
    /// The points of a front, and the course of its search.
    #[derive(Default)]
    pub struct Fronts, FrontsView {
        /// Limit of each requested point, ascending: of the area, or of the charge in nC; none of the genetic
        /// algorithm.
        limit: Vec<f64> = array("limit", "1", [limit]),
        /// What became of it: `found`, the design that is at least as good, or why there is none.
        outcome: LongTexts = array("outcome", "", [limit]),
        /// What the objective of each design gains over the membrane at rest: the displacement along the directions, or
        /// by how much the targets are nearer.
        gain: Vec<f64> = array("gain", "mm", [row]),
        /// If the second objective is the charge, the charge on the electrodes of each design.
        charge: Option<Vec<f64>> = array("charge", "nC", [row]),
        /// Area of the reference of the hypervolume, or its charge in nC; its gain is 0.
        reference: Option<Vec<f64>> = array("reference", "1", [target]),
        /// Number of simulated patterns whenever the front grew.
        simulations: Vec<u64> = array("simulations", "1", [growth]),
        /// Hypervolume of the designs so far: gain times area fraction, or gain times charge in mm nC, or the product
        /// of all objectives.
        hypervolume: Vec<f64> = array("hypervolume", "mm", [growth]),
        /// The objectives of a front of the genetic algorithm.
        objectives: Option<FrontObjectives> = group("objectives"),
    }
}

arrays! {
    /// Two or three objectives of a front, and their values.
    #[derive(Default)]
    pub struct FrontObjectives, FrontObjectivesView {
        /// Each objective in YAML.
        objective: LongTexts = array("objective", "", [objective]),
        /// Unit of its values.
        unit: Vec<String> = array("unit", "", [objective]),
        /// Reference of the hypervolume in each objective, in this unit.
        reference: Vec<f64> = array("reference", "1", [objective]),
        /// Values of each design, in these units: what an objective gains over the membrane at rest, area or charge.
        values: Packed<f64> = array("values", "1", [row, objective]),
    }
}

impl Fronts {
    /// Returns the unit of the hypervolume, if that of the first objective is `unit`: the product of the units of all
    /// objectives, such as `mm`, `mm nC` or `mm^2`.
    #[must_use]
    pub fn hypervolume_unit(&self, unit: &str) -> String {
        let Some(objectives) = &self.objectives else {
            return match self.charge {
                Some(_) => format!("{unit} {CHARGE_UNIT}"),
                None => unit.to_owned(),
            };
        };
        let mut powers: Vec<(&str, usize)> = Vec::new();
        for unit in objectives.unit.iter().filter(|unit| *unit != "1") {
            match powers.iter_mut().find(|(known, _)| known == unit) {
                Some((_, power)) => *power += 1,
                None => powers.push((unit, 1)),
            }
        }
        let factors = powers.into_iter().map(|(unit, power)| match power {
            1 => unit.to_owned(),
            power => format!("{unit}^{power}"),
        });
        factors.collect::<Vec<_>>().join(" ")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_unit_of_a_hypervolume_is_the_product_of_those_of_the_objectives() {
        let charge = Fronts {
            charge: Some(Vec::new()),
            ..Fronts::default()
        };
        assert_eq!(Fronts::default().hypervolume_unit("mN"), "mN");
        assert_eq!(charge.hypervolume_unit("mm"), "mm nC");
        for (units, product) in [
            (&["mm", "1"][..], "mm"),
            (&["mm", "mm", "1"], "mm^2"),
            (&["mm", "1", "nC"], "mm nC"),
            (&["mN", "mN", "mN"], "mN^3"),
        ] {
            let objectives = FrontObjectives {
                unit: units.iter().map(|unit| (*unit).to_owned()).collect(),
                ..FrontObjectives::default()
            };
            let front = Fronts {
                objectives: Some(objectives),
                ..charge.clone()
            };
            assert_eq!(front.hypervolume_unit("mm"), product);
        }
    }
}
