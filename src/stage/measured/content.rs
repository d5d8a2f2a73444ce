//! Comparisons as artifacts store them.

use super::compare::{Compared, Values};
use deaflow_content::{ComparedFiles, ComparedRows, LongTexts};

/// Returns how well each file agrees.
#[must_use]
pub fn compared_files(compared: &[Compared]) -> ComparedFiles {
    let mut all = ComparedFiles::default();
    for one in compared {
        let own = &one.agreement;
        let (translation, rotation) = match &one.values {
            Values::Field { result, .. } => (result.translation_mm, result.rotation),
            Values::Series { .. } => ([0.0; 2], 0.0),
        };
        all.quantities.push(one.values.quantities().name().to_owned());
        all.points.push(own.points as u64);
        all.without_equilibrium.push(one.without_equilibrium.len() as u64);
        all.bias.push(own.bias.unwrap_or(0.0));
        all.rms.push(own.rms);
        all.largest.push(own.largest.0);
        all.largest_row.push(own.largest.1 as u64);
        all.has_r_squared.push(u64::from(own.r_squared.is_some()));
        all.r_squared.push(own.r_squared.unwrap_or(0.0));
        all.has_chi2.push(u64::from(own.chi2_per_dof.is_some()));
        all.chi2_per_dof.push(own.chi2_per_dof.unwrap_or(0.0));
        all.translation.push(translation);
        all.rotation.push(rotation);
    }
    all.name = LongTexts(compared.iter().map(|one| one.name.clone()).collect());
    all
}

/// Returns the measured and simulated numbers of each file.
#[must_use]
pub fn compared_rows(compared: &[Compared]) -> ComparedRows {
    let mut all = ComparedRows::default();
    for (file, one) in compared.iter().enumerate() {
        let mut add = |number: usize, at: f64, position: [f64; 2], component: u64, [measured, simulated]: [f64; 2]| {
            all.file.push(file as u64);
            all.number.push(number as u64);
            all.at.push(at);
            all.position.push(position);
            all.component.push(component);
            all.measured.push(measured);
            all.simulated.push(simulated);
        };
        match &one.values {
            Values::Field {
                points_mm,
                rows,
                simulated_mm,
                result,
            } => {
                let places = points_mm.iter().zip(rows);
                let numbers = simulated_mm.iter().zip(&result.residual_mm);
                for ((position, row), (simulated, difference)) in places.zip(numbers) {
                    for component in [0, 1] {
                        let numbers = [simulated[component] + difference[component], simulated[component]];
                        add(*row, 0.0, *position, component as u64, numbers);
                    }
                }
            }
            Values::Series {
                rows,
                at,
                measured,
                simulated,
                ..
            } => {
                for (place, row) in rows.iter().enumerate() {
                    add(*row, at[place], [0.0; 2], 0, [measured[place], simulated[place]]);
                }
            }
        }
    }
    all
}
