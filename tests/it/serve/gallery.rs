//! The sketchpad as it opens, its gallery, the voltage that plays, what lies beyond the limit, and links to drawings.

use serde_json::{Value, json};

use super::super::common::{Workspace, scene_of_20_cells};
use super::server::Server;
use super::tab::Tab;
use super::{disc, on_the_sketchpad, photographed, rows, rows_of, with_scene};

/// Waits until the numbers are those of what is drawn.
const SETTLED: &str = "document.querySelector('#results')?.dataset.settled === 'true'";

#[test]
fn a_sweep_ends_at_the_limit_and_has_the_solutions_of_single_requests() {
    let workspace = with_scene();
    let server = Server::start(&workspace, &["sketch", "scene.yaml"]);
    let mut body = json!({ "pattern": rows(disc), "elements_per_cell": 1, "point": [35, 20], "direction": 90 });
    let reply = server.post("/api/sketch/sweep", &body);
    assert_eq!(reply.status, 200, "{}", reply.text());
    let (document, _) = reply.frame();
    let points = document["points"].as_array().unwrap();
    let of = |at: usize, name: &str| points[at][name].as_f64().unwrap();
    let last = points.len() - 1;
    assert!(last >= 20, "{document}");
    assert!(
        (1..=last).all(|at| of(at, "voltage") > of(at - 1, "voltage")),
        "{document}"
    );
    let alone = server.post("/api/sketch", &body).json();
    let limit = alone["critical_voltage"].as_f64().unwrap();
    let stable = alone["critical_bracket"][0].as_f64().unwrap();
    assert!(
        (of(last, "voltage") - limit.min(stable)).abs() < 1e-9,
        "{document} and {alone}"
    );
    let moved = reply.numbers("displacement");
    let each = 51 * 51 * 2;
    assert_eq!(moved.len(), points.len() * each);
    for at in [1, last / 2, last] {
        body["voltage"] = json!(of(at, "voltage"));
        let single = server.post("/api/sketch", &body).json();
        for name in ["max_displacement", "value"] {
            let (in_sweep, alone) = (of(at, name), single[name].as_f64().unwrap());
            assert!(
                (in_sweep - alone).abs() < 1e-6,
                "{name} of {at}: {in_sweep} and {alone}"
            );
        }
        let field = moved[at * each..][..each].chunks_exact(2);
        let largest = field
            .map(|u| f64::from(u[0]).hypot(f64::from(u[1])))
            .fold(0.0, f64::max);
        assert!((largest - of(at, "max_displacement")).abs() < 1e-5, "{at}");
    }
    // The breakdown field is that of the scene, or of the usual elastomer.
    assert_eq!(document["breakdown_assumed"], true);
    assert!(
        (1..=last).all(|at| of(at, "breakdown_ratio") > of(at - 1, "breakdown_ratio")),
        "{document}"
    );
    body["effects"] = json!(["dielectric_breakdown"]);
    let single = server.post("/api/sketch", &body).json();
    let ratio = single["breakdown_ratio"].as_f64().unwrap();
    assert!(
        (ratio / of(last, "breakdown_ratio") - 1.0).abs() < 1e-6,
        "{ratio} {document}"
    );
    body.as_object_mut().unwrap().remove("effects");
    // Without a limit, it ends at the requested voltage.
    let estimate = json!({ "pattern": rows(disc), "elements_per_cell": 1, "method": "linear", "voltage": 4000 });
    let (document, _) = server.post("/api/sketch/sweep", &estimate).frame();
    assert_eq!(document["points"][last]["voltage"], 4000.0, "{document}");
    assert!(document["critical_voltage"].is_null());
    body["voltage"] = json!(0);
    body["method"] = json!("linear");
    assert_eq!(server.post("/api/sketch/sweep", &body).status, 400);
}

#[test]
fn the_sketchpad_opens_with_a_pattern_that_moves_and_has_a_gallery() {
    let Some(mut tab) = Tab::open() else { return };
    let workspace = with_scene();
    let server = Server::start(&workspace, &["sketch", "scene.yaml"]);
    tab.screen(1440, 900, "light");
    tab.go(&server.url);
    tab.until(SETTLED);
    assert_eq!(tab.value("document.querySelector('#volts').value"), "5250 V");
    assert_eq!(tab.text("#area"), "area 50 %, 1250 mm²");
    // The sweep runs once, by itself, and ends at the voltage of the drawing.
    tab.until("document.querySelector('#sweep svg') && document.querySelector('#play').textContent.includes('Play')");
    tab.until("document.querySelector('#volts').value === '5250 V'");
    assert_eq!(tab.value("document.querySelectorAll('[data-gallery]').length"), 8);
    photographed(&mut tab, "gallery");
    // Why an effect is not possible: keys are code.
    let refused = tab.value("[...document.querySelectorAll('[data-refused]')].map((one) => [one.textContent, one.querySelectorAll('code').length])");
    let refused = refused.as_array().unwrap();
    assert!(
        !refused.is_empty() && refused.iter().any(|one| one[1].as_u64().unwrap() > 0),
        "{refused:?}"
    );
    assert!(
        refused.iter().all(|one| !one[0].as_str().unwrap().contains('`')),
        "{refused:?}"
    );
    // It plays: the voltage, the membrane and the dot move.
    tab.value("window.seen = new Set(); window.watch = setInterval(() => window.seen.add(`${document.querySelector('#volts').value} ${document.querySelector('#sweep .dot').getAttribute('cx')}`), 30)");
    tab.click("#play");
    // The numbers are those of the sweep, with the electric field.
    tab.until(
        "Number(document.querySelector('#swept')?.dataset.value) > 3000 && \
         Number(document.querySelector('#breakdown')?.dataset.value) > 0",
    );
    tab.until("document.querySelector('.legend').textContent.startsWith('pull-in: no stable state above the limit')");
    tab.until("document.querySelector('#play').textContent.includes('Play')");
    tab.value("clearInterval(window.watch)");
    tab.until(SETTLED);
    assert_eq!(tab.value("document.querySelector('#swept')"), Value::Null);
    assert_eq!(tab.value("document.querySelector('#voltage').max"), "10000");
    let fits = "[...document.querySelectorAll('fieldset select')].every((one) => one.getBoundingClientRect().right <= \
                one.closest('fieldset').getBoundingClientRect().right)";
    assert_eq!(tab.value(fits), true);
    assert!(tab.value("window.seen.size").as_u64().unwrap() > 5);
    // Whatever is drawn stops it, and the curve is grey.
    tab.click("[data-gallery=disc]");
    tab.until("document.querySelector('#sweep').classList.contains('old')");
    tab.click("button[name=undo]");
    tab.until("document.querySelector('#area').textContent.startsWith('area 50 %')");
    // Devices have scenes of their own, with their frames, groups and states.
    tab.click("[data-gallery=lens]");
    tab.until("document.querySelector('select[name=scene]')?.value === 'lens (example)'");
    tab.until(SETTLED);
    assert!(tab.number("#max-displacement") > 0.1);
    tab.click("[data-gallery=push-pull]");
    tab.until("document.querySelector('select[name=state]')");
    tab.until(SETTLED);
    assert!(tab.number("#max-displacement") > 0.1);
    // A pattern of one group has the group that is driven in the state.
    tab.value(
        "(() => { const state = document.querySelector('select[name=state]'); state.value = 'pull'; \
         state.dispatchEvent(new Event('change')); })()",
    );
    tab.click("[data-gallery=disc]");
    tab.until(SETTLED);
    assert!(tab.number("#max-displacement") > 0.1);
    // The command names the pipeline that the page has, and a voltage without a unit is in V.
    tab.until("document.querySelector('#command')?.textContent.includes('deaflow solve mine.yaml mine.csv')");
    tab.write("#volts", "6");
    tab.until("document.querySelector('#voltage-unit').textContent === 'no unit: read as 6 V'");
    tab.write("#volts", "5 kV");
    tab.until("document.querySelector('#voltage-unit').textContent === ''");
    tab.click("#own-scene");
    tab.until("!document.querySelector('#own-scene')");
    assert_eq!(tab.complaints, Vec::<String>::new());
}

#[test]
fn a_drawing_of_the_command_line_says_what_its_cells_are() {
    let Some(mut tab) = Tab::open() else { return };
    let workspace = with_scene();
    let disc = "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"50mm\" height=\"50mm\" viewBox=\"0 0 50 50\">\
                <circle cx=\"25\" cy=\"25\" r=\"9.3\"/></svg>";
    workspace.write("disc.svg", disc);
    let server = Server::start(&workspace, &["sketch", "scene.yaml", "disc.svg"]);
    tab.go(&server.url);
    tab.until(SETTLED);
    let told = tab.text("[data-note=pattern]");
    assert!(
        told.starts_with("disc.svg: read by the centres of cells: 271.7 mm²"),
        "{told}"
    );
}

#[test]
fn curves_that_elements_follow_are_drawn_as_such() {
    let workspace = with_scene();
    let scene = std::fs::read_to_string(workspace.path("scene.yaml")).unwrap();
    let round = "cells: 50, frame: { opening: { disc: { centre: [25 mm, 25 mm], radius: 20 mm } }, curves: fitted }";
    assert!(scene.contains("cells: 50"), "{scene}");
    workspace.write("round.yaml", &scene.replacen("cells: 50", round, 1));
    let borders = |scene: &str| {
        let server = Server::start(&workspace, &["sketch", scene]);
        server.get("/api/scenes").json()["scenes"][0]["borders"].clone()
    };
    assert_eq!(borders("scene.yaml"), Value::Null);
    let round = borders("round.yaml");
    let opening = round["opening"][0].as_array().unwrap();
    let radius = |at: &Value| (at[0].as_f64().unwrap() - 0.5).hypot(at[1].as_f64().unwrap() - 0.5);
    assert!(
        opening.len() > 20 && opening.iter().all(|at| (radius(at) - 0.4).abs() < 1e-6),
        "{round}"
    );
    assert_eq!(round["bodies"], json!([]));
}

/// The voltage at which the red part of the slider begins.
const ZONE: &str = "(() => { const [zone, range] = ['#unstable-zone', '#voltage'].map((one) => document.querySelector(one).getBoundingClientRect()); return (zone.left - range.left - 8) / (range.width - 16) * Number(document.querySelector('#voltage').max) })()";

#[test]
fn beyond_the_limit_the_last_stable_state_stays_and_a_button_goes_back() {
    let Some(mut tab) = Tab::open() else { return };
    let (_workspace, _server) = on_the_sketchpad(&mut tab);
    tab.click("[data-tool=rectangle]");
    tab.stroke("#pad", &[[0.3, 0.3], [0.6, 0.6]]);
    tab.until(SETTLED);
    tab.until("!document.querySelector('#unstable-zone').hidden && document.querySelector('#to-limit').hidden");
    let limit = tab.text("#critical-voltage");
    // The red part of the slider begins at the limit.
    let begins = tab.value(ZONE).as_f64().unwrap();
    let told: f64 = limit.split(' ').nth(1).unwrap().parse().unwrap();
    assert!((begins - told).abs() < 0.02 * told, "{begins} and {limit}");
    tab.write("#volts", "9 kV");
    // The last one along the voltage, which is not the one that was shown before.
    tab.until("document.querySelector('.legend').textContent.includes('this is the last stable one, at ')");
    let legend = tab.text(".legend");
    let last = legend
        .split("the last stable one, at ")
        .nth(1)
        .and_then(|rest| rest.split(' ').next());
    let last: f64 = last.unwrap().parse().unwrap();
    assert!(
        (last - told).abs() < 0.1 * told && last > 5300.0,
        "{legend} and {limit}"
    );
    assert!(legend.contains("displacement: 0 to "), "{legend}");
    // Another colouring is that of the same state.
    tab.value("(() => { const e = document.querySelector('select[name=colouring]'); e.value = 'stress'; e.dispatchEvent(new Event('change')) })()");
    tab.until(&format!("document.querySelector('.legend').textContent.includes('the last stable one, at {last} V: larger principal stress')"));
    tab.value("(() => { const e = document.querySelector('select[name=colouring]'); e.value = 'displacement'; e.dispatchEvent(new Event('change')) })()");
    tab.until("!document.querySelector('#to-limit').hidden");
    assert!(tab.text("#to-limit").starts_with("Go to ") && tab.text("#to-limit").ends_with(" kV"));
    photographed(&mut tab, "beyond");
    // Of another drawing nothing is known yet.
    tab.stroke("#pad", &[[0.1, 0.3], [0.2, 0.6]]);
    tab.until(&format!("document.querySelector('.legend').textContent.includes('this is the last stable one') && !document.querySelector('.legend').textContent.includes('at {last} V')"));
    tab.until(SETTLED);
    tab.value("document.querySelector('[data-gallery=ring]').click()");
    assert_eq!(tab.text("#critical-voltage"), "computing the critical voltage …");
    let hidden =
        tab.value("document.querySelector('#unstable-zone').hidden && document.querySelector('#to-limit').hidden");
    assert_eq!(hidden, true);
    tab.until(SETTLED);
    tab.click("#to-limit");
    tab.until("document.querySelector('#outcome').textContent === 'converged'");
    tab.until("document.querySelector('#to-limit').hidden");
    assert_eq!(tab.complaints, Vec::<String>::new());
}

#[test]
fn the_lowest_limit_is_named_first_and_bounds_the_slider() {
    let workspace = Workspace::new();
    let scene = |prestretch: &str| {
        let scene = scene_of_20_cells().replace("prestretch: 3.0", prestretch);
        scene + "properties: { dielectric_breakdown: { law: constant, field: 80 MV/m } }\n"
    };
    workspace.write("scene.yaml", &scene("prestretch: 3.0"));
    let server = Server::start(&workspace, &["sketch", "scene.yaml"]);
    let half = rows_of(20, |x, _| x < 10);
    let solved = |more: &Value| {
        let mut body = json!({ "pattern": half, "elements_per_cell": 1 });
        body.as_object_mut().unwrap().extend(more.as_object().unwrap().clone());
        server.post("/api/sketch", &body).json()
    };
    let found = solved(&json!({}));
    let breakdown = found["breakdown_voltage"].as_f64().unwrap();
    assert!(breakdown < found["critical_voltage"].as_f64().unwrap(), "{found}");
    assert_eq!(found["wrinkling_voltage"], Value::Null);
    // The field at that voltage is the breakdown field.
    let there = solved(&json!({ "voltage": breakdown, "effects": ["dielectric_breakdown"] }));
    let ratio = there["breakdown_ratio"].as_f64().unwrap();
    assert!((ratio - 1.0).abs() < 2e-3, "{there}");
    // With little prestretch it wrinkles before. If that is simulated, it is no limit.
    let taut = scene("prestretch: 1.2");
    let found = solved(&json!({ "scene": taut }));
    let wrinkling = found["wrinkling_voltage"].as_f64().unwrap();
    assert!(wrinkling < found["critical_voltage"].as_f64().unwrap(), "{found}");
    let cells = |voltage: f64| {
        let body = json!({ "scene": taut, "pattern": half, "elements_per_cell": 1, "voltage": voltage, "quick": true, "fields": ["tension"] });
        server.post("/api/sketch", &body).body
    };
    let wrinkled = |voltage: f64| cells(voltage).iter().rev().take(400).filter(|code| **code == 1).count();
    assert!(
        wrinkled(0.95 * wrinkling) == 0 && wrinkled(1.02 * wrinkling) > 0,
        "{wrinkling}"
    );
    let simulated = solved(&json!({ "scene": taut, "effects": ["wrinkling"] }));
    assert_eq!(simulated["wrinkling_voltage"], Value::Null);

    let Some(mut tab) = Tab::open() else { return };
    tab.screen(1440, 900, "light");
    tab.go(&server.url);
    tab.until(SETTLED);
    tab.until("document.querySelector('#sweep .dot') && document.querySelector('#play').textContent.includes('Play')");
    let told = tab.text("#critical-voltage");
    let limits = format!("limit {breakdown:.0} V (breakdown field); stability is lost at 7");
    assert!(told.starts_with(&limits), "{told}");
    let begins = tab.value(ZONE).as_f64().unwrap();
    assert!((begins - breakdown).abs() < 0.01 * breakdown, "{begins}");
    // Above it, the page says so, and the button goes below it.
    tab.write("#volts", "7000");
    tab.until("document.querySelector('#passed')?.textContent.includes('above the breakdown field')");
    tab.until("!document.querySelector('#to-limit').hidden");
    tab.click("#to-limit");
    tab.until("document.querySelector('#to-limit').hidden && !document.querySelector('#passed')");
    // The curve of another drawing is grey and has no place for this one; played anew it is neither.
    let curve = "[document.querySelector('#sweep').classList.contains('old'), document.querySelector('#sweep .dot').getAttribute('visibility')]";
    assert_eq!(tab.value(curve), json!([false, "visible"]));
    tab.click("[data-gallery=ring]");
    assert_eq!(tab.value(curve), json!([true, "hidden"]));
    tab.click("#play");
    tab.until("document.querySelector('.legend').textContent.includes('; colours 0 to ')");
    tab.until("document.querySelector('#play').textContent.includes('Play')");
    assert_eq!(tab.value(curve), json!([false, "visible"]));
    // The states of tension are three colours with names, and the picture that is saved has what is on the screen.
    tab.value("(() => { const e = document.querySelector('select[name=colouring]'); e.value = 'tension'; e.dispatchEvent(new Event('change')) })()");
    tab.until("document.querySelector('.legend').textContent === 'tension: tautwrinkledslack'");
    let swatches = "new Set([...document.querySelectorAll('.legend .swatch')].map((one) => getComputedStyle(one).backgroundColor)).size";
    assert_eq!(tab.value(swatches), 3);
    assert_eq!(tab.value("document.querySelector('canvas.bar').hidden"), true);
    tab.value("(() => { const made = URL.createObjectURL; URL.createObjectURL = (blob) => { window.saved = blob; return made(blob) } })()");
    tab.click("#save-picture");
    tab.until("window.saved");
    let size = tab.value("createImageBitmap(window.saved).then((image) => [image.width, image.height])");
    assert_eq!(size[0], 1272);
    assert!(size[1].as_f64().unwrap() > 1272.0, "{size}");
    // A shape that is being drawn has its size beside its area.
    tab.click("[data-tool=rectangle]");
    tab.value("for (const [type, x, y] of [['pointerdown', 0.21, 0.21], ['pointermove', 0.29, 0.44]]) { const pad = document.querySelector('#pad'); const box = pad.getBoundingClientRect(); pad.setPointerCapture = () => {}; pad.dispatchEvent(new PointerEvent(type, { clientX: box.left + x * box.width, clientY: box.top + y * box.height, pointerId: 1 })) }");
    tab.until("document.querySelector('#area').textContent.endsWith('; rectangle 5 mm × 12.5 mm')");
    tab.value("document.querySelector('#pad').dispatchEvent(new PointerEvent('pointerup', { pointerId: 1 }))");
    tab.until("document.querySelector('#area').textContent.endsWith(' mm²')");
    assert_eq!(tab.complaints, Vec::<String>::new());
}

#[test]
fn states_beyond_the_limit_of_finer_meshes_are_said_to_be_of_the_mesh() {
    let Some(mut tab) = Tab::open() else { return };
    let workspace = with_scene();
    let server = Server::start(&workspace, &["sketch", "scene.yaml"]);
    tab.screen(1440, 900, "light");
    tab.go(&server.url);
    tab.until(SETTLED);
    tab.click("[data-gallery=lens]");
    tab.until("document.querySelector('#own-scene')");
    tab.until(SETTLED);
    tab.until("document.querySelector('#critical-voltage').textContent.startsWith('limit 7')");
    tab.until("document.querySelector('#play').textContent.includes('Play')");
    tab.write("#volts", "8 kV");
    tab.until("document.querySelector('#outcome')?.textContent === 'converged, on this mesh only'");
    tab.write("#volts", "10 kV");
    // The state that is drawn is the one at the stated limit.
    tab.until("document.querySelector('.legend').textContent.includes('this is the last stable one, at 7')");
    let limit = tab.text("#critical-voltage");
    let limit: f64 = limit.split(' ').nth(1).unwrap().parse().unwrap();
    let legend = tab.text(".legend");
    let drawn = legend.split("the last stable one, at ").nth(1).unwrap();
    let drawn: f64 = drawn.split(' ').next().unwrap().parse().unwrap();
    assert!((drawn - limit).abs() < 1.0, "{legend} and {limit}");
    assert_eq!(tab.complaints, Vec::<String>::new());
}

/// How many pixels of the drawing have the colour of the deformed outline.
const OUTLINE: &str = "(() => { const pad = document.querySelector('#pad'); const { data } = pad.getContext('2d').getImageData(0, 0, pad.width, pad.height); let count = 0; for (let at = 0; at < data.length; at += 4) count += Math.hypot(data[at] - 0x7b, data[at + 1] - 0x1f, data[at + 2] - 0xa2) < 60; return count })()";

#[test]
fn the_point_is_dragged_and_a_narrow_screen_draws_the_deformed_outline_over_the_drawing() {
    let Some(mut tab) = Tab::open() else { return };
    let (_workspace, _server) = on_the_sketchpad(&mut tab);
    tab.click("[data-gallery=half]");
    tab.until(SETTLED);
    assert_eq!(tab.value(OUTLINE), 0);
    let field = |tab: &mut Tab, label: &str| -> f64 {
        let found = tab.value(&format!(
            "document.querySelector('input[aria-label=\"{label}\"]').value"
        ));
        found.as_str().unwrap().parse().unwrap()
    };
    // At rest, a point is where it is drawn: margins of 4 % around 50 mm.
    tab.write("#volts", "0");
    tab.until("document.querySelector('#max-displacement')?.dataset.value === '0'");
    tab.stroke("#membrane", &[[0.5, 0.5], [0.4, 0.4], [0.316, 0.316]]);
    assert!((field(&mut tab, "x, mm") - 15.0).abs() < 0.3 && (field(&mut tab, "y, mm") - 35.0).abs() < 0.3);
    // The tip of the arrow turns it.
    tab.stroke("#membrane", &[[0.316 + 0.12, 0.316], [0.4, 0.25], [0.316, 0.15]]);
    assert!((field(&mut tab, "direction, °") - 90.0).abs() <= 2.0);
    tab.write("#volts", "5250");
    tab.until(SETTLED);
    tab.screen(390, 900, "light");
    tab.until(&format!("{OUTLINE} > 100"));
    assert_eq!(tab.complaints, Vec::<String>::new());
}

#[test]
fn a_link_holds_the_drawing() {
    let Some(mut tab) = Tab::open() else { return };
    let (_workspace, server) = on_the_sketchpad(&mut tab);
    tab.stroke("#pad", &[[0.2, 0.3], [0.4, 0.5], [0.5, 0.3], [0.6, 0.7]]);
    tab.write("#volts", "4321.5 V");
    tab.write("input[aria-label='x, mm']", "12.25");
    tab.write("input[aria-label='direction, °']", "-30");
    tab.until(SETTLED);
    let numbers = "['#max-displacement', '#value'].map((one) => document.querySelector(one).dataset.value)";
    let drawn = tab.value("JSON.parse(sessionStorage.getItem('deaflow scene'))");
    let before = tab.value(numbers);
    tab.value("navigator.clipboard.writeText = async (text) => { window.copied = text }");
    assert!(
        tab.text("[aria-label=Draw]")
            .contains("It opens on this machine, while this server runs.")
    );
    tab.click("#copy-link");
    let link = tab.value("window.copied").as_str().unwrap().to_owned();
    assert!(link.len() <= 2048, "{} bytes", link.len());
    tab.value("sessionStorage.clear(); localStorage.clear()");
    tab.go("about:blank");
    tab.go(&link);
    tab.until(SETTLED);
    assert_eq!(tab.value(numbers), before);
    assert_eq!(tab.value("document.querySelector('#volts').value"), "4321.5 V");
    assert_eq!(tab.value("location.hash"), "#/sketch");
    // The next stroke stores the drawing as it was, with the stroke.
    tab.stroke("#pad", &[[0.9, 0.9], [0.9, 0.9]]);
    tab.until("!document.querySelector('button[name=undo]').disabled");
    tab.click("button[name=undo]");
    assert_eq!(tab.value("JSON.parse(sessionStorage.getItem('deaflow scene'))"), drawn);
    // Beyond the limit the last stable state is drawn, with a bar as high as that of others.
    let height = tab.value("document.querySelector('canvas.bar').clientHeight");
    tab.go("about:blank");
    tab.go(&link.replace("volts=4321.5", "volts=9000"));
    tab.until("document.querySelector('.legend').textContent.includes('this is the last stable one, at ')");
    assert_eq!(tab.value("document.querySelector('canvas.bar').clientHeight"), height);
    // A link to a scene that is not there says so, and so does one that was cut off.
    let address = format!("http://127.0.0.1:{}/", server.port);
    for (changed, told) in [
        (link.replace("scene=scene", "scene=other"), "needs the scene “other”"),
        (link[..link.len() - 40].to_owned(), "the link is incomplete"),
    ] {
        assert!(changed.starts_with(&address), "{changed}");
        tab.go("about:blank");
        tab.go(&changed);
        tab.until(&format!(
            "document.querySelector('[role=alert]')?.textContent.includes({})",
            json!(told)
        ));
        tab.until("document.querySelector('#outcome')");
    }
    assert_eq!(tab.complaints, Vec::<String>::new());
}
