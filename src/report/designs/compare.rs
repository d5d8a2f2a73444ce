//! Comparison of a design with the intuitive designs, at its own and at equal area, and with the best of the gradient
//! search.

use std::cmp::Ordering;

use super::design::{Comparison, Design, LEAST_MM, SAME_AREA};
use super::objective::Objective;
use crate::format::{change, percents, signed, three};
use deaflow_content::is_met;
use deaflow_field::NO_FIELD;
use deaflow_pattern::{Role, largest_area};

/// What a gradient search gives. It is no bound: other starts may find more, and so may other constraints, such as
/// another area.
const SAME: &str = "the best pattern found by gradient search under the same constraints";

/// The same for a pattern that was searched under other constraints, or does not meet its own.
const OTHER: &str = "the best pattern found by gradient search under other constraints";

/// If the gains at equal area and at its own area differ by more than this, both are reported.
const GAIN_DIFFERENCE: f64 = 0.05;

/// A pattern, as it is compared with the others of its target.
pub(crate) struct Compared<'d> {
    pub role: Role,
    pub units: u64,
    pub area: f64,
    pub simulated_mm: Option<f64>,
    /// The estimated error of the simulation, if it is known.
    pub error_mm: Option<f64>,
    /// The displacement to be reached, mm.
    pub value_mm: Option<f64>,
    /// Whether a given displacement is to be reached, so that a larger one is not better.
    pub is_met: bool,
    /// The area of the target, as written in files.
    pub area_target: &'d str,
    pub constraints: &'d str,
    pub status: &'d str,
}

/// Compares all designs with each other.
pub fn compare(designs: &mut [Design]) {
    let compared: Vec<Comparison> = designs.iter().map(|design| of(design, designs)).collect();
    for (design, compared) in designs.iter_mut().zip(compared) {
        design.compared = compared;
    }
}

fn of(design: &Design, all: &[Design]) -> Comparison {
    let same: Vec<Compared<'_>> = all
        .iter()
        .filter(|other| design.has_same_target(other))
        .map(compared)
        .collect();
    comparison(&compared(design), &same)
}

fn compared(design: &Design) -> Compared<'_> {
    Compared {
        role: design.role,
        units: design.units,
        area: design.area,
        simulated_mm: design.simulated_mm,
        error_mm: design.error_mm,
        value_mm: design.objective.value_mm,
        is_met: design.objective.is_met,
        area_target: &design.area_target,
        constraints: &design.constraints,
        status: &design.status,
    }
}

/// Compares a pattern with all of its target.
pub(crate) fn comparison(own: &Compared<'_>, all: &[Compared<'_>]) -> Comparison {
    let distance = |other: &Compared<'_>| (other.area - own.area).abs();
    let nearest = |role: Role| {
        let of_role = all.iter().filter(|other| other.role == role);
        of_role.min_by(|a, b| distance(a).total_cmp(&distance(b)))
    };
    let equal = nearest(Role::IntuitiveEqualArea).filter(|other| distance(other) <= SAME_AREA);
    let intuitive = [nearest(Role::Intuitive), equal];
    let best = optimum(own, all);
    // An intuitive design at its own area may have a larger one than the optimum.
    let has_ratio = !own.is_met && own.role != Role::Intuitive;
    let both = best.filter(|_| has_ratio).zip(own.simulated_mm);
    // The ratio to a displacement that is tiny, or the other way, means nothing.
    let ratio = both
        .filter(|((_, mm), own_mm)| *mm > LEAST_MM && *own_mm >= 0.0)
        .map(|((_, mm), own_mm)| own_mm / mm);
    let difference_mm = both
        .filter(|((_, mm), own_mm)| own_mm * mm < 0.0)
        .map(|((_, mm), own_mm)| own_mm - mm);
    let is_compared = ratio.is_some() || difference_mm.is_some();
    let [intuitive_own, intuitive_equal_area] = intuitive.map(|other| other?.simulated_mm);
    let gains = intuitive.map(|other| gain(own, other?));
    let areas = intuitive.map(|other| other.map(|other| other.area));
    // One that violates its constraints itself is compared with any.
    let is_strict = own.status.is_empty() || is_met(own.status);
    let violating = intuitive.map(|other| is_strict && other.is_some_and(|other| !other.is_feasible()));
    let has_feasible = all.iter().any(|other| other.role.is_intuitive() && other.is_feasible());
    let has_gain = gains.iter().any(Option::is_some);
    Comparison {
        intuitive_own,
        intuitive_equal_area,
        over: [0, 1].map(|over| {
            Some(OverIntuitive {
                gain: gains[over]?,
                area: areas[over]?,
                is_violating: violating[over],
            })
        }),
        is_incomparable: is_strict && has_gain && !has_feasible,
        optimum: best.map(|(_, mm)| mm),
        ratio,
        difference_mm,
        optimum_is: best.filter(|_| is_compared).map(|(best, _)| best_found(own, best)),
    }
}

impl Compared<'_> {
    /// Whether a pattern that is drawn for comparison satisfies the constraints of the target, a largest area among
    /// them. The intuitive design at its own area need not have the area of the target: a gain over it is stated with
    /// its area.
    pub fn is_feasible(&self) -> bool {
        // Without a field, the evaluator says nothing about constraints.
        let is_known = !self.status.is_empty() && !self.status.starts_with(NO_FIELD);
        (!is_known || is_met(self.status)) && !exceeds(self.area, self.area_target)
    }
}

/// Whether an area is larger than the largest one of a target.
pub(crate) fn exceeds(area: f64, target: &str) -> bool {
    largest_area(target).is_some_and(|largest| area > largest + SAME_AREA)
}

/// Returns the gain of a pattern over another one; `None` if a given displacement is to be reached, as a larger one is
/// not better then, or if the pattern is only drawn for comparison.
fn gain(own: &Compared<'_>, other: &Compared<'_>) -> Option<Gain> {
    let own_mm = own.simulated_mm.filter(|_| own.role.is_compared() && !own.is_met)?;
    Some(Gain::over(own_mm, other.simulated_mm?, other.error_mm))
}

impl Comparison {
    /// Returns the gains over the intuitive designs at its own and at equal area; none over one that violates the
    /// constraints.
    pub(crate) fn gains(self) -> [Option<Gain>; 2] {
        self.over
            .map(|over| over.filter(|over| !over.is_violating).map(|over| over.gain))
    }

    /// Says how near the pattern comes to the optimum: the share of it, or the difference in the unit of the values if
    /// they move in opposite directions; `None` if neither is known.
    #[must_use]
    pub fn to_optimum(self, objective: &Objective) -> Option<String> {
        let optimum = self.optimum_is?;
        match (self.ratio, self.difference_mm) {
            (Some(ratio), _) => Some(format!("{} of {optimum}", percents(ratio))),
            (None, Some(difference)) => Some(format!("{} {optimum}", Gain::Difference(difference).than(objective))),
            (None, None) => None,
        }
    }

    /// Says how much more than the intuitive designs a pattern of this area reaches: first than that of the same area,
    /// even if that violates constraints, then than the other one with its area, unless that violates constraints.
    #[must_use]
    pub fn over_intuitive(self, area: f64, objective: &Objective) -> Vec<String> {
        let [own, equal] = self.over;
        let is_same = |other: f64| (other - area).abs() <= SAME_AREA;
        let sentence = |over: OverIntuitive| {
            let than = over.gain.than(objective);
            let which = match (is_same(over.area), over.is_violating) {
                (true, false) => " of the same area".to_owned(),
                (true, true) => " of the same area, which violates constraints".to_owned(),
                (false, _) => {
                    let [other, area] = [over.area, area].map(percents);
                    format!(", which covers {other} of the membrane instead of {area}")
                }
            };
            format!("{than} the intuitive design{which}")
        };
        let is_other = |own: &OverIntuitive| equal.is_none() || !is_same(own.area);
        let own = own.filter(|own| !own.is_violating && is_other(own));
        equal.into_iter().chain(own).map(sentence).collect()
    }

    /// Writes the gains over the intuitive designs for a table: first that at equal area, as in
    /// [`Self::over_intuitive`].
    #[must_use]
    pub fn gains_text(self, objective: &Objective) -> Option<String> {
        let [own, equal] = self.over;
        let own = own.filter(|own| !own.is_violating);
        let own = own.map(|own| format!("{} at its area of {}", own.gain.text(objective), percents(own.area)));
        let equal = equal.map(|equal| {
            let violates = if equal.is_violating {
                ", which violates constraints"
            } else {
                ""
            };
            format!("{} at equal area{violates}", equal.gain.text(objective))
        });
        let both: Vec<String> = equal.into_iter().chain(own).collect();
        (!both.is_empty()).then(|| format!("gain over the intuitive design {}", both.join(", ")))
    }

    /// Whether the gain over the intuitive design at its own area adds much to that at equal area.
    #[must_use]
    pub fn has_two_gains(self) -> bool {
        match self.over {
            [Some(own), Some(equal)] => equal.is_violating || own.gain.differs_from(equal.gain),
            _ => false,
        }
    }

    /// Says that no intuitive design satisfies the constraints; `None` if one does.
    #[must_use]
    pub fn without_intuitive(&self) -> Option<&'static str> {
        self.is_incomparable
            .then_some("no intuitive design satisfies the constraints")
    }

    /// Writes the same as a cell of a table: `97.5 %`, or `−3.00 mm`.
    #[must_use]
    pub fn share_text(self, objective: &Objective) -> Option<String> {
        let difference = |value: f64| Gain::Difference(value).text(objective);
        let share = self.ratio.map(percents);
        share.or_else(|| self.difference_mm.map(difference))
    }
}

/// Returns the best of the optima with its displacement: the largest one, or the one nearest to the target value.
fn optimum<'o>(own: &Compared<'_>, all: &'o [Compared<'o>]) -> Option<(&'o Compared<'o>, f64)> {
    let badness = |mm: f64| own.value_mm.map_or(-mm, |value| (mm - value).abs());
    let best = |same_units: bool| {
        let optima = all.iter().filter(|other| other.role == Role::Optimum);
        let fitting = optima.filter(|other| !same_units || other.units == own.units);
        let values = fitting.filter_map(|other| Some((other, other.simulated_mm?)));
        values.min_by(|a, b| badness(a.1).total_cmp(&badness(b.1)))
    };
    best(true).or_else(|| best(false))
}

/// Says what an optimum is to a pattern. An empty status says nothing against a pattern.
fn best_found(own: &Compared<'_>, optimum: &Compared<'_>) -> &'static str {
    let is_within = |pattern: &Compared<'_>| matches!(pattern.status, "" | "met");
    match own.constraints == optimum.constraints && is_within(own) && is_within(optimum) {
        true => SAME,
        false => OTHER,
    }
}

/// Below this share of the largest displacement of a target, a difference between prediction and simulation is relative
/// to that share: the direction of a pattern that hardly moves is not what an evaluator has to predict.
const LEAST_SHARE: f64 = 0.1;

/// Returns the difference between prediction and simulation as a fraction of the simulated displacement, or of a tenth
/// of the largest one of the target; `None` if that is less than a micrometre.
pub(crate) fn prediction_error(difference_mm: f64, simulated_mm: f64, largest_mm: f64) -> Option<f64> {
    let scale_mm = simulated_mm.abs().max(LEAST_SHARE * largest_mm);
    (scale_mm > LEAST_MM).then_some((difference_mm / scale_mm).abs())
}

/// How much more a pattern reaches than another one.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Gain {
    /// As a fraction of what the other one reaches.
    Fraction(f64),
    /// The difference, in the unit of the values: the other one moves the other way, or by less than its error, and a
    /// fraction of that means nothing.
    Difference(f64),
}

impl Gain {
    /// Returns the gain over a pattern with a value and its error, if that is known.
    pub fn over(own_mm: f64, other_mm: f64, error_mm: Option<f64>) -> Self {
        let difference = own_mm - other_mm;
        match other_mm > LEAST_MM.max(error_mm.unwrap_or(0.0)) {
            true => Self::Fraction(difference / other_mm),
            false => Self::Difference(difference),
        }
    }

    /// Returns the fraction, if it is one.
    pub fn fraction(self) -> Option<f64> {
        match self {
            Self::Fraction(fraction) => Some(fraction),
            Self::Difference(_) => None,
        }
    }

    /// Returns the difference in the unit of the values, if it is one.
    pub fn difference(self) -> Option<f64> {
        match self {
            Self::Fraction(_) => None,
            Self::Difference(difference) => Some(difference),
        }
    }

    /// Writes it with its sign: `+25.0 %`, or `+1.99 mm`.
    pub fn text(self, objective: &Objective) -> String {
        match self {
            Self::Fraction(fraction) => change(fraction),
            Self::Difference(difference) => {
                let number = three(objective.shown(difference));
                format!("{} {}", signed(number, difference), objective.shown_unit())
            }
        }
    }

    /// Writes it in words, to be followed by what it is a gain over: `25.0 % more than`, `1.99 mm less than`.
    fn than(self, objective: &Objective) -> String {
        let (size, more) = match self {
            Self::Fraction(fraction) => (percents(fraction.abs()), fraction),
            Self::Difference(difference) => {
                let number = three(objective.shown(difference.abs()));
                (format!("{number} {}", objective.shown_unit()), difference)
            }
        };
        match more.partial_cmp(&0.0) {
            Some(Ordering::Equal) => "as much as".to_owned(),
            Some(Ordering::Less) => format!("{size} less than"),
            _ => format!("{size} more than"),
        }
    }

    /// Whether it is worth to be stated beside another gain.
    pub fn differs_from(self, other: Self) -> bool {
        match (self, other) {
            (Self::Fraction(own), Self::Fraction(other)) => (own - other).abs() > GAIN_DIFFERENCE,
            _ => self != other,
        }
    }
}

/// The comparison with one of the intuitive designs.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct OverIntuitive {
    pub gain: Gain,
    /// The area of the intuitive design, a share of the free membrane.
    pub area: f64,
    /// Whether that design violates the constraints of the target, which the compared one satisfies.
    pub is_violating: bool,
}

#[cfg(test)]
pub(crate) mod tests {
    use std::sync::Arc;

    use super::*;
    use crate::artifacts::StageArtifact;
    use crate::designs::{Objective, role_word};
    use crate::drawing::Background;
    use deaflow_base::ArtifactId;
    use deaflow_pattern::{Membrane, Pattern, Raster};
    use deaflow_scene::Scene;

    /// A design of case `I` without fields.
    pub(crate) fn design(role: Role, units: u64, simulated_mm: Option<f64>) -> Design {
        Design {
            name: format!("I-centre-{}", role_word(role)),
            made: StageArtifact {
                stage: "verified".into(),
                kind: "verify".into(),
                digest: ArtifactId::of(b"verified"),
            },
            case: "I".into(),
            target: "centre".into(),
            role,
            member: 0,
            units,
            setting: String::new(),
            objective: Objective::read("{ point: [25, 25], direction: 0 }", &Scene::vhb4910()).unwrap(),
            area_target: "0.5".into(),
            area: 0.5,
            constraints: "{}".into(),
            status: "met".into(),
            scene: Arc::new(Scene::vhb4910()),
            background: Background::plain(Membrane::square(50.0)),
            pattern: Pattern::from_fn(Raster::PAPER, |_, _| true),
            predicted: Some(vec![0.0; 5202]),
            simulated: None,
            heights: None,
            states: Vec::new(),
            predicted_mm: Some(1.0),
            robust_mm: None,
            simulated_mm,
            error_mm: None,
            distance_mm: None,
            interval: None,
            outcome: None,
            compared: Comparison::default(),
            front: None,
        }
    }

    #[test]
    fn an_optimum_on_the_same_units_is_preferred() {
        let mut designs = vec![
            design(Role::Ga, 20, Some(1.8)),
            design(Role::Refined, 50, Some(1.9)),
            design(Role::Optimum, 20, Some(1.85)),
            design(Role::Optimum, 50, Some(2.0)),
            design(Role::Intuitive, 50, Some(1.5)),
            design(Role::IntuitiveEqualArea, 50, Some(1.6)),
            design(Role::Intuitive, 50, None),
        ];
        designs[6].target = "other".into();
        compare(&mut designs);
        assert_eq!(designs[0].compared.optimum, Some(1.85));
        assert_eq!(designs[1].compared.optimum, Some(2.0));
        assert_eq!(designs[1].compared.ratio, Some(0.95));
        assert_eq!(
            (designs[4].compared.ratio, designs[5].compared.ratio),
            (None, Some(0.8)),
            "own and equal area"
        );
        assert_eq!(designs[1].compared.intuitive_own, Some(1.5));
        assert_eq!(designs[1].compared.intuitive_equal_area, Some(1.6));
        assert_eq!(designs[6].compared, Comparison::default());

        designs.remove(2);
        compare(&mut designs);
        assert_eq!(designs[0].compared.optimum, Some(2.0), "the best there is");
    }

    #[test]
    fn a_ratio_to_an_optimum_that_hardly_moves_or_moves_the_other_way_is_a_difference_or_none() {
        for (own, optimum, ratio, difference) in [
            (1.0, 1e-4, None, None),
            (-1.0, -2.0, None, None),
            (-1.0, 2.0, None, Some("3.00 mm less than ")),
            (1.0, -2.0, None, Some("3.00 mm more than ")),
            (-1.0, 5e-4, None, Some("1.00 mm less than ")),
            (0.0, 2.0, Some(0.0), None),
        ] {
            let mut both = vec![
                design(Role::Refined, 50, Some(own)),
                design(Role::Optimum, 50, Some(optimum)),
            ];
            compare(&mut both);
            let found = &both[0].compared;
            assert_eq!(found.ratio, ratio, "{own}, {optimum}");
            assert_eq!(found.difference_mm.is_some(), difference.is_some(), "{own}, {optimum}");
            if let Some(text) = difference {
                assert_eq!(found.to_optimum(&both[0].objective), Some(format!("{text}{SAME}")));
            }
        }
    }

    #[test]
    fn a_gain_over_a_pattern_that_moves_by_less_than_its_error_is_a_difference() {
        for (other, error, gain) in [
            (0.02, None, Gain::Fraction(99.0)),
            (0.02, Some(0.05), Gain::Difference(1.98)),
            (-0.1, Some(0.01), Gain::Difference(2.1)),
        ] {
            let mut both = vec![
                design(Role::Refined, 50, Some(2.0)),
                design(Role::Intuitive, 50, Some(other)),
            ];
            both[1].error_mm = error;
            compare(&mut both);
            assert_eq!(both[0].compared.gains(), [Some(gain), None], "{other} ± {error:?}");
            assert_eq!(both[1].compared.gains(), [None; 2], "over itself");
            assert_eq!(
                both[0].gain_texts(),
                [Some(gain.text(&both[0].objective)), None],
                "as in pages"
            );
        }
    }

    #[test]
    fn the_optimum_is_the_best_found_under_the_constraints_that_a_design_has_and_meets() {
        let is = |change: &dyn Fn(&mut [Design])| {
            let mut both = [
                design(Role::Refined, 50, Some(1.0)),
                design(Role::Optimum, 50, Some(2.0)),
            ];
            change(&mut both);
            compare(&mut both);
            both[0].compared.optimum_is
        };
        assert_eq!(is(&|_| ()), Some(SAME));
        assert_eq!(
            is(&|both| both[0].constraints = "{ min_feature: 3 }".into()),
            Some(OTHER)
        );
        assert_eq!(is(&|both| both[0].status = "area 0.4, wanted 0.5".into()), Some(OTHER));
        assert_eq!(is(&|both| both[1].status = "2 islands".into()), Some(OTHER));
        assert_eq!(is(&|both| both[1].simulated_mm = Some(1e-4)), None, "without a ratio");
        for text in [SAME, OTHER] {
            assert!(!text.contains("optimum"), "{text}");
        }
    }

    #[test]
    fn designs_for_another_objective_area_or_scene_are_not_compared() {
        let found = design(Role::Refined, 50, Some(1.0));
        let optimum = design(Role::Optimum, 50, Some(2.0));
        let compared = |optimum: Design| {
            let mut both = vec![found.clone(), optimum];
            compare(&mut both);
            both[0].compared.ratio
        };
        assert_eq!(compared(optimum.clone()), Some(0.5));
        let mut elsewhere = optimum.clone();
        elsewhere.objective = Objective::read("{ point: [30, 25], direction: 0 }", &Scene::vhb4910()).unwrap();
        let smaller = Design {
            area_target: "0.4".into(),
            ..optimum.clone()
        };
        let weaker = Design {
            scene: Arc::new(Scene::vhb4910().at_voltage(4000.0)),
            ..optimum
        };
        assert_eq!([elsewhere, smaller, weaker].map(compared), [None; 3]);
    }

    #[test]
    fn if_a_value_is_to_be_reached_the_optimum_is_the_nearest_to_it() {
        let mut designs = vec![
            design(Role::Ga, 20, Some(1.01)),
            design(Role::Optimum, 50, Some(1.2)),
            design(Role::Optimum, 50, Some(1.001)),
        ];
        for design in &mut designs {
            design.objective.value_mm = Some(1.0);
        }
        compare(&mut designs);
        assert_eq!(designs[0].compared.optimum, Some(1.001));
    }

    #[test]
    fn of_several_intuitive_designs_the_one_with_equal_area_is_used() {
        let mut designs = vec![
            design(Role::Refined, 50, Some(2.0)),
            design(Role::IntuitiveEqualArea, 50, Some(1.6)),
            design(Role::IntuitiveEqualArea, 50, Some(1.7)),
        ];
        designs[0].area = 0.4;
        designs[2].area = 0.4004;
        compare(&mut designs);
        assert_eq!(designs[0].compared.intuitive_equal_area, Some(1.7));
        // One with another area gives no gain at equal area.
        designs[2].area = 0.41;
        compare(&mut designs);
        assert_eq!(designs[0].compared.intuitive_equal_area, None);
    }
}
