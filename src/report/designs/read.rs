//! Designs as they stand in the artifacts of design and verify stages.

use super::compare::{Compared, compare};
use super::names::name;
use super::wanted::Wanted;
use super::{Design, Role};
use crate::report::gather::{Made, ReportError, Source, each};
use crate::report::summary::has_field;
use crate::store::Store;

/// Cells of a pattern, and numbers of a field.
const CELLS: usize = 50 * 50;
const FIELD: usize = 51 * 51 * 2;

/// The status of a design of which the evaluator has no field, and so no value.
const NO_FIELD: &str = "no stable field";

/// The designs of a run, each once, named and compared: those that were verified, and those that were not as predicted. What
/// was verified by the stages named in `superseded` alone, the earlier rounds, is left out.
///
/// # Errors
/// When an artifact cannot be read or does not hold what its kind promises.
pub fn designs(store: &Store, made: &[Made], superseded: &[&str]) -> Result<Vec<Design>, ReportError> {
    let (mut all, mut earlier): (Vec<Design>, Vec<Design>) = Default::default();
    let verified = each(store, made, "verify", |source| {
        Ok((source.stage.stage.clone(), read(source)?))
    })?;
    for (stage, designs) in verified {
        if superseded.contains(&stage.as_str()) {
            earlier.extend(designs);
            continue;
        }
        for design in designs {
            match all.iter_mut().find(|known| same(known, &design)) {
                Some(known) if better(&design, known) => *known = design,
                Some(_) => {}
                None => all.push(design),
            }
        }
    }
    for design in each(store, made, "design", read)?.into_iter().flatten() {
        if !all.iter().chain(&earlier).any(|known| same(known, &design)) {
            all.push(design);
        }
    }
    sort(&mut all);
    name(&mut all);
    compare(&mut all);
    Ok(all)
}

/// Whether both are one design: of two verifications the better one is kept.
fn same(a: &Design, b: &Design) -> bool {
    a.is_beside(b) && (a.role, a.member, a.units) == (b.role, b.member, b.units) && a.pattern == b.pattern
}

/// Whether one verification is to be believed more than another.
fn better(new: &Design, known: &Design) -> bool {
    match (new.error_mm, known.error_mm) {
        (Some(new), Some(known)) => new < known,
        (new, known) => new.is_some() && known.is_none(),
    }
}

/// Cases and targets in the order in which they appear first, and their designs by role.
fn sort(designs: &mut [Design]) {
    let mut order: Vec<(String, String)> = Vec::new();
    let mut cases: Vec<String> = Vec::new();
    for design in designs.iter() {
        let key = (design.case.clone(), design.target.clone());
        if !cases.contains(&key.0) {
            cases.push(key.0.clone());
        }
        if !order.contains(&key) {
            order.push(key);
        }
    }
    let place = |design: &Design| {
        let case = cases.iter().position(|case| *case == design.case);
        let target = order.iter().position(|(c, t)| (c, t) == (&design.case, &design.target));
        (case, target, design.role, design.member)
    };
    designs.sort_by_key(place);
}

/// The rows of one artifact.
fn read(source: &Source<'_>) -> Result<Vec<Design>, ReportError> {
    let texts = |path: &str| -> Result<Vec<String>, ReportError> { Ok(source.artifact.texts(path)?.1) };
    let (cases, names, roles) = (texts("case")?, texts("name")?, texts("role")?);
    let (objectives, targets) = (source.artifact.long_texts("objective")?, texts("area_target")?);
    let states = source.artifact.long_texts("status")?;
    let constraints = source.artifact.long_texts("constraints")?;
    let (members, units) = (source.counts("member")?, source.counts("units")?);
    let (areas, patterns, predicted) = (
        source.reals("area")?,
        source.artifact.u8s("patterns")?.1,
        source.reals("predicted")?,
    );
    let n = names.len();
    let lengths = [
        cases.len(),
        roles.len(),
        objectives.len(),
        targets.len(),
        states.len(),
        constraints.len(),
        members.len(),
    ];
    let fits = lengths == [n; 7] && [units.len(), areas.len()] == [n; 2];
    if !fits || patterns.len() != n * CELLS || predicted.len() != n * FIELD {
        return Err(source.wrong("its arrays differ in length"));
    }
    let values = match source.stage.kind.as_str() {
        "verify" => source.reals("component/predicted")?,
        _ => source.reals("value")?,
    };
    if values.len() != n {
        return Err(source.wrong("it has not a value for each design"));
    }
    let side = source.side()?;
    let mut simulations = simulations(source, n)?.into_iter();
    let mut designs = Vec::with_capacity(n);
    for k in 0..n {
        let role = Role::named(&roles[k]).ok_or_else(|| source.wrong(format!("it has no role `{}`", roles[k])))?;
        let wanted = Wanted::read(&objectives[k]).map_err(|e| source.wrong(e.to_string()))?;
        let Simulated {
            field,
            value,
            error,
            outcome,
        } = simulations.next().unwrap_or_default();
        designs.push(Design {
            name: String::new(),
            case: cases[k].clone(),
            target: names[k].clone(),
            role,
            member: members[k],
            units: units[k],
            wanted,
            area_target: area_target(&targets[k]),
            area: areas[k],
            constraints: constraints[k].clone(),
            status: states[k].clone(),
            side,
            pattern: patterns[k * CELLS..][..CELLS].to_vec(),
            predicted: predicted[k * FIELD..][..FIELD].to_vec(),
            simulated: field,
            predicted_mm: (states[k] != NO_FIELD).then_some(values[k]),
            simulated_mm: value,
            error_mm: error,
            outcome,
            compared: Compared::default(),
        });
    }
    Ok(designs)
}

/// The number as short as it can be, or the word.
fn area_target(text: &str) -> String {
    text.parse::<f64>()
        .map_or_else(|_| text.to_owned(), |area| area.to_string())
}

/// What verification found of a row.
#[derive(Default)]
struct Simulated {
    field: Option<Vec<f64>>,
    value: Option<f64>,
    error: Option<f64>,
    outcome: Option<String>,
}

/// What verification found of each row; nothing in a design stage. Its arrays have a row for each pattern with a field only.
fn simulations(source: &Source<'_>, n: usize) -> Result<Vec<Simulated>, ReportError> {
    if source.stage.kind != "verify" {
        return Ok(Vec::new());
    }
    let outcomes = source.artifact.texts("outcome")?.1;
    let (fields, values, errors) = (
        source.reals("displacement")?,
        source.reals("component/simulated")?,
        source.reals("component/error")?,
    );
    let estimated = source.counts("component/error_known")?;
    let solved = outcomes.iter().filter(|o| has_field(o)).count();
    if outcomes.len() != n
        || [values.len(), errors.len(), estimated.len()] != [solved; 3]
        || fields.len() != solved * FIELD
    {
        return Err(source.wrong("its arrays differ in length"));
    }
    let mut row = 0;
    let mut found = Vec::with_capacity(n);
    for outcome in outcomes {
        let known = has_field(&outcome).then(|| {
            row += 1;
            row - 1
        });
        found.push(Simulated {
            field: known.map(|row| fields[row * FIELD..][..FIELD].to_vec()),
            value: known.map(|row| values[row]),
            // An error that is not known is not zero.
            error: known
                .map(|row| errors[row])
                .filter(|error| error.is_finite() && *error >= 0.0),
            outcome: Some(outcome),
        });
    }
    Ok(found)
}
