// Findings of an audit: the rows with each fault, drawn, and simulated again beside their labels.

import { frame, json } from "./server.js";
import { attempt, h, number, replace, short } from "./elements.js";
import { card, patternsAt, rowLink, size } from "./pictures.js";
import { drawBar, drawMembrane, drawPattern, magnitudes } from "./membrane.js";
import { Pattern } from "./pattern.js";
import { saveRows } from "./files.js";

/** @param {HTMLElement} place @param {any} found @param {URLSearchParams} query with the open finding and row, if any */
export async function findings(place, found, query) {
  const list = JSON.parse(found.attributes.findings ?? "[]");
  const own = found.ancestry.find((/** @type {any} */ one) => one.digest === found.digest);
  const inputs = own?.inputs ?? [];
  const marked = new Set();
  const counted = h("span", { class: "soft" });
  /** @type {any[]} */ const sets = [];
  for (const digest of inputs) {
    try {
      sets.push(await json(`artifacts/${digest}`));
    } catch {
      // A dataset that is not in the store is not drawn.
    }
  }
  /** The row of the URL. @type {(() => Promise<void>)|null} */ let first = null;
  const section = (/** @type {any} */ finding) => {
    const pictures = h("div", {});
    const one = (/** @type {number} */ row) => {
      const show = () => open(row, pictures, finding.check);
      if (query.get("check") === finding.check && query.get("row") === String(row)) first = show;
      return h("button", { type: "button", onclick: () => void show() }, `row ${row}`);
    };
    const rows = finding.examples.map(one);
    const marks = finding.examples.length ? h("button", { type: "button", onclick: () => {
      finding.examples.forEach((/** @type {number} */ row) => marked.add(row));
      counted.textContent = `${marked.size} rows marked`;
    } }, "Mark these rows") : null;
    return h("section", { class: "panel", "data-check": finding.check }, h("h2", {}, h("span", { class: finding.severity }, finding.severity), ` ${finding.check}: ${finding.count}`), h("p", {}, finding.message), h("div", { class: "tools" }, rows, marks), pictures);
  };
  /** @param {number} row @param {HTMLElement} pictures @param {string} check */
  const open = async (row, pictures, check) => {
    const words = new URLSearchParams({ tab: "findings", check, row: String(row) });
    history.replaceState(null, "", `#/artifacts/${found.digest}?${words}`);
    await attempt(pictures, async () => {
      replace(pictures, h("p", { class: "soft" }, "Reading …"));
      await sample(sets, row, pictures, { check, audit: found.digest });
      if (TWINS.includes(check)) await partners(sets, row, pictures);
    });
  };
  const waiting = h("div", {});
  const blocks = list.some((/** @type {any} */ one) => one.severity === "error");
  replace(
    place,
    h("p", {}, "Dataset ", inputs.map((/** @type {string} */ input) => [short(input), " "]), "– ", blocks ? "The audit found errors: stages that need it cannot be built." : list.length ? "The findings block no stage." : "No findings."),
    lookedAt(found),
    waiting,
    list.map(section),
    list.length ? h("div", { class: "tools" }, h("button", { type: "button", onclick: () => saveRows(marked, found.attributes.dataset ?? inputs[0] ?? "", "findings") }, "Save the list of marked rows"), counted) : null,
  );
  const shown = first ? /** @type {() => Promise<void>} */ (first)() : null;
  await attempt(waiting, () => waits(waiting, found.digest, blocks));
  await shown;
}

/** Describes what was checked, as the command does. @param {any} found */
function lookedAt(found) {
  const summary = JSON.parse(found.attributes.summary ?? "{}");
  const finer = summary.resimulated ?? {};
  const parts = [
    summary.samples === undefined ? "" : `${summary.samples} samples`,
    summary.solved_again === undefined ? "" : `${summary.solved_again} solved again on their own mesh`,
    finer.samples ? `${finer.samples} on a finer mesh${(finer.largest_error ?? null) === null ? "" : `, with a largest error of ${number(finer.largest_error, 3)} mm${(finer.allowed ?? null) === null ? " (no limit is declared)" : ` (allowed: ${number(finer.allowed, 3)} mm)`}`}` : "",
    finer.samples ? `${finer.faults} of these are wrong: at 95 % confidence, at most ${number(100 * finer.excluded_above, 3)} % of all labels` : "",
  ].filter(Boolean);
  return parts.length ? h("p", { class: "soft", id: "looked-at" }, `Checked: ${parts.join("; ")}.`) : null;
}

/** Checks whose rows have a partner: the same pattern, or an image of it. */
const TWINS = ["leak", "duplicate", "symmetry"];

/** Pipelines that are searched for stages that need an audit. */
const MOST = 50;

/** Lists the stages that need an audit, and those after them. @param {HTMLElement} place @param {string} digest @param {boolean} blocks */
async function waits(place, digest, blocks) {
  const { pipelines } = await json("pipelines");
  /** @type {any[]} */ const texts = [];
  for (const one of pipelines.slice(0, MOST)) {
    const pipeline = await json(`pipelines/${one.id}`);
    if (pipeline.problem) continue;
    for (const audit of pipeline.stages.filter((/** @type {any} */ stage) => stage.digest === digest)) {
      const needs = (/** @type {string} */ name) => [...pipeline.needs[name].needs, ...pipeline.needs[name].gates];
      /** @type {string[]} */ const first = [];
      /** @type {string[]} */ const later = [];
      // Stages are sorted: each one is after all that it needs.
      for (const stage of pipeline.stages) {
        if (needs(stage.name).includes(audit.name)) first.push(stage.name);
        else if (needs(stage.name).some((name) => first.includes(name) || later.includes(name))) later.push(stage.name);
      }
      const names = [first.join(", "), later.length ? `and after them ${later.join(", ")}` : ""].filter(Boolean).join("; ");
      const link = h("a", { href: `#/pipelines/${one.id}` }, pipeline.pipeline);
      texts.push(h("p", { "data-blocks": [...first, ...later].join(" ") }, "In ", link, !first.length ? `, no stage needs ${audit.name}.` : blocks ? `, ${audit.name} blocks: ${names}.` : `, these stages need ${audit.name} and may be built: ${names}.`));
    }
  }
  replace(place, texts);
}

/** The rows with the same pattern, or an image of it, and their parts of the set. @param {any[]} sets @param {number} row @param {HTMLElement} place */
async function partners(sets, row, place) {
  const set = holds(sets, row);
  if (!set) return;
  const { neighbours } = await json(`artifacts/${set.digest}/neighbours?row=${row}&limit=12`);
  const twins = neighbours.filter((/** @type {any} */ one) => one.distance === 0);
  const rows = [row, ...twins.map((/** @type {any} */ one) => one.row)];
  const answer = await json(`artifacts/${set.digest}/rows?limit=0`);
  const at = answer.columns.findIndex((/** @type {any} */ column) => column.name === "split");
  const splits = await Promise.all(rows.map(async (one) => (at < 0 ? "" : (await json(`artifacts/${set.digest}/rows?limit=1&offset=${one}`)).rows[0]?.[at] ?? "")));
  const patterns = await patternsAt(set, rows);
  const cards = rows.map((one, k) => card(patterns[k], rowLink(set.digest, one), h("div", {}, k ? `row ${one}` : `row ${one}, this one`), splits[k] ? h("div", { class: splits[k] === splits[0] ? "soft" : "error" }, splits[k]) : null));
  place.append(h("h3", {}, "Same pattern, or an image of it"), twins.length ? h("div", { class: "cards", "data-partners": twins.map((/** @type {any} */ one) => one.row).join(" ") }, cards) : h("p", { class: "soft" }, "No other row has this pattern."));
}

/** The set that has a row with a pattern. @param {any[]} sets @param {number} row */
function holds(sets, row) {
  return sets.find((set) => set.datasets.some((/** @type {any} */ one) => one.axes.length === 3 && one.axes[1] === "y" && one.axes[2] === "x" && row < one.shape[0]));
}

/** Checks on a finer mesh: the labels are correct on their own mesh, which is too coarse. */
const FINER = ["accuracy", "stability"];

/** A row with its label, and as the audit has simulated it again. @param {any[]} sets @param {number} row @param {HTMLElement} place @param {{check: string, audit: string}} of */
async function sample(sets, row, place, { check, audit }) {
  const set = holds(sets, row);
  if (!set) throw new Error(`row ${row} cannot be shown: the dataset of the audit is not in the store`);
  const { document: found, arrays } = await frame(`artifacts/${set.digest}/again?row=${row}&audit=${audit}`);
  const { shape, data } = arrays.pattern;
  const pattern = new Pattern(shape[1], shape[0], Uint8Array.from(data));
  const field = (/** @type {string} */ name) => /** @type {Float32Array|null} */ (arrays[name]?.data ?? null);
  // If the mesh of the label is unknown, there is only the finer one.
  const finer = FINER.includes(check) || found.again.mesh === null;
  const [which, words] = finer ? ["finer", "Simulated on a finer mesh"] : ["again", "Simulated again on the same mesh"];
  const label = field("label");
  const simulated = field(which);
  const canvases = ["Pattern", "Label", words, "Difference"].map((name) => ({ name, canvas: h("canvas", { role: "img", "aria-label": name }), bar: h("canvas", { class: "bar", "aria-hidden": "true" }), note: h("figcaption", { class: "small soft" }) }));
  const error = (/** @type {any} */ one) => (one.max_error_mm === null ? one.outcome ?? "not simulated" : `the label differs by up to ${number(one.max_error_mm, 4)} mm`);
  replace(
    place,
    h("h3", {}, h("a", { href: rowLink(set.digest, row) }, `Row ${row}`), " of ", short(set.digest)),
    h("p", { class: "small", "data-finer-error": found.finer.max_error_mm === null ? null : String(found.finer.max_error_mm) },
      found.again.mesh ? `On the mesh of the label (${found.again.mesh}): ${error(found.again)}. ` : "The mesh of the label is unknown. ",
      found.finer.mesh ? `On a finer mesh (${found.finer.mesh}): ${error(found.finer)}.` : "There is no finer mesh."),
    h("div", { class: "pair" }, canvases.map(({ canvas, bar, note }, at) => h("figure", {}, canvas, at ? bar : null, note))),
  );
  const extent = size(set, pattern);
  const difference = label && simulated ? Float32Array.from(label, (value, at) => value - simulated[at]) : null;
  const largest = [label, simulated].flatMap((values) => (values ? [Math.max(...magnitudes(values, pattern.columns, pattern.rows))] : []));
  const one = (/** @type {number} */ at, /** @type {Float32Array|null} */ values, /** @type {string} */ without) => {
    const { name, canvas, bar, note } = canvases[at];
    const of = values ? magnitudes(values, pattern.columns, pattern.rows) : null;
    // Label and simulation share a colour scale; the difference has its own, on the undeformed membrane.
    const high = of ? Math.max(...(at === 3 ? of : largest)) : 0;
    drawMembrane(canvas, pattern, at === 3 && values ? new Float32Array(values.length) : values, { size: extent, scale: at === 3 ? 1 : 2, values: of, low: 0, high });
    bar.hidden = !of;
    if (of) drawBar(bar, false);
    note.textContent = of ? `${name}: largest ${number(Math.max(...of))} mm` : `${name}: ${without}`;
  };
  drawPattern(canvases[0].canvas, pattern);
  canvases[0].note.textContent = "Pattern";
  one(1, label, "no field");
  one(2, simulated, found[which].outcome ?? "not simulated");
  one(3, difference, "nothing to compare");
}
