//! What a person sees of models, designs, accuracy, audits and runs that go on.

use serde_json::json;

use super::super::import;
use super::answers::long_run;
use super::server::Server;
use super::tab::Tab;
use super::{photographed, with_scene};

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
        first.contains("bezier") && first.contains("it has learned from no pattern of this family"),
        "{first}"
    );
    assert!(first.contains("its nearest pattern in training differs in"), "{first}");
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
    assert!(text.as_str().unwrap().contains("% of the optimum"), "{text}");
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
    for (wrong, told) in [
        ("-5", "allowed: 0 to 1000000 V"),
        ("abc", "“abc” is no number"),
        ("", "a number is wanted"),
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
    let child = long_run(&workspace);
    let server = Server::start(&workspace, &["serve", "views.yaml", "long.yaml"]);
    tab.screen(1440, 900, "light");
    tab.go(&server.url);
    tab.click("a[href='#/pipelines/0']");
    tab.until("document.querySelectorAll('svg.dag g').length === 12");
    assert_eq!(tab.value(CROSSED), false);
    photographed(&mut tab, "stages");
    tab.go(&format!("http://127.0.0.1:{}/#/pipelines/1", server.port));
    tab.until("document.querySelector('[data-state=running]')");
    tab.until("document.querySelector('[data-state=running] progress').value > 0");
    assert!(tab.text("#status").contains("short is being built"));
    photographed(&mut tab, "running");
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
