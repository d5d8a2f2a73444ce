//! `deaflow solve` of a scene with a pressure or a volume, or with bodies that move out of the plane: equilibria in
//! space.

use serde_json::{Value, json};

use super::breakdown;
use super::figure::{self, Membrane};
use super::simulation::{Computation, PatternSolver, Simulation};
use crate::job::{JobResult, extend};
use crate::point::Probe;
use crate::text::Text;
use crate::{CliError, Exit, Output, model_warnings, table};
use deaflow_base::four_digits;
use deaflow_content::{CoveredCells, DrawnElectrodes, Inflations, Packed};
use deaflow_fem::screening::resolve;
use deaflow_fem::{Inflated, InflationOutcome, InflationSolver, MeshRequest, Method, Peak, SetupError, SpatialMotion};
use deaflow_field::Field;
use deaflow_pattern::Pattern;
use deaflow_scene::{Pressurised, Scene};

/// The share of compressed membrane above which a warning names it.
const COMPRESSED: f64 = 0.005;

/// Finds the equilibria of patterns in space.
///
/// # Errors
/// When an option, the scene or a pattern cannot be used, or the file cannot be written.
pub fn execute(simulation: Simulation<'_>, output: &Output) -> Result<Exit, CliError> {
    check_arguments(&simulation)?;
    let probe = simulation.arguments.point.on(&simulation.scene)?;
    let SpatialEquilibria {
        scene,
        found,
        content,
        warnings,
    } = SpatialEquilibria::find(&simulation.computation())?;
    let unstable = found.iter().filter(|one| !is_stable(one)).count();
    let peaks = found.iter().map(|one| Peak::of(&one.displacement, &one.heights));
    let peaks: Vec<Peak> = peaks.collect();
    let at_point = found.iter().map(|one| probe?.in_space(&one.displacement, &one.heights));
    let at_point: Vec<Option<[f64; 3]>> = at_point.collect();
    let along = |at: [f64; 3]| probe.and_then(|probe| probe.along([at[0], at[1]]));
    let document = |index: usize| {
        let mut document = document((index, (&found[index], &peaks[index])), &scene);
        if let Some(at) = at_point[index].filter(|_| is_stable(&found[index])) {
            extend(&mut document, json!({ "at_point_mm": at, "along_mm": along(at) }));
        }
        document
    };
    let drawn = found.iter().enumerate().map(|(index, one)| Membrane {
        index,
        state: None,
        displacement: is_stable(one).then_some(&one.displacement),
        heights: Some(&one.heights),
    });
    let figure = figure::draw(&simulation, &drawn.collect::<Vec<_>>(), probe.as_ref(), output);
    let result = JobResult {
        patterns: found.len(),
        arrays: content.object(),
        parameters: simulation.described(""),
        attachments: None,
        warnings,
        document: json!({
            "equilibria": (0..found.len()).map(document).collect::<Vec<_>>(),
            "unstable": unstable,
            "point": probe.as_ref().map(Probe::document),
        }),
        text: text(&found, &peaks, &scene, probe.as_ref().zip(Some(&at_point[..]))),
        exit: if unstable > 0 { Exit::Unstable } else { Exit::Done },
    };
    simulation.with_figure(figure).finish(result, output)
}

/// The equilibria of patterns in space.
pub struct SpatialEquilibria {
    scene: Scene,
    found: Vec<Inflated>,
    /// The arrays.
    pub content: Inflations,
    /// Warnings about the model, one line each.
    pub warnings: Vec<String>,
}

impl SpatialEquilibria {
    /// Finds the equilibrium of each pattern.
    ///
    /// # Errors
    /// When the scene or a pattern cannot be simulated in this way.
    pub fn find(computation: &Computation<'_>) -> Result<Self, CliError> {
        check(computation)?;
        let (scene, left_out) = resolved(computation.scene)?;
        let options = computation.options()?;
        let solver = PatternSolver::new(&scene, |scene| {
            let solver = InflationSolver::new(scene, options)?;
            Ok::<_, SetupError>(solver.within(computation.parameters.work_limit()))
        })?;
        let (mut found, mut seconds) = (Vec::new(), Vec::new());
        computation.run(
            |pattern: &Pattern| Ok(solver.with(pattern, |solver: &InflationSolver| solver.solve(pattern))?),
            |inflated, time| {
                found.push(inflated);
                seconds.push(time);
            },
        )?;
        Ok(Self {
            content: content(computation, &scene, &found, seconds),
            warnings: left_out.into_iter().chain(warnings(&scene, &found)?).collect(),
            scene,
            found,
        })
    }
}

/// Returns the scene with its effects resolved, which are those of the flat membrane, and a warning if that leaves out
/// one of them.
///
/// # Errors
/// When they cannot be resolved.
pub fn resolved(given: &Scene) -> Result<(Scene, Option<String>), CliError> {
    let left_out = given.auto && resolve(&given.in_plane())?.effects.fringe_field.is_some();
    let warning = left_out.then(|| {
        let what = under_pressure_or_in_space(given);
        format!("`effects: auto` chooses `fringe_field`, which is not simulated {what} and is left out")
    });
    Ok((resolve(given)?, warning))
}

/// Refuses options of the command that are not simulated in space.
///
/// # Errors
/// When there are any.
pub fn check_arguments(simulation: &Simulation<'_>) -> Result<(), CliError> {
    match simulation.arguments.cells {
        true => Err(without_option(&simulation.scene, "this option", "remove `--cells`")),
        false => Ok(()),
    }
}

/// Returns that a scene in space is not simulated with an option, and what to do.
pub fn without_option(scene: &Scene, option: &'static str, help: &str) -> CliError {
    CliError::from(SetupError::not_in_space(scene, option)).help(help.to_owned())
}

/// Refuses methods and states that are not simulated in space.
///
/// # Errors
/// When there are any.
pub fn check(computation: &Computation<'_>) -> Result<(), CliError> {
    let scene = computation.scene;
    let refused = |help: &str| Err(without_option(scene, "this option", help));
    if computation.parameters.method() != Method::Newton {
        return refused("use `--method newton`");
    }
    if matches!(computation.parameters.mesh_request(), MeshRequest::Accuracy(_)) {
        return refused("remove `--accuracy`, and compare two meshes by `--elements-per-cell`");
    }
    if !scene.states.is_empty() {
        let what = under_pressure_or_in_space(scene);
        return Err(
            CliError::bad_input(format!("equilibria {what} are computed for one state of a device"))
                .help("choose a state: --state NAME"),
        );
    }
    if computation.patterns.iter().any(|pattern| pattern.coverage().is_some()) {
        return Err(SetupError::Coverage { with: "`loads`" }.into());
    }
    Ok(())
}

/// What messages call the simulation of a scene.
fn under_pressure_or_in_space(scene: &Scene) -> &'static str {
    match scene.loads {
        Some(_) => "under pressure",
        None => "in space",
    }
}

fn is_stable(one: &Inflated) -> bool {
    one.outcome == InflationOutcome::Converged
}

/// Returns the place of a peak.
pub fn at_mm(peak: &Peak, scene: &Scene) -> [f64; 2] {
    corner_mm(peak.corner, scene)
}

/// Returns the place of a corner of cells, given by its column and row.
pub fn corner_mm(corner: [usize; 2], scene: &Scene) -> [f64; 2] {
    let cell_mm = scene.membrane().cell_mm();
    [0, 1].map(|axis| corner[axis] as f64 * cell_mm[axis])
}

/// Returns a displacement along x, y and out of the plane, corner by corner.
pub fn components(displacement: &Field, heights: &[f64]) -> impl Iterator<Item = [f64; 3]> {
    let planar = displacement.values().chunks_exact(2);
    let all = planar.zip(heights);
    all.map(|(planar, height)| [planar[0], planar[1], *height])
}

fn warnings(scene: &Scene, found: &[Inflated]) -> Result<Vec<String>, SetupError> {
    let named = found
        .iter()
        .enumerate()
        .map(|(index, one)| (format!("pattern {index}"), one));
    let of_states = warnings_of_states(scene, &named.collect::<Vec<_>>());
    Ok(model_warnings::in_space(scene)?.into_iter().chain(of_states).collect())
}

/// Warns of states of patterns, which have names: of fields close to breakdown, and of compressed membranes.
pub fn warnings_of_states(scene: &Scene, found: &[(String, &Inflated)]) -> Vec<String> {
    let stable = || found.iter().filter(|(_, one)| is_stable(one));
    let fields = stable().filter_map(|(name, one)| breakdown::warning(scene, name, one.breakdown_ratio));
    let compressed = stable().filter_map(|(name, one)| compressed(scene, name, one.compressed));
    fields.chain(compressed).collect()
}

/// Warns of a compressed share of a membrane.
pub fn compressed(scene: &Scene, name: &str, share: f64) -> Option<String> {
    (scene.effects.wrinkling.is_none() && share >= COMPRESSED).then(|| {
        format!(
            "{name}: {:.1} % of the membrane is compressed and would wrinkle; simulate `wrinkling`",
            100.0 * share
        )
    })
}

fn content(computation: &Computation<'_>, scene: &Scene, found: &[Inflated], solve_seconds: Vec<f64>) -> Inflations {
    let known = |value: fn(&Inflated) -> f64| -> Vec<f64> {
        let value = |one: &Inflated| if is_stable(one) { value(one) } else { f64::NAN };
        found.iter().map(value).collect()
    };
    let displacement = found.iter().flat_map(|one| {
        let all = components(&one.displacement, &one.heights);
        all.flatten().map(|value| if is_stable(one) { value } else { f64::NAN })
    });
    let limits = |at: usize, converged: f64| {
        let limit = |one: &Inflated| match one.outcome {
            InflationOutcome::Converged => converged,
            InflationOutcome::LimitPoint {
                last_stable,
                first_unstable,
            } => [last_stable, first_unstable][at],
            InflationOutcome::Flat(_) | InflationOutcome::WorkLimit => f64::NAN,
        };
        found.iter().map(limit).collect()
    };
    let has_bodies = scene.geometry.bodies.is_some();
    let motions = || {
        let each = |one: &Inflated| -> Vec<SpatialMotion> {
            let none = SpatialMotion {
                translation: [f64::NAN; 3],
                rotation: f64::NAN,
            };
            let known = |motion: &SpatialMotion| if is_stable(one) { *motion } else { none };
            one.bodies.iter().map(known).collect()
        };
        found.iter().flat_map(each)
    };
    Inflations {
        patterns: computation.patterns.to_vec(),
        electrodes: DrawnElectrodes::of(computation.patterns),
        covered: CoveredCells::of(computation.patterns),
        outcome: found.iter().map(|one| one.outcome.name().to_owned()).collect(),
        displacement: Packed(displacement.collect()),
        pressure: known(|one| one.pressure),
        volume: known(|one| one.volume),
        body_translation: has_bodies.then(|| Packed(motions().flat_map(|motion| motion.translation).collect())),
        body_rotation: has_bodies.then(|| Packed(motions().map(|motion| motion.rotation).collect())),
        last_stable: limits(0, 1.0),
        first_unstable: limits(1, f64::NAN),
        wrinkled_fraction: known(|one| one.compressed),
        breakdown_ratio: known(|one| one.breakdown_ratio),
        newton_iterations: found.iter().map(|one| one.newton_iterations).collect(),
        krylov_iterations: found.iter().map(|one| one.krylov_iterations).collect(),
        solve_seconds,
        scene: scene.clone(),
        solver: computation.solver(),
        effects: scene.effects.clone(),
    }
}

/// The overview, the motions of bodies, and how to go beyond the limit of work.
fn text(found: &[Inflated], peaks: &[Peak], scene: &Scene, point: Option<(&Probe, &[Option<[f64; 3]>])>) -> Text {
    let mut text = Text::of(overview(found, peaks, scene));
    if let Some((probe, at_point)) = point {
        text.table(displacements_of(probe, found, at_point));
    }
    if found.iter().any(|one| is_stable(one) && !one.bodies.is_empty()) {
        text.table(bodies(found));
    }
    if found.iter().any(|one| one.outcome == InflationOutcome::WorkLimit) {
        text.line("work-limit: raise the limit, as in --time-limit \"60 s\"");
    }
    text
}

/// The displacement of a point in each pattern.
fn displacements_of(probe: &Probe, found: &[Inflated], at_point: &[Option<[f64; 3]>]) -> table::Table {
    let height = format!("height {}", probe.title_of_place());
    let along = probe.has_direction().then(|| probe.title());
    let header = ["pattern", "along x", "along y", &height];
    let header: Vec<&str> = header.into_iter().chain(along.as_deref()).collect();
    let mut table = table::table(&header, &header[1..]);
    for (index, (one, at)) in found.iter().zip(at_point).enumerate() {
        if let Some(at) = at.filter(|_| is_stable(one)) {
            let values = at.into_iter().chain(probe.along([at[0], at[1]]));
            let values = values.map(|mm| format!("{} mm", four_digits(mm)));
            table.add_row(std::iter::once(index.to_string()).chain(values));
        }
    }
    table
}

/// How the bodies of the patterns move.
fn bodies(found: &[Inflated]) -> table::Table {
    let header = ["pattern", "body", "along x", "along y", "height", "rotation"];
    let mut table = table::table(&header, &header[2..]);
    for (index, one) in found.iter().enumerate().filter(|(_, one)| is_stable(one)) {
        for (body, motion) in one.bodies.iter().enumerate() {
            let [x, y, height] = motion.translation.map(|mm| format!("{} mm", four_digits(mm)));
            let rotation = format!("{} deg", four_digits(motion.rotation));
            table.add_row([index.to_string(), body.to_string(), x, y, height, rotation]);
        }
    }
    table
}

fn overview(found: &[Inflated], peaks: &[Peak], scene: &Scene) -> table::Table {
    let header = [
        "pattern",
        "outcome",
        "largest displacement",
        "height there",
        "at",
        "pressure",
        "volume",
    ];
    let mut table = table::table(&header, &["largest displacement", "height there", "pressure", "volume"]);
    for (index, (one, peak)) in found.iter().zip(peaks).enumerate() {
        let or_dash = |text: String| if is_stable(one) { text } else { "-".to_owned() };
        let hundredths = |mm: f64| (100.0 * mm).round() / 100.0;
        let [x, y] = at_mm(peak, scene);
        table.add_row([
            index.to_string(),
            outcome(one, scene),
            or_dash(format!("{} mm", four_digits(peak.mm))),
            or_dash(format!("{} mm", four_digits(peak.height))),
            or_dash(format!("{}, {} mm", hundredths(x), hundredths(y))),
            or_dash(format!("{} Pa", four_digits(one.pressure))),
            or_dash(format!("{} ml", four_digits(one.volume))),
        ]);
    }
    table
}

/// The largest load with a stable equilibrium, if that of the scene has none: in Pa or in ml.
fn limit(one: &Inflated, scene: &Scene) -> Option<Pressurised> {
    match (one.outcome, scene.pressurised()?) {
        (InflationOutcome::LimitPoint { last_stable, .. }, Pressurised::Pressure(load)) => {
            Some(Pressurised::Pressure(last_stable * load))
        }
        (InflationOutcome::LimitPoint { last_stable, .. }, Pressurised::Volume(load)) => {
            Some(Pressurised::Volume(last_stable * load))
        }
        _ => None,
    }
}

/// The outcome for people, with the limit.
pub fn outcome(one: &Inflated, scene: &Scene) -> String {
    let name = one.outcome.name();
    match limit(one, scene) {
        Some(Pressurised::Pressure(pascals)) => format!("{name} at {} Pa", four_digits(pascals)),
        Some(Pressurised::Volume(millilitres)) => format!("{name} at {} ml", four_digits(millilitres)),
        None => name.to_owned(),
    }
}

fn document((index, (one, peak)): (usize, (&Inflated, &Peak)), scene: &Scene) -> Value {
    let mut document = json!({
        "index": index,
        "outcome": one.outcome.name(),
        "newton_iterations": one.newton_iterations,
        "krylov_iterations": one.krylov_iterations,
    });
    let more = match one.outcome {
        InflationOutcome::Converged => json!({
            "largest_displacement_mm": peak.mm,
            "height_mm": peak.height,
            "at_mm": at_mm(peak, scene),
            "pressure_pa": one.pressure,
            "volume_ml": one.volume,
            "wrinkled_fraction": one.compressed,
            "breakdown_ratio": one.breakdown_ratio,
        }),
        InflationOutcome::LimitPoint {
            last_stable,
            first_unstable,
        } => json!({ "last_stable": last_stable, "first_unstable": first_unstable }),
        InflationOutcome::Flat(_) | InflationOutcome::WorkLimit => json!({}),
    };
    extend(&mut document, more);
    if is_stable(one) && !one.bodies.is_empty() {
        let motions = one.bodies.iter();
        let (translations, rotations): (Vec<[f64; 3]>, Vec<f64>) =
            motions.map(|motion| (motion.translation, motion.rotation)).unzip();
        let motions = json!({ "body_translation_mm": translations, "body_rotation_deg": rotations });
        extend(&mut document, motions);
    }
    extend(
        &mut document,
        match limit(one, scene) {
            Some(Pressurised::Pressure(pascals)) => json!({ "limit_pa": pascals }),
            Some(Pressurised::Volume(millilitres)) => json!({ "limit_ml": millilitres }),
            None => json!({}),
        },
    );
    document
}
