// Panels of the sketchpad: comparison of methods and meshes, and effects.

import { json } from "./server.js";
import { errorDigits, h, number, prose, replace, roundedBy, table } from "./elements.js";

/** Methods that are compared: method, elements per cell, order. */
const COMPARED = [["linear", 1, 1], ["chord:2", 1, 1], ["newton", 1, 1], ["newton", 2, 1], ["newton", 1, 2], ["newton", 2, 2]];

/** A table for a drawing, which turns grey when the drawing changes. */
class DrawingTable {
  /** @param {any} pad */
  constructor(pad) {
    this.pad = pad;
    this.box = h("div", {});
    this.old = h("p", { class: "small warning", role: "status" });
    this.drawing = "";
  }

  /** @param {any} content */
  fill(content) {
    replace(this.box, content);
    this.check();
  }

  /** Identifies the drawing and its conditions, without method and mesh. */
  key() {
    const { pattern, voltage, state, effects, point, direction } = this.pad;
    return [pattern.cells.join(""), voltage, state, effects, point, direction].join(" ");
  }

  start() {
    this.drawing = this.key();
    this.fill(h("p", { class: "soft" }, "Computing …"));
  }

  /** Marks the table if the drawing has changed. */
  check() {
    const old = this.box.childElementCount > 0 && this.drawing !== this.key();
    this.box.classList.toggle("old", old);
    this.old.textContent = old ? "The pattern, voltage, state, effects or point has changed since." : "";
  }
}

export class Compare extends DrawingTable {
  panel() {
    return h(
      "section",
      { class: "panel wide" },
      h("h2", {}, "Accuracy and time"),
      h("p", { class: "soft small" }, "The same pattern with several methods and meshes, with the error against Newton’s method on a finer mesh."),
      h("button", { type: "button", onclick: () => this.run(), id: "compare" }, "Compare"),
      this.old,
      this.box,
    );
  }

  async run() {
    const { pad } = this;
    this.start();
    const { drawing } = this;
    await pad.attempt(this.box, async () => {
      const body = pad.body(false);
      /** @type {any[]} */ const rows = [];
      const progress = () => (rows.length < COMPARED.length ? h("p", { class: "soft" }, `Computing: ${rows.length} of ${COMPARED.length} …`) : null);
      const heads = ["method", { title: "elements per cell", number: true }, { title: "order", number: true }, { title: "largest, mm", number: true }, { title: "value, mm", number: true }, { title: "error, mm", number: true }, { title: "ms", number: true }, ""];
      for (const [method, elements, order] of COMPARED) {
        if (pad.ended || this.drawing !== drawing) return;
        this.fill([rows.length ? table("Methods", heads, rows) : null, progress()]);
        const own = { ...body, method, elements_per_cell: elements, order, fields: [] };
        // The first solution includes the setup of the solver.
        await json("sketch", { body: { ...own, quick: true } });
        const found = await json("sketch", { body: own });
        rows.push([
          method, elements, order, roundedBy(found.max_displacement, found.error), roundedBy(found.value, found.error), errorDigits(found.error), number(1000 * found.seconds, 3),
          h("button", { type: "button", onclick: () => this.pad.adopt(String(method), Number(elements), Number(order)) }, "Use"),
        ]);
      }
      if (this.drawing === drawing) this.fill(table("Methods", heads, rows));
    });
  }
}

export class Effects extends DrawingTable {
  panel() {
    const { pad } = this;
    const known = pad.scene.effects.filter((/** @type {any} */ effect) => effect.on !== null && !effect.in_time && !["charge_control", "rigid_inclusion"].includes(effect.name));
    /** @type {{name: string, box: any, refused: string|null}[]} */
    const boxes = known.map((/** @type {any} */ effect) => {
      const box = h("input", { type: "checkbox", name: effect.name, checked: effect.on, disabled: Boolean(effect.refused), onchange: () => pad.take({ effects: boxes.filter((one) => one.box.checked).map((one) => one.name) }) });
      return { name: effect.name, box, refused: effect.refused ?? null };
    });
    return h(
      "section",
      { class: "panel wide" },
      h("h2", {}, "Effects"),
      pad.scene.auto ? h("p", { class: "soft small" }, "The scene selects the effects by screening; a choice here replaces them.") : null,
      h("div", { class: "boxes" }, boxes.map((one) => h("label", { class: "toggle" }, one.box, h("span", {}, one.name.replaceAll("_", " "), one.refused ? h("span", { class: "soft small", "data-refused": one.name }, ": ", prose(one.refused)) : null)))),
      h("button", { type: "button", onclick: () => this.run(), id: "screen" }, "Check effects"),
      this.old,
      this.box,
    );
  }

  async run() {
    const { pad } = this;
    this.start();
    await pad.attempt(this.box, async () => {
      this.fill(h("p", { class: "soft" }, "Computing with and without each effect …"));
      const found = await json("sketch/screen", { body: { ...pad.body(true), fields: [] } });
      const rows = found.effects.map((/** @type {any} */ row) => [
        row.effect.replaceAll("_", " "),
        number(row.number, 3),
        number(row.threshold, 3),
        h("span", { class: row.called_for === "yes" ? "warning" : null }, row.called_for),
        h("span", {}, prose(row.status)),
        h("span", {}, prose(row.change)),
      ]);
      this.fill(table("Screening", ["effect", { title: "number", number: true }, { title: "threshold", number: true }, "significant", "now", "influence"], rows));
    });
  }
}
