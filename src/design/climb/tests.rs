use super::*;
use crate::design::{Aim, Constraints, Goal, Limits, Measure, Motion};
use crate::field::{CORNERS, Differentiable, PredictError, Predictor, WithGradient};
use crate::pattern::{CELLS, distance};

/// A membrane whose every point moves along x by Σ worth · active + ½ bend (Σ spread · active)², in mm.
struct Quadratic {
    worth: Vec<f64>,
    spread: Vec<f64>,
    bend: f64,
    /// More active cells than this have no field.
    most: usize,
}

impl Quadratic {
    fn sums(&self, pattern: &Pattern) -> (f64, f64) {
        let active = (0..CELLS * CELLS).filter(|&cell| pattern.cells()[cell] == 1);
        active.fold((0.0, 0.0), |(a, b), cell| (a + self.worth[cell], b + self.spread[cell]))
    }

    fn value(&self, pattern: &Pattern) -> f64 {
        let (linear, spread) = self.sums(pattern);
        linear + 0.5 * self.bend * spread * spread
    }

    fn field(&self, pattern: &Pattern) -> Field {
        Field::from_values([self.value(pattern), 0.0].repeat(CORNERS * CORNERS)).unwrap()
    }
}

impl Predictor for Quadratic {
    fn predict(&self, patterns: &[Pattern]) -> Result<Vec<Field>, PredictError> {
        Ok(patterns.iter().map(|pattern| self.field(pattern)).collect())
    }

    fn predict_some(&self, patterns: &[Pattern]) -> Result<Vec<Option<Field>>, PredictError> {
        let some = |pattern: &Pattern| (pattern.active_cells() <= self.most).then(|| self.field(pattern));
        Ok(patterns.iter().map(some).collect())
    }
}

impl Differentiable for Quadratic {
    fn gradient(
        &self,
        pattern: &Pattern,
        slope: &dyn Fn(&Field) -> Field,
    ) -> Result<Option<WithGradient>, PredictError> {
        if pattern.active_cells() > self.most {
            return Ok(None);
        }
        let field = self.field(pattern);
        let along: f64 = slope(&field).values().iter().step_by(2).sum();
        let (_, spread) = self.sums(pattern);
        let cell = |(worth, own): (&f64, &f64)| along * (worth + self.bend * spread * own);
        let gradient = self.worth.iter().zip(&self.spread).map(cell).collect();
        Ok(Some((field, gradient)))
    }
}

fn goal(motion: Motion) -> Goal {
    let aim = Aim {
        point_mm: [25.0, 25.0],
        motion,
        weight: 1.0,
    };
    let measure = match motion {
        Motion::Along(_) => Measure::Displacement,
        Motion::By(..) | Motion::To(_) => Measure::Distance,
    };
    Goal::new(measure, &[aim], 50.0, None, 0.0).unwrap()
}

fn linear() -> Quadratic {
    Quadratic {
        worth: (0..2500)
            .map(|cell| ((cell * 37 % 2500) as f64 - 999.5) * 1e-6)
            .collect(),
        spread: vec![0.0; 2500],
        bend: 0.0,
        most: 2500,
    }
}

fn half() -> Pattern {
    Pattern::from_fn(|x, _| x < 25)
}

#[test]
fn the_optimum_of_a_linear_membrane_is_found_from_anywhere() {
    let (physics, goal) = (linear(), goal(Motion::Along(0.0)));
    for (area, cells) in [
        ((0.5, 0.5), 1250),
        ((0.0, 1.0), 1500),
        ((0.05, 0.055), 137),
        ((0.7, 0.8), 1750),
    ] {
        let mut worth = physics.worth.clone();
        worth.sort_by(|a, b| b.total_cmp(a));
        let best: f64 = worth[..cells].iter().sum();
        for start in [half(), Pattern::from_fn(|_, _| false), Pattern::from_fn(|_, _| true)] {
            let none = Constraints::default();
            let terrain = Terrain::new(&physics, &goal, 50, area, &none);
            let climb = terrain.climb(&start, &|_| ()).unwrap().unwrap();
            assert_eq!(climb.pattern.active_cells(), cells);
            assert!((climb.merit * 2.5 - best).abs() < 1e-9 && climb.exhausted);
            assert!(climb.steps.windows(2).all(|pair| pair[0].merit < pair[1].merit));
        }
    }
}

#[test]
fn no_exchange_of_two_units_improves_what_a_climb_ends_with() {
    // Concave: what a cell is worth depends on all others, and a few hundred exchanges are needed from anywhere.
    let physics = Quadratic {
        spread: (0..2500)
            .map(|cell| ((cell * 53 % 1009) as f64 - 300.0) * 3e-6)
            .collect(),
        bend: -0.3,
        ..linear()
    };
    let goal = goal(Motion::Along(0.0));
    for side in [20, 50] {
        let none = Constraints::default();
        let terrain = Terrain::new(&physics, &goal, side, (0.495, 0.505), &none);
        let climb = terrain.climb(&half(), &|_| ()).unwrap().unwrap();
        assert!(climb.exhausted && (1238..=1262).contains(&climb.pattern.active_cells()));
        let on = terrain.units().of(&climb.pattern);
        let turned = |units: [usize; 2]| {
            let mut other = on.clone();
            units.iter().for_each(|&unit| other[unit] = !other[unit]);
            terrain.units().pattern(&other)
        };
        let mut gained = 0;
        for k in 0..20_000 {
            let pair = [k * 7919 % on.len(), k * 104_729 / 7 % on.len()];
            let other = turned(pair);
            if pair[0] == pair[1] || !(1238..=1262).contains(&other.active_cells()) {
                continue;
            }
            gained += usize::from(physics.value(&other) / 2.5 > climb.merit + 1e-6);
        }
        assert_eq!(gained, 0, "{side}");
    }
}

#[test]
fn a_wanted_value_is_met() {
    let (physics, goal) = (linear(), goal(Motion::By(0.0, 0.1)));
    let none = Constraints::default();
    let terrain = Terrain::new(&physics, &goal, 50, (0.5, 0.5), &none);
    let climb = terrain.climb(&half(), &|_| ()).unwrap().unwrap();
    assert!((physics.value(&climb.pattern) - 0.1).abs() < 1e-3, "{}", climb.merit);
}

#[test]
fn there_is_no_climb_where_nothing_has_a_field() {
    let physics = Quadratic { most: 1000, ..linear() };
    let goal = goal(Motion::Along(0.0));
    let none = Constraints::default();
    let at = |area| {
        let terrain = Terrain::new(&physics, &goal, 50, area, &none);
        terrain.climb(&half(), &|_| ()).unwrap()
    };
    assert!(at((0.5, 0.5)).is_none());
    // Towards the edge of stability the climb stops before it.
    let climb = at((0.0, 0.4)).unwrap();
    assert!(climb.pattern.active_cells() == 1000);
}

/// A membrane whose left side is worth most, as smoothly as a real one.
fn smooth() -> Quadratic {
    let worth = |cell: usize| ((cell % 50) as f64 / 50.0 * 3.0).cos() * (1.0 + 0.3 * (cell / 50) as f64 / 50.0) * 1e-3;
    Quadratic {
        worth: (0..2500).map(worth).collect(),
        ..linear()
    }
}

#[test]
fn several_designs_differ_as_much_as_they_must_and_lose_little() {
    let (physics, goal, none) = (smooth(), goal(Motion::Along(0.0)), Constraints::default());
    let mut found: Vec<Pattern> = Vec::new();
    let mut merits = Vec::new();
    for _ in 0..4 {
        let terrain = Terrain::new(&physics, &goal, 50, (0.45, 0.55), &none).apart_from(&found, 0.05);
        let climb = terrain.climb(&half(), &|_| ()).unwrap().unwrap();
        assert!(found.iter().all(|other| distance(other, &climb.pattern) >= 0.05));
        merits.push(climb.merit);
        found.push(climb.pattern);
    }
    assert!(
        merits[1..]
            .iter()
            .all(|merit| *merit < merits[0] && *merit > 0.97 * merits[0]),
        "{merits:?}"
    );
}

#[test]
fn constraints_are_kept_all_the_way() {
    let (physics, goal) = (smooth(), goal(Motion::Along(0.0)));
    let limits = Limits {
        min_feature_mm: Some(4.0),
        islands: Some(1),
        ..Limits::default()
    };
    let constraints = Constraints::new(limits, 50.0).unwrap();
    let terrain = Terrain::new(&physics, &goal, 50, (0.39, 0.41), &constraints);
    let scattered = Pattern::from_fn(|x, y| (x * 7 + y * 11) % 5 < 2);
    for start in [half(), scattered] {
        let climb = terrain.climb(&start, &|_| ()).unwrap().unwrap();
        assert!(constraints.hold(&climb.pattern) && climb.exhausted);
        assert!((0.39..=0.41).contains(&climb.pattern.area_fraction()));
        let free = Constraints::default();
        let without = Terrain::new(&physics, &goal, 50, (0.39, 0.41), &free);
        let best = without.climb(&start, &|_| ()).unwrap().unwrap().merit;
        assert!(
            climb.merit <= best && climb.merit > 0.9 * best,
            "{} {best}",
            climb.merit
        );
    }
}

#[test]
fn what_is_not_admitted_is_not_taken() {
    struct FewOnTheRight;
    impl crate::design::Admission for FewOnTheRight {
        fn admissible(&self, patterns: &[Pattern]) -> Result<Vec<bool>, PredictError> {
            let few = |pattern: &Pattern| (0..50).filter(|&y| pattern.is_active(30, y)).count() <= 10;
            Ok(patterns.iter().map(few).collect())
        }
    }
    let physics = Quadratic {
        worth: (0..2500).map(|cell| (cell % 50) as f64 * 1e-5).collect(),
        ..linear()
    };
    let (goal, none) = (goal(Motion::Along(0.0)), Constraints::default());
    let terrain = Terrain::new(&physics, &goal, 50, (0.5, 0.5), &none);
    assert!(
        terrain
            .climb(&half(), &|_| ())
            .unwrap()
            .unwrap()
            .pattern
            .is_active(30, 0)
    );
    let terrain = terrain.admitting(Some(&FewOnTheRight));
    let climb = terrain.climb(&half(), &|_| ()).unwrap().unwrap();
    assert_eq!((0..50).filter(|&y| climb.pattern.is_active(30, y)).count(), 10);
}
