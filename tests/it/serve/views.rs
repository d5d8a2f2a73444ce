//! What a person sees of models, designs, accuracy, audits and runs that go on.

use serde_json::json;

use super::super::common::scene_file;
use super::super::import;
use super::answers::{MODEL, long_run};
use super::server::Server;
use super::tab::Tab;
use super::{blank, on_the_sketchpad, photographed, with_scene};

/// A stage of each kind that has a view of its own, as small as they may be.
const STAGES: &str = "  small:    { kind: sample, family: small-grid, count: 12, seed: 1 }
  bezier:   { kind: sample, family: bezier, count: 12, seed: 3 }
  solved:   { kind: solve, needs: [small], elements_per_cell: 1 }
  balanced: { kind: balance, needs: [solved], bins: 5, range: [0 mm, 2.5 mm], target: 12, symmetry: d4, seed: 4 }
  audited:  { kind: audit, needs: [balanced], samples: 2, seed: 7 }
  network:  { kind: train, needs: [balanced, audited], network: physics, epochs: 1, batch: 8, seed: 5 }
  truth:    { kind: solve, needs: [bezier], elements_per_cell: 2, order: 2 }
  judged:   { kind: evaluate, needs: [network, truth], estimates: [linear] }
  design:   { kind: design, evaluator: linear, area: 0.5, population: 20, generations: 2, seed: 6, objective: { point: [25 mm, 25 mm], direction: 0 deg } }
  optimum:  { kind: design, method: adjoint, units: 20, starts: 1, area: 0.5, seed: 7, objective: { point: [25 mm, 25 mm], direction: 0 deg } }
  verified: { kind: verify, needs: [design, optimum], elements_per_cell: 1 }
  costs:    { kind: accuracy, needs: [truth], methods: [{ method: linear, elements_per_cell: 1 }, { method: newton, elements_per_cell: 1 }] }
";

#[test]
fn models_designs_and_accuracy_have_views_of_their_own() {
    let Some(mut tab) = Tab::open() else { return };
    let workspace = with_scene();
    workspace.write(
        "views.yaml",
        &format!("version: 1\nname: views\nscene: scene.yaml\nstages:\n{STAGES}"),
    );
    let digests = workspace.stages(&["run", "views.yaml"]).digests();
    let server = Server::start(&workspace, &["serve", "views.yaml"]);
    let at = |digest: &str, more: &str| format!("http://127.0.0.1:{}/#/artifacts/{digest}{more}", server.port);
    tab.screen(1440, 900, "light");
    tab.go(&server.url);
    tab.until("document.querySelector('#views a')");
    // The network, its errors, and the worst of its patterns, which leads to the sample.
    tab.go(&at(&digests["network"], ""));
    tab.until("document.querySelectorAll('[data-worst] .card').length === 8");
    let worst = server
        .get(&format!(
            "/api/artifacts/{}/rows?sort=-pattern/max_error.0_mm&limit=1",
            digests["judged"]
        ))
        .json();
    let column = |name: &str| {
        worst["columns"]
            .as_array()
            .unwrap()
            .iter()
            .position(|column| column["name"] == name)
            .unwrap()
    };
    let row = worst["rows"][0][column("set_row")].as_u64().unwrap();
    let first = tab.value("document.querySelector('[data-worst] .card').innerText");
    let first = first.as_str().unwrap();
    assert!(
        first.contains("bezier") && first.contains("the training set has no pattern of this family"),
        "{first}"
    );
    assert!(first.contains("the nearest training pattern differs in"), "{first}");
    assert!(first.contains("% of its largest displacement"), "{first}");
    photographed(&mut tab, "model");
    tab.click("[data-worst] .card");
    tab.until(&format!(
        "location.hash.includes('row={row}') && document.querySelector('#sample canvas')"
    ));
    // The sample: what it is like, and what it comes from.
    tab.until("document.querySelectorAll('[data-neighbours] .card').length === 6");
    tab.until("document.querySelector('[data-seed]')");
    assert_eq!(tab.value("document.querySelector('[data-seed]').dataset.seed"), "3");
    photographed(&mut tab, "sample");
    // Images of a pattern in a balanced set, by a button.
    tab.go(&at(&digests["balanced"], "?tab=rows&row=0"));
    tab.click("[data-alike=orbit]");
    tab.until("document.querySelector('input[name=filter]').value.startsWith('orbit = ')");
    let orbit = server
        .get(&format!("/api/artifacts/{}/rows?limit=1", digests["balanced"]))
        .json();
    let place = orbit["columns"]
        .as_array()
        .unwrap()
        .iter()
        .position(|column| column["name"] == "orbit")
        .unwrap();
    let own = orbit["rows"][0][place].as_str().unwrap();
    let same = server
        .get(&format!(
            "/api/artifacts/{}/rows?limit=0&filter=orbit+%3D+{own}",
            digests["balanced"]
        ))
        .json()["matched"]
        .clone();
    tab.until(&format!(
        "document.querySelector('#matched').dataset.matched === '{same}'"
    ));
    // One value of a column of texts is chosen from a list.
    tab.go(&at(&digests["verified"], "?tab=rows"));
    tab.write("select[name=only-role]", "optimum");
    tab.until("document.querySelector('#matched').dataset.matched === '1'");
    assert_eq!(
        tab.value("document.querySelector('input[name=filter]').value"),
        "role = \"optimum\""
    );
    // Designs beside the optimum, with masks.
    tab.go(&at(&digests["verified"], ""));
    tab.until("document.querySelectorAll('[data-mask=dxf]').length > 1");
    let text = tab.value("document.querySelector('main').innerText");
    assert!(
        text.as_str()
            .unwrap()
            .contains("% of the best pattern found by gradient search under the same constraints"),
        "{text}"
    );
    // The objective stands there in words.
    assert!(
        text.as_str().unwrap().contains("Displacement of (25, 25) mm at 0°"),
        "{text}"
    );
    // Areas have mm² beside the share, and numbers their errors.
    let cards = "[...document.querySelectorAll('.card')]";
    let with_both = format!("{cards}.length > 1 && {cards}.every((card) => / %, \\d+ mm²/.test(card.textContent))");
    assert_eq!(tab.value(&with_both), true);
    assert!(text.as_str().unwrap().contains(" ± "), "{text}");
    photographed(&mut tab, "designs");
    tab.value(
        "window.saved = []; HTMLAnchorElement.prototype.click = function () { window.saved.push(this.download) }",
    );
    tab.click("[data-mask=dxf]");
    tab.until("window.saved.length === 1 && window.saved[0].endsWith('.dxf')");
    // Accuracy: a setting of a point, as a stage takes it.
    tab.go(&at(&digests["costs"], ""));
    tab.until("document.querySelectorAll('[data-setting]').length === 2");
    tab.click("[data-setting]");
    tab.until("document.querySelector('.copyable pre').textContent.includes('elements_per_cell: 1')");
    tab.until("document.querySelector('iframe')?.contentDocument?.querySelector('svg')");
    photographed(&mut tab, "accuracy");
    tab.go(&at(&digests["costs"], "?tab=origin"));
    tab.until("document.querySelector('[aria-label=Ancestry]')");
    photographed(&mut tab, "origin");
    tab.go(&format!("http://127.0.0.1:{}/#/artifacts", server.port));
    tab.until("document.querySelectorAll('tbody tr').length > 10");
    photographed(&mut tab, "artifacts");
    assert_eq!(tab.complaints, Vec::<String>::new());
}

#[test]
fn the_worst_pattern_of_a_model_and_why_are_found_without_an_evaluation() {
    let Some(mut tab) = Tab::open() else { return };
    let workspace = with_scene();
    workspace.write(
        "model.yaml",
        &format!("version: 1\nname: model\nscene: scene.yaml\nstages:\n{MODEL}"),
    );
    let digests = workspace.stages(&["run", "model.yaml"]).digests();
    let server = Server::start(&workspace, &["serve", "model.yaml"]);
    let worst = server
        .get(&format!("/api/artifacts/{}/judged?limit=1", digests["network"]))
        .json();
    tab.screen(1440, 900, "light");
    tab.go(&server.url);
    // From the menu: the model, its worst pattern, and the row with what is predicted of it.
    tab.click("a[href='#/models']");
    tab.until("document.querySelector('[data-own] .card')");
    let first = tab.value("document.querySelector('[data-own] .card').innerText");
    let first = first.as_str().unwrap();
    assert!(
        first.contains("small-grid") && first.contains("the nearest training pattern differs in"),
        "{first}"
    );
    assert!(!first.contains("differs in 0 %"), "{first}");
    // What was learned from can be looked at, too.
    for part in ["train", "test"] {
        tab.value(&format!("(() => {{ const select = document.querySelector('select[name=judged-split]'); select.value = '{part}'; select.dispatchEvent(new Event('change')); }})()"));
        tab.until(&format!(
            "document.querySelector('[data-own][data-split={part}] .card')"
        ));
    }
    tab.click("[data-own] .card");
    tab.until("document.querySelectorAll('#prediction canvas[role=img]').length === 3 && document.querySelectorAll('#prediction figcaption')[2].textContent.startsWith('Error: largest')");
    assert_eq!(
        tab.value("Number(document.querySelector('[data-error]').dataset.error)"),
        worst["rows"][0]["max_error_mm"]
    );
    assert!(
        tab.value("location.hash")
            .as_str()
            .unwrap()
            .contains(&format!("row={}", worst["rows"][0]["row"]))
    );
    photographed(&mut tab, "prediction");
    // A card that says how far the nearest learned pattern is says whether that explains anything.
    assert!(
        !first.contains("for the best predictions of")
            || first.contains("this is not the reason")
            || first.contains("it is farther"),
        "{first}"
    );
    // On a narrow screen the cells of a run stand below each other.
    tab.screen(390, 900, "light");
    tab.go(&format!("http://127.0.0.1:{}/#/runs", server.port));
    tab.until("document.querySelector('table.stacked td[data-title=results] div')");
    let inside = tab.value("[...document.querySelectorAll('table.stacked td *')].every((e) => { const box = e.getBoundingClientRect(); return box.left >= 0 && box.right <= 390 })");
    assert_eq!(inside, true);
    assert_eq!(tab.complaints, Vec::<String>::new());
}

/// Cells of the drawn pattern that are active.
fn drawn(tab: &mut Tab) -> f64 {
    let text = tab.value("document.querySelector('#area').textContent.split(' ')[1]");
    text.as_str().unwrap().parse::<f64>().unwrap() * 25.0
}

#[test]
fn numbers_of_before_are_grey_and_shapes_are_drawn_by_keys() {
    let Some(mut tab) = Tab::open() else { return };
    let (_workspace, _server) = on_the_sketchpad(&mut tab);
    // The stages stand there before anything is saved.
    tab.until(
        "document.querySelector('#stages pre')?.textContent.includes('mine: { kind: patterns, files: [mine.csv] }')",
    );
    tab.value(
        "window.saved = []; HTMLAnchorElement.prototype.click = function () { window.saved.push(this.download) }",
    );
    tab.write("input[name=name]", "disc");
    assert!(
        tab.text("#stages pre")
            .contains("disc: { kind: patterns, files: [disc.csv] }")
    );
    tab.click("#into-pipeline");
    tab.until("window.saved.length === 1 && window.saved[0] === 'disc.csv'");
    // What is no pattern is refused before it is sent.
    tab.value("(() => { const input = document.querySelector('input[type=file]'); const data = new DataTransfer(); data.items.add(new File(['x'], 'notes.txt')); input.files = data.files; input.dispatchEvent(new Event('change')) })()");
    tab.until("document.body.innerText.includes('cannot open “notes.txt”: unknown format') && document.body.innerText.includes('allowed: png, jpg, jpeg, tif, tiff, bmp, csv, npy, svg, dxf')");
    // An effect without data cannot be switched on, and says why.
    assert_eq!(
        tab.value("document.querySelector('input[name=strain_stiffening]').disabled"),
        true
    );
    assert!(tab.text("[data-refused=strain_stiffening]").contains("no data"));
    assert_eq!(
        tab.value("document.querySelector('input[name=wrinkling]').disabled"),
        false
    );
    // A shape by two corners: the second is seen while it moves, and Escape drops it.
    tab.value("document.querySelector('#pad').focus()");
    assert_eq!(tab.value("document.querySelector('button[name=undo]').disabled"), true);
    let corner = |tab: &mut Tab, more: &str| {
        tab.key("r", 0);
        tab.key(" ", 0);
        (0..3).for_each(|_| tab.key("ArrowRight", 0));
        (0..2).for_each(|_| tab.key("ArrowUp", 0));
        tab.until("document.querySelector('#area').textContent === 'area 0.48 %, 12 mm²; rectangle 4 mm × 3 mm'");
        tab.key(more, 0);
    };
    corner(&mut tab, "Escape");
    tab.until("document.querySelector('#area').textContent === 'area 0 %, 0 mm²'");
    corner(&mut tab, " ");
    tab.until("!document.querySelector('button[name=undo]').disabled");
    assert_eq!(drawn(&mut tab), 12.0);
    // Ctrl Z works wherever nothing is written.
    tab.value("document.querySelector('#compare').focus()");
    tab.key("z", 2);
    tab.until("document.querySelector('#area').textContent === 'area 0 %, 0 mm²' && document.querySelector('button[name=undo]').disabled");
    tab.key("y", 2);
    tab.until("document.querySelector('#area').textContent === 'area 0.48 %, 12 mm²' && document.querySelector('button[name=redo]').disabled");
    // A wrong value greys the numbers of before, and a unit is none.
    let grey = "document.querySelector('#results').classList.contains('old')";
    let clear = "!document.querySelector('#results').classList.contains('old')";
    let settled = "document.querySelector('#results').dataset.settled === 'true'";
    tab.write("#volts", "many");
    tab.until(grey);
    tab.write("#volts", "4 kV");
    tab.until(clear);
    assert_eq!(tab.value("document.querySelector('#voltage').value"), "4000");
    tab.write("input[aria-label='x, mm']", "80");
    tab.until(grey);
    tab.write("input[aria-label='x, mm']", "2.5 cm");
    tab.until(clear);
    tab.until(settled);
    // So does a question that has no answer; a late refusal of an older one says nothing.
    tab.value("window.own = window.fetch; window.fetch = () => Promise.reject(new Error('gone'))");
    tab.write("#volts", "4100");
    tab.until(grey);
    tab.until("document.querySelector('#notice').textContent.includes('gone')");
    tab.value("window.fetch = window.own");
    tab.write("#volts", "4200");
    tab.until(clear);
    tab.until(settled);
    tab.value("window.fetch = (...all) => new Promise((_, reject) => { setTimeout(() => reject(new Error('late')), 1500); window.fetch = window.own })");
    tab.write("#volts", "4300");
    tab.write("#volts", "4400");
    tab.until(settled);
    tab.value("new Promise((resolve) => setTimeout(resolve, 1800))");
    assert_eq!(tab.value(clear), true);
    assert!(!tab.text("#notice").contains("late"));
    // A wanted value is held against the one that there is.
    tab.write("input[name=wanted]", "1 mm");
    tab.until("document.querySelector('#wanted').textContent.endsWith('mm too small')");
    tab.screen(390, 900, "light");
    tab.value("scrollTo(0, 1200)");
    tab.until("document.querySelector('#value-line').getBoundingClientRect().top === 0 && document.querySelector('#value-line').textContent.startsWith('value ')");
    assert_eq!(tab.complaints, Vec::<String>::new());
}

#[test]
fn a_wrong_number_is_told_beside_its_field_and_all_values_can_be_reached() {
    let Some(mut tab) = Tab::open() else { return };
    let workspace = with_scene();
    let stages: String = (0..60)
        .map(|k| format!("  s{k:02}: {{ kind: sample, family: small-grid, count: 4, seed: {k} }}\n"))
        .collect();
    workspace.write(
        "many.yaml",
        &format!("version: 1\nname: many\nscene: scene.yaml\nstages:\n{stages}"),
    );
    let server = Server::start(&workspace, &["serve", "many.yaml"]);
    tab.screen(1440, 900, "light");
    tab.go(&format!("{}#/sketch", server.url));
    tab.until("document.querySelector('#outcome')");
    blank(&mut tab, "many", 50);
    for (wrong, told) in [
        ("-5", "allowed: 0 to 1000000 V"),
        ("abc", "“abc” is not a number"),
        ("", "enter a number"),
        ("2e9", "allowed"),
    ] {
        tab.write("#volts", wrong);
        tab.until(&format!(
            "document.querySelector('#voltage-trouble').textContent.includes({})",
            json!(told)
        ));
        assert_eq!(
            tab.value("document.querySelector('#volts').getAttribute('aria-invalid')"),
            "true"
        );
    }
    tab.write("#volts", "4000");
    tab.until("document.querySelector('#voltage-trouble').textContent === ''");
    // The colours of a magnitude begin at zero.
    tab.stroke("#pad", &[[0.3, 0.3], [0.6, 0.6]]);
    tab.until("document.querySelector('.legend.soft').textContent.startsWith('displacement: 0 to ')");
    let listed = server.get("/api/pipelines/0").json()["values"]
        .as_array()
        .unwrap()
        .len();
    tab.go(&format!("http://127.0.0.1:{}/#/pipelines/0", server.port));
    // Values of scenes and designs stand on top; the others are folded.
    tab.until("document.querySelector('#other-values')?.open === false");
    assert_eq!(
        tab.value("document.querySelector('[aria-label=\"Main values\"] [data-path]').dataset.path"),
        "scene.drive.voltage"
    );
    tab.value("document.querySelector('#other-values').open = true");
    tab.click("button[name=all-values]");
    tab.until(&format!("document.querySelectorAll('[data-path]').length === {listed}"));
    // On a narrow screen stages stand below each other, and nothing is cut off.
    tab.screen(390, 900, "light");
    tab.until("document.querySelectorAll('ol.stages li').length === 60 && document.querySelector('ol.stages').clientHeight > 0");
    assert_eq!(
        tab.value("document.querySelector('svg.dag').getClientRects().length"),
        0
    );
    let inside = tab.value("[...document.querySelectorAll('[data-path]')].every((input) => { const box = input.getBoundingClientRect(); return box.left >= 0 && box.right <= 390 && box.width > 150 })");
    assert_eq!(inside, true);
    assert_eq!(tab.complaints, Vec::<String>::new());
}

/// Whether a line of the drawing of stages runs through a box.
const CROSSED: &str = "(() => { const boxes = [...document.querySelectorAll('svg.dag g')].map((g) => { const [, x, y] = /translate\\(([-\\d.]+) ([-\\d.]+)\\)/.exec(g.getAttribute('transform')); const r = g.querySelector('rect'); return [Number(x), Number(y), Number(r.getAttribute('width')), Number(r.getAttribute('height'))]; }); return [...document.querySelectorAll('svg.dag path')].some((path) => { const length = path.getTotalLength(); for (let k = 0; k <= 400; k += 1) { const p = path.getPointAtLength((k / 400) * length); if (boxes.some(([x, y, w, h]) => p.x > x + 1 && p.x < x + w - 1 && p.y > y + 1 && p.y < y + h - 1)) return true; } return false; }) })()";

#[test]
fn the_drawing_of_stages_keeps_lines_clear_of_boxes_and_shows_what_goes_on() {
    let Some(mut tab) = Tab::open() else { return };
    let workspace = with_scene();
    workspace.write(
        "views.yaml",
        &format!("version: 1\nname: views\nscene: scene.yaml\nstages:\n{STAGES}"),
    );
    // The values of a sweep end with what differs between its stages.
    let swept = "  drawn: { kind: sample, foreach: { longparameter: [125, 1050] }, family: small-grid, count: \"${longparameter}\", seed: 1 }\n";
    workspace.write(
        "swept.yaml",
        &format!("version: 1\nname: swept\nscene: scene.yaml\nstages:\n{swept}"),
    );
    let child = long_run(&workspace, &[]);
    let server = Server::start(&workspace, &["serve", "views.yaml", "long.yaml", "swept.yaml"]);
    tab.screen(1440, 900, "light");
    tab.go(&server.url);
    tab.click("a[href='#/pipelines/0']");
    tab.until("document.querySelectorAll('svg.dag g').length === 12");
    assert_eq!(tab.value(CROSSED), false);
    photographed(&mut tab, "stages");
    tab.go(&format!("http://127.0.0.1:{}/#/pipelines/2", server.port));
    tab.until("document.querySelectorAll('svg.dag g').length === 2");
    let inside = "[...document.querySelectorAll('svg.dag g')].every((one) => [...one.querySelectorAll('text')].every((text) => text.getBoundingClientRect().right < one.querySelector('rect').getBoundingClientRect().right))";
    assert_eq!(tab.value(inside), true);
    let names = tab.value("[...document.querySelectorAll('svg.dag .name')].map((one) => one.textContent)");
    let ends = |at: usize, end: &str| {
        let name = names[at].as_str().unwrap();
        name.starts_with("drawn") && name.ends_with(end)
    };
    assert!(ends(0, "parameter=125") && ends(1, "parameter=1050"), "{names}");
    tab.go(&format!("http://127.0.0.1:{}/#/pipelines/1", server.port));
    tab.until("document.querySelector('[data-state=running]')");
    tab.until("document.querySelector('[data-state=running] progress').value > 0");
    assert!(tab.text("#status").contains("short is running"));
    photographed(&mut tab, "running");
    // With other values it is another run, which is said, and nothing of this plan is under way.
    tab.write("input[name=find]", "elements_per_cell");
    tab.write("[data-path='stages.solved.elements_per_cell']", "3");
    tab.until("document.querySelector('#elsewhere').textContent.includes('with the values of the file')");
    tab.until("!document.querySelector('[data-state=running]')");
    tab.write("[data-path='stages.solved.elements_per_cell']", "4");
    tab.until("document.querySelector('[data-state=running]') && !document.querySelector('#elsewhere').textContent");
    let mut child = child;
    child.kill().unwrap();
    child.wait().unwrap();
    tab.until("!document.querySelector('[data-state=running]')");
    assert_eq!(tab.complaints, Vec::<String>::new());
}

#[test]
fn a_repeated_pattern_is_shown_with_its_partner_and_what_waits_for_the_audit() {
    let Some(mut tab) = Tab::open() else { return };
    let workspace = with_scene();
    let (mut cells, mut fields) = import::solved(&workspace, 6);
    cells.copy_within(0..2500, 5 * 2500);
    fields.copy_within(0..5202, 5 * 5202);
    import::npz(&workspace.path("labels.npz"), &cells, &fields);
    let stages = "  labels: { kind: import, files: [labels.npz] }\n  audited: { kind: audit, needs: [labels], samples: 1 }\n  network: { kind: train, needs: [labels, audited], network: physics, epochs: 1, batch: 8, seed: 5 }\n";
    workspace.write(
        "twice.yaml",
        &format!("version: 1\nname: twice\nscene: scene.yaml\nstages:\n{stages}"),
    );
    workspace.run(&["run", "twice.yaml", "--until", "audited"]);
    let server = Server::start(&workspace, &["serve", "twice.yaml"]);
    tab.screen(1440, 900, "light");
    tab.go(&server.url);
    tab.click("a[href='#/audits']");
    tab.until("document.querySelector('[data-blocks=network]')");
    tab.until("document.querySelector('[data-check=duplicate] button')");
    tab.click("[data-check=duplicate] button");
    tab.until("document.querySelector('[data-partners]')");
    let partners = tab.value("[document.querySelector('[data-check=duplicate] button').textContent, document.querySelector('[data-partners]').dataset.partners]");
    assert!(
        partners == json!(["row 0", "5"]) || partners == json!(["row 5", "0"]),
        "{partners}"
    );
    photographed(&mut tab, "partner");
    // The row that is open has an address.
    let hash = tab.value("location.hash");
    assert!(hash.as_str().unwrap().contains("check=duplicate&row="), "{hash}");
    tab.reload();
    tab.until("document.querySelector('[data-check=duplicate] [data-partners]')");
    tab.value(
        "window.saved = []; HTMLAnchorElement.prototype.click = function () { window.saved.push(this.download) }",
    );
    tab.value(
        "[...document.querySelectorAll('button')].find((button) => button.textContent === 'Mark these rows').click()",
    );
    tab.value("[...document.querySelectorAll('button')].find((button) => button.textContent === 'Save the list of marked rows').click()");
    tab.until("window.saved.length === 1 && window.saved[0].startsWith('findings-')");
    assert_eq!(tab.complaints, Vec::<String>::new());
}

/// The drawn share of a canvas without its edge: its mean colour between that of paper and of the first group.
const DRAWN_SHARE: &str = "(canvas => { const { width, height } = canvas; \
    const data = canvas.getContext('2d').getImageData(0, 0, width, height).data; const edge = 6; \
    const paper = data[4 * (edge * width + edge)]; let sum = 0; \
    for (let y = edge; y < height - edge; y += 1) for (let x = edge; x < width - edge; x += 1) \
    sum += (paper - data[4 * (y * width + x)]) / (paper - 0x2b); return sum / (width * height); })";

#[test]
fn drawn_electrodes_are_shown_with_their_edges() {
    let Some(mut tab) = Tab::open() else { return };
    let workspace = with_scene();
    let coarse = scene_file().replace("cells: 50", "cells: 16");
    workspace.write("scene.yaml", &coarse);
    let shapes = "shapes: [{ ring: { centre: [25 mm, 25 mm], radii: [3.3 mm, 9 mm] } }]";
    let stages: String = ["fitted", "coverage", "cells"]
        .iter()
        .map(|edges| {
            format!(
                "  {edges}: {{ kind: patterns, edges: {edges}, {shapes} }}\n  solved-{edges}: {{ kind: solve, needs: \
                 [{edges}], elements_per_cell: 2 }}\n"
            )
        })
        .collect();
    workspace.write(
        "edges.yaml",
        &format!("version: 1\nname: edges\nscene: scene.yaml\nstages:\n{stages}"),
    );
    let digests = workspace.stages(&["run", "edges.yaml"]).digests();
    let server = Server::start(&workspace, &["serve", "edges.yaml"]);
    let at = |path: &str| server.get(&format!("/api/artifacts/{}", digests["solved-fitted"].clone() + path));
    let reply = at("/shapes?rows=0").json();
    let rings = reply["shapes"][0].as_array().unwrap();
    assert_eq!(rings.len(), 2, "a ring has an outer and an inner edge");
    for vertex in rings.iter().flat_map(|ring| ring["ring"].as_array().unwrap()) {
        let [x, y] = [0, 1].map(|axis| 50.0 * vertex[axis].as_f64().unwrap() - 25.0);
        let radius = x.hypot(y);
        assert!((radius - 9.0).abs() < 1e-5 || (radius - 3.3).abs() < 1e-5, "{radius}");
    }
    assert_eq!((at("/shapes?rows=1").status, at("/shapes?rows=a").status), (404, 400));
    let of_cells = server.get(&format!("/api/artifacts/{}/shapes?rows=0", digests["solved-cells"]));
    assert_eq!(of_cells.status, 404, "{}", of_cells.text());
    let exact = std::f64::consts::PI * (81.0 - 3.3 * 3.3) / 2500.0;
    let rows = server
        .get(&format!("/api/artifacts/{}/rows", digests["solved-coverage"]))
        .json();
    let columns = rows["columns"].as_array().unwrap();
    let area = columns.iter().position(|column| column["name"] == "area").unwrap();
    let found = rows["rows"][0][area].as_f64().unwrap();
    assert!((found / exact - 1.0).abs() < 1e-6, "{found} {exact}");
    tab.screen(1440, 900, "light");
    tab.go(&server.url);
    tab.until("document.querySelector('#views a')");
    for (edges, most) in [("fitted", 0.01), ("coverage", 0.02), ("cells", 0.2)] {
        for stage in [edges.to_owned(), format!("solved-{edges}")] {
            let digest = &digests[&stage];
            tab.go(&format!(
                "http://127.0.0.1:{}/#/artifacts/{digest}?tab=rows&row=0",
                server.port
            ));
            tab.until(&format!(
                "document.querySelector('h1')?.textContent.includes('{}') && \
                 document.querySelector('button.card canvas') && document.querySelector('canvas[aria-label=Pattern]')",
                &digest[..12]
            ));
            std::thread::sleep(std::time::Duration::from_millis(400));
            let share = tab.value(&format!("{DRAWN_SHARE}(document.querySelector('button.card canvas'))"));
            let share = share.as_f64().unwrap();
            assert!((share / exact - 1.0).abs() < most, "{stage}: {share} of {exact}");
            if stage.starts_with("solved") {
                photographed(&mut tab, &format!("edges-{edges}"));
            }
        }
    }
    assert_eq!(tab.complaints, Vec::<String>::new());
}
