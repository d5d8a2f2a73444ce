//! The metadata of a research object: a Workflow Run RO-Crate 0.5 (Leo et al., *Recording provenance of workflow runs
//! with RO-Crate*, PLOS ONE 2024; RO-Crate 1.1). The run is an action whose instrument is the pipeline; each stage is
//! an action whose instrument is deaflow.

use std::collections::{BTreeMap, BTreeSet};

use serde_json::{Value, json};

use deaflow_base::{Digest, uri};

/// The name of the metadata file.
pub const METADATA: &str = "ro-crate-metadata.json";

/// The profiles of our crates: identifier, name, version.
const PROFILES: [[&str; 3]; 3] = [
    ["https://w3id.org/ro/wfrun/process/0.5", "Process Run Crate", "0.5"],
    ["https://w3id.org/ro/wfrun/workflow/0.5", "Workflow Run Crate", "0.5"],
    [
        "https://w3id.org/workflowhub/workflow-ro-crate/1.0",
        "Workflow RO-Crate",
        "1.0",
    ],
];

/// A file of the crate.
#[derive(Clone, Debug)]
pub struct CrateFile {
    /// Its path in the crate.
    pub path: String,
    /// Its description.
    pub description: String,
    /// Its media type.
    pub format: &'static str,
    /// Its length in bytes.
    pub size: u64,
}

/// A stage and its artifact.
#[derive(Clone, Debug)]
pub struct CrateStage {
    /// Its name.
    pub name: String,
    /// Its kind.
    pub kind: String,
    /// Names of the stages that it reads.
    pub needs: Vec<String>,
    /// Its artifact as a file of the crate.
    pub file: String,
    /// Digest of the artifact.
    pub digest: String,
    /// Its action key.
    pub key: String,
    /// Its canonical parameters.
    pub parameters: String,
    /// Its start and end, in UTC, RFC 3339.
    pub times: [String; 2],
    /// The host.
    pub host: String,
    /// Version of the program, and its build.
    pub program: [String; 2],
    /// Its figures, as files of the crate.
    pub figures: Vec<String>,
}

/// A run of a pipeline as a crate.
#[derive(Clone, Debug)]
pub struct ResearchObject {
    /// Name of the pipeline.
    pub name: String,
    /// The licence of the content: a URL or a text.
    pub license: String,
    /// The pipeline file.
    pub workflow: String,
    /// The other source files.
    pub sources: Vec<String>,
    /// Overrides of the pipeline, by path.
    pub overrides: BTreeMap<String, String>,
    /// The stages, in topological order.
    pub stages: Vec<CrateStage>,
    /// All files except the metadata.
    pub files: Vec<CrateFile>,
}

fn reference(id: &str) -> Value {
    json!({ "@id": id })
}

/// Returns a single value, or several as a list, as RO-Crate recommends; `None` without values.
fn list(values: impl IntoIterator<Item = Value>) -> Option<Value> {
    let mut values: Vec<Value> = values.into_iter().collect();
    match values.len() {
        0 => None,
        1 => values.pop(),
        _ => Some(Value::Array(values)),
    }
}

fn link(path: &str) -> Value {
    reference(&uri(path))
}

impl ResearchObject {
    /// Returns the document `ro-crate-metadata.json`, which depends only on the artifacts.
    #[must_use]
    pub fn metadata(&self) -> Value {
        let mut graph = vec![self.descriptor(), self.root()];
        graph.extend(PROFILES.iter().map(
            |[id, name, version]| json!({ "@id": id, "@type": "CreativeWork", "name": name, "version": version }),
        ));
        graph.push(json!({
            "@id": "#pipeline-language",
            "@type": "ComputerLanguage",
            "name": "deaflow pipeline (YAML)",
            "version": "1",
        }));
        graph.extend(self.files.iter().map(|file| self.file(file)));
        graph.extend(self.programs());
        graph.extend(self.overrides.iter().map(
            |(path, value)| json!({ "@id": override_id(path), "@type": "PropertyValue", "name": path, "value": value }),
        ));
        graph.push(self.run());
        graph.extend(self.stages.iter().flat_map(|stage| self.stage(stage)));
        json!({ "@context": "https://w3id.org/ro/crate/1.1/context", "@graph": graph })
    }

    fn descriptor(&self) -> Value {
        json!({
            "@id": METADATA,
            "@type": "CreativeWork",
            "about": reference("./"),
            "conformsTo": [reference("https://w3id.org/ro/crate/1.1"), reference(PROFILES[2][0])],
        })
    }

    fn root(&self) -> Value {
        let actions = std::iter::once(reference("#run"));
        json!({
            "@id": "./",
            "@type": "Dataset",
            "name": format!("Run of the deaflow pipeline {}", self.name),
            "description": self.description(),
            "datePublished": self.times()[1],
            "license": self.license,
            "conformsTo": PROFILES.iter().map(|[id, ..]| reference(id)).collect::<Vec<_>>(),
            "mainEntity": link(&self.workflow),
            "hasPart": self.files.iter().map(|file| link(&file.path)).collect::<Vec<_>>(),
            "mentions": actions.chain(self.stages.iter().map(|stage| reference(&stage.id()))).collect::<Vec<_>>(),
        })
    }

    fn description(&self) -> String {
        format!(
            "The pipeline {} with {} stages and all of its results: each artifact as a self-contained HDF5 file with \
             units, descriptions and provenance; the lock file, which makes a rerun compare its digests with these; \
             and the figures.",
            self.name,
            self.stages.len()
        )
    }

    fn file(&self, file: &CrateFile) -> Value {
        let mut entity = json!({
            "@id": uri(&file.path),
            "@type": "File",
            "name": file.path,
            "description": file.description,
            "encodingFormat": file.format,
            "contentSize": file.size.to_string(),
        });
        if file.path == self.workflow {
            entity["@type"] = json!(["File", "SoftwareSourceCode", "ComputationalWorkflow"]);
            entity["name"] = json!(self.name);
            entity["programmingLanguage"] = reference("#pipeline-language");
        }
        if let Some(stage) = self.stages.iter().find(|stage| stage.file == file.path) {
            entity["identifier"] = json!(format!("blake3:{}", stage.digest));
        }
        entity
    }

    /// Returns the programs that built artifacts, each once.
    fn programs(&self) -> Vec<Value> {
        let builds: BTreeSet<&[String; 2]> = self.stages.iter().map(|stage| &stage.program).collect();
        let program = |program: &[String; 2]| {
            json!({
                "@id": program_id(program),
                "@type": "SoftwareApplication",
                "name": "deaflow",
                "softwareVersion": format!("{} (build {})", program[0], program[1]),
                "identifier": program[1],
            })
        };
        builds.into_iter().map(program).collect()
    }

    /// Returns the times from the first stage to the last, in one run or several.
    fn times(&self) -> [String; 2] {
        let began = self.stages.iter().map(|stage| &stage.times[0]).min();
        let ended = self.stages.iter().map(|stage| &stage.times[1]).max();
        [began, ended].map(|time| time.cloned().unwrap_or_default())
    }

    fn run(&self) -> Value {
        let [start, end] = self.times();
        let last = self.stages.iter().max_by(|a, b| a.times[1].cmp(&b.times[1]));
        let sources = self.sources.iter().map(|path| link(path));
        let overrides = self.overrides.keys().map(|path| reference(&override_id(path)));
        let results: BTreeSet<&String> = self.stages.iter().flat_map(|stage| stage.files()).collect();
        let mut action = json!({
            "@id": "#run",
            "@type": "CreateAction",
            "name": format!("run of {}", self.name),
            "description": "From the start of the first stage to the end of the last; stages may be from earlier runs.",
            "instrument": link(&self.workflow),
            "startTime": start,
            "endTime": end,
            "actionStatus": "http://schema.org/CompletedActionStatus",
        });
        add(&mut action, "object", list(sources.chain(overrides)));
        add(&mut action, "result", list(results.into_iter().map(|path| link(path))));
        add(
            &mut action,
            "agent",
            last.map(|stage| reference(&program_id(&stage.program))),
        );
        action
    }

    fn stage(&self, stage: &CrateStage) -> [Value; 2] {
        let parameters = format!("{}/parameters", stage.id());
        let of = |name: &String| self.stages.iter().find(|other| other.name == *name);
        let inputs = stage.needs.iter().filter_map(of).map(|other| link(&other.file));
        let mut action = json!({
            "@id": stage.id(),
            "@type": "CreateAction",
            "name": format!("stage {}", stage.name),
            "description": format!("A stage of kind {}, on {}.", stage.kind, stage.host),
            "identifier": stage.key,
            "instrument": reference(&program_id(&stage.program)),
            "agent": reference(&program_id(&stage.program)),
            "startTime": stage.times[0],
            "endTime": stage.times[1],
            "actionStatus": "http://schema.org/CompletedActionStatus",
        });
        add(&mut action, "object", list(inputs.chain([reference(&parameters)])));
        add(&mut action, "result", list(stage.files().map(|path| link(path))));
        let value = json!({
            "@id": parameters,
            "@type": "PropertyValue",
            "name": format!("parameters of {}", stage.name),
            "value": stage.parameters,
        });
        [action, value]
    }

    /// Writes the readme of the crate.
    #[must_use]
    pub fn readme(&self) -> String {
        let mut text = format!(
            "# {}\n\n{}\n\n| stage | kind | artifact | file |\n|---|---|---|---|\n",
            self.name,
            self.description()
        );
        for stage in &self.stages {
            let (name, digest) = (stage.name.replace('|', "\\|"), &stage.digest[..Digest::SHORT]);
            text += &format!(
                "| {name} | {} | `{digest}` | [{}]({}) |\n",
                stage.kind,
                stage.file,
                uri(&stage.file)
            );
        }
        let sets = self
            .overrides
            .iter()
            .map(|(path, value)| format!(" --set '{path}={value}'"));
        text += &format!(
            "\nRun again:\n\n    deaflow run '{}'{}",
            self.workflow,
            sets.collect::<String>()
        );
        text += if self.overrides.is_empty() { " --locked\n" } else { "\n" };
        text += &format!(
            "\nLicence: {}\n\nMade with deaflow; {METADATA} has its version, the times and the inputs.\n",
            self.license
        );
        text
    }
}

impl CrateStage {
    fn id(&self) -> String {
        format!("#stage-{}", uri(&self.name).replace('/', "%2F"))
    }

    fn files(&self) -> impl Iterator<Item = &String> {
        std::iter::once(&self.file).chain(&self.figures)
    }
}

fn add(entity: &mut Value, name: &str, value: Option<Value>) {
    if let Some(value) = value {
        entity[name] = value;
    }
}

fn override_id(path: &str) -> String {
    format!("#set-{}", uri(path).replace('/', "%2F"))
}

fn program_id([version, build]: &[String; 2]) -> String {
    format!("#deaflow-{}-{:.12}", uri(version), uri(build))
}
