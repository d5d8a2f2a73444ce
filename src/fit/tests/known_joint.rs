//! Joint fits against the answers of an independent program (closed forms, Runge–Kutta integration with a relative
//! error of 10⁻¹⁰, and scipy's trust-region method, in Python).

use super::noise::deviate;
use crate::data_set::Prepared;
use crate::{
    CreepCurve, Curve, DataSet, Elastomer, FitError, FreeParameter, HistoryCurve, JointFit, JointOptions, Law, LawKind,
    Load, Profiles, SheetCurve, Sigma, Test, Verdict, ViscousLaw, fit_together,
};

fn near(number: f64, known: f64, relative: f64) {
    assert!((number / known - 1.0).abs() <= relative, "{number}, not {known}");
}

/// Returns the numbers of a set at values of the parameters that it needs.
fn numbers(set: &DataSet<'_>, values: &[f64]) -> Vec<f64> {
    let prepared = Prepared::new(set, &|_| true).unwrap();
    let rows = prepared.residuals(values).unwrap();
    rows.into_iter().map(|row| row.0).collect()
}

fn modulus(name: &str, start: f64) -> FreeParameter {
    FreeParameter::positive(name, start, 1.0, 1e9)
}

fn fixed(values: &[(&str, f64)]) -> JointOptions {
    JointOptions {
        fixed: values
            .iter()
            .map(|(name, value)| ((*name).to_owned(), *value))
            .collect(),
        profiles: Profiles::Never,
        more_starts: Vec::new(),
    }
}

fn viscous(viscous: ViscousLaw, branches: usize) -> Elastomer {
    let law = LawKind::NeoHookean;
    Elastomer { law, branches, viscous }
}

/// Uniaxial steps to 2 and 3, as histories with sudden steps.
#[test]
fn steps_are_histories() {
    let time_s: Vec<f64> = (0..25).map(|i| 0.05 * 2000_f64.powf(f64::from(i) / 24.0)).collect();
    let mut index = 0;
    let sets = [2.0, 3.0].map(|stretch: f64| {
        let relaxed = |t: &f64| {
            let modulus = 15e3 + 30e3 * (-t / 0.8).exp() + 20e3 * (-t / 12.0).exp();
            modulus * (stretch - stretch.powi(-2))
        };
        let truth: Vec<f64> = time_s.iter().map(relaxed).collect();
        let measured = truth.iter().map(|stress| {
            index += 1;
            stress * (1.0 + 0.01 * deviate(index))
        });
        DataSet::History(HistoryCurve {
            name: format!("step to {stretch}"),
            elastomer: viscous(ViscousLaw::Linear, 2),
            test: Test::Uniaxial,
            history: vec![(0.0, 1.0), (0.0, stretch)],
            time_s: time_s.clone(),
            stress_pa: measured.collect(),
            sigma: Sigma::Stated(truth.iter().map(|stress| 0.01 * stress).collect()),
        })
    });
    let time = |name: &str, start: f64| FreeParameter::positive(name, start, 1e-6, 1e6);
    let free = [
        modulus("shear_modulus", 20e3),
        modulus("branch_modulus_1", 20e3),
        time("branch_time_1", 0.5),
        modulus("branch_modulus_2", 20e3),
        time("branch_time_2", 20.0),
    ];
    let fit = fit_together(&free, &sets, &fixed(&[])).unwrap();
    let values = [14.937645e3, 30.494843e3, 0.82823964, 19.46648e3, 12.371668];
    let errors = [0.0042330, 0.0099296, 0.0239331, 0.0128814, 0.0213614];
    for (parameter, (value, error)) in fit.estimate.parameters.iter().zip(values.into_iter().zip(errors)) {
        near(parameter.value, value, 5e-8);
        near(parameter.standard_error.unwrap(), error, 1.3e-5);
    }
    near(fit.estimate.sum_of_squares, 51.593892, 1e-8);
    near(fit.estimate.information.aicc, 62.957528, 1e-7);
}

/// A free sheet at 12.5 kV; μ = 20 kPa with a linear branch of 40 kPa and 3 s; σ = 0.002.
fn creep(law: ViscousLaw) -> JointFit {
    let mut curve = CreepCurve {
        name: "creep".to_owned(),
        elastomer: viscous(ViscousLaw::Linear, 1),
        test: Test::Equibiaxial,
        load: Load::Stress(0.0),
        voltage_v: 12.5e3,
        thickness_m: 1e-3,
        time_s: vec![0.0, 0.1, 0.3, 1.0, 2.0, 4.0, 8.0, 16.0, 40.0],
        stretch: vec![1.0; 9],
        sigma: Sigma::UnstatedAbsolute,
    };
    let truth = numbers(&DataSet::Creep(curve.clone()), &[20e3, 40e3, 3.0, 4.7, 0.0]);
    let measured = truth.iter().enumerate();
    curve.stretch = measured
        .map(|(i, above)| 1.0 + above + 0.002 * deviate(i + 1))
        .collect();
    curve.sigma = Sigma::Stated(vec![0.002; 9]);
    curve.elastomer.viscous = law;
    let free = [
        modulus("shear_modulus", 25e3),
        modulus("branch_modulus_1", 30e3),
        FreeParameter::positive("branch_time_1", 1.0, 1e-3, 1e3),
    ];
    fit_together(
        &free,
        &[DataSet::Creep(curve)],
        &fixed(&[("relative_permittivity", 4.7)]),
    )
    .unwrap()
}

#[test]
fn creep_of_a_free_sheet() {
    let known = [
        (ViscousLaw::Linear, [20.412043e3, 36.638619e3, 3.0505959], 5.9618),
        (ViscousLaw::Finite, [20.440091e3, 36.525648e3, 2.9694], 5.9127),
    ];
    for (law, values, chi2) in known {
        let fit = creep(law);
        assert!(fit.estimate.converged && fit.estimate.iterations < 20);
        for (parameter, value) in fit.estimate.parameters.iter().zip(values) {
            near(parameter.value, value, if value == 2.9694 { 2e-5 } else { 3e-8 });
        }
        near(fit.estimate.sum_of_squares, chi2, 1e-5);
    }
}

/// At first the branches are springs, in the end they carry nothing: sheets of other moduli.
#[test]
fn creep_begins_and_ends_at_equilibria() {
    let at_equilibrium = |modulus: f64| {
        let sheet = SheetCurve {
            name: "sheet".to_owned(),
            law: LawKind::NeoHookean,
            test: Test::PureShear,
            load: Load::Stress(8e3),
            thickness_m: 1e-3,
            voltage_v: vec![9e3],
            stretch: vec![1.0],
            sigma: Sigma::UnstatedAbsolute,
        };
        numbers(&DataSet::Sheet(sheet), &[modulus, 4.7, -50.0])[0]
    };
    for law in [ViscousLaw::Linear, ViscousLaw::Finite] {
        let curve = CreepCurve {
            name: "creep".to_owned(),
            elastomer: viscous(law, 2),
            test: Test::PureShear,
            load: Load::Stress(8e3),
            voltage_v: 9e3,
            thickness_m: 1e-3,
            time_s: vec![1e5, 0.0],
            stretch: vec![1.0; 2],
            sigma: Sigma::UnstatedAbsolute,
        };
        let found = numbers(&DataSet::Creep(curve), &[20e3, 40e3, 3.0, 10e3, 0.1, 4.7, -50.0]);
        assert!((found[1] - at_equilibrium(70e3)).abs() < 1e-13, "{law:?} {found:?}");
        assert!((found[0] - at_equilibrium(20e3)).abs() < 1e-10, "{law:?} {found:?}");
    }
}

const LOAD: f64 = 45e3 * (3.0 - 1.0 / 243.0);

/// Returns a sheet under a dead load with noise of 0.2 %.
fn sheet(load: Load) -> DataSet<'static> {
    let mut curve = SheetCurve {
        name: "sheet".to_owned(),
        law: LawKind::NeoHookean,
        test: Test::Equibiaxial,
        load: Load::Stress(LOAD),
        thickness_m: 1e-3,
        voltage_v: [0.0, 1.0, 2.0, 2.5, 3.0, 3.5, 3.8, 4.0].map(|kv| 1e3 * kv).to_vec(),
        stretch: vec![1.0; 8],
        sigma: Sigma::UnstatedAbsolute,
    };
    let above = numbers(&DataSet::Sheet(curve.clone()), &[45e3, 4.7, 0.0]);
    let truth: Vec<f64> = above.iter().map(|above| 1.0 + above).collect();
    let measured = truth.iter().enumerate();
    curve.stretch = measured.map(|(i, l)| l * (1.0 + 0.002 * deviate(i + 1))).collect();
    curve.sigma = Sigma::Stated(truth.iter().map(|l| 0.002 * l).collect());
    curve.load = load;
    DataSet::Sheet(curve)
}

fn electric() -> [FreeParameter; 2] {
    [
        modulus("shear_modulus", 60e3),
        FreeParameter::positive("relative_permittivity", 3.0, 1.0, 100.0),
    ]
}

/// A dead load determines both the modulus and the permittivity, given as a stress or as a force. The first search ends
/// at the edge of pull-in, where the sum of squares falls without end towards parameters without a state.
#[test]
fn a_sheet_under_a_dead_load() {
    let width_m = 0.05;
    let force_n = LOAD * width_m * 1e-3;
    for load in [Load::Stress(LOAD), Load::Force { force_n, width_m }] {
        let fit = fit_together(&electric(), &[sheet(load)], &fixed(&[])).unwrap();
        let known = [(44.944987e3, 9.6081e-4), (4.6780231, 5.85935e-3)];
        for (parameter, (value, error)) in fit.estimate.parameters.iter().zip(known) {
            near(parameter.value, value, 3e-8);
            near(parameter.standard_error.unwrap(), error, 1e-5);
        }
        near(fit.estimate.sum_of_squares, 5.7098, 1e-5);
        let (made, found) = fit.estimate.searches;
        assert!(made > found && found > 0, "{made} {found}");
        assert_eq!(fit.verdict, Verdict::Determined);
    }
}

/// With the load known as a prestretch only ε/μ is determined: in 1/kPa.
#[test]
fn a_prestretched_sheet_determines_a_ratio() {
    let fit = fit_together(&electric(), &[sheet(Load::Prestretch(3.0))], &fixed(&[])).unwrap();
    let [modulus, permittivity] = [0, 1].map(|i| &fit.estimate.parameters[i]);
    near(1e3 * permittivity.value / modulus.value, 0.10465001, 1e-7);
    assert_eq!((modulus.standard_error, permittivity.standard_error), (None, None));
    let Verdict::NotDetermined(names) = &fit.verdict else {
        panic!("{}", fit.verdict);
    };
    assert_eq!(names.len(), 1);
    let known: Vec<_> = fit.estimate.directions.iter().filter(|d| d.determined).collect();
    // Along the unit vector (−1, 1)/√2 the ratio changes by √2.
    near(std::f64::consts::SQRT_2 * known[0].standard_error, 0.002563, 2e-4);
    near(fit.estimate.sum_of_squares, 7.3312, 1e-5);
}

/// Stress and sheet share the modulus and the limit: the permittivity follows from the prestretched sheet then.
#[test]
fn curves_and_a_sheet_share_parameters() {
    let law = LawKind::Gent;
    let truth = Law::Gent {
        shear_modulus: 45e3,
        jm: 80.0,
    };
    let stretch: Vec<f64> = (1..=12).map(|i| 1.0 + 0.3 * f64::from(i)).collect();
    let curve = Curve {
        name: "pull".to_owned(),
        test: Test::Uniaxial,
        stress_pa: stretch
            .iter()
            .map(|l| truth.nominal_stress(Test::Uniaxial, *l).unwrap())
            .collect(),
        stretch,
        sigma: Sigma::StatedFraction(0.02),
    };
    let mut sheet = SheetCurve {
        name: "sheet".to_owned(),
        law,
        test: Test::PureShear,
        load: Load::Prestretch(2.0),
        thickness_m: 1e-3,
        voltage_v: vec![2e3, 5e3, 8e3],
        stretch: vec![1.0; 3],
        sigma: Sigma::UnstatedAbsolute,
    };
    let above = numbers(&DataSet::Sheet(sheet.clone()), &[45e3, 80.0, 4.7, -150.0]);
    sheet.stretch = above.iter().map(|above| 1.0 + above).collect();
    sheet.sigma = Sigma::StatedFraction(0.002);
    let free = [
        modulus("shear_modulus", 30e3),
        FreeParameter::positive("jm", 200.0, 1.0, 1e6),
        FreeParameter::positive("relative_permittivity", 3.0, 1.0, 100.0),
        FreeParameter::signed("voltage_offset", 0.0, -1e3, 1e3, 1e3),
    ];
    let sets = [DataSet::Curve(law, curve), DataSet::Sheet(sheet)];
    let fit = fit_together(&free, &sets, &fixed(&[])).unwrap();
    for (parameter, value) in fit.estimate.parameters.iter().zip([45e3, 80.0, 4.7, -150.0]) {
        near(parameter.value, value, 1e-8);
        assert!(parameter.standard_error.is_some());
    }
    assert!(!fit.estimate.parameters[3].logarithmic);
    assert_eq!(fit.sets[1].residuals.len(), 3);
    near(
        fit.sets[0].simulated[3],
        truth.nominal_stress(Test::Uniaxial, 2.2).unwrap(),
        1e-8,
    );
    assert!(fit.outliers.is_empty() && fit.warnings.is_empty());
}

/// A step that softens the sheet beyond its pull-in is refused; a start beyond it is an error.
#[test]
fn a_sheet_without_a_state_is_refused() {
    let mut free = electric();
    free[0].start = 10e3;
    let error = fit_together(&free, &[sheet(Load::Stress(LOAD))], &fixed(&[])).unwrap_err();
    assert_eq!(
        error,
        FitError::NoState {
            set: "sheet".to_owned()
        }
    );
    let more_starts = vec![vec![50e3, 4.0]];
    let options = JointOptions {
        more_starts,
        ..fixed(&[])
    };
    let fit = fit_together(&free, &[sheet(Load::Stress(LOAD))], &options).unwrap();
    near(fit.estimate.parameters[0].value, 44.944987e3, 3e-8);
    assert_eq!(fit.estimate.searches, (1, 1));
}

#[test]
fn settings_that_are_not_valid_are_refused() {
    let sheet_set = || [sheet(Load::Stress(LOAD))];
    let message = |free: &[FreeParameter], sets: &[DataSet<'_>], options: &JointOptions| {
        fit_together(free, sets, options).unwrap_err().to_string()
    };
    let none = fixed(&[]);
    let [first, second] = electric();
    let start = FreeParameter {
        start: 1e12,
        ..first.clone()
    };
    let bounds = FreeParameter {
        lower: -1.0,
        ..first.clone()
    };
    let three = JointOptions {
        more_starts: vec![vec![1.0; 3]],
        ..none.clone()
    };
    let DataSet::Sheet(curve) = sheet(Load::Stress(LOAD)) else {
        unreachable!();
    };
    let changed = |change: fn(&mut SheetCurve)| {
        let mut curve = curve.clone();
        change(&mut curve);
        message(&electric(), &[DataSet::Sheet(curve)], &none)
    };
    let found = [
        message(&[], &sheet_set(), &none),
        message(&electric(), &[], &none),
        message(std::slice::from_ref(&first), &sheet_set(), &none),
        message(
            &[first.clone(), second.clone(), modulus("jm", 1.0)],
            &sheet_set(),
            &none,
        ),
        message(&[first.clone(), first.clone()], &sheet_set(), &none),
        message(&[start, second.clone()], &sheet_set(), &none),
        message(&[bounds, second.clone()], &sheet_set(), &none),
        message(&electric(), &sheet_set(), &three),
        changed(|curve| curve.test = Test::Uniaxial),
        changed(|curve| curve.thickness_m = 0.0),
        changed(|curve| curve.voltage_v[1] = f64::NAN),
        changed(|curve| curve.stretch[2] = -1.0),
        changed(|curve| curve.load = Load::Prestretch(-2.0)),
    ];
    let expected = [
        "nothing to fit: there are no free parameters",
        "nothing to fit: there are no data",
        "`sheet` needs the parameter `relative_permittivity`: let it be free, or give its value",
        "no data depend on the parameter `jm`",
        "the parameter `shear_modulus` is given twice",
        "the start 1000000000000 of `shear_modulus` is not within its bounds 1 and 1000000000",
        "the bounds -1 and 1000000000 of `shear_modulus` are not in order, or not positive where they must be",
        "3 starting values were given for 2 parameters",
        "`sheet`: a sheet under voltage is equibiaxial or in pure shear, not uniaxial",
        "`sheet`: the thickness 0 is not a positive number",
        "curve `sheet`, row 2: the voltage is not a finite number",
        "curve `sheet`, row 3: the stretch -1 is not positive",
        "`sheet`: the prestretch -2 is not a positive number",
    ];
    assert_eq!(found, expected);
}
