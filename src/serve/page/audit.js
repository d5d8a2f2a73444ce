// Findings of an audit: what is wrong in which rows, with the rows drawn, and simulated again beside their labels.

import { frame, json } from "./server.js";
import { h, number, problem, replace, short } from "./elements.js";
import { card, patternsAt, rowLink, size } from "./pictures.js";
import { drawMembrane, drawPattern, magnitudes } from "./membrane.js";
import { Pattern } from "./pattern.js";
import { save } from "./files.js";

/** @param {HTMLElement} place @param {any} found */
export async function findings(place, found) {
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
      // What is not in the store is not drawn.
    }
  }
  const section = (/** @type {any} */ finding) => {
    const pictures = h("div", {});
    const rows = finding.examples.map((/** @type {number} */ row) => h("button", { type: "button", onclick: () => void open(row, pictures, finding.check) }, `row ${row}`));
    const marks = finding.examples.length ? h("button", { type: "button", onclick: () => {
      finding.examples.forEach((/** @type {number} */ row) => marked.add(row));
      counted.textContent = `${marked.size} rows marked`;
    } }, "Mark these rows") : null;
    return h("section", { class: "panel", "data-check": finding.check }, h("h2", {}, h("span", { class: finding.severity }, finding.severity), ` ${finding.check}: ${finding.count}`), h("p", {}, finding.message), h("div", { class: "tools" }, rows, marks), pictures);
  };
  /** @param {number} row @param {HTMLElement} pictures @param {string} check */
  const open = async (row, pictures, check) => {
    try {
      replace(pictures, h("p", { class: "soft" }, "Reading …"));
      await sample(sets, row, pictures);
      if (TWINS.includes(check)) await partners(sets, row, pictures);
    } catch (error) {
      replace(pictures, problem(error));
    }
  };
  const waiting = h("div", {});
  const blocks = list.some((/** @type {any} */ one) => one.severity === "error");
  replace(
    place,
    h("p", {}, "Dataset ", inputs.map((/** @type {string} */ input) => [short(input), " "]), "– ", blocks ? "Stages that need this audit are not built while it finds errors." : list.length ? "No stage is kept from being built." : "Nothing was found."),
    waiting,
    list.map(section),
    list.length ? h("div", { class: "tools" }, h("button", { type: "button", onclick: () => save([...marked].sort((a, b) => a - b).join("\n") + "\n", `findings-${found.digest.slice(0, 12)}.txt`) }, "Save the list of marked rows"), counted) : null,
  );
  try {
    await waits(waiting, found.digest, blocks);
  } catch (error) {
    replace(waiting, problem(error));
  }
}

/** Checks whose rows have a partner: the same pattern, or an image of it. */
const TWINS = ["leak", "duplicate", "symmetry"];

/** Pipelines that are looked through for stages that wait for an audit. */
const MOST = 50;

/** Which stages wait for an audit: those that need it, and what comes after them. @param {HTMLElement} place @param {string} digest @param {boolean} blocks */
async function waits(place, digest, blocks) {
  const { pipelines } = await json("pipelines");
  /** @type {any[]} */ const told = [];
  for (const one of pipelines.slice(0, MOST)) {
    const pipeline = await json(`pipelines/${one.id}`);
    if (pipeline.problem) continue;
    for (const audit of pipeline.stages.filter((/** @type {any} */ stage) => stage.digest === digest)) {
      const needs = (/** @type {string} */ name) => [...pipeline.needs[name].needs, ...pipeline.needs[name].gates];
      /** @type {string[]} */ const first = [];
      /** @type {string[]} */ const later = [];
      // Stages stand after all that they need.
      for (const stage of pipeline.stages) {
        if (needs(stage.name).includes(audit.name)) first.push(stage.name);
        else if (needs(stage.name).some((name) => first.includes(name) || later.includes(name))) later.push(stage.name);
      }
      const names = [first.join(", "), later.length ? `and after them ${later.join(", ")}` : ""].filter(Boolean).join("; ");
      const link = h("a", { href: `#/pipelines/${one.id}` }, pipeline.pipeline);
      told.push(h("p", { "data-blocks": [...first, ...later].join(" ") }, "In ", link, !first.length ? `, no stage waits for ${audit.name}.` : blocks ? `, ${audit.name} keeps from being built: ${names}.` : `, these wait for ${audit.name} and may be built: ${names}.`));
    }
  }
  replace(place, told);
}

/** The rows that have the same pattern, or an image of it, and which part of the set they stand in. @param {any[]} sets @param {number} row @param {HTMLElement} place */
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
  place.append(h("h3", {}, "The same pattern, or an image of it"), twins.length ? h("div", { class: "cards", "data-partners": twins.map((/** @type {any} */ one) => one.row).join(" ") }, cards) : h("p", { class: "soft" }, "No other row has it."));
}

/** The set that has a row with a pattern. @param {any[]} sets @param {number} row */
function holds(sets, row) {
  return sets.find((set) => set.datasets.some((/** @type {any} */ one) => one.axes.length === 3 && one.axes[1] === "y" && one.axes[2] === "x" && row < one.shape[0]));
}

/** A row as it is labelled and as it is simulated anew. @param {any[]} sets @param {number} row @param {HTMLElement} place */
async function sample(sets, row, place) {
  for (const set of sets) {
    const patterns = set.datasets.find((/** @type {any} */ one) => one.path === "patterns" || (one.axes.length === 3 && one.axes[1] === "y" && one.axes[2] === "x"));
    const field = set.datasets.find((/** @type {any} */ one) => patterns && one.axes[0] === patterns.axes[0] && one.axes.length === 4 && one.axes[3] === "xy");
    if (!patterns || row >= patterns.shape[0]) continue;
    const paths = [patterns, field].filter(Boolean).map((/** @type {any} */ one) => one.path).join(",");
    const { arrays } = await frame(`artifacts/${set.digest}/arrays?paths=${encodeURIComponent(paths)}&rows=${row}`);
    const { shape, data } = arrays[patterns.path];
    const pattern = new Pattern(shape[2], shape[1], Uint8Array.from(data));
    const labelled = field ? /** @type {Float32Array} */ (arrays[field.path].data) : null;
    const body = { ...(set.attributes.scene ? { scene: set.attributes.scene } : {}), pattern: pattern.asRows(), fields: ["displacement"], quick: true };
    const again = await frame("sketch", { body });
    const simulated = /** @type {Float32Array|null} */ (again.arrays.displacement?.data ?? null);
    const canvases = ["Pattern", "Label", "Simulated again", "Difference"].map((name) => ({ name, canvas: h("canvas", { role: "img", "aria-label": name }), note: h("figcaption", { class: "small soft" }) }));
    replace(place, h("h3", {}, `Row ${row} of `, short(set.digest)), h("div", { class: "pair" }, canvases.map(({ canvas, note }) => h("figure", {}, canvas, note))));
    const extent = size(set, pattern);
    const one = (/** @type {number} */ at, /** @type {Float32Array|null} */ values, /** @type {string} */ without) => {
      const { name, canvas, note } = canvases[at];
      const of = values ? magnitudes(values, pattern.columns, pattern.rows) : null;
      drawMembrane(canvas, pattern, values, { size: extent, scale: at === 3 ? 1 : 2, values: of, low: 0, high: of ? Math.max(...of) : 0 });
      note.textContent = of ? `${name}: largest ${number(Math.max(...of), 5)} mm` : `${name}: ${without}`;
    };
    drawPattern(canvases[0].canvas, pattern);
    canvases[0].note.textContent = "Pattern";
    one(1, labelled, "it has no field");
    one(2, simulated, again.document.outcome);
    one(3, labelled && simulated ? Float32Array.from(labelled, (value, at) => value - simulated[at]) : null, "there is nothing to compare");
    return;
  }
  throw new Error(`the dataset of this audit, which row ${row} is of, is not in the store`);
}
