//! A report is one page without external resources, and designs as files that other programs read.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

use super::browser::{Browser, Seen, printed_colours};
use super::common::{SMALL, Workspace, files, scene_file, snapshot};
use super::serve::tab::Tab;

/// Designs of every role in two cases, a dataset, a network, an evaluation and an accuracy stage.
const STAGES: &str = "
  small:     { kind: sample, family: small-grid, count: 60, seed: 1 }
  bezier:    { kind: sample, family: bezier, count: 8, seed: 3 }
  solved:    { kind: solve, needs: [small, bezier], elements_per_cell: 1 }
  balanced:  { kind: balance, needs: [solved], bins: 20, range: [0 mm, 2.5 mm], target: 60, symmetry: d4, seed: 4 }
  surrogate: { kind: train, needs: [balanced], network: qin2024, epochs: 1, seed: 5 }
  reference: { kind: solve, needs: [bezier], elements_per_cell: 2 }
  judged:    { kind: evaluate, needs: [surrogate, reference], estimates: [linear] }
  accuracy:  { kind: accuracy, needs: [reference], methods: [{ method: linear, elements_per_cell: 1 }, { elements_per_cell: 1 }] }
  swept:
    kind: design
    case: II
    evaluator: linear
    targets:
      - { name: area-5, objective: { point: [25 mm, 25 mm], direction: 0 deg }, area: 0.05 }
      - { name: area-50, objective: { point: [25 mm, 25 mm], direction: 0 deg }, area: 0.5 }
      - { name: area-70, objective: { point: [25 mm, 25 mm], direction: 0 deg }, area: 0.7 }
    population: 20
    generations: 3
    seed: 6
  best:
    kind: design
    method: adjoint
    case: II
    targets: [{ name: area-5, objective: { point: [25 mm, 25 mm], direction: 0 deg }, area: 0.05 }]
    starts: 1
    units: 20
    seed: 1
  turned:
    kind: design
    case: III-rotation
    evaluator: linear
    objective: { points: [{ point: [37.5 mm, 37.5 mm], direction: 135 deg }, { point: [12.5 mm, 12.5 mm], direction: 315 deg }] }
    area: free
    population: 20
    generations: 2
    seed: 8
  verified:  { kind: verify, needs: [swept, best, turned], elements_per_cell: 1, order: 1 }
";

const COLUMNS: &str = "name,case,role,units,point_x_mm,point_y_mm,direction_deg,objective,area_target,area,area_mm2,predicted_mm,simulated_mm,\
                       simulated_error_mm,predicted_mN,simulated_mN,simulated_error_mN,distance_mm,intuitive_own_mm,intuitive_equal_area_mm,optimum_mm,ratio_to_optimum,network_mm,\
                       interval_lower_mm,interval_upper_mm,novelty,out_of_distribution,pattern_file";

fn workspace() -> Workspace {
    let workspace = Workspace::new();
    workspace.write("scene.yaml", &scene_file());
    workspace.write(
        "cases.yaml",
        &format!("version: 1\nname: cases\nscene: scene.yaml\nstages:{STAGES}"),
    );
    let ended = workspace.run(&["run", "cases.yaml", "--quiet"]);
    assert_eq!(ended.code, Some(0), "{}", ended.stderr);
    workspace
}

/// The rows of the table by name.
fn table(path: &Path) -> BTreeMap<String, BTreeMap<String, String>> {
    let text = std::fs::read_to_string(path).unwrap();
    assert_eq!(text.lines().next(), Some(COLUMNS));
    let names: Vec<&str> = COLUMNS.split(',').collect();
    let mut reader = csv::Reader::from_reader(text.as_bytes());
    let row = |record: csv::StringRecord| {
        let fields = names.iter().zip(&record);
        let fields: BTreeMap<String, String> = fields.map(|(k, v)| ((*k).to_owned(), v.to_owned())).collect();
        (fields["name"].clone(), fields)
    };
    let rows: Vec<(String, BTreeMap<String, String>)> = reader.records().map(|record| row(record.unwrap())).collect();
    let table: BTreeMap<String, BTreeMap<String, String>> = rows.iter().cloned().collect();
    assert_eq!(table.len(), rows.len(), "names are unique");
    table
}

fn number(row: &BTreeMap<String, String>, column: &str) -> f64 {
    row[column].parse().unwrap_or_else(|_| panic!("{column} of {row:?}"))
}

/// Each design that was searched has its mask beside the page, as `export design` makes it, and a link to it.
fn masks_are_linked(workspace: &Workspace, designs: &BTreeMap<String, BTreeMap<String, String>>) {
    let page = std::fs::read_to_string(workspace.path("out/index.html")).unwrap();
    let searched = |name: &&String| ["ga", "refined", "optimum"].contains(&designs[*name]["role"].as_str());
    let names: Vec<&String> = designs.keys().filter(searched).collect();
    assert!(!names.is_empty());
    for name in &names {
        assert!(page.contains(&format!("href=\"data/masks/{name}.dxf\"")), "{name}");
    }
    assert_eq!(files(&workspace.path("out/data/masks")).len(), names.len());
    let export = [
        "export",
        "design",
        "cases.yaml:verified",
        "--case",
        "II",
        "--design",
        "area-5",
        "--role",
        "ga",
        "-o",
        "ga.dxf",
    ];
    assert_eq!(workspace.run(&export).code, Some(0));
    let polygons = |path: &str| {
        let text = std::fs::read_to_string(workspace.path(path)).unwrap();
        text[text.find("ENTITIES").unwrap()..].to_owned()
    };
    assert_eq!(polygons("ga.dxf"), polygons("out/data/masks/II-area-5-ga.dxf"));
}

#[test]
fn a_report_opens_anywhere_fetches_nothing_and_its_designs_are_files() {
    let workspace = workspace();
    let ended = workspace.run(&["report", "cases.yaml", "-o", "out", "--json"]);
    assert_eq!(ended.code, Some(0), "{}", ended.stderr);
    let told = ended.json();
    assert_eq!(
        (&told["page"], &told["found"]["targets"]),
        (&"out/index.html".into(), &4.into())
    );

    let designs = table(&workspace.path("out/data/designs.csv"));
    // Three targets of one case with three patterns each, of which one has an optimum too; and one of the other case.
    assert_eq!(designs.len(), 13);
    assert_eq!(told["patterns"].as_array().unwrap().len(), 13);
    let best = &designs["II-area-5-optimum"];
    assert_eq!((best["role"].as_str(), best["units"].as_str()), ("optimum", "20"));
    let ga = &designs["II-area-5-ga"];
    assert_eq!((ga["case"].as_str(), ga["area_target"].as_str()), ("II", "0.05"));
    assert_eq!(number(ga, "optimum_mm"), number(best, "simulated_mm"));
    let ratio = number(ga, "simulated_mm") / number(best, "simulated_mm");
    assert!(
        (number(ga, "ratio_to_optimum") - ratio).abs() < 2e-6 && ratio < 1.0,
        "{ga:?}"
    );
    assert_eq!(designs["II-area-50-ga"]["optimum_mm"], "", "of another target");
    let own = &designs["II-area-5-intuitive-own-area"];
    assert_eq!((own["role"].as_str(), own["units"].as_str()), ("intuitive", "50"));
    assert_eq!(ga["intuitive_own_mm"], own["simulated_mm"]);
    let turned = &designs["III-rotation-design-ga"];
    assert_eq!(turned["point_x_mm"], "37.5 12.5");
    assert_eq!(
        (turned["direction_deg"].as_str(), turned["area_target"].as_str()),
        ("135 315", "free")
    );
    assert!(number(turned, "simulated_error_mm") >= 0.0);

    patterns_are_what_was_simulated(&workspace, &designs);
    masks_are_linked(&workspace, &designs);
    page_is_complete(&workspace, designs.keys());
    opens_in_a_browser(&workspace, designs.len());
    legends_keep_their_colours_on_paper(&workspace);

    // The same again, byte for byte, and nothing of the last one left over.
    let before = contents(&workspace.path("out"));
    std::fs::write(workspace.path("out/data/patterns/mine.csv"), "mine").unwrap();
    assert_eq!(
        workspace
            .run(&["report", "cases.yaml", "-o", "out", "--until", "best"])
            .code,
        Some(0)
    );
    let names: Vec<String> = contents(&workspace.path("out")).into_keys().collect();
    let expected = [
        "data/csv-metadata.json",
        "data/designs.csv",
        "data/masks/II-area-5-optimum.dxf",
        "data/patterns/II-area-5-intuitive-equal-area.csv",
        "data/patterns/II-area-5-intuitive-own-area.csv",
        "data/patterns/II-area-5-optimum.csv",
        "data/patterns/mine.csv",
        "index.html",
    ];
    assert_eq!(names, expected);
    let alone = table(&workspace.path("out/data/designs.csv"));
    assert_eq!(alone["II-area-5-optimum"]["simulated_mm"], "", "not verified");
    std::fs::remove_file(workspace.path("out/data/patterns/mine.csv")).unwrap();
    assert_eq!(workspace.run(&["report", "cases.yaml", "-o", "out"]).code, Some(0));
    assert!(contents(&workspace.path("out")) == before);
}

/// Files of a folder by their names within it.
fn contents(folder: &Path) -> BTreeMap<String, Vec<u8>> {
    let name = |path: &Path| path.strip_prefix(folder).unwrap().display().to_string();
    let read = |path: &std::path::PathBuf| (name(path), std::fs::read(path).unwrap());
    files(folder).iter().map(read).collect()
}

/// `solve` takes each pattern file as it is, and finds what the table says: no axis is turned around.
fn patterns_are_what_was_simulated(workspace: &Workspace, designs: &BTreeMap<String, BTreeMap<String, String>>) {
    let turned = &designs["III-rotation-design-ga"];
    for row in designs.values() {
        let text = std::fs::read_to_string(workspace.path("out/data").join(&row["pattern_file"])).unwrap();
        let cells: Vec<Vec<&str>> = text.lines().map(|line| line.split(',').collect()).collect();
        assert!(
            cells.len() == 50 && cells.iter().all(|line| line.len() == 50),
            "{}",
            row["name"]
        );
        let on = cells.iter().flatten().filter(|cell| **cell == "1").count() as f64;
        assert!((on / 2500.0 - number(row, "area")).abs() < 1e-6, "{}", row["name"]);
    }
    let file = format!("out/data/{}", turned["pattern_file"]);
    let options = ["-o", "one.h5", "--elements-per-cell", "1", "--order", "1"];
    let ended = workspace.run(&[&["solve", "scene.yaml", &file], &options[..]].concat());
    assert_eq!(ended.code, Some(0), "{}", ended.stderr);
    let solved = hdf5::File::open(workspace.path("one.h5")).unwrap();
    let field = solved.dataset("displacement").unwrap().read_raw::<f64>().unwrap();
    // The points stand in the middle of a cell: the mean of its corners.
    let at = |x: usize, y: usize, k: usize| {
        let corners = [(x, y), (x + 1, y), (x, y + 1), (x + 1, y + 1)];
        corners.iter().map(|(x, y)| field[2 * (51 * y + x) + k]).sum::<f64>() / 4.0
    };
    let along =
        |x, y, degrees: f64| at(x, y, 0) * degrees.to_radians().cos() + at(x, y, 1) * degrees.to_radians().sin();
    let value = 0.5 * (along(37, 37, 135.0) + along(12, 12, 315.0));
    assert!(
        (value - number(turned, "simulated_mm")).abs() < 1e-5,
        "{value} {turned:?}"
    );
}

/// What can be seen without a browser.
fn page_is_complete<'n>(workspace: &Workspace, designs: impl Iterator<Item = &'n String>) {
    let page = std::fs::read_to_string(workspace.path("out/index.html")).unwrap();
    let fetched = ["http:", "https:", "//fonts", "<script", "@import", "url("];
    assert!(fetched.iter().all(|word| !page.contains(word)), "nothing is fetched");
    for name in designs {
        assert!(page.contains(&format!("id=\"{name}\"><h5>")), "{name}");
    }
    let headings = headings(&page);
    assert!(headings.len() > 13, "{headings:?}");
    snapshot!(headings.join("\n"));
    // Each drawing has a text for readers who do not see it; one holds what the others share.
    assert_eq!(
        page.matches("role=\"img\" aria-label=\"").count() + 1,
        page.matches("<svg").count()
    );
    let ids: Vec<&str> = page
        .split(" id=\"")
        .skip(1)
        .map(|rest| rest.split('"').next().unwrap())
        .collect();
    assert_eq!(ids.iter().collect::<BTreeSet<_>>().len(), ids.len(), "no id twice");
    assert!(page.len() < 1_500_000, "{}", page.len());
}

/// Titles of the sections of a page.
fn headings(page: &str) -> Vec<&str> {
    let title = |rest: &'_ str| rest.split_once('>').map(|(_, rest)| rest.len());
    let starts = page
        .match_indices("<h")
        .filter(|(at, _)| page[at + 2..].starts_with(['1', '2', '3', '4']));
    let titles = starts.filter_map(|(at, _)| {
        let start = page.len() - title(&page[at..])?;
        page[start..].split('<').next()
    });
    titles.filter(|title| !title.trim().is_empty()).collect()
}

fn opens_in_a_browser(workspace: &Workspace, designs: usize) {
    let Some(browser) = Browser::find() else {
        return;
    };
    let faults = browser.faults(&workspace.path("out/index.html"));
    assert!(faults.is_empty(), "{} faults:\n{}", faults.len(), faults.join("\n"));
    for (width, name) in [(1280, "desktop.png"), (390, "phone.png")] {
        let seen = browser.visit(&workspace.path("out/index.html"), width, 1600);
        let Seen {
            width: inner,
            scrolled,
            drawings,
            without_size,
            fetched,
            ..
        } = seen;
        assert_eq!(inner, width, "{seen:?}");
        assert!(scrolled <= width, "the page scrolls sideways: {seen:?}");
        assert_eq!((without_size, fetched), (0, 0), "{seen:?}");
        assert!(drawings >= 2 * designs as u32 + 10, "{seen:?}");
        assert_eq!(seen.complaints, Vec::<String>::new());
        let image = workspace.path(name);
        browser.photograph(&workspace.path("out/index.html"), width, 1600, &image);
        let (colours, covered) = super::browser::colours(&image, width as usize);
        assert!(
            colours > 30 && covered > 0.03,
            "{name}: {colours} colours, {covered} covered"
        );
    }
}

/// Keys of legends are backgrounds, which browsers leave out of what they print unless the page asks for them.
fn legends_keep_their_colours_on_paper(workspace: &Workspace) {
    let Some(mut tab) = Tab::open() else {
        return;
    };
    let page = std::fs::read_to_string(workspace.path("out/index.html")).unwrap();
    let head = page.split("<body>").next().unwrap();
    // Without the drawings, which have the same colours.
    let legends = page.split("<ul class=\"legend\">").skip(1);
    let legends: Vec<&str> = legends.map(|rest| rest.split("</ul>").next().unwrap()).collect();
    let colours =
        [("blue", 0x00_72b2), ("orange", 0xe6_9f00), ("green", 0x00_9e73)].map(|(class, rgb): (&str, u32)| {
            let [_, red, green, blue] = rgb.to_be_bytes();
            (class, [red, green, blue])
        });
    let used: Vec<[u8; 3]> = colours
        .into_iter()
        .filter(|(class, _)| {
            legends
                .iter()
                .any(|legend| legend.contains(&format!("<li class=\"{class}\">")))
        })
        .map(|(_, colour)| colour)
        .collect();
    assert!(used.len() >= 2, "{legends:?}");
    let mut printed = |head: &str| {
        let lists: String = legends
            .iter()
            .map(|legend| format!("<ul class=\"legend\">{legend}</ul>"))
            .collect();
        let file = workspace.path("legends.html");
        std::fs::write(&file, format!("{head}<body>{lists}</body></html>")).unwrap();
        tab.go("about:blank");
        tab.go(&format!("file://{}", file.display()));
        tab.until("document.readyState === 'complete' && document.querySelector('.legend')");
        printed_colours(&tab.print())
    };
    let on_paper = printed(head);
    assert!(
        used.iter().all(|colour| on_paper.contains(colour)),
        "{used:?} in {on_paper:?}"
    );
    // Otherwise they are not there.
    let plain = printed(&head.replace("color-adjust: exact", "color-adjust: economy"));
    assert!(
        used.iter().all(|colour| !plain.contains(colour)),
        "{used:?} in {plain:?}"
    );
}

#[test]
fn what_is_not_built_is_named_and_left_out_only_where_that_is_asked_for() {
    let workspace = Workspace::small();
    let report = ["report", "small.yaml", "-o", "out"];
    let ended = workspace.run(&report);
    assert_eq!(ended.code, Some(2));
    assert!(ended.stderr.contains("store"), "{}", ended.stderr);

    workspace.stages(&["run", "small.yaml", "--until", "small"]);
    let ended = workspace.run(&report);
    assert_eq!(ended.code, Some(2));
    for part in [
        "3 of 4",
        "large, solved, balanced",
        "deaflow run small.yaml",
        "--partial",
    ] {
        assert!(ended.stderr.contains(part), "{}", ended.stderr);
    }
    snapshot!(ended);
    assert!(!workspace.path("out").exists(), "nothing is written");

    let ended = workspace.run(&[&report[..], &["--partial"]].concat());
    assert_eq!(ended.code, Some(0), "{}", ended.stderr);
    assert!(ended.stderr.contains("large, solved, balanced"), "{}", ended.stderr);
    let page = std::fs::read_to_string(workspace.path("out/index.html")).unwrap();
    assert!(page.contains("3 of 4"));
    assert!(!workspace.path("out/data").exists(), "there are no designs");

    // A pipeline that has been changed since is one that has not been built.
    workspace.stages(&["run", "small.yaml"]);
    workspace.write("small.yaml", &SMALL.replace("target: 4", "target: 5"));
    let ended = workspace.run(&report);
    assert_eq!(ended.code, Some(2));
    assert!(
        ended.stderr.contains("1 of 4") && ended.stderr.contains("balanced"),
        "{}",
        ended.stderr
    );

    // The report is a folder and the sheet a page; both are printed to PDF by a browser.
    for (arguments, named) in [
        (["-o", "out.pdf"], "use -o out; "),
        (["--sheet", "sheet.pdf"], "name it sheet.html; "),
    ] {
        let refused = workspace.refused(&[&["report", "small.yaml", "--partial"], &arguments[..]].concat());
        assert!(
            refused.contains(named) && refused.contains("print it to a PDF"),
            "{refused}"
        );
    }

    workspace.write("taken", "a file");
    let ended = workspace.run(&["report", "small.yaml", "-o", "taken/out", "--partial"]);
    assert_eq!(ended.code, Some(1));
    assert!(ended.stderr.contains("taken"), "{}", ended.stderr);
}

#[test]
fn the_report_marks_built_and_reused_stages() {
    let workspace = Workspace::small();
    workspace.stages(&["run", "small.yaml", "--until", "solved"]);
    workspace.stages(&["run", "small.yaml"]);
    let ended = workspace.run(&["report", "small.yaml", "-o", "out"]);
    assert_eq!(ended.code, Some(0), "{}", ended.stderr);
    let page = std::fs::read_to_string(workspace.path("out/index.html")).unwrap();
    assert!(page.contains("<i></i>1 built</li>") && page.contains("<i></i>3 reused</li>"));
    assert!(page.contains("<title>balanced: balance, built</title>"));
    assert!(page.contains("<title>solved: solve, reused</title>"));
}
