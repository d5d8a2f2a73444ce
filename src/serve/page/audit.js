// Findings of an audit: what is wrong in which rows, with the rows drawn, and simulated again beside their labels.

import { frame, json } from "./server.js";
import { h, number, problem, replace, short } from "./elements.js";
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
    const rows = finding.examples.map((/** @type {number} */ row) => h("button", { type: "button", onclick: () => void open(row, pictures) }, `row ${row}`));
    const marks = finding.examples.length ? h("button", { type: "button", onclick: () => {
      finding.examples.forEach((/** @type {number} */ row) => marked.add(row));
      counted.textContent = `${marked.size} rows marked`;
    } }, "Mark these rows") : null;
    return h("section", { class: "panel", "data-check": finding.check }, h("h2", {}, h("span", { class: finding.severity }, finding.severity), ` ${finding.check}: ${finding.count}`), h("p", {}, finding.message), h("div", { class: "tools" }, rows, marks), pictures);
  };
  /** @param {number} row @param {HTMLElement} pictures */
  const open = async (row, pictures) => {
    try {
      replace(pictures, h("p", { class: "soft" }, "Reading …"));
      await sample(sets, row, pictures);
    } catch (error) {
      replace(pictures, problem(error));
    }
  };
  const blocks = list.some((/** @type {any} */ one) => one.severity === "error");
  replace(
    place,
    h("p", {}, "Dataset ", inputs.map((/** @type {string} */ input) => [short(input), " "]), "– ", blocks ? "Stages that need this audit are not built while it finds errors." : list.length ? "No stage is kept from being built." : "Nothing was found."),
    list.map(section),
    list.length ? h("div", { class: "tools" }, h("button", { type: "button", onclick: () => save([...marked].sort((a, b) => a - b).join("\n") + "\n", `findings-${found.digest.slice(0, 12)}.txt`) }, "Save the list of marked rows"), counted) : null,
  );
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
    const size = /** @type {[number, number]} */ ([pattern.columns, pattern.rows]);
    const one = (/** @type {number} */ at, /** @type {Float32Array|null} */ values, /** @type {string} */ without) => {
      const { name, canvas, note } = canvases[at];
      const of = values ? magnitudes(values, pattern.columns, pattern.rows) : null;
      drawMembrane(canvas, pattern, values, { size, values: of });
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
