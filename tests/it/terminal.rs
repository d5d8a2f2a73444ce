//! Text from elsewhere changes nothing about a terminal, whichever way it comes.

use std::fs;

use super::common::{Ended, SMALL, Workspace, files};

/// Clears the screen, sets the title, turns to red in a single character, rewinds the line, turns words round.
const HARM: &str = "\u{1b}[2J\u{1b}]0;owned\u{7}\u{9b}31m\r\u{7f}\u{202e}x\u{2028}";

fn harmful(c: char) -> bool {
    let direction = matches!(c, '\u{202a}'..='\u{202e}' | '\u{2066}'..='\u{2069}' | '\u{2028}' | '\u{2029}');
    direction || c.is_control() && !matches!(c, '\n' | '\t')
}

fn check(what: &str, ended: &Ended) {
    for text in [&ended.stdout, &ended.stderr] {
        assert!(!text.contains(harmful), "{what}: {text:?}");
    }
}

/// As text of YAML and of JSON.
fn escaped() -> String {
    let each = |c: char| format!("\\u{:04x}", c as u32);
    HARM.chars().map(each).collect()
}

#[test]
fn words_of_files_are_shown_without_what_a_terminal_would_obey() {
    let workspace = Workspace::small();
    workspace.stages(&["run", "small.yaml", "--lock"]);
    let evil = format!("\"{}\"", escaped());
    let mut pipelines = vec![
        (
            "in a comment",
            format!("# {HARM}\n{}", SMALL.replace("version: 1", "version: 7")),
        ),
        (
            "raw in a value",
            SMALL.replace("name: small", &format!("name: a{HARM}b")),
        ),
        (
            "ends of lines",
            SMALL.replace("version: 1", "version: 7").replace('\n', "\r\n"),
        ),
    ];
    for (what, from) in [
        ("name", "name: small"),
        ("stage", "  solved: "),
        ("kind", "kind: balance"),
        ("need", "needs: [small"),
        ("family", "family: small-grid"),
        ("key", "bins:"),
        ("quantity", "5.25 kV"),
        ("model", "neo-hookean"),
        ("scene", "effects:"),
    ] {
        let (head, word) = from.rsplit_once([' ', '[']).unwrap_or(("", from));
        let with = match from {
            "  solved: " => format!("  {evil}: "),
            "bins:" | "effects:" => format!("{evil}:"),
            "5.25 kV" | "neo-hookean" => evil.clone(),
            _ => from.replace(word, &evil),
        };
        assert!(SMALL.contains(from) && (head.is_empty() || with != from), "{from}");
        pipelines.push((what, SMALL.replacen(from, &with, 1)));
    }
    for (what, text) in &pipelines {
        workspace.write("evil.yaml", text);
        for arguments in [
            &["plan", "evil.yaml"][..],
            &["plan", "evil.yaml", "--json"],
            &["dag", "evil.yaml"],
            &["run", "evil.yaml", "--until", "small"],
            &["run", "evil.yaml", "--until", "small", "--json", "--progress", "json"],
            &["status", "evil.yaml"],
        ] {
            check(&format!("{what}: {arguments:?}"), &workspace.run(arguments));
        }
    }
    // What a lock file says.
    let lock = fs::read_to_string(workspace.path("small.yaml.lock")).unwrap();
    workspace.write(
        "small.yaml.lock",
        &lock.replace("target: \"", &format!("target: \"{}", escaped())),
    );
    check("a lock file", &workspace.run(&["run", "small.yaml", "--locked"]));
}

#[test]
fn words_of_a_store_are_shown_without_what_a_terminal_would_obey() {
    let workspace = Workspace::small();
    workspace.stages(&["run", "small.yaml"]);
    assert_eq!(workspace.run(&["pin", "balanced", "--label", HARM]).code, Some(0));
    let run = files(&workspace.path("store/runs")).remove(0);
    let text = fs::read_to_string(&run).unwrap();
    let text = text.replace("small.yaml", &format!("{}.yaml", escaped()));
    fs::write(
        &run,
        text.replace("\"pipeline\": \"small\"", &format!("\"pipeline\": \"{}\"", escaped())),
    )
    .unwrap();
    for folder in ["objects", "records", "runs", "pins", "tmp"] {
        fs::write(workspace.path("store").join(folder).join(format!("stray{HARM}")), "").unwrap();
    }
    let mut shown = String::new();
    for arguments in [
        &["pin"][..],
        &["status"],
        &["gc", "--dry-run"],
        &["fsck"],
        &["show", "solved"],
        &["show", HARM],
        &["explain", "small.yaml", HARM],
        &["unpin", HARM],
    ] {
        for json in [&[][..], &["--json"]] {
            let arguments = [arguments, json].concat();
            let ended = workspace.run(&arguments);
            check(&format!("{arguments:?}"), &ended);
            shown += &ended.stdout;
        }
    }
    assert!(
        shown.contains("[2J") && shown.contains("\\u009b"),
        "it is shown, as text: {shown}"
    );
}

#[test]
fn names_of_files_and_arguments_are_shown_without_what_a_terminal_would_obey() {
    let workspace = Workspace::small();
    let scene = format!("scene{HARM}.yaml");
    workspace.write(&scene, SMALL);
    let bad = format!("bad{HARM}.yaml");
    workspace.write(&bad, "version: 7\n");
    let pattern = format!("p{HARM}.csv");
    workspace.write(&pattern, "1,2,3\n");
    let flag = format!("--{HARM}");
    let set = format!("stages.{HARM}=1");
    let out = format!("out{HARM}/");
    for arguments in [
        &["plan", &bad][..],
        &["plan", HARM],
        &["screen", &scene],
        &["solve", &scene, &pattern, "-o", "out.h5"],
        &["solve", &scene, HARM, "-o", "out.h5"],
        &["solve", &scene, &pattern, "-o", &out],
        &["predict", HARM, &pattern, "-o", "out.h5"],
        &["export", "design", &pattern, "--scene", &scene, "-o", "m.svg"],
        &["run", "small.yaml", &flag],
        &["run", "small.yaml", "--until", HARM],
        &["run", "small.yaml", "--set", &set],
        &["plan", "small.yaml", "--store", &out],
        &["run", "small.yaml", "--jobs", HARM],
        &[HARM],
        &["report", "small.yaml", "-o", &bad],
        &["audit", HARM],
    ] {
        for json in [&[][..], &["--json"]] {
            let arguments = [arguments, json].concat();
            check(&format!("{arguments:?}"), &workspace.run(&arguments));
        }
    }
}

/// `script` (bsdutils, which every Debian has) gives the command a terminal.
#[test]
fn on_a_terminal_only_our_own_colours_are_sent() {
    let workspace = Workspace::new();
    workspace.write("bad.yaml", "version: 7\n");
    workspace.write("worse.yaml", &format!("version: \"{HARM}\"\n"));
    fs::copy(workspace.path("bad.yaml"), workspace.path(&format!("bad{HARM}.yaml"))).unwrap();
    let mut coloured = 0;
    for name in ["bad.yaml", "worse.yaml", "bad*x*.yaml", "none*.yaml"] {
        let line = format!("{} plan {name}", env!("CARGO_BIN_EXE_deaflow"));
        let mut command = workspace.dressed("script");
        command
            .args(["-qec", &line, "/dev/null"])
            .stdin(std::process::Stdio::null());
        let output = command.output().unwrap();
        let text = String::from_utf8(output.stdout).unwrap();
        assert!(text.contains("error:"), "{name}: {text:?}");
        // Select Graphic Rendition, and the ends of lines of terminals.
        let mut parts = text.split("\u{1b}[");
        let first = parts.next().unwrap_or_default().to_owned();
        let plain: Vec<&str> = parts
            .map(|part| {
                coloured += 1;
                let rest = part.trim_start_matches(|c: char| c.is_ascii_digit() || c == ';');
                rest.strip_prefix('m').unwrap_or_else(|| panic!("{name}: {text:?}"))
            })
            .collect();
        let plain = (first + &plain.concat()).replace("\r\n", "\n");
        assert!(!plain.contains(harmful), "{name}: {plain:?}");
    }
    assert!(coloured > 0);
}
