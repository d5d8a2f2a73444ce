//! `kind: fit` fits a scene to measurements: the law of its elastomer or its viscoelastic branches to tests of
//! specimens, or any of its numbers to tests and devices at once. Other stages take the scene by
//! `scene: { from: STAGE }`.

use std::path::Path;

use serde_json::{Value, json};

use super::measure::{self, tables_of};
use super::measured::{
    Compared, Device, FreeKey, LAWS, MOST_BRANCHES, MeasuredSet, MeasuredTable, Measurement, MeshChoice, SpecimenFit,
    VOLTAGE_OFFSET, compare_all, compared_files, compared_rows, dimension_of, fit_scene, law_named, name_of_law,
    replaces_known_elastomer,
};
use super::{needed, scene};
use deaflow_base::{Canonical, Declared, Dimension, Document, Fields, InputError, Node, Parameter, Schema, parameters};
use deaflow_content::{FitCandidates, FittedParameters, FittedScene, LongTexts};
use deaflow_fit::{Estimate, LawKind, Parameter as Fitted, Test, Verdict};
use deaflow_orchestrator::{Input, Job, Kind, Needs, Plan, Stage, StageCheck, StageDeclaration, StageError};
use deaflow_scene::{Scene, Tolerances};
use deaflow_store::{Artifact, Object};

/// The kind `fit`.
pub struct FitKind;

impl Kind for FitKind {
    fn name(&self) -> &'static str {
        "fit"
    }

    fn recipe(&self) -> u32 {
        1
    }

    fn needs(&self) -> Needs {
        Needs::new(&[measure::NAME], 1, 1000)
    }

    fn reads_scene(&self) -> bool {
        true
    }

    fn makes_scene(&self) -> bool {
        true
    }

    fn as_written(&self, both: [&Canonical; 2]) -> [Canonical; 2] {
        both.map(|parameters| {
            let mut written = parameters.clone();
            scene::write_tolerances(&mut written, &["scene", "tolerances"]);
            written
        })
    }

    fn scene_of(&self, artifact: &Artifact) -> Result<Node, StageError> {
        let view = FittedScene::open(artifact)?;
        let (scene, tolerances) = (view.scene().read()?, view.tolerances().read()?);
        let text = scene.to_text_with(tolerances.as_ref());
        let document = Document::from_text(Path::new("the fitted scene"), &text);
        Ok(document.map_err(|error| StageError::in_artifact(artifact, error))?.root)
    }

    fn results(&self, artifact: &Artifact) -> Result<Vec<(String, f64)>, StageError> {
        let view = FittedScene::open(artifact)?;
        let (names, values) = (view.parameters().name().read()?.0, view.parameters().value().read()?);
        let fitted = names.iter().map(|name| format!("fitted.{name}")).zip(values);
        let ([sum], [dof], [stated]) = (
            view.sum_of_squares().read()?,
            view.degrees_of_freedom().read()?,
            view.stated().read()?,
        );
        let chi2 = (stated == 1 && dof > 0).then(|| ("chi2_per_dof".to_owned(), sum / dof as f64));
        Ok(fitted.chain(chi2).collect())
    }

    fn schema(&self) -> Vec<Fields> {
        vec![FitParameters::fields()]
    }

    fn check(&self, stage: &StageDeclaration<'_>, needs: &[StageDeclaration<'_>]) -> Result<StageCheck, InputError> {
        let has_free = stage.node.peek("free").is_some();
        if let (true, Some(laws)) = (has_free, stage.node.peek("laws")) {
            return Err(laws
                .error("laws are compared without `free`, which fits numbers of the law of the scene")
                .help("use two stages: one with `laws`, and one with `free` and the scene of the first"));
        }
        if let (true, Some(branches)) = (has_free, stage.node.peek("branches")) {
            return Err(branches
                .error("branches are compared without `free`")
                .help("use two stages: one with `branches`, and one with `free` and the scene of the first"));
        }
        needed::measured_once(stage, needs)?;
        let tests = needs
            .iter()
            .filter_map(|need| need.node.peek("files")?.list("files").ok());
        let tests = tests
            .flatten()
            .filter_map(|entry| entry.peek("test")?.text("test").ok());
        let of_others = |test: &&str| Measurement::from_name(test).is_some_and(|test| test.of_specimen().is_none());
        match (has_free, tests.into_iter().find(of_others)) {
            (false, Some(test)) => Err(stage
                .node
                .error(format!("a fit to `{test}` needs free parameters"))
                .help("name numbers of the scene, as in free: { shear_modulus: auto, voltage_offset: auto }")),
            _ => {
                check_free(stage)?;
                Ok(StageCheck::default())
            }
        }
    }

    fn read(&self, stage: &Node, scene: Option<&Node>) -> Result<Box<dyn Stage>, InputError> {
        Ok(Box::new(FitStage {
            parameters: FitParameters::read_with(stage, &["kind", "needs"])?,
            tolerances: scene.map(Tolerances::of_scene).transpose()?.flatten(),
            scene: scene::read_all_states(stage, scene)?,
        }))
    }
}

parameters! {
    /// Fits a scene to measurements.
    struct FitParameters as "a fit stage" {
        /// Numbers of the scene to fit, by the end of their path, with bounds as in `1 kPa..1 MPa` or `auto`;
        /// `voltage_offset` is added to all voltages. Without them laws are fitted to tests of specimens.
        free: Option<Free>,
        /// Laws to fit to curves at equilibrium: neo-hookean, gent, yeoh, mooney-rivlin, arruda-boyce, ogden or ogden:N
        /// with N terms; all if not given. The law of relaxation; that of the scene if not given.
        laws: Option<Vec<LawName>> [((), 1..=20)],
        /// The largest number of viscoelastic branches, which relaxation compares.
        branches: u64 [0..=MOST_BRANCHES] = 3,
    }
    include {
        /// The mesh of devices.
        mesh: MeshChoice,
    }
}

/// Checks that the scene of the pipeline has the free numbers. What `effects: auto` decides, and a scene that another
/// stage makes, are not known yet.
fn check_free(stage: &StageDeclaration<'_>) -> Result<(), InputError> {
    let (Some(node), None) = (stage.node.peek("free"), stage.scene_from) else {
        return Ok(());
    };
    let scene = scene::read_all_states(stage.node, stage.scene)?.simulated();
    if scene.auto {
        return Ok(());
    }
    let root = Document::from_text(Path::new("scene"), &scene.to_text())?.root;
    let Free(free) = Free::read(node, "free", &())?;
    let found = free.iter().map(|key| FreeKey::find(&root, key).map(|_| ()));
    found.collect::<Result<(), _>>().map_err(|error| node.place(error))
}

/// Free numbers of a scene: `KEY` or `KEY=LOW..HIGH`.
#[derive(Clone, Debug, PartialEq, Eq)]
struct Free(Vec<String>);

/// The word for the usual bounds.
const AUTO: &str = "auto";

impl Parameter for Free {
    type Limits = ();
    type Literal = Self;

    fn read(node: &Node, key: &str, (): &()) -> Result<Self, InputError> {
        let entries = node.entries(key)?;
        if entries.is_empty() {
            return Err(node
                .error(format!("`{key}` is empty"))
                .help("name a number of the scene"));
        }
        let free = |(name, bounds): &(Node, Node)| {
            let name = name.text("a number of the scene")?;
            Ok(match bounds.text(name)? {
                AUTO => name.to_owned(),
                bounds => format!("{name}={bounds}"),
            })
        };
        Ok(Self(entries.iter().map(free).collect::<Result<_, InputError>>()?))
    }

    fn canonical(&self) -> Option<Canonical> {
        let entry = |text: &String| {
            let (name, bounds) = text.split_once('=').unwrap_or((text, AUTO));
            (name.to_owned(), Canonical::from(bounds))
        };
        Some(Canonical::map(self.0.iter().map(entry)))
    }

    fn schema((): &()) -> Schema {
        Schema::new(json!({
            "type": "object",
            "minProperties": 1,
            "additionalProperties": Value::from(Schema::text()),
        }))
    }

    fn literal(literal: Self) -> Self {
        literal
    }

    fn example() -> String {
        "{ shear_modulus: auto }".to_owned()
    }
}

/// The name of a law.
#[derive(Clone, Debug, PartialEq, Eq)]
struct LawName(String);

impl LawName {
    fn kind(&self) -> Option<LawKind> {
        law_named(&self.0).ok()
    }
}

impl Parameter for LawName {
    type Limits = ();
    type Literal = &'static str;

    fn read(node: &Node, key: &str, (): &()) -> Result<Self, InputError> {
        match law_named(node.text(key)?) {
            Ok(kind) => Ok(Self(name_of_law(kind))),
            Err(allowed) => Err(node
                .error(format!("`{key}` is {}", node.found()))
                .help(format!("allowed: {allowed}"))),
        }
    }

    fn canonical(&self) -> Option<Canonical> {
        Some(Canonical::from(self.0.as_str()))
    }

    fn schema((): &()) -> Schema {
        let names = LAWS.into_iter().map(name_of_law).chain(["ogden".to_owned()]);
        let names: Vec<String> = names.collect();
        Schema::word(&names.iter().map(String::as_str).collect::<Vec<_>>())
    }

    fn literal(literal: &'static str) -> Self {
        Self(literal.to_owned())
    }

    fn example() -> String {
        "gent".to_owned()
    }
}

struct FitStage {
    scene: Scene,
    /// Those of the scene, which the fitted one keeps.
    tolerances: Option<Tolerances>,
    parameters: FitParameters,
}

impl Stage for FitStage {
    fn parameters(&self) -> Canonical {
        let free = self.parameters.free.as_ref().map(|Free(free)| &free[..]);
        let own = match self.parameters.to_canonical() {
            // Changes the key: earlier versions kept law and branches of the former elastomer among the properties.
            Canonical::Map(mut own) if replaces_known_elastomer(&self.scene, free) => {
                own.insert("known_elastomer".to_owned(), 2_u64.into());
                Canonical::Map(own)
            }
            own => own,
        };
        let mut all = scene::with_scene(own, &self.scene);
        if let (Some(tolerances), Canonical::Map(all)) = (&self.tolerances, &mut all)
            && let Some(Canonical::Map(scene)) = all.get_mut("scene")
        {
            scene.insert("tolerances".to_owned(), tolerances.to_canonical());
        }
        all
    }

    fn revision(&self) -> u32 {
        // 1: laws with undetermined parameters are not chosen; 2: nor those with more parameters and about the same
        // AICc.
        let compares_laws = self.parameters.laws.as_ref().is_none_or(|laws| laws.len() > 1);
        2 * u32::from(self.parameters.free.is_none() && compares_laws)
    }

    fn unit(&self) -> &'static str {
        "files"
    }

    fn plan(&self, inputs: &[Input]) -> Plan {
        Plan::Whole {
            steps: inputs.len() as u64,
        }
    }

    fn build(&self, job: &Job<'_>) -> Result<Object, StageError> {
        let tables = tables_of(job.inputs.iter())?;
        let content = match &self.parameters.free {
            Some(Free(free)) => self.numbers(free, tables, job),
            None => self.laws(&tables, job),
        };
        job.progress.advance(job.inputs.len() as u64);
        let content = FittedScene {
            tolerances: self.tolerances.clone(),
            ..content.map_err(scene::refused)?
        };
        Ok(content.object())
    }
}

impl FitStage {
    /// Fits numbers of the scene.
    fn numbers(&self, free: &[String], tables: Vec<MeasuredTable>, job: &Job<'_>) -> Result<FittedScene, InputError> {
        let mesh = &self.parameters.mesh;
        let device = Device::new(&self.scene, free, mesh.options())?;
        let sets = MeasuredSet::of_tables(tables, &device, &self.scene, |note| job.progress.note(note))?;
        let found = fit_scene(&device, &sets, !mesh.is_chosen())?;
        found
            .warnings(&device)?
            .iter()
            .for_each(|warning| job.progress.note(warning));
        let device = found.mesh.map_or_else(|| device.clone(), |mesh| device.on(mesh));
        let (compared, _) = compare_all(&device, &sets, &found.values(), false)?;
        let names = device
            .keys()
            .iter()
            .map(|key| (key.path.clone(), key.dimension))
            .collect();
        Ok(content(
            (&found.fit.estimate, &found.fit.verdict),
            names,
            &compared,
            found.scene,
            found.mesh.map(|mesh| mesh.to_string()),
        ))
    }

    /// Fits laws or branches.
    fn laws(&self, tables: &[MeasuredTable], job: &Job<'_>) -> Result<FittedScene, InputError> {
        let names = self.parameters.laws.iter().flatten();
        let laws: Vec<LawKind> = names.filter_map(LawName::kind).collect();
        let measured = tables.iter().filter_map(MeasuredTable::of_specimen).collect();
        let fit = SpecimenFit::new(measured, &self.scene, &laws, self.parameters.branches as usize)?;
        let doubt = fit.doubt_at_prestretch(&self.scene);
        let warnings = fit.warnings().into_iter().chain(doubt);
        warnings.for_each(|warning| job.progress.note(&warning));
        if let (Some(law), Some(reason)) = (fit.chosen_law(), fit.reason()) {
            let name = name_of_law(law.law.kind());
            job.progress.note(&format!("{name} is chosen: {reason}"));
        }
        let scene = fit.scene(&self.scene)?;
        let Some((estimate, verdict, _)) = fit.chosen() else {
            return Err(InputError::new("no law fits the curves").help(fit.verdicts().join("; ")));
        };
        let named = |parameter: &Fitted| (parameter.name.clone(), dimension_of(&parameter.name));
        let names = estimate.parameters.iter().map(named).collect();
        let mut content = content((estimate, verdict), names, &fit.compared()?, scene, None);
        content.candidates = Some(candidates(&fit));
        Ok(content)
    }
}

fn candidates(fit: &SpecimenFit) -> FitCandidates {
    let mut all = FitCandidates::default();
    let (mut left_out, mut left_out_tests) = (Vec::new(), Vec::new());
    let mut add = |name: String, estimate: Option<&Estimate>, is_chosen: bool| {
        let aicc = estimate
            .map(|estimate| estimate.information.aicc)
            .filter(|aicc| aicc.is_finite());
        all.name.push(name);
        all.fitted.push(u64::from(estimate.is_some()));
        all.chosen.push(u64::from(is_chosen));
        all.aicc.push(aicc.unwrap_or_default());
        all.sum_of_squares
            .push(estimate.map_or(0.0, |estimate| estimate.sum_of_squares));
    };
    if let SpecimenFit::Laws(_, candidates) = fit {
        let tests = candidates
            .iter()
            .map(|one| &one.left_out)
            .max_by_key(|tests| tests.len());
        let tests: Vec<Test> = tests.into_iter().flatten().map(|(test, _)| *test).collect();
        for one in candidates {
            let rms = |test: &Test| {
                one.left_out
                    .iter()
                    .find(|(other, _)| other == test)
                    .and_then(|(_, rms)| *rms)
            };
            left_out.extend(
                tests
                    .iter()
                    .map(|test| rms(test).filter(|rms| rms.is_finite()).unwrap_or(0.0)),
            );
        }
        left_out_tests = tests.iter().map(|test| test.name().to_owned()).collect();
    }
    match fit {
        SpecimenFit::Laws(_, candidates) => {
            let chosen = fit.chosen_law().map(|fit| fit.law.kind());
            for one in candidates {
                let estimate = one.fit.as_ref().ok().map(|fit| &fit.estimate);
                add(name_of_law(one.kind), estimate, Some(one.kind) == chosen);
            }
        }
        SpecimenFit::Branches(_, fits) => {
            for (at, one) in fits.iter().enumerate() {
                add(one.branches().to_string(), Some(&one.estimate), at == 0);
            }
        }
    }
    FitCandidates {
        left_out_test: left_out_tests,
        left_out_rms: left_out,
        ..all
    }
}

fn content(
    (estimate, verdict): (&Estimate, &Verdict),
    named: Vec<(String, Dimension)>,
    compared: &[Compared],
    scene: Scene,
    mesh: Option<String>,
) -> FittedScene {
    let (names, dimensions): (Vec<String>, Vec<Dimension>) = named.into_iter().unzip();
    let flag = |is: bool| u64::from(is);
    let each = &estimate.parameters;
    let interval = |parameter: &Fitted| -> [Option<f64>; 2] {
        let ends = parameter.profile.or(parameter.interval).filter(|_| estimate.converged);
        let finite = |end: f64| Some(end).filter(|end| end.is_finite());
        ends.map_or([None; 2], |(low, high)| [finite(low), finite(high)])
    };
    let count = each.len();
    let covariance = (0..count).flat_map(|row| (0..count).map(move |column| (row, column)));
    let covariance = covariance.map(|(row, column)| {
        let is_in = row < estimate.covariance.nrows() && column < estimate.covariance.ncols();
        let value = if is_in { estimate.covariance[(row, column)] } else { 0.0 };
        if value.is_finite() { value } else { 0.0 }
    });
    FittedScene {
        parameters: FittedParameters {
            name: LongTexts(names),
            value: each.iter().map(|parameter| parameter.value).collect(),
            unit: dimensions
                .iter()
                .map(|dimension| dimension.base_unit().to_owned())
                .collect(),
            logarithmic: each.iter().map(|parameter| flag(parameter.logarithmic)).collect(),
            determined: each
                .iter()
                .map(|parameter| flag(parameter.standard_error.is_some()))
                .collect(),
            at_bound: each.iter().map(|parameter| flag(parameter.at_bound)).collect(),
            standard_error: each
                .iter()
                .map(|parameter| parameter.standard_error.unwrap_or(0.0))
                .collect(),
            interval: each
                .iter()
                .map(|parameter| interval(parameter).map(|end| end.unwrap_or(0.0)))
                .collect(),
            bounded: each
                .iter()
                .map(|parameter| interval(parameter).map(|end| flag(end.is_some())))
                .collect(),
            covariance: covariance.collect(),
        },
        sum_of_squares: [estimate.sum_of_squares],
        stated: [flag(estimate.stated)],
        degrees_of_freedom: [estimate.degrees_of_freedom as u64],
        verdict: match verdict {
            Verdict::Determined => "determined",
            Verdict::Open(_) => "open",
            Verdict::NotDetermined(_) => "not-determined",
            Verdict::ReducesTo(_) => "reduces",
            Verdict::Unstable(..) => "unstable",
            Verdict::NotConverged => "not-converged",
        }
        .to_owned(),
        candidates: None,
        files: compared_files(compared),
        rows: compared_rows(compared),
        mesh,
        scene,
        tolerances: None,
    }
}

/// Returns the voltage offset in V that a fit has found, if it was free.
///
/// # Errors
/// If the artifact cannot be read.
pub fn offset_of(fit: &Artifact) -> Result<Option<f64>, StageError> {
    let parameters = FittedScene::open(fit)?.parameters();
    let (names, values) = (parameters.name().read()?.0, parameters.value().read()?);
    let mut named = names.iter().zip(values);
    Ok(named.find(|(name, _)| *name == VOLTAGE_OFFSET).map(|(_, value)| value))
}
