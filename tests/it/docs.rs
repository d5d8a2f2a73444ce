//! Runs the commands of README and documentation, and compares their output with the output that the pages show.
//!
//! Blocks of `sh` and `python` are run, each page in a folder of its own with a copy of `pipelines/`. The block of
//! `text` after them is their output; in it, a line `…` stands for any lines, and `…` at the end of a line for any
//! words. HTML comments before a block change this:
//!
//! - `<!-- not run: REASON -->`: the block is not run; the test prints the reason
//! - `<!-- run as: COMMAND -->`: this is run instead
//! - `<!-- exit: CODE -->`: the last command ends with this code, and the block shows stderr too
//! - `<!-- file: PATH -->`: the block is written to this file
//!
//! `DEAFLOW_UPDATE_DOCS=1 cargo test --test it docs` writes the output of commands and the generated pages into the
//! files.

mod markdown;
mod update;

use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::Command;

use super::common::{Workspace, compare};
use markdown::{Block, blocks};

/// Whether pages are rewritten where they differ.
fn is_update() -> bool {
    std::env::var_os("DEAFLOW_UPDATE_DOCS").is_some_and(|value| value == "1")
}

#[test]
fn the_readme_is_true() {
    run("README.md");
}

#[test]
fn the_tutorial_is_true() {
    run("docs/tutorial.md");
}

#[test]
fn the_page_on_runs_is_true() {
    run("docs/runs.md");
}

#[test]
fn the_page_on_sharing_is_true() {
    run("docs/sharing.md");
}

#[test]
fn the_page_on_python_is_true() {
    run("docs/python.md");
}

#[test]
fn the_page_on_data_is_true() {
    run("docs/data.md");
}

#[test]
fn the_page_on_sides_is_true() {
    run("docs/sides.md");
}

#[test]
fn the_page_on_motion_out_of_the_plane_is_true() {
    run("docs/out-of-plane.md");
}

#[test]
fn the_page_on_tolerances_is_true() {
    run("docs/tolerances.md");
}

#[test]
fn the_page_on_fronts_is_true() {
    run("docs/fronts.md");
}

#[test]
fn the_page_on_reports_is_true() {
    run("docs/report.md");
}

#[test]
fn the_page_on_fitting_is_true() {
    run("docs/fit.md");
}

#[test]
fn the_page_on_published_results_is_true() {
    run("docs/published.md");
}

#[test]
fn the_page_on_coming_from_other_programs_is_true() {
    run("docs/coming-from.md");
}

#[test]
fn the_reference_says_what_the_program_reads() {
    is_written_by(&["schema"], "docs/tools/reference.py", "docs/reference.md");
}

#[test]
fn the_tables_of_arrays_say_what_the_program_writes() {
    is_written_by(&["schema", "artifacts"], "docs/tools/arrays.py", "docs/arrays.md");
}

/// Compares a page with the output of a tool that reads what the program prints.
fn is_written_by(arguments: &[&str], tool: &str, page: &str) {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let workspace = Workspace::new();
    workspace.write("printed.json", &workspace.run(arguments).stdout);
    let written = Command::new(super::h5py::python())
        .arg(root.join(tool))
        .stdin(std::fs::File::open(workspace.path("printed.json")).unwrap())
        .output()
        .unwrap();
    assert!(written.status.success(), "{}", String::from_utf8_lossy(&written.stderr));
    if is_update() {
        std::fs::write(root.join(page), &written.stdout).unwrap();
    }
    let stored = std::fs::read_to_string(root.join(page)).unwrap();
    assert!(
        String::from_utf8_lossy(&written.stdout) == stored,
        "{page} is out of date; run: deaflow {} | python3 {tool} > {page}",
        arguments.join(" ")
    );
}

#[test]
fn links_lead_somewhere() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let docs = std::fs::read_dir(root.join("docs")).unwrap();
    let files = docs
        .map(|entry| entry.unwrap().path())
        .filter(|path| path.extension().is_some_and(|e| e == "md"));
    for file in files.chain([root.join("README.md"), root.join("CONTRIBUTING.md")]) {
        let text = std::fs::read_to_string(&file).unwrap();
        for link in markdown::links(&text) {
            let (path, anchor) = link.split_once('#').unwrap_or((link, ""));
            let target = if path.is_empty() {
                file.clone()
            } else {
                file.parent().unwrap().join(path)
            };
            assert!(target.exists(), "{}: no {link}", file.display());
            if !anchor.is_empty() {
                let headings = markdown::anchors(&std::fs::read_to_string(&target).unwrap());
                assert!(headings.contains(anchor), "{}: no heading of {link}", file.display());
            }
        }
    }
}

#[test]
fn tasks_lead_to_commands_that_are_run() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let index = std::fs::read_to_string(root.join("docs/how-do-i.md")).unwrap();
    let tasks: Vec<&str> = index
        .lines()
        .filter(|line| line.starts_with("- ") && !line.contains('°'))
        .collect();
    assert!(tasks.len() >= 40, "{} tasks", tasks.len());
    for link in tasks.iter().flat_map(|task| markdown::links(task)) {
        let (path, anchor) = link.split_once('#').unwrap_or((link, ""));
        let page = path
            .strip_prefix("../")
            .map_or_else(|| format!("docs/{path}"), str::to_owned);
        let test = format!("run(\"{page}\");");
        assert!(include_str!("docs.rs").contains(&test), "{link}: {page} is not run");
        let text = std::fs::read_to_string(root.join(&page)).unwrap();
        let section = markdown::section(&text, anchor);
        let is_run =
            |block: &Block| matches!(block.language.as_str(), "sh" | "python") && block.directive("not run").is_none();
        assert!(blocks(&section).iter().any(is_run), "{link}: no command that is run");
    }
}

/// All figures of the documentation together, bytes: they are fetched with every clone.
const MOST_FIGURES: u64 = 1_300_000;

#[test]
fn figures_are_shown_and_a_tool_draws_them() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let docs = std::fs::read_dir(root.join("docs")).unwrap();
    let pages = docs.map(|entry| entry.unwrap().path()).chain([root.join("README.md")]);
    let mut shown = std::collections::BTreeSet::new();
    for page in pages.filter(|path| path.extension().is_some_and(|e| e == "md")) {
        let text = std::fs::read_to_string(&page).unwrap();
        for part in text.split("![").skip(1) {
            let path = part
                .split_once("](")
                .and_then(|(_, rest)| rest.split_once(')'))
                .unwrap()
                .0;
            shown.insert(path.rsplit('/').next().unwrap().to_owned());
        }
    }
    let tools = [
        "docs/tools/figures.py",
        "docs/tools/moving.py",
        "docs/tools/photographs.py",
        "docs/tools/ring.py",
        "docs/tools/published.py",
    ];
    let tools = tools
        .map(|tool| std::fs::read_to_string(root.join(tool)).unwrap())
        .concat();
    for name in &shown {
        let entry = format!("\"{}\":", name.trim_end_matches(".png"));
        let is_drawn = tools.contains(&entry) || tools.contains(&format!("\"{name}\""));
        assert!(name == "python.png" || is_drawn, "no tool draws {name}");
    }
    let files = std::fs::read_dir(root.join("docs/figures")).unwrap();
    let files: Vec<_> = files.map(|entry| entry.unwrap()).collect();
    let names = files.iter().map(|file| file.file_name().into_string().unwrap());
    assert_eq!(
        names.collect::<std::collections::BTreeSet<_>>(),
        shown,
        "every figure is shown"
    );
    let size: u64 = files.iter().map(|file| file.metadata().unwrap().len()).sum();
    assert!(size <= MOST_FIGURES, "{size} bytes");
}

/// Runs the blocks of a page from top to bottom.
fn run(file: &str) {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join(file);
    let text = std::fs::read_to_string(&path).unwrap();
    let session = Session::new();
    let mut printed = None;
    let mut replaced = Vec::new();
    for block in blocks(&text) {
        let place = format!("{file}, line {}", block.line);
        if let Some(reason) = block.directive("not run") {
            let _ = writeln!(std::io::stderr(), "NOT RUN: {place}: {reason}");
            printed = None;
        } else if let Some(path) = block.directive("file") {
            session.write(path, &block.text);
        } else if let "sh" | "python" = block.language.as_str() {
            printed = Some(session.run(&block, &place));
        } else if block.language == "text"
            && let Some(printed) = printed.take()
            && let Err(difference) = compare::check(&block.text, &printed)
        {
            assert!(is_update(), "{place}: {difference}\n\nprinted was:\n{printed}");
            let new = update::merged(&block.text, &printed);
            compare::check(&new, &printed).unwrap_or_else(|e| panic!("{place}: {e} in the new block:\n{new}"));
            replaced.push((block, new));
        }
    }
    if !replaced.is_empty() {
        std::fs::write(path, update::with_blocks(&text, &replaced)).unwrap();
    }
}

/// A folder in which a reader tries what is written.
struct Session {
    workspace: Workspace,
}

impl Session {
    fn new() -> Self {
        let workspace = Workspace::new();
        copy(
            &Path::new(env!("CARGO_MANIFEST_DIR")).join("pipelines"),
            &workspace.path("pipelines"),
        );
        super::python::install(&workspace.path(""));
        let programs = workspace.path("bin");
        std::fs::create_dir(&programs).unwrap();
        std::os::unix::fs::symlink(env!("CARGO_BIN_EXE_deaflow"), programs.join("deaflow")).unwrap();
        let python = Command::new(super::h5py::python())
            .args(["-c", "import sys; print(sys.executable)"])
            .output();
        let python = String::from_utf8(python.unwrap().stdout).unwrap();
        std::os::unix::fs::symlink(python.trim(), programs.join("python3")).unwrap();
        Self { workspace }
    }

    fn write(&self, path: &str, text: &str) {
        self.workspace.write(path, text);
    }

    /// The output of a block: stdout, and stderr too if the block is to fail.
    fn run(&self, block: &Block, place: &str) -> String {
        let mut paths = vec![self.workspace.path("bin")];
        paths.extend(std::env::split_paths(&std::env::var_os("PATH").unwrap_or_default()));
        let program = if block.language == "python" { "python3" } else { "bash" };
        let text = block.directive("run as").unwrap_or(&block.text);
        let text = if program == "bash" {
            format!("set -euo pipefail\n{text}")
        } else {
            text.to_owned()
        };
        let output = self
            .workspace
            .dressed(program)
            .args(["-c", &text])
            .env("PATH", std::env::join_paths(paths).unwrap())
            .output()
            .unwrap();
        let (stdout, stderr) = (
            String::from_utf8_lossy(&output.stdout),
            String::from_utf8_lossy(&output.stderr),
        );
        let expected: i32 = block.directive("exit").map_or(0, |code| code.parse().unwrap());
        assert_eq!(output.status.code(), Some(expected), "{place}:\n{stdout}\n{stderr}");
        if expected == 0 {
            stdout.into_owned()
        } else {
            format!("{stdout}{stderr}")
        }
    }
}

fn copy(from: &Path, to: &Path) {
    std::fs::create_dir(to).unwrap();
    for entry in std::fs::read_dir(from).unwrap() {
        let from = entry.unwrap().path();
        let to: PathBuf = to.join(from.file_name().unwrap());
        if from.is_dir() {
            copy(&from, &to);
        } else {
            std::fs::copy(&from, &to).unwrap();
        }
    }
}
