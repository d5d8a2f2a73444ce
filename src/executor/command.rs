//! Any engine, by a command of the user that starts workers: PBS, SGE, LSF, HyperQueue, Kubernetes.
//!
//! The engine is not queried: the workers are counted by their heartbeats in the store.

use std::collections::BTreeMap;

use super::engine::{Engine, EngineError, Request, last_line, output_of, quoted, run_all};

/// The largest number of workers per call.
const MAX_WORKERS: u32 = 100_000;

/// The placeholders that a command may have in braces.
const PLACEHOLDERS: [&str; 9] = [
    "n", "worker", "script", "name", "threads", "memory", "minutes", "gpus", "logs",
];

/// An engine that is given by its commands.
pub struct CommandEngine {
    submit: String,
    cancel: Option<String>,
    environment: Vec<String>,
}

impl CommandEngine {
    /// With the command that submits workers, and the one that cancels them, if any.
    ///
    /// # Errors
    /// If a placeholder is unknown, or the first command does not contain the worker.
    pub fn new(submit: String, cancel: Option<String>, environment: Vec<String>) -> Result<Self, String> {
        let names = placeholders(&submit);
        if let Some(unknown) = names.iter().find(|name| !PLACEHOLDERS.contains(name)) {
            return Err(format!(
                "unknown {{{unknown}}}; allowed: {{{}}}",
                PLACEHOLDERS.join("}, {")
            ));
        }
        if !names.contains(&"worker") && !names.contains(&"script") {
            return Err("contains neither {worker} nor {script}".to_owned());
        }
        let cancels = cancel.as_deref().map(placeholders).unwrap_or_default();
        if let Some(unknown) = cancels.iter().find(|name| !["id", "name"].contains(name)) {
            return Err(format!("unknown {{{unknown}}} in `cancel`; allowed: {{id}}, {{name}}"));
        }
        Ok(Self {
            submit,
            cancel,
            environment,
        })
    }
}

impl Engine for CommandEngine {
    fn submit(&self, request: &Request<'_>) -> Result<Option<String>, EngineError> {
        let worker = quoted(request.worker);
        let worker = match self.environment.as_slice() {
            [] => worker,
            lines => quoted(&[
                "bash".to_owned(),
                "-c".to_owned(),
                format!("{}\nexec {worker}", lines.join("\n")),
            ]),
        };
        let resources = request.resources;
        let values = [
            ("n", request.workers.to_string()),
            ("script", quoted(std::slice::from_ref(&worker))),
            ("worker", worker),
            ("name", request.name.to_owned()),
            ("threads", resources.threads.to_string()),
            ("memory", resources.memory.unwrap_or(0).to_string()),
            ("minutes", resources.minutes().unwrap_or(0).to_string()),
            ("gpus", resources.gpus.to_string()),
            ("logs", quoted(&[request.logs.to_owned()])),
        ];
        let output = shell(&filled(&self.submit, &values))?;
        Ok(last_line(&output).map(str::to_owned))
    }

    fn active_workers(&self, _names: &[&str]) -> Result<Option<BTreeMap<String, u32>>, EngineError> {
        Ok(None)
    }

    fn cancel(&self, arrays: &[(&str, Option<&str>)]) -> Result<(), EngineError> {
        // Without a command, workers stop when they see the note in the store.
        let Some(cancel) = &self.cancel else {
            return Ok(());
        };
        let commands = arrays.iter().map(|(name, id)| {
            let values = [
                ("name", (*name).to_owned()),
                ("id", quoted(&[id.unwrap_or_default().to_owned()])),
            ];
            filled(cancel, &values)
        });
        run_all(commands.map(|command| shell(&command)))
    }

    fn most_workers(&self) -> u32 {
        MAX_WORKERS
    }
}

fn shell(command: &str) -> Result<String, EngineError> {
    let output = output_of("sh", &["-c".to_owned(), command.to_owned()], "");
    output.map_err(|error| EngineError {
        command: command.to_owned(),
        ..error
    })
}

/// Returns the words in braces. Braces around anything else belong to the shell.
fn placeholders(command: &str) -> Vec<&str> {
    let opened = command
        .split('{')
        .skip(1)
        .filter_map(|rest| Some(rest.split_once('}')?.0));
    let is_word = |word: &&str| !word.is_empty() && word.bytes().all(|byte| byte.is_ascii_lowercase());
    opened.filter(is_word).collect()
}

/// Replaces the placeholders by values. Braces in a value are kept.
fn filled(command: &str, values: &[(&str, String)]) -> String {
    let mut rest = command;
    let mut text = String::new();
    while let Some(at) = rest.find('{') {
        let (before, from) = rest.split_at(at);
        text += before;
        let found = values.iter().find_map(|(name, value)| {
            let after = from.strip_prefix('{')?.strip_prefix(name)?.strip_prefix('}')?;
            Some((value, after))
        });
        (text, rest) = match found {
            Some((value, after)) => (text + value, after),
            None => (text + "{", &from[1..]),
        };
    }
    text + rest
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::profile::Resources;

    #[test]
    fn placeholders_are_replaced_once() {
        let values = [("n", "3".to_owned()), ("worker", "echo {n}".to_owned())];
        assert_eq!(
            filled("run {n} ${HOME} {worker} {", &values),
            "run 3 ${HOME} echo {n} {"
        );
        assert_eq!(placeholders("a {n} ${HOME} {worker} {a b}"), ["n", "worker"]);
    }

    #[test]
    fn a_command_without_the_worker_or_with_an_unknown_placeholder_is_refused() {
        let new = |submit: &str, cancel: Option<&str>| {
            CommandEngine::new(submit.to_owned(), cancel.map(str::to_owned), Vec::new()).err()
        };
        assert_eq!(new("submit.sh {n} {worker}", Some("qdel {id}")), None);
        assert!(new("submit.sh {n}", None).unwrap().contains("{worker}"));
        assert!(new("submit.sh {count} {worker}", None).unwrap().contains("{count}"));
        assert!(new("submit.sh {worker}", Some("qdel {job}")).unwrap().contains("{job}"));
    }

    #[test]
    fn the_command_runs_in_a_shell_and_its_last_line_is_the_number() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("it's written");
        let submit = "echo notice; for i in $(seq {n}); do {worker}; done; echo 42".to_owned();
        let engine = CommandEngine::new(submit, None, vec!["export WHO=there".to_owned()]).unwrap();
        let resources = Resources {
            workers: 2,
            threads: 1,
            memory: None,
            time: None,
            partition: None,
            gpus: 0,
            requeue: true,
            retries: 3,
        };
        let script = format!("echo $WHO >> \"{}\"", file.display());
        let worker = ["sh".to_owned(), "-c".to_owned(), script];
        let request = Request {
            name: "deaflow-1",
            workers: 2,
            resources: &resources,
            worker: &worker,
            logs: "/logs",
        };
        assert_eq!(engine.submit(&request).unwrap().as_deref(), Some("42"));
        assert_eq!(std::fs::read_to_string(&file).unwrap(), "there\nthere\n");
        engine.cancel(&[("deaflow-1", Some("42"))]).unwrap();
        let script = "printf '%s\n' {script} | sh".to_owned();
        let engine = CommandEngine::new(script, Some("echo {id} >> cancelled".to_owned()), Vec::new()).unwrap();
        engine.submit(&request).unwrap();
        assert_eq!(
            std::fs::read_to_string(&file).unwrap(),
            "there\nthere\n\n",
            "$WHO is not set here"
        );
    }
}
