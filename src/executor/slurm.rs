//! Slurm, by the commands `sbatch`, `squeue` and `scancel`. Workers are submitted as arrays, because Slurm takes about
//! a second per job.
//!
//! Arrays are identified by name, so that the successor of a killed submitter finds an array whose number was not
//! saved.

use std::collections::BTreeMap;

use super::engine::{Engine, EngineError, Request, last_line, output_of, quoted, run_all};
use super::profile::SlurmOptions;

/// The largest array if the cluster does not report it: Slurm's default.
const DEFAULT_ARRAY_SIZE: u32 = 1001;

/// Short names of the states of ended tasks: cancelled, completed, timed out and so on.
const ENDED: [&str; 9] = ["BF", "CA", "CD", "DL", "F", "NF", "OOM", "PR", "TO"];

/// A Slurm cluster.
pub struct SlurmEngine {
    options: SlurmOptions,
    /// Shell commands before each worker.
    environment: Vec<String>,
    most: u32,
}

impl SlurmEngine {
    /// Finds the cluster and reads its largest array size.
    ///
    /// # Errors
    /// If the commands of Slurm are missing.
    pub fn find(options: SlurmOptions, environment: Vec<String>) -> Result<Self, EngineError> {
        output_of("squeue", &["--version".to_owned()], "")?;
        // Only the array size is needed; on an error the default is used.
        let configuration = output_of("scontrol", &["show".to_owned(), "config".to_owned()], "").unwrap_or_default();
        Ok(Self {
            options,
            environment,
            most: most_workers(&configuration),
        })
    }
}

impl Engine for SlurmEngine {
    fn submit(&self, request: &Request<'_>) -> Result<Option<String>, EngineError> {
        let output = output_of(
            "sbatch",
            &arguments(&self.options, request),
            &script(&self.environment, request),
        )?;
        // `NUMBER` or `NUMBER;CLUSTER`, after messages of the site.
        let last = last_line(&output).unwrap_or_default();
        let number = last.split(';').next().unwrap_or_default();
        match !number.is_empty() && number.bytes().all(|byte| byte.is_ascii_digit()) {
            true => Ok(Some(number.to_owned())),
            false => Ok(None),
        }
    }

    fn active_workers(&self, names: &[&str]) -> Result<Option<BTreeMap<String, u32>>, EngineError> {
        let arguments = ["--me", "--noheader", "--array", "--format=%t %j"].map(str::to_owned);
        let names = format!("--name={}", names.join(","));
        let output = output_of("squeue", &[&arguments[..], &[names]].concat(), "")?;
        Ok(Some(counted(&output)))
    }

    fn cancel(&self, arrays: &[(&str, Option<&str>)]) -> Result<(), EngineError> {
        // `--name` takes one name.
        let cancel = |name: &str| output_of("scancel", &["--me".to_owned(), format!("--name={name}")], "");
        run_all(arrays.iter().map(|(name, _)| cancel(name)))
    }

    fn most_workers(&self) -> u32 {
        self.most
    }
}

/// Parses `MaxArraySize = 1001`: the largest index of a task is one less, and indices start at 0.
fn most_workers(configuration: &str) -> u32 {
    let lines = configuration.lines().filter_map(|line| line.split_once('='));
    let mut sizes = lines.filter(|(key, _)| key.trim() == "MaxArraySize");
    let size = sizes.next().and_then(|(_, value)| value.trim().parse().ok());
    size.unwrap_or(DEFAULT_ARRAY_SIZE).max(1)
}

/// Counts the queued or running tasks by the name of the array.
fn counted(output: &str) -> BTreeMap<String, u32> {
    let mut counts = BTreeMap::new();
    let tasks = output.lines().filter_map(|line| line.trim().split_once(' '));
    for (_, name) in tasks.filter(|(state, _)| !ENDED.contains(state)) {
        *counts.entry(name.trim().to_owned()).or_default() += 1;
    }
    counts
}

fn arguments(options: &SlurmOptions, request: &Request<'_>) -> Vec<String> {
    let Request {
        name,
        workers,
        resources,
        logs,
        ..
    } = request;
    // Options of the profile come first: of repeated options the last counts.
    let mut arguments = options.extra.clone();
    arguments.extend([
        "--parsable".to_owned(),
        format!("--job-name={name}"),
        format!("--array=0-{}", workers.saturating_sub(1)),
        format!("--output={}/{name}-%a.log", logs.replace('%', "%%")),
        "--open-mode=append".to_owned(),
        format!("--cpus-per-task={}", resources.threads),
        if resources.requeue { "--requeue" } else { "--no-requeue" }.to_owned(),
    ]);
    let optional = [
        resources.memory.map(|memory| format!("--mem={memory}M")),
        resources.minutes().map(|minutes| format!("--time={minutes}")),
        resources
            .partition
            .as_ref()
            .map(|partition| format!("--partition={partition}")),
        (resources.gpus > 0).then(|| format!("--gpus={}", resources.gpus)),
        options.account.as_ref().map(|account| format!("--account={account}")),
    ];
    arguments.extend(optional.into_iter().flatten());
    arguments
}

fn script(environment: &[String], request: &Request<'_>) -> String {
    // With `exec` signals reach the worker instead of the shell.
    let lines = environment.iter().map(String::as_str);
    let worker = format!("exec {}", quoted(request.worker));
    let lines: Vec<&str> = ["#!/bin/bash"]
        .into_iter()
        .chain(lines)
        .chain([worker.as_str()])
        .collect();
    lines.join("\n") + "\n"
}

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use super::*;
    use crate::profile::Resources;

    #[test]
    fn queued_and_running_tasks_are_counted_by_name() {
        let output = "PD one\nR one\nCG two\nCD two\nTO three\n\nbroken\n";
        let counts = counted(output);
        assert_eq!(counts, [("one".to_owned(), 2), ("two".to_owned(), 1)].into());
        assert_eq!(counted(""), BTreeMap::new());
    }

    #[test]
    fn the_largest_array_is_that_of_the_cluster() {
        assert_eq!(most_workers("MaxArraySize            = 5\nMaxJobCount = 10"), 5);
        assert_eq!(most_workers("nothing"), DEFAULT_ARRAY_SIZE);
        assert_eq!(most_workers("MaxArraySize = 0"), 1);
    }

    #[test]
    fn a_request_passes_all_options_of_the_profile() {
        let resources = Resources {
            workers: 8,
            threads: 4,
            memory: Some(7630),
            time: Some(Duration::from_secs(90)),
            partition: Some("main".to_owned()),
            gpus: 1,
            requeue: true,
            retries: 3,
        };
        let worker = ["/opt/a b/deaflow".to_owned(), "worker".to_owned()];
        let request = Request {
            name: "deaflow-1",
            workers: 8,
            resources: &resources,
            worker: &worker,
            logs: "/logs/100%",
        };
        let options = SlurmOptions {
            account: Some("lab".to_owned()),
            extra: vec!["--qos=low".to_owned()],
        };
        assert_eq!(
            arguments(&options, &request).join(" "),
            "--qos=low --parsable --job-name=deaflow-1 --array=0-7 --output=/logs/100%%/deaflow-1-%a.log \
             --open-mode=append --cpus-per-task=4 --requeue --mem=7630M --time=2 --partition=main --gpus=1 \
             --account=lab"
        );
        assert_eq!(
            script(&["module load hdf5".to_owned()], &request),
            "#!/bin/bash\nmodule load hdf5\nexec '/opt/a b/deaflow' worker\n"
        );
    }
}
