//! `kind: compare` puts measured beside simulated numbers: of the scene of the pipeline, or of a fit.

use super::fit::offset_of;
use super::measure::{self, tables_of};
use super::measured::{
    Compared, Device, MeasuredSet, MeshChoice, VOLTAGE_OFFSET, WithEffect, compare_all, compared_files, compared_rows,
    with_neglected_effects,
};
use super::{needed, scene};
use deaflow_base::{Canonical, Declared, Fields, InputError, Node, Voltage, parameters};
use deaflow_content::{ArtifactKind, ComparedEffects, Comparison, FittedScene};
use deaflow_orchestrator::{Input, Job, Kind, Needs, Plan, Stage, StageCheck, StageDeclaration, StageError};
use deaflow_scene::Scene;
use deaflow_store::{Artifact, Object};

/// The kind `compare`.
pub struct CompareKind;

impl Kind for CompareKind {
    fn name(&self) -> &'static str {
        "compare"
    }

    fn recipe(&self) -> u32 {
        1
    }

    fn needs(&self) -> Needs {
        Needs::new(&[measure::NAME], 1, 1000)
    }

    fn optional_needs(&self) -> &'static [&'static str] {
        &["fit"]
    }

    fn reads_scene(&self) -> bool {
        true
    }

    fn results(&self, artifact: &Artifact) -> Result<Vec<(String, f64)>, StageError> {
        let files = Comparison::open(artifact)?.files();
        let (names, rms) = (files.name().read()?.0, files.rms().read()?);
        let (has_explained, explained, has_chi2, chi2) = (
            files.has_r_squared().read()?,
            files.r_squared().read()?,
            files.has_chi2().read()?,
            files.chi2_per_dof().read()?,
        );
        let of = |at: usize| {
            let named = |word: &str, value: f64| (format!("{word}.{}", names[at]), value);
            let chi2 = (has_chi2[at] == 1).then(|| named("chi2_per_dof", chi2[at]));
            let explained = (has_explained[at] == 1).then(|| named("r_squared", explained[at]));
            [named("rms", rms[at])]
                .into_iter()
                .chain(explained)
                .chain(chi2)
                .collect::<Vec<_>>()
        };
        Ok((0..names.len()).flat_map(of).collect())
    }

    fn schema(&self) -> Vec<Fields> {
        vec![CompareParameters::fields()]
    }

    fn check(&self, stage: &StageDeclaration<'_>, needs: &[StageDeclaration<'_>]) -> Result<StageCheck, InputError> {
        needed::measured_once(stage, needs)?;
        let fits = needed::count(needs, &["fit"]);
        if fits > 1 {
            let message = format!("a compare stage takes its scene from one fit; `needs` names {fits}");
            return Err(needed::wrong_number(stage, message, "keep one of them"));
        }
        if let (1, Some(offset)) = (fits, stage.node.peek("voltage_offset")) {
            return Err(offset
                .error("the voltage offset is that of the fit in `needs`")
                .help("remove `voltage_offset`"));
        }
        if let (1, Some(scene)) = (fits, stage.scene_from) {
            return Err(scene
                .error("the scene is that of the fit in `needs`")
                .help("remove `scene`"));
        }
        Ok(StageCheck::default())
    }

    fn read(&self, stage: &Node, scene: Option<&Node>) -> Result<Box<dyn Stage>, InputError> {
        let parameters = CompareParameters::read_with(stage, &["kind", "needs"])?;
        Ok(Box::new(CompareStage {
            scene: scene::read_all_states(stage, scene)?,
            parameters,
        }))
    }
}

parameters! {
    /// Puts measured beside simulated numbers.
    struct CompareParameters as "a compare stage" {
        /// A voltage that is added to all voltages; with a fit in `needs` it is that of the fit.
        voltage_offset: Option<Voltage> [-1e6..=1e6],
        /// Whether to simulate also with each neglected effect whose data the scene has.
        effects: bool = false,
    }
    include {
        /// The mesh of devices.
        mesh: MeshChoice,
    }
}

struct CompareStage {
    scene: Scene,
    parameters: CompareParameters,
}

impl Stage for CompareStage {
    fn parameters(&self) -> Canonical {
        scene::with_scene(self.parameters.to_canonical(), &self.scene)
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
        let fit = job.inputs.iter().find(|input| ArtifactKind::Fit.is_of(input));
        let (scene, offset) = match fit {
            Some(fit) => (FittedScene::open(fit)?.scene().read()?, offset_of(fit)?),
            None => (
                self.scene.clone(),
                self.parameters.voltage_offset.map(|offset| offset.value()),
            ),
        };
        let measured = job.inputs.iter().filter(|input| ArtifactKind::Measure.is_of(input));
        let (keys, values): (Vec<String>, Vec<f64>) =
            offset.iter().map(|offset| (VOLTAGE_OFFSET.to_owned(), *offset)).unzip();
        let mesh = &self.parameters.mesh;
        let device = Device::new(&scene, &keys, mesh.options()).map_err(scene::refused)?;
        let sets = MeasuredSet::of_tables(tables_of(measured)?, &device, &scene, |note| job.progress.note(note));
        let sets = sets.map_err(scene::refused)?;
        let found = compare_all(&device, &sets, &values, !mesh.is_chosen());
        let (compared, mesh) = found.map_err(scene::refused)?;
        let device = device.on(mesh);
        let effects = match self.parameters.effects {
            true => {
                let found = with_neglected_effects(&scene, &device, (&sets, &compared), &values);
                Some(of_effects(&found.map_err(scene::refused)?, &compared, job))
            }
            false => None,
        };
        job.progress.advance(job.inputs.len() as u64);
        let content = Comparison {
            files: compared_files(&compared),
            rows: compared_rows(&compared),
            effects,
            mesh: sets.iter().any(MeasuredSet::is_of_device).then(|| mesh.to_string()),
            scene,
        };
        Ok(content.object())
    }
}

fn of_effects(found: &[WithEffect], compared: &[Compared], job: &Job<'_>) -> ComparedEffects {
    let mut all = ComparedEffects::default();
    for one in found {
        all.name.push(one.effect.to_owned());
        match &one.agreements {
            Ok(agreements) => {
                all.simulated.push(1);
                all.rms.extend(agreements.iter().map(|own| own.rms));
            }
            Err(why) => {
                job.progress.note(&format!("with {}: {why}", one.effect));
                all.simulated.push(0);
                all.rms.extend(std::iter::repeat_n(0.0, compared.len()));
            }
        }
    }
    all
}
