//! The fabrication sheet of a design: one printed page that is true to scale, and whose table is read back.

use super::browser::Browser;
use super::common::{Workspace, snapshot};

const PIPELINE: &str = "version: 1
name: bench
scene:
  geometry: { side: 50 mm, thickness: 1 mm, prestretch: 3, cells: 20 }
  material: { model: neo-hookean, shear_modulus: 45 kPa, relative_permittivity: 4.7 }
  drive: { voltage: 5.25 kV }
  effects: {}
  tolerances: { voltage: 1 %, thickness: 3 % }
stages:
  design:
    kind: design
    case: I
    method: adjoint
    targets:
      - { name: centre, objective: { point: [25 mm, 25 mm], direction: 0 deg }, area: 0.5 }
      - { name: two, objective: { points: [{ point: [12.5 mm, 25 mm], direction: 0 deg }, { point: [37.5 mm, 25 mm], direction: 180 deg }] }, area: 0.4 }
    starts: 1
    seed: 1
  verified: { kind: verify, needs: [design], elements_per_cell: 1 }
  made:     { kind: yield, needs: [design], samples: 100, wanted: 1.5 mm, seed: 1 }
";

/// Three points across a large membrane, a long geometry, and neglected effects.
const CROWDED: &str = "version: 1
name: crowded
scene:
  geometry:
    size: [180 mm, 90 mm]
    cells: [24, 12]
    thickness: 1 mm
    prestretch: 3
    bodies:
      - { rectangle: [[15 mm, 15 mm], [22.5 mm, 22.5 mm]] }
      - { rectangle: [[45 mm, 15 mm], [52.5 mm, 22.5 mm]] }
      - { rectangle: [[75 mm, 15 mm], [82.5 mm, 22.5 mm]] }
      - { rectangle: [[105 mm, 15 mm], [112.5 mm, 22.5 mm]] }
      - { rectangle: [[135 mm, 15 mm], [142.5 mm, 22.5 mm]] }
  material: { model: neo-hookean, shear_modulus: 45 kPa, relative_permittivity: 4.7 }
  drive: { voltage: 4 kV }
  properties: { strain_stiffening: { model: gent, jm: 20 }, dielectric_breakdown: { law: constant, field: 30 MV/m } }
  effects: {}
  tolerances: { voltage: 1 %, shear_modulus: 5 %, thickness: 3 %, permittivity: 2 %, mask: 0.2 mm }
stages:
  design:
    kind: design
    case: three points of a long membrane with five bodies
    method: adjoint
    objective: { points: [{ point: [45 mm, 60 mm], direction: 0 deg }, { point: [90 mm, 60 mm], direction: 0 deg }, { point: [135 mm, 60 mm], direction: 0 deg }] }
    area: 0.4
    starts: 1
    seed: 1
  verified: { kind: verify, needs: [design], elements_per_cell: 1 }
  made:     { kind: yield, needs: [design], samples: 20, wanted: 0.5 mm, seed: 1 }
  again:    { kind: yield, needs: [design], samples: 20, wanted: 0.6 mm, seed: 2 }
  last:     { kind: yield, needs: [design], samples: 20, wanted: 0.7 mm, seed: 3 }
";

/// A membrane across the page, with a frame, a body that turns, and two groups of electrodes in two states.
const DEVICE: &str = "version: 1
name: device
scene:
  geometry:
    size: [160 mm, 80 mm]
    cells: [32, 16]
    thickness: 1 mm
    prestretch: [3, 2]
    frame: { opening: { rectangle: [[10 mm, 10 mm], [150 mm, 70 mm]] } }
    bodies: [{ rectangle: [[70 mm, 30 mm], [90 mm, 50 mm]] }]
  material: { model: neo-hookean, shear_modulus: 45 kPa, relative_permittivity: 4.7 }
  drive: { voltages: [4 kV, 2 kV] }
  states: { left: { voltages: [4 kV, 0 kV] }, right: { voltages: [0 kV, 3 kV] } }
  effects: {}
stages:
  design:
    kind: design
    method: adjoint
    objective: { points: [{ body: 0, direction: 0 deg, state: left }, { body: 0, direction: 180 deg, state: right }] }
    area: 0.4
    starts: 1
    seed: 1
  verified: { kind: verify, needs: [design], elements_per_cell: 1 }
";

fn workspace(pipeline: &str) -> Workspace {
    let workspace = Workspace::new();
    workspace.write("bench.yaml", pipeline);
    let ended = workspace.run(&["run", "bench.yaml", "--quiet"]);
    assert_eq!(ended.code, Some(0), "{}", ended.stderr);
    workspace
}

/// Makes a sheet and returns it.
fn sheet(workspace: &Workspace, more: &[&str]) -> String {
    let ended = workspace.run(&[&["report", "bench.yaml", "--sheet", "sheet.html"], more].concat());
    assert_eq!(ended.code, Some(0), "{}", ended.stderr);
    std::fs::read_to_string(workspace.path("sheet.html")).unwrap()
}

/// The text between two others.
fn between<'t>(text: &'t str, start: &str, end: &str) -> &'t str {
    let (_, rest) = text.split_once(start).unwrap_or_else(|| panic!("no {start} in {text}"));
    rest.split_once(end).unwrap().0
}

/// The text of a page without its drawing and style.
fn words(page: &str) -> String {
    let (_, body) = page.split_once("<main>").unwrap();
    let (before, rest) = body.split_once("<svg").unwrap();
    let (_, after) = rest.split_once("</svg>").unwrap();
    let mut text = String::new();
    let mut is_tag = false;
    for c in format!("{before}{after}").chars() {
        match c {
            '<' => (is_tag, text) = (true, text + " "),
            '>' => is_tag = false,
            c if !is_tag => text.push(if c == '\u{a0}' { ' ' } else { c }),
            _ => {}
        }
    }
    text.split_whitespace().collect::<Vec<_>>().join(" ")
}

/// The first column of the table.
fn voltages(page: &str) -> Vec<&str> {
    let rows = page.split("<th scope=\"row\">").skip(1);
    rows.map(|row| row.split('<').next().unwrap()).collect()
}

#[test]
fn a_sheet_is_true_to_scale_and_says_what_to_make_and_to_expect() {
    let workspace = workspace(PIPELINE);
    let page = sheet(&workspace, &["--design", "centre"]);
    let again = sheet(&workspace, &["--design", "centre"]);
    assert!(page == again, "the same bytes");
    for fetched in ["http:", "https:", "<script", "@import", "url("] {
        assert!(!page.contains(fetched), "{fetched}");
    }
    // One unit of the drawing is a millimetre, on paper and on the membrane.
    assert!(page.contains("id=\"mask\" width=\"50mm\" height=\"50mm\" viewBox=\"0 0 50 50\""));
    assert!(page.contains("class=\"check\" width=\"50mm\""));
    let export = [
        "export",
        "design",
        "bench.yaml:verified",
        "--design",
        "centre",
        "-o",
        "mask.svg",
    ];
    assert_eq!(workspace.run(&export).code, Some(0));
    let mask = std::fs::read_to_string(workspace.path("mask.svg")).unwrap();
    let electrode = |text: &'_ str| between(text, "<path id=\"electrode\"", "/>").to_owned();
    assert_eq!(electrode(&page), electrode(&mask));

    let text = words(&page);
    let run = workspace.run(&["run", "bench.yaml", "--json"]).json();
    let stages = run["stages"].as_array().unwrap();
    let verified = stages.iter().find(|stage| stage["name"] == "verified").unwrap();
    assert!(text.contains(verified["digest"].as_str().unwrap()), "{verified}");
    for part in [
        "I centre: gradient search",
        "pipeline bench",
        "stage verified",
        "mm at 5.25 kV",
        "by the mesh",
        "predicted",
        "more than the intuitive design of the same area",
        "made, 100 devices: mean",
        "the ± leave out the error of the mesh, about 0.0",
        "5 % quantile",
        "of the devices reach 1.5 mm",
        "constraints: area 0.5: met",
        "membrane 1 mm thick, 0.11111 mm on the frame; prestretch 3",
        "shear_modulus: 45 kPa",
        "effects simulated: none",
        "20 × 20 cells ·",
        "largest voltage: about",
        "electric field at 5.25 kV:",
        "of the breakdown field (that of VHB 4910, as the scene has none)",
    ] {
        assert!(text.contains(part), "{part}: {text}");
    }
    assert!(
        text.contains("strain stiffening") || text.contains("No significant effect"),
        "{text}"
    );
    assert!(!text.contains("Not verified"), "{text}");
    // Eighths of 5.25 kV to the volt.
    let eighths = ["0.656", "1.312", "1.969", "2.625", "3.281", "3.938", "4.594", "5.25"];
    assert_eq!(voltages(&page), eighths);

    let unverified = words(&sheet(&workspace, &["--design", "centre", "--until", "design"]));
    assert!(
        unverified.contains("Not verified") && unverified.contains("stage design"),
        "{unverified}"
    );
    has_one_page(&workspace, &["--design", "centre"]);
    has_one_page(&workspace, &["--design", "two"]);
}

#[test]
fn what_is_written_into_the_table_is_read_back() {
    let workspace = workspace(PIPELINE);
    for (target, files) in [("centre", 2), ("two", 4)] {
        let page = sheet(&workspace, &["--design", target]);
        let list = between(&page, "<pre class=\"list\">", "</pre>");
        workspace.write("measured.yaml", list);
        let header = between(&page, "<code class=\"header\">", "</code>");
        let names: Vec<&str> = list
            .split("file: ")
            .skip(1)
            .map(|rest| rest.split(',').next().unwrap())
            .collect();
        assert_eq!(names.len(), files);
        for name in names {
            let rows = voltages(&page);
            let rows = rows.iter().map(|kv| {
                let kilovolts: f64 = kv.parse().unwrap();
                format!("{kv},{:.3}\n", 0.06 * kilovolts.powi(2))
            });
            workspace.write(name, &format!("{header}\n{}", rows.collect::<String>()));
        }
        let commands = between(&page, "<pre class=\"commands\">", "</pre>");
        let run = |command: &str| {
            let words: Vec<&str> = command.split_whitespace().skip(1).chain(["--json"]).collect();
            let ended = workspace.run(&words);
            assert_eq!(ended.code, Some(0), "{command}: {}", ended.stderr);
            ended.json()
        };
        let told: Vec<_> = commands.lines().map(run).collect();
        let [_, measured, compared] = told.as_slice() else {
            panic!("{commands}")
        };
        let read = measured["files"].as_array().unwrap();
        assert!(
            read.len() == files && read.iter().all(|file| file["rows"] == 8),
            "{measured}"
        );
        assert_eq!(compared["compared"].as_array().unwrap().len(), files, "{compared}");
    }
    // At the voltage of the design the comparison simulates what the sheet promises, but for the mesh.
    let page = sheet(&workspace, &["--design", "two"]);
    let value = words(&page);
    let promised: f64 = between(&value, "What it should do ", " mm").parse().unwrap();
    let ended = workspace.run(&["compare", "bench.yaml", "measured.yaml", "-o", "compared.csv"]);
    assert_eq!(ended.code, Some(0), "{}", ended.stderr);
    let table = std::fs::read_to_string(workspace.path("compared.csv")).unwrap();
    let simulated = |name: &str| -> f64 {
        let last = table.lines().rfind(|line| line.starts_with(name)).unwrap();
        last.rsplit(',').nth(1).unwrap().parse().unwrap()
    };
    let mean = 0.5 * (simulated("x1.csv") - simulated("x2.csv"));
    assert!((mean / promised - 1.0).abs() < 0.05, "{mean} {promised}\n{table}");
}

#[test]
fn the_commands_of_a_sheet_and_a_page_have_the_overrides() {
    let workspace = Workspace::new();
    workspace.write("bench.yaml", PIPELINE);
    let sets = ["--set", "scene.drive.voltage=4 kV", "--set", "stages.design.starts=2"];
    let ended = workspace.run(&[&["run", "bench.yaml", "--quiet"], &sets[..]].concat());
    assert_eq!(ended.code, Some(0), "{}", ended.stderr);
    let page = sheet(&workspace, &[&sets[..], &["--design", "centre"]].concat());
    let list = between(&page, "<pre class=\"list\">", "</pre>");
    workspace.write("measured.yaml", list);
    for file in ["x.csv", "y.csv"] {
        workspace.write(file, "voltage_kV,displacement_mm\n2,0.2\n3,0.5\n4,0.9\n");
    }
    let commands = between(&page, "<pre class=\"commands\">", "</pre>").replace("&#39;", "'");
    let commands: Vec<&str> = commands.lines().collect();
    assert_eq!(commands.len(), 3, "{commands:?}");
    for (command, has_stages) in commands.iter().zip([true, false, false]) {
        assert!(command.contains(" --set 'scene.drive.voltage=4 kV'"), "{command}");
        assert_eq!(command.contains("stages.design.starts=2"), has_stages, "{command}");
        let words = shlex::split(command).unwrap();
        let words: Vec<&str> = words.iter().skip(1).map(String::as_str).collect();
        let ended = workspace.run(&words);
        assert_eq!(ended.code, Some(0), "{command}: {}", ended.stderr);
    }
    // The page names the same design, which is that of the overrides; without them none is built.
    let ended = workspace.run(&[&["report", "bench.yaml", "-o", "out"], &sets[..]].concat());
    assert_eq!(ended.code, Some(0), "{}", ended.stderr);
    let index = std::fs::read_to_string(workspace.path("out/index.html")).unwrap();
    let export = between(&index, "deaflow export design ", " --design").replace("&#39;", "'");
    assert_eq!(
        export,
        "bench.yaml:verified --set 'scene.drive.voltage=4 kV' --set stages.design.starts=2 --case I"
    );
    let ended = workspace.run(&[
        "export",
        "design",
        "bench.yaml:verified",
        "--design",
        "centre",
        "-o",
        "m.svg",
    ]);
    assert_eq!(ended.code, Some(2), "{}", ended.stdout);
    let ended = workspace.run(&[&["export", "design", "bench.yaml:made", "-o", "m.svg"], &sets[..2]].concat());
    let told = "--until made --set 'scene.drive.voltage=4 kV'";
    assert!(ended.code == Some(2) && ended.stderr.contains(told), "{}", ended.stderr);
    // The name of a stage alone is that of the last run: the pipeline, its overrides and the objective are named.
    let ended = workspace.run(&["export", "design", "verified", "--design", "centre", "-o", "m.svg"]);
    assert_eq!(ended.code, Some(0), "{}", ended.stderr);
    for part in [
        "stage verified of pipeline bench (",
        "--set 'scene.drive.voltage=4 kV'",
        "point: [25 mm, 25 mm]",
    ] {
        assert!(ended.stdout.contains(part), "{part}: {}", ended.stdout);
    }
    let ended = workspace.run(&[&["export", "design", "verified", "-o", "m.svg"], &sets[..]].concat());
    let told = "name the stage as PIPELINE.yaml:STAGE";
    assert!(ended.code == Some(2) && ended.stderr.contains(told), "{}", ended.stderr);
    // The scene of a check and of a mask has its overrides, too.
    workspace.write("ones.csv", "1,1,1\n1,0,1\n1,1,1\n");
    for command in [
        &["check", "ones.csv", "--scene", "bench.yaml"][..],
        &["export", "design", "ones.csv", "--scene", "bench.yaml", "-o", "m.svg"],
    ] {
        let ended = workspace.run(command);
        assert_eq!(ended.code, Some(2), "{}", ended.stdout);
        let ended = workspace.run(&[command, &["--set", "scene.geometry.cells=3"]].concat());
        assert_eq!(ended.code, Some(0), "{}", ended.stderr);
    }
}

#[test]
fn groups_frame_and_bodies_are_drawn_and_states_have_their_rows() {
    let workspace = workspace(DEVICE);
    let page = sheet(&workspace, &[]);
    assert!(page.contains("id=\"mask\" width=\"160mm\" height=\"80mm\" viewBox=\"0 0 160 80\""));
    for part in [
        "id=\"electrode-1\"",
        "id=\"electrode-2\"",
        "id=\"opening\"",
        "id=\"bodies\"",
        "class=\"held\"",
    ] {
        assert!(page.contains(part), "{part}");
    }
    let numbers: Vec<&str> = page
        .split("<text class=\"group\"")
        .skip(1)
        .map(|rest| between(rest, ">", "<"))
        .collect();
    assert_eq!(numbers, ["1", "2"]);
    assert_eq!(
        voltages(&page)[..5],
        ["left: 1", "left: 2", "left: 3", "left: 4", "right: 0.75"]
    );
    let text = words(&page);
    for part in [
        "prestretch 3 along x, 2 along y",
        "state right: group 1 0 kV, group 2 3 kV",
        "several states",
    ] {
        assert!(text.contains(part), "{part}: {text}");
    }
    has_one_page(&workspace, &[]);

    // Twice as large it does not fit: the drawing says its scale.
    let double = DEVICE.replace("size: [160 mm, 80 mm]", "size: [320 mm, 160 mm]");
    let double = double.replace(
        "[[10 mm, 10 mm], [150 mm, 70 mm]]",
        "[[20 mm, 20 mm], [300 mm, 140 mm]]",
    );
    let double = double.replace(
        "[[70 mm, 30 mm], [90 mm, 50 mm]]",
        "[[140 mm, 60 mm], [180 mm, 100 mm]]",
    );
    let workspace = self::workspace(&double);
    let page = sheet(&workspace, &[]);
    assert!(page.contains("id=\"mask\" width=\"160mm\" height=\"80mm\" viewBox=\"0 0 320 160\""));
    assert!(words(&page).contains("Scale 1:2"));
}

#[test]
fn a_crowded_sheet_has_one_page_too() {
    let workspace = workspace(CROWDED);
    let page = sheet(&workspace, &[]);
    let text = words(&page);
    assert!(text.contains("x3, mm") && text.contains("last, 20 devices"), "{text}");
    assert!(text.contains("strain stiffening"), "{text}");
    has_one_page(&workspace, &[]);
}

#[test]
fn a_sheet_needs_one_design() {
    let workspace = workspace(PIPELINE);
    let refused = |arguments: &[&str]| {
        let ended = workspace.run(&[&["report", "bench.yaml"], arguments].concat());
        assert_eq!(ended.code, Some(2), "{}", ended.stderr);
        assert!(!workspace.path("sheet.html").exists() && !workspace.path("out").exists());
        ended
    };
    snapshot!(refused(&["--sheet", "sheet.html", "-o", "out"]));
    for (arguments, told) in [
        (&["--sheet", "sheet.html", "--design", "edge"][..], "no design matches"),
        (&["-o", "out", "--design", "centre"], "--sheet"),
        (&[], "--output"),
        (&["--sheet", "bench.yaml", "--design", "centre"], "bench.yaml"),
    ] {
        let ended = refused(arguments);
        assert!(ended.stderr.contains(told), "{told}: {}", ended.stderr);
    }
    let bare = Workspace::small();
    bare.stages(&["run", "small.yaml"]);
    let ended = bare.run(&["report", "small.yaml", "--sheet", "sheet.html"]);
    assert_eq!(ended.code, Some(2));
    assert!(ended.stderr.contains("no designs"), "{}", ended.stderr);
    // Both at once.
    let ended = workspace.run(&[
        "report",
        "bench.yaml",
        "--sheet",
        "out/sheet.html",
        "-o",
        "out",
        "--design",
        "two",
        "--json",
    ]);
    assert_eq!(ended.code, Some(0), "{}", ended.stderr);
    let told = ended.json();
    assert_eq!(
        (&told["page"], &told["sheet"]["file"]),
        (&"out/index.html".into(), &"out/sheet.html".into())
    );
    assert_eq!(told["sheet"]["verified"], true);
}

/// A browser prints the sheet on one page.
fn has_one_page(workspace: &Workspace, more: &[&str]) {
    let Some(browser) = Browser::find() else {
        return;
    };
    sheet(workspace, more);
    assert_eq!(browser.pages(&workspace.path("sheet.html")), 1, "{more:?}");
}
