//! The sketchpad and the page of a pipeline as a person finds them: what may be drawn, what is old, what is kept, what
//! is refused where.

use rustix::process::Signal;
use serde_json::{Value, json};

use super::super::common::{Workspace, scene_file};
use super::server::Server;
use super::tab::Tab;
use super::{disc, rows};

/// Waits until the numbers are those of what is drawn.
const SETTLED: &str = "document.querySelector('#results').dataset.settled === 'true'";

#[test]
fn the_pad_keeps_to_the_membrane_and_to_its_own_drawing_and_says_what_is_old() {
    let Some(mut tab) = Tab::open() else { return };
    let workspace = Workspace::new();
    let round = scene_file().replace(
        "cells: 50",
        "cells: 50, frame: { opening: { disc: { centre: [25 mm, 25 mm], radius: 24 mm } } }",
    );
    workspace.write("round.yaml", &round);
    let server = Server::start(&workspace, &["sketch", "round.yaml"]);
    tab.screen(1440, 900, "light");
    tab.go(&server.url);
    tab.until("document.querySelector('#outcome')");
    super::blank(&mut tab, "round", 50);
    // Nothing is drawn on the frame, and all is what is within it.
    tab.click("[data-tool=rectangle]");
    tab.stroke("#pad", &[[0.01, 0.01], [0.07, 0.07]]);
    tab.until(SETTLED);
    assert_eq!(tab.text("#area"), "area 0 % of the membrane, 0 mm²");
    assert!(tab.text("#invitation").starts_with("Draw an electrode here"));
    tab.click("[data-tool=fill]");
    tab.stroke("#pad", &[[0.5, 0.5], [0.5, 0.5]]);
    tab.until("document.querySelector('#area').textContent.startsWith('area 100 % of the membrane')");
    tab.click("button[name=clear]");
    tab.click("[data-tool=rectangle]");
    tab.stroke("#pad", &[[0.2, 0.3], [0.45, 0.7]]);
    tab.until(SETTLED);
    // What prints the same stands beside it.
    tab.until("document.querySelector('#command pre')?.textContent.includes('mine.csv --elements-per-cell 1 --order 1 --point')");
    tab.write("input[name=name]", "half-a-disc");
    tab.until("document.querySelector('#command pre').textContent.includes('half-a-disc.csv')");
    // A table is grey once it is of another pattern.
    tab.click("#compare");
    tab.until("document.querySelectorAll('[aria-label=Methods] tbody tr').length === 6");
    let old = "document.querySelector('[aria-label=Methods]').closest('.old') && document.body.innerText.includes('has changed since')";
    assert_eq!(tab.value(&format!("Boolean({old})")), false);
    let area = tab.text("#area");
    tab.stroke("#pad", &[[0.5, 0.3], [0.55, 0.7]]);
    tab.until(old);
    tab.click("button[name=undo]");
    tab.until(&format!(
        "!({old}) && document.querySelector('#area').textContent === {}",
        json!(area)
    ));
    // Towards a wanted value, no further.
    tab.until(SETTLED);
    let wanted = tab.number("#value") + 0.2;
    tab.write("input[name=wanted]", &format!("{wanted:.4}"));
    tab.until("document.querySelector('#wanted').textContent.endsWith('mm too small')");
    tab.click("#improve");
    tab.until("document.querySelector('#course')?.textContent.startsWith('Reached: ')");
    tab.until("document.querySelector('#wanted').textContent.startsWith('reached')");
    // The numbers of the page can be had on the mesh of the search, and are its own there.
    tab.until("document.querySelector('.best button + button')");
    tab.value("document.querySelector('.best button + button').click()");
    tab.until(SETTLED);
    assert_eq!(tab.value("document.querySelector('select[name=order]').value"), "2");
    // Its error is not known: it has four digits.
    let (told, best) = (tab.text(".best p"), tab.number(".best p"));
    let shown = told.rsplit(' ').nth(1).unwrap();
    assert!(
        shown.len() <= "0.1234".len() && (shown.parse::<f64>().unwrap() - best).abs() < 5e-4,
        "{told}"
    );
    let found = tab.number("#value");
    assert!((found - best).abs() < 1e-5, "{found}, and {best}");
    // The ends of the colours are rounded by the error, as the largest displacement.
    let largest = tab.text("#max-displacement");
    assert_eq!(tab.text(".legend"), format!("displacement: 0 to {largest}"));
    assert_eq!(tab.text("#invitation"), "");
    // Another tab that draws meanwhile changes what a new tab begins with, and not this one, which can still take back.
    tab.until(SETTLED);
    let area = tab.text("#area");
    tab.value("localStorage.setItem('deaflow round', JSON.stringify(Array.from({ length: 50 }, () => new Array(50).fill(0))))");
    tab.reload();
    tab.until(&format!(
        "document.querySelector('#area')?.textContent === {}",
        json!(area)
    ));
    tab.until("!document.querySelector('button[name=undo]').disabled");
    tab.click("button[name=undo]");
    tab.until(&format!(
        "document.querySelector('#area').textContent !== {}",
        json!(area)
    ));
    assert_eq!(tab.complaints, Vec::<String>::new());
    // A server that has ended is said to have, with what is to be done.
    assert_eq!(server.end(Signal::TERM).code, Some(0));
    tab.stroke("#pad", &[[0.5, 0.3], [0.55, 0.7]]);
    tab.until("document.querySelector('#notice').textContent.includes('start it again')");
    tab.until("document.querySelector('#status').textContent.includes('start it again')");
}

#[test]
fn a_file_is_opened_with_a_note_on_how_it_was_read() {
    let Some(mut tab) = Tab::open() else { return };
    let (_workspace, _server) = super::on_the_sketchpad(&mut tab);
    let open = |name: &str, value: u8| {
        let row = |y: usize| {
            let cells = (0..50).map(|x| (u8::from(disc(x, y)) * value).to_string());
            cells.collect::<Vec<_>>().join(",")
        };
        let lines: Vec<String> = (0..50).map(row).collect();
        format!(
            "const given = new DataTransfer(); given.items.add(new File([{}], '{name}')); \
             const input = document.querySelector('[aria-label=\"Open a pattern\"]'); \
             input.files = given.files; input.dispatchEvent(new Event('change'))",
            json!(lines.join("\n"))
        )
    };
    tab.value(&format!("(() => {{ {} }})()", open("mask.csv", 255)));
    tab.until("document.querySelector('#opened').textContent === 'mask.csv: values 0 and 255 read as 0 and 1'");
    tab.until("!document.querySelector('#area').textContent.startsWith('area 0 %')");
    // The note is about the opened file.
    tab.value(&format!("(() => {{ {} }})()", open("cells.csv", 1)));
    tab.until("document.querySelector('#opened').textContent === ''");
}

#[test]
fn a_voltage_between_two_meshes_is_told_by_both() {
    let Some(mut tab) = Tab::open() else { return };
    let (_workspace, server) = super::on_the_sketchpad(&mut tab);
    let body = json!({ "pattern": rows(disc), "elements_per_cell": 1 });
    let found = server.post("/api/sketch", &body).json();
    let number = |value: &Value| value.as_f64().unwrap_or_else(|| panic!("{found}"));
    let stable = number(&found["critical_bracket"][0]).floor() - 1.0;
    assert!(stable > number(&found["critical_voltage"]), "{found}");
    let drawn = rows(disc);
    tab.value(&format!(
        "sessionStorage.setItem('deaflow drawn', {})",
        json!(drawn.to_string())
    ));
    tab.reload();
    tab.until("document.querySelector('#area')?.textContent.startsWith('area 15')");
    // There is a state on the mesh of the page, which finer meshes do not have.
    tab.write("#volts", &stable.to_string());
    tab.until("document.querySelector('#beyond')");
    let told = tab.text("#beyond");
    assert!(
        told.contains("two finer meshes") && told.contains("1 bilinear element along a cell"),
        "{told}"
    );
    let critical = tab.text("#critical-voltage");
    let critical = critical.strip_prefix("limit ").unwrap();
    // Where the mesh of the page contradicts them, its own bracket stands beside.
    let (critical, alone) = critical.split_once(" (this mesh alone: ").unwrap();
    assert!(alone.contains(" to "), "{alone}");
    assert!(told.contains(critical), "{told} and {critical}");
    // Beyond both the same number is told, and that of the mesh as what it is.
    tab.write("#volts", &(stable + 1000.0).to_string());
    let alone = "With this mesh (1 bilinear element along a cell), it is stable up to";
    tab.until(&format!(
        "document.querySelector('#notice').textContent.includes({}) && document.querySelector('#notice').textContent.includes({})",
        json!(critical),
        json!(alone)
    ));
    assert_eq!(tab.complaints, Vec::<String>::new());
}

#[test]
fn values_are_refused_beside_their_fields_and_a_run_tells_how_it_ended() {
    let Some(mut tab) = Tab::open() else { return };
    let workspace = Workspace::small();
    let server = Server::start(&workspace, &["serve", "small.yaml", "--allow-run"]);
    tab.screen(1440, 900, "light");
    tab.go(&server.url);
    tab.click("a[href='#/pipelines/0']");
    tab.until("document.querySelector('#stop-run')?.disabled && !document.querySelector('#run').disabled");
    tab.write("input[name=find]", "voltage");
    for (value, told) in [("4", "has no unit"), ("many", "many")] {
        tab.write("[data-path='scene.drive.voltage']", value);
        tab.until(&format!(
            "document.querySelector(\"[data-wrong='scene.drive.voltage']\").textContent.includes({}) && document.querySelector('#run').disabled",
            json!(told)
        ));
    }
    // What is foreseen stands with the plan, before anything is run.
    tab.write("[data-path='scene.drive.voltage']", "9 kV");
    tab.until("document.querySelector('#warnings').textContent.startsWith('Warning: ') && !document.querySelector('#run').disabled");
    assert_eq!(tab.text("[data-wrong='scene.drive.voltage']"), "");
    tab.write("[data-path='scene.drive.voltage']", "5 kV");
    tab.until("!document.querySelector('#warnings').textContent && !document.querySelector('#run').disabled");
    tab.click("#run");
    tab.until("document.querySelector('#run-end')?.dataset.code === '0'");
    let ended = tab.text("#run-end");
    assert!(
        ended.starts_with("done, after ") && ended.contains("scene.drive.voltage=5 kV"),
        "{ended}"
    );
    tab.click("#run-end a[href^='#/runs/']");
    tab.until("document.querySelector('h1').textContent.startsWith('Run ')");
    assert_eq!(tab.complaints, Vec::<String>::new());
}
