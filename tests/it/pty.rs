//! Output on a terminal: width, colours, progress bars and Ctrl-C.
//!
//! `script` (bsdutils, which every Debian has) gives a command a terminal, and `stty` gives that its width.

use std::io::{BufRead, BufReader, Read, Write};
use std::process::{Child, Command, Stdio};
use std::thread::{JoinHandle, sleep, spawn};
use std::time::{Duration, Instant};

use super::common::{Ended, SMALL, TINY, Workspace, csv, scene_file, snapshot, snapshots::without_numbers};

/// A command on a terminal of so many columns.
fn on_terminal(workspace: &Workspace, columns: usize, arguments: &[&str]) -> Command {
    let words = std::iter::once(env!("CARGO_BIN_EXE_deaflow")).chain(arguments.iter().copied());
    let line = format!("stty cols {columns} rows 50; exec {}", shlex::try_join(words).unwrap());
    let mut command = workspace.dressed("script");
    command.args(["-qec", &line, "/dev/null"]).env("TERM", "xterm");
    command
}

/// What a command writes to a terminal, and its exit code.
fn shown(workspace: &Workspace, columns: usize, arguments: &[&str]) -> (Option<i32>, String) {
    let output = on_terminal(workspace, columns, arguments)
        .stdin(Stdio::null())
        .output()
        .unwrap();
    (output.status.code(), String::from_utf8(output.stdout).unwrap())
}

/// The lines that a terminal shows, each state of a bar being one, without colours.
fn lines(text: &str) -> Vec<String> {
    let mut plain = String::new();
    let mut rest = text;
    while let Some((before, after)) = rest.split_once('\u{1b}') {
        plain += before;
        let parameters = after.strip_prefix('[').unwrap_or(after);
        let end = parameters.find(|c: char| ('@'..='~').contains(&c));
        // Moves of the cursor begin another line.
        plain += if end.is_some_and(|end| parameters[end..].starts_with('m')) {
            ""
        } else {
            "\n"
        };
        rest = end.map_or("", |end| &parameters[end + 1..]);
    }
    plain += rest;
    plain
        .split(['\n', '\r'])
        .filter(|line| !line.is_empty())
        .map(str::to_owned)
        .collect()
}

/// Colours are sequences that end in m; a bar moves the cursor by others.
fn is_coloured(text: &str) -> bool {
    text.split("\u{1b}[").skip(1).any(|part| {
        let rest = part.trim_start_matches(|c: char| c.is_ascii_digit() || c == ';');
        rest.starts_with('m')
    })
}

#[test]
fn no_line_is_longer_than_the_terminal() {
    let workspace = Workspace::small();
    assert_eq!(workspace.run(&["run", "small.yaml"]).code, Some(0));
    let long = "a reason that is longer than what a terminal of eighty columns has room for, and has an end";
    assert_eq!(workspace.run(&["pin", "solved", "--label", long]).code, Some(0));
    let set = "stages.solved.elements_per_cell=2";
    for columns in [80, 140] {
        for arguments in [
            &["plan", "small.yaml", "--set", set][..],
            &["run", "small.yaml", "-n", "--set", "scene.drive.voltage=5 kV"],
            &["run", "small.yaml", "-v"],
            &["run", "small.yaml"],
            &["status"],
            &["log"],
            &["log", "small.yaml"],
            &["show", "solved"],
            &["show", "balanced"],
            &["gc", "-n"],
            &["pin"],
            &["fsck"],
            &["doctor"],
            &["dag", "small.yaml"],
            &["explain", "small.yaml", "solved", "--set", set],
            &["diff", "small.yaml@1", "small.yaml", "--set", set],
            &[
                "sweep",
                "small.yaml",
                "-n",
                "--set",
                "stages.solved.elements_per_cell=1,2,3",
            ],
            &["screen", "small.yaml"],
        ] {
            let (code, text) = shown(&workspace, columns, arguments);
            assert_eq!(code, Some(0), "{arguments:?}: {text}");
            for line in lines(&text) {
                // A path stays whole, so that it can be copied.
                let is_word = !line.trim().contains(' ');
                assert!(
                    is_word || line.chars().count() <= columns,
                    "{columns} {arguments:?}: {line}\n{text}"
                );
            }
        }
    }
    // Help, and what is refused with a place in a file.
    let misspelt = "stages.solved.elements_per_cel=2";
    for arguments in [
        &["help"][..],
        &["run", "-h"],
        &["plan", "small.yaml", "--set", misspelt],
    ] {
        let (_, text) = shown(&workspace, 80, arguments);
        for line in lines(&text) {
            assert!(line.chars().count() <= 80, "{arguments:?}: {line}\n{text}");
        }
    }
    let (_, wide) = shown(&workspace, 160, &["pin"]);
    assert!(wide.contains(long), "a wide terminal is used: {wide}");
}

#[test]
fn a_stage_stands_on_one_line_and_its_reasons_below() {
    let workspace = Workspace::small();
    assert_eq!(workspace.run(&["run", "small.yaml"]).code, Some(0));
    let arguments = ["plan", "small.yaml", "--set", "stages.solved.elements_per_cell=2"];
    let (_, text) = shown(&workspace, 80, &arguments);
    let lines = lines(&text);
    let of_stage = |name: &str| {
        lines
            .iter()
            .filter(|line| line.starts_with(&format!(" {name} ")))
            .count()
    };
    for name in ["small", "large", "solved", "balanced"] {
        assert_eq!(of_stage(name), 1, "{name}: {text}");
    }
    let at = lines.iter().position(|line| line.starts_with(" solved ")).unwrap();
    assert!(
        lines[at].contains("stale") && lines[at].contains(" s "),
        "{}",
        lines[at]
    );
    let is_reason = |line: &str| ["elements_per_cell", "1", "2"].iter().all(|part| line.contains(part));
    assert!(is_reason(&lines[at + 1]), "{text}");
    // Other programs read as long lines as there are.
    let plain = workspace.run(&arguments).stdout;
    let line = plain.lines().find(|line| line.starts_with(" solved ")).unwrap();
    assert!(is_reason(line) && !is_coloured(&plain), "{plain}");
}

#[test]
fn colours_follow_outcomes_where_they_are_asked_for() {
    let workspace = Workspace::small();
    let (code, built) = shown(&workspace, 80, &["run", "small.yaml", "-v"]);
    assert_eq!(code, Some(0), "{built}");
    assert!(built.contains("\u{1b}[32mbuilt\u{1b}[0m"), "{built:?}");
    let (_, reused) = shown(&workspace, 80, &["run", "small.yaml", "-v"]);
    assert!(reused.contains("\u{1b}[2mreused\u{1b}[0m"), "{reused:?}");
    let stale = ["plan", "small.yaml", "--set", "stages.solved.elements_per_cell=2"];
    assert!(shown(&workspace, 80, &stale).1.contains("\u{1b}[33mstale\u{1b}[0m"));
    for arguments in [&["run", "small.yaml", "-v"][..], &stale, &["status"], &["gc", "-n"]] {
        let never = [arguments, &["--color", "never"]].concat();
        let (_, text) = shown(&workspace, 80, &never);
        assert!(!is_coloured(&text), "{never:?}: {text:?}");
        let mut quiet = on_terminal(&workspace, 80, arguments);
        let output = quiet.env("NO_COLOR", "1").stdin(Stdio::null()).output().unwrap();
        assert!(
            !is_coloured(&String::from_utf8(output.stdout).unwrap()),
            "{arguments:?}"
        );
        assert!(!is_coloured(&workspace.run(arguments).stdout), "{arguments:?}");
    }
}

#[test]
fn a_run_ends_with_the_lines_that_matter() {
    let workspace = Workspace::tiny();
    let run = ["run", "tiny.yaml", "--until", "verified"];
    let ended = workspace.run(&run);
    assert_eq!(ended.code, Some(0), "{}", ended.stderr);
    let is_warning = |line: &&str| line.starts_with("warning: ") || line.contains(" about patterns of the dataset");
    let (warned, lines): (Vec<&str>, Vec<&str>) = ended.stdout.lines().partition(is_warning);
    assert_eq!(lines.len(), 5, "{}", ended.stdout);
    for (line, parts) in lines.iter().zip([
        &["tiny", "8"][..],
        &["verified: ", " mm"],
        &["verified: "],
        &["store/figures/tiny"],
        &["deaflow report tiny.yaml --until verified -o report"],
    ]) {
        assert!(parts.iter().all(|part| line.contains(part)), "{parts:?}: {line}");
    }
    assert!(!warned.is_empty(), "{}", ended.stdout);
    snapshot!(without_numbers(&ended.stdout), "built");
    // The last line names a command that works.
    let words: Vec<&str> = lines[4]
        .split_once("deaflow ")
        .unwrap()
        .1
        .split(';')
        .next()
        .unwrap()
        .split(' ')
        .collect();
    assert_eq!(workspace.run(&words).code, Some(0), "{words:?}");

    let again = workspace.run(&run).stdout;
    let is_summary = |line: &str| line.starts_with("tiny") && line.contains('8');
    assert!(again.lines().any(is_summary), "{again}");
    snapshot!(without_numbers(&again), "reused");
    let verbose = workspace.run(&[&run[..], &["-v"]].concat()).stdout;
    let is_row = |line: &str| line.starts_with(" verified ") && line.contains("reused");
    assert!(
        verbose.lines().any(is_row) && verbose.contains("-evolution.png"),
        "{verbose}"
    );
    snapshot!(without_numbers(&verbose), "verbose");
    let both = workspace.run(&[&run[..], &["-v", "-q"]].concat());
    assert_eq!(both.code, Some(2), "{}", both.stdout);
    // Without designs the result is the number of samples and their largest displacement.
    let solved = workspace.run(&["run", "tiny.yaml", "--until", "solved"]).stdout;
    let is_result = |line: &str| line.starts_with("solved: ") && line.contains(" 82 ") && line.contains(" mm");
    assert!(solved.lines().any(is_result), "{solved}");
    snapshot!(solved, "solved");
}

/// The states of the bar of a stage.
fn bars<'t>(lines: &'t [String], name: &str) -> Vec<&'t String> {
    lines
        .iter()
        .filter(|line| line.starts_with(name) && line.contains('['))
        .collect()
}

#[test]
fn a_bar_has_a_pace_within_its_first_step_and_fits() {
    for columns in [80, 140] {
        let workspace = Workspace::tiny();
        let arguments = [
            "run",
            "tiny.yaml",
            "--until",
            "surrogate",
            "--set",
            "stages.balanced.target=600",
            "--jobs",
            "1",
        ];
        let (code, text) = shown(&workspace, columns, &arguments);
        assert_eq!(code, Some(0), "{text}");
        let lines = lines(&text);
        for line in &lines {
            assert!(line.chars().count() <= columns, "{columns}: {line}");
        }
        let bars = bars(&lines, "surrogate ");
        let paced = |line: &&&String| line.contains("0/1 epochs") && line.contains("/min");
        assert!(bars.iter().any(|line| paced(&line)), "{columns}: {bars:?}");
    }
}

/// The events of a run on stderr.
fn events(ended: &Ended) -> Vec<serde_json::Value> {
    assert_eq!(ended.code, Some(0), "{}", ended.stderr);
    ended
        .stderr
        .lines()
        .map(|line| serde_json::from_str(line).unwrap())
        .collect()
}

#[test]
fn steps_are_called_what_they_are_and_have_parts() {
    let workspace = Workspace::new();
    let text = TINY.replace(
        "  reference:",
        "  newton:    { kind: design, evaluator: newton, objective: { point: [25 mm, 25 mm], direction: 0 deg }, area: 0.5, population: 70, generations: 1, seed: 6 }
  refined:   { kind: design, evaluator: linear, refine: true, objective: { point: [25 mm, 25 mm], direction: 0 deg }, area: 0.5, population: 20, generations: 1, seed: 6 }
  optimum:   { kind: design, method: adjoint, starts: 2, objective: { point: [25 mm, 25 mm], direction: 0 deg }, area: 0.5, seed: 7 }
  reference:",
    );
    workspace.write("tiny.yaml", &text);
    let events = events(&workspace.run(&["run", "tiny.yaml", "--progress", "json", "--jobs", "2"]));
    let of = |name: &str| events.iter().filter(|event| event["name"] == name).collect::<Vec<_>>();
    for (name, unit) in [
        ("small", "patterns"),
        ("solved", "patterns"),
        ("surrogate", "epochs"),
        ("newton", "generations"),
        ("refined", "steps"),
        ("optimum", "searches"),
        ("verified", "targets"),
        ("accuracy", "methods"),
        ("balanced", "steps"),
    ] {
        assert_eq!(of(name)[0]["unit"], unit, "{name}");
    }
    for name in ["surrogate", "newton", "optimum", "accuracy", "balanced"] {
        let events = of(name);
        let place = |kind: &str| events.iter().position(|event| event["event"] == kind);
        let part = place("part").unwrap_or_else(|| panic!("{name}: {events:?}"));
        assert!(
            Some(part) < place("progress"),
            "{name}: a part is told before the first step is over"
        );
        for event in events.iter().filter(|event| event["event"] == "part") {
            assert!((0.0..=1.0).contains(&event["done"].as_f64().unwrap()), "{event}");
        }
    }
}

/// A command on a terminal that somebody watches and may interrupt.
struct Watched {
    child: Child,
    reader: JoinHandle<()>,
    text: std::sync::Arc<std::sync::Mutex<String>>,
}

impl Watched {
    fn begin(workspace: &Workspace, arguments: &[&str]) -> Self {
        let mut command = on_terminal(workspace, 80, arguments);
        let mut child = command.stdin(Stdio::piped()).stdout(Stdio::piped()).spawn().unwrap();
        let mut output = child.stdout.take().unwrap();
        let text = std::sync::Arc::<std::sync::Mutex<String>>::default();
        let read = text.clone();
        let reader = spawn(move || {
            let mut bytes = [0; 4096];
            while let Ok(n @ 1..) = output.read(&mut bytes) {
                read.lock().unwrap().push_str(&String::from_utf8_lossy(&bytes[..n]));
            }
        });
        Self { child, reader, text }
    }

    fn wait_until(&mut self, what: &str, is_there: impl Fn(&str) -> bool) {
        let start = Instant::now();
        loop {
            let text = self.text.lock().unwrap().clone();
            if is_there(&text) {
                return;
            }
            assert!(start.elapsed() < Duration::from_secs(120), "no {what:?}: {text}");
            assert!(self.child.try_wait().unwrap().is_none(), "no {what:?}: {text}");
            sleep(Duration::from_millis(20));
        }
    }

    fn wait_for(&mut self, words: &str) {
        self.wait_until(words, |text| text.contains(words));
    }

    fn interrupt(&mut self) {
        let input = self.child.stdin.as_mut().unwrap();
        input.write_all(b"\x03").unwrap();
        input.flush().unwrap();
    }

    /// Its exit code, how long it went on, and all that it has written.
    fn end(mut self) -> (Option<i32>, Duration, String) {
        let start = Instant::now();
        let code = self.child.wait().unwrap().code();
        self.reader.join().unwrap();
        let text = self.text.lock().unwrap().clone();
        (code, start.elapsed(), text)
    }
}

#[test]
fn ctrl_c_keeps_what_there_is_and_the_same_command_goes_on() {
    let workspace = Workspace::tiny();
    let run = [
        "run",
        "tiny.yaml",
        "--until",
        "surrogate",
        "--set",
        "stages.surrogate.epochs=2000",
    ];
    let mut first = Watched::begin(&workspace, &run);
    // The number of epochs that are done is not 0 any more.
    first.wait_until("an epoch", |text| {
        text.match_indices("/2000 epochs")
            .any(|(at, _)| text[..at].ends_with(|c: char| c.is_ascii_digit()) && !text[..at].ends_with(" 0"))
    });
    first.interrupt();
    let (code, _, text) = first.end();
    assert_eq!(code, Some(75), "{text}");
    let logged = workspace.run(&["log", "tiny.yaml", "--json"]).json();
    let stages = logged["runs"][0]["stages"].as_array().unwrap().clone();
    let outcome = stages.iter().find(|stage| stage["name"] == "surrogate").unwrap();
    assert_eq!(outcome["outcome"], "stopped");
    let joined = |text: &str| text.split_whitespace().collect::<Vec<_>>().join(" ");
    let text = joined(&lines(&text).join(" "));
    assert!(!text.contains("error:"), "{text}");
    // The same command goes on from there; without a terminal the signal is the same.
    let mut second = workspace.command(&[&run[..], &["--progress", "json"]].concat());
    let mut second = second.stdout(Stdio::null()).stderr(Stdio::piped()).spawn().unwrap();
    let mut events = BufReader::new(second.stderr.take().unwrap())
        .lines()
        .map(Result::unwrap);
    let resumed = events.find(|line| line.contains("\"event\":\"resumed\"")).unwrap();
    assert!(resumed.contains("\"name\":\"surrogate\""), "{resumed}");
    let process = rustix::process::Pid::from_child(&second);
    rustix::process::kill_process(process, rustix::process::Signal::INT).unwrap();
    let message = events.find(|line| !line.starts_with('{')).unwrap();
    assert!(text.contains(&joined(&message)), "{message}: {text}");
    snapshot!(message);
    assert_eq!(second.wait().unwrap().code(), Some(75));
    assert_eq!(workspace.run(&["fsck"]).code, Some(0));
}

#[test]
fn a_search_along_the_gradient_ends_between_two_evaluations() {
    let workspace = Workspace::new();
    let search = "  best: { kind: design, method: adjoint, objective: { point: [25 mm, 25 mm], direction: 0 deg }, \
                  units: 50, starts: 1, seed: 1 }\n";
    let (scene, _) = SMALL.split_once("stages:\n").unwrap();
    workspace.write("small.yaml", &format!("{scene}stages:\n{search}"));
    let mut command = workspace.command(&["run", "small.yaml", "--jobs", "1", "--progress", "json"]);
    let mut run = command.stdout(Stdio::null()).stderr(Stdio::piped()).spawn().unwrap();
    let mut events = BufReader::new(run.stderr.take().unwrap()).lines().map(Result::unwrap);
    // The gradient was followed from the only start; exchanges of pairs, which take most of the time, begin.
    events.find(|line| line.contains("\"event\":\"progress\"")).unwrap();
    let process = rustix::process::Pid::from_child(&run);
    rustix::process::kill_process(process, rustix::process::Signal::INT).unwrap();
    let rest: Vec<String> = events.collect();
    assert_eq!(run.wait().unwrap().code(), Some(75), "{rest:?}");
    assert!(!rest.iter().any(|line| line.contains("error")), "{rest:?}");
    let logged = workspace.run(&["log", "small.yaml", "--json"]).json();
    assert_eq!(logged["runs"][0]["stages"][0]["outcome"], "stopped", "{logged}");
    assert_eq!(workspace.run(&["fsck"]).code, Some(0));
}

#[test]
fn a_second_ctrl_c_ends_at_once() {
    let workspace = Workspace::new();
    // One chunk that takes minutes, and cannot stop in between.
    let slow = SMALL
        .replace("count: 4", "count: 60")
        .replace("elements_per_cell: 1", "elements_per_cell: 8, order: 2");
    workspace.write("slow.yaml", &slow);
    let mut run = Watched::begin(&workspace, &["run", "slow.yaml", "--until", "solved", "--jobs", "1"]);
    run.wait_for("/62 patterns");
    run.interrupt();
    run.wait_for("Ctrl-C");
    run.interrupt();
    let (code, took, text) = run.end();
    assert_eq!(code, Some(75), "{text}");
    assert!(took < Duration::from_secs(5), "{took:?}");
    assert_eq!(workspace.run(&["fsck"]).code, Some(0));
}

#[test]
fn how_far_patterns_move_is_a_table_of_few_and_numbers_of_many() {
    let workspace = Workspace::new();
    workspace.write("scene.yaml", &scene_file());
    workspace.write("hot.yaml", &scene_file().replace("5.25 kV", "14 kV"));
    workspace.write("half.csv", &csv(|x, _| x < 25));
    workspace.write("dot.csv", &csv(|x, y| x == 30 && y == 10));
    workspace.write("bare.csv", &csv(|_, _| false));
    let options = ["-o", "o.h5", "--elements-per-cell", "1"];
    let few = [&["solve", "hot.yaml", "half.csv", "bare.csv"][..], &options].concat();
    let (code, text) = shown(&workspace, 80, &few);
    assert_eq!(code, Some(3), "{text}");
    let lines = lines(&text);
    assert!(lines.iter().all(|line| line.chars().count() <= 80), "{text}");
    for colour in ["\u{1b}[32mconverged\u{1b}[0m", "\u{1b}[31m"] {
        assert!(text.contains(colour), "{text:?}");
    }
    let row = |index: usize| {
        let start = format!("{index:>8} ");
        let row = lines.iter().find(|line| line.starts_with(&start));
        row.unwrap_or_else(|| panic!("{text}"))
            .split_whitespace()
            .collect::<Vec<_>>()
    };
    assert_eq!(row(1), ["1", "bare.csv", "converged", "0", "mm", "-"]);
    assert!(
        row(0)[2] != "converged" && row(0).ends_with(&["-", "-"]),
        "{:?}",
        row(0)
    );

    let moved = [
        &["solve", "scene.yaml", "half.csv", "dot.csv"][..],
        &options,
        &["--json"],
    ]
    .concat();
    let document = workspace.run(&moved).json();
    let dot = &document["patterns"][1];
    assert_eq!(
        (&dot["outcome"], &document["outcomes"]["converged"]),
        (&"converged".into(), &2.into())
    );
    let mm = dot["max_displacement_mm"].as_f64().unwrap();
    assert!(
        mm > 0.0 && document["max_displacement_mm"]["smallest"] == mm,
        "{document}"
    );
    let at: Vec<f64> = serde_json::from_value(dot["at_mm"].clone()).unwrap();
    // The cell reaches from 30 mm to 31 mm and from 10 mm to 11 mm; the corner that moves most is one of its own.
    assert!(
        (30.0..=31.0).contains(&at[0]) && (10.0..=11.0).contains(&at[1]),
        "{at:?}"
    );
    let unstable = workspace.run(&[&few[..], &["--json"]].concat()).json();
    assert!(unstable["patterns"][0]["max_displacement_mm"].is_null() && unstable["patterns"][0]["at_mm"].is_null());

    let many = |scene: &'static str, pattern: &'static str| {
        let patterns: Vec<&str> = std::iter::repeat_n(pattern, 22).collect();
        workspace.run(&[&["solve", scene][..], &patterns, &options].concat())
    };
    let (sound, lost) = (many("scene.yaml", "dot.csv"), many("hot.yaml", "half.csv"));
    assert_eq!((sound.code, lost.code), (Some(0), Some(3)), "{}", sound.stderr);
    for part in ["converged 22\n", " at 3", "deaflow show o.h5 --csv"] {
        assert!(sound.stdout.contains(part), "{part}: {}", sound.stdout);
    }
    for part in [" 22\n", "pattern 19:", "--json"] {
        assert!(lost.stdout.contains(part), "{part}: {}", lost.stdout);
    }
    assert!(!lost.stdout.contains("pattern 20:"), "{}", lost.stdout);
    snapshot!(sound.stdout, "sound");
    snapshot!(lost.stdout, "lost");
}
