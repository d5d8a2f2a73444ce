//! Derivatives of all models with respect to all their parameters, against central differences.

use crate::data_set::Prepared;
use crate::{CreepCurve, Curve, DataSet, Elastomer, HistoryCurve, LawKind, Load, SheetCurve, Sigma, Test, ViscousLaw};

/// Asserts that the derivatives of the residuals agree with differences at values of the parameters that a set needs.
fn check(set: &DataSet<'_>, values: &[f64], tolerance: f64) {
    let prepared = Prepared::new(set, &|_| true).unwrap();
    let names: Vec<String> = prepared.needs().into_iter().map(|need| need.name).collect();
    assert_eq!(names.len(), values.len(), "{names:?}");
    let rows = prepared.residuals(values).unwrap();
    for (p, name) in names.iter().enumerate() {
        let step = 3e-3 * values[p].abs();
        let moved = |by: f64| -> Vec<f64> {
            let mut values = values.to_vec();
            values[p] += by;
            let rows = prepared.residuals(&values).unwrap();
            rows.into_iter().map(|row| row.0).collect()
        };
        // Of fourth order.
        let [a, b, c, d] = [2.0, 1.0, -1.0, -2.0].map(|factor| moved(factor * step));
        let largest = rows.iter().map(|row| row.1[p].abs()).fold(0.0, f64::max);
        // In pure shear I₁ and I₂ are equal, so that c2 has no effect.
        if name == "c2" && largest == 0.0 {
            continue;
        }
        assert!(largest > 0.0, "{} {name}", set.name());
        for (row, (_, gradient)) in rows.iter().enumerate() {
            let difference = (8.0 * (b[row] - c[row]) - (a[row] - d[row])) / (12.0 * step);
            assert!(
                (gradient[p] - difference).abs() <= tolerance * largest,
                "{} {name} row {row}: {} {difference}",
                set.name(),
                gradient[p]
            );
        }
    }
}

fn elastomers() -> Vec<(Elastomer, Vec<f64>)> {
    let laws = [
        (LawKind::NeoHookean, vec![20e3]),
        (LawKind::Gent, vec![20e3, 60.0]),
        (LawKind::MooneyRivlin, vec![20e3, 1e3]),
        (LawKind::Ogden(2), vec![15e3, 1.6, 4e3, -2.0]),
    ];
    let with = |viscous: ViscousLaw| {
        laws.clone().map(|(law, mut values)| {
            values.extend([40e3, 3.0, 8e3, 0.2]);
            let branches = 2;
            (Elastomer { law, branches, viscous }, values)
        })
    };
    [ViscousLaw::Linear, ViscousLaw::Finite]
        .into_iter()
        .flat_map(with)
        .collect()
}

const HISTORY: [(f64, f64); 6] = [(0.0, 1.0), (2.0, 2.2), (5.0, 2.2), (5.0, 1.4), (6.0, 1.4), (20.0, 1.9)];

fn history(elastomer: Elastomer, test: Test) -> HistoryCurve {
    let time_s = vec![0.5, 2.0, 4.0, 5.0, 5.5, 12.0, 19.0, 40.0];
    HistoryCurve {
        name: format!("history {test:?} {elastomer:?}"),
        elastomer,
        test,
        history: HISTORY.to_vec(),
        stress_pa: vec![10e3; time_s.len()],
        time_s,
        sigma: Sigma::UnstatedRelative,
    }
}

#[test]
fn of_histories() {
    for (elastomer, values) in elastomers() {
        for test in Test::ALL {
            check(&DataSet::History(history(elastomer, test)), &values, 1e-7);
        }
    }
}

#[test]
fn of_creep() {
    let loads = [
        (Test::Uniaxial, Load::Stress(20e3), 0.0),
        (Test::Uniaxial, Load::Stress(-20e3), 0.0),
        (Test::Equibiaxial, Load::Stress(5e3), 9e3),
        (Test::PureShear, Load::Prestretch(1.5), 9e3),
        (
            Test::PureShear,
            Load::Force {
                force_n: 0.3,
                width_m: 0.05,
            },
            -9e3,
        ),
    ];
    for (i, (elastomer, values)) in elastomers().into_iter().enumerate() {
        for (at, (test, load, voltage_v)) in loads.into_iter().enumerate() {
            // Each load with some of the laws, each law with some of the loads.
            if (i + at) % 3 != 0 {
                continue;
            }
            let mut values = values.clone();
            if voltage_v != 0.0 {
                values.extend([4.7, 100.0]);
            }
            let time_s = vec![8.0, 0.0, 0.05, 1.0, 30.0];
            let creep = CreepCurve {
                name: format!("creep {test:?} {load:?} {elastomer:?}"),
                elastomer,
                test,
                load,
                voltage_v,
                thickness_m: 1e-3,
                stretch: vec![1.5; time_s.len()],
                time_s,
                sigma: Sigma::UnstatedAbsolute,
            };
            check(&DataSet::Creep(creep), &values, 1e-7);
        }
    }
}

#[test]
fn of_sheets_and_curves() {
    for (elastomer, values) in elastomers().into_iter().take(4) {
        let law = elastomer.law;
        let mut values = values[..law.parameters().len()].to_vec();
        let stretch = vec![0.8, 1.2, 1.9];
        let curve = Curve {
            name: format!("curve {law:?}"),
            test: Test::PureShear,
            stress_pa: vec![1e4; 3],
            stretch: stretch.clone(),
            sigma: Sigma::UnstatedRelative,
        };
        check(&DataSet::Curve(law, curve), &values, 1e-9);
        values.extend([4.7, 100.0]);
        for (test, load) in [
            (Test::Equibiaxial, Load::Stress(8e3)),
            (Test::PureShear, Load::Prestretch(1.8)),
        ] {
            let sheet = SheetCurve {
                name: format!("sheet {test:?} {law:?}"),
                law,
                test,
                load,
                thickness_m: 1e-3,
                voltage_v: vec![0.0, 3e3, -7e3],
                stretch: stretch.clone(),
                sigma: Sigma::UnstatedAbsolute,
            };
            check(&DataSet::Sheet(sheet), &values, 1e-8);
        }
    }
}
