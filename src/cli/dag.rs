//! `deaflow dag`: the stages of a pipeline and their dependencies, as text or for Mermaid and Graphviz.

use std::fmt::Write;
use std::path::PathBuf;

use clap::{Args, ValueEnum};
use serde_json::json;

use super::arguments::pipeline_parser;
use super::{CliError, Exit, Output, pipeline};
use deaflow_orchestrator::StageSpec;

/// Draw the stages of a pipeline and their dependencies
#[derive(Debug, Args)]
#[command(after_help = examples!(
    "deaflow dag pipeline.yaml",
    "deaflow dag pipeline.yaml --format dot | dot -Tsvg -o stages.svg",
))]
pub struct DagArguments {
    /// The pipeline: a YAML file, or a folder with exactly one [default: the current folder]
    #[arg(default_value = ".", hide_default_value = true, value_parser = pipeline_parser())]
    pub pipeline: PathBuf,
    /// The output format
    #[arg(long, value_enum, default_value_t = DagFormat::Text)]
    pub format: DagFormat,
}

#[derive(Clone, Copy, Debug, ValueEnum)]
pub enum DagFormat {
    /// One line per stage
    Text,
    /// A Mermaid flow chart
    Mermaid,
    /// A Graphviz digraph
    Dot,
}

pub fn execute(arguments: &DagArguments, output: &Output) -> Result<Exit, CliError> {
    let pipeline = pipeline::load_plain(&arguments.pipeline)?;
    let waits: Vec<Vec<usize>> = pipeline.stages.iter().map(StageSpec::waits_for).collect();
    let stages: Vec<Node<'_>> = pipeline
        .stages
        .iter()
        .zip(&waits)
        .map(|(spec, needs)| Node {
            name: &spec.name,
            kind: spec.kind.name(),
            needs,
        })
        .collect();
    if output.is_json() {
        let needs = |stage: &Node<'_>| stage.needs.iter().map(|&n| stages[n].name).collect::<Vec<_>>();
        let node = |stage: &Node<'_>| json!({ "name": stage.name, "kind": stage.kind, "needs": needs(stage) });
        output.document(&json!({ "stages": stages.iter().map(node).collect::<Vec<_>>() }))?;
        return Ok(Exit::Done);
    }
    match arguments.format {
        DagFormat::Text => output.text(text(&stages))?,
        DagFormat::Mermaid => output.plain(&mermaid(&stages))?,
        DagFormat::Dot => output.plain(&dot(&pipeline.name, &stages))?,
    }
    Ok(Exit::Done)
}

/// A stage; its needs are positions in the list of stages.
struct Node<'a> {
    name: &'a str,
    kind: &'a str,
    needs: &'a [usize],
}

fn text(stages: &[Node<'_>]) -> String {
    let width = |of: fn(&Node<'_>) -> usize| stages.iter().map(of).max().unwrap_or(0);
    let (names, kinds) = (width(|s| s.name.chars().count()), width(|s| s.kind.chars().count()));
    let line = |stage: &Node<'_>| {
        let needs: Vec<&str> = stage.needs.iter().map(|&n| stages[n].name).collect();
        let needs = if needs.is_empty() {
            String::new()
        } else {
            format!("  <- {}", needs.join(", "))
        };
        format!("{:<names$}  {:<kinds$}{needs}", stage.name, stage.kind)
            .trim_end()
            .to_owned()
    };
    stages.iter().map(line).collect::<Vec<_>>().join("\n")
}

/// Formats a Mermaid chart. Stages are numbered, since a name may be a keyword of the language (`end`).
fn mermaid(stages: &[Node<'_>]) -> String {
    let mut out = String::from("flowchart LR\n");
    for (i, stage) in stages.iter().enumerate() {
        let _ = writeln!(out, "    s{i}[\"{}<br/><i>{}</i>\"]", stage.name, stage.kind);
    }
    for (i, stage) in stages.iter().enumerate() {
        stage.needs.iter().for_each(|need| {
            let _ = writeln!(out, "    s{need} --> s{i}");
        });
    }
    out
}

fn dot(pipeline: &str, stages: &[Node<'_>]) -> String {
    let quoted = |text: &str| format!("\"{}\"", text.replace('\\', "\\\\").replace('"', "\\\""));
    let mut out = format!(
        "digraph {} {{\n    rankdir=LR;\n    node [shape=box];\n",
        quoted(pipeline)
    );
    for stage in stages {
        let label = format!("\"{}\\n{}\"", stage.name, stage.kind);
        let _ = writeln!(out, "    {} [label={label}];", quoted(stage.name));
        for &need in stage.needs {
            let _ = writeln!(out, "    {} -> {};", quoted(stages[need].name), quoted(stage.name));
        }
    }
    out + "}"
}

#[cfg(test)]
mod tests {
    use super::*;

    const STAGES: [Node<'static>; 3] = [
        Node {
            name: "small",
            kind: "sample",
            needs: &[],
        },
        Node {
            name: "end",
            kind: "sample",
            needs: &[],
        },
        Node {
            name: "solved",
            kind: "solve",
            needs: &[0, 1],
        },
    ];

    #[test]
    fn every_form_has_every_stage_and_every_need() {
        assert_eq!(
            text(&STAGES),
            "small   sample\nend     sample\nsolved  solve   <- small, end"
        );
        let chart = mermaid(&STAGES);
        assert!(
            chart.starts_with("flowchart LR\n    s0[\"small<br/><i>sample</i>\"]"),
            "{chart}"
        );
        assert!(chart.contains("s0 --> s2\n    s1 --> s2"), "{chart}");
        let graph = dot("a \"b\"", &STAGES);
        assert!(
            graph.starts_with("digraph \"a \\\"b\\\"\" {") && graph.ends_with('}'),
            "{graph}"
        );
        assert!(
            graph.contains("\"small\" -> \"solved\";\n    \"end\" -> \"solved\";"),
            "{graph}"
        );
    }
}
