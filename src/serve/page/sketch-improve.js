// Improve: a gradient search that starts at the drawn pattern.

import { lines } from "./server.js";
import { h, labelled, number, numeric, problem, replace, showInvalid } from "./elements.js";
import { charts } from "./chart.js";
import { drawPattern } from "./membrane.js";
import { Pattern } from "./pattern.js";
import { quantity } from "./quantity.js";
import { compareWithTarget } from "./sketch-numbers.js";

/** Method, elements per cell and order of the search. @type {[string, number, number]} */
const MESH = ["newton", 1, 2];

export class Improve {
  /** @param {any} pad */
  constructor(pad) {
    this.pad = pad;
    /** @type {{pattern: Pattern, value: number, target: number|null}|null} */ this.best = null;
    /** @type {AbortController|null} */ this.search = null;
  }

  end() {
    this.search?.abort();
  }

  panel() {
    this.keepArea = h("input", { type: "checkbox", name: "keep-area" });
    this.feature = numeric("", "Minimum width in mm", { name: "feature", placeholder: "any" });
    this.featureError = h("span", { class: "error", role: "alert" });
    this.start = h("button", { type: "button", class: "main", onclick: () => this.run(), id: "improve" }, "Improve");
    this.stop = h("button", { type: "button", disabled: true, onclick: () => this.search?.abort(), id: "stop" }, "Stop");
    this.progress = h("div", { "aria-live": "polite" });
    this.bestBox = h("div", { class: "best" });
    return h(
      "section",
      { class: "panel" },
      h("h2", {}, "Improve"),
      h("p", { class: "soft small" }, "Follows the gradient of the displacement of the point, with Newton’s method on biquadratic elements, and shows each step. With a target, it searches up or down for the nearest pattern."),
      h("div", { class: "tools" }, h("label", { class: "toggle" }, this.keepArea, "keep the area"), labelled("minimum width, mm", this.feature, this.featureError)),
      h("div", { class: "tools" }, this.start, this.stop),
      this.progress,
      this.bestBox,
    );
  }

  async run() {
    if (this.search) return;
    const { pad } = this;
    const { value: width, wrong } = this.feature.value.trim() ? quantity(this.feature.value, "length", 0, Math.max(...pad.scene.size_mm)) : { value: 0, wrong: "" };
    showInvalid(this.feature, this.featureError, wrong);
    if (wrong) return;
    this.search = new AbortController();
    this.start.disabled = true;
    this.stop.disabled = false;
    const before = pad.pattern.copy();
    const { target } = pad;
    /** @type {number[]} */ const values = [];
    // The best pattern of another search may be for other voltages and points.
    this.best = null;
    replace(this.bestBox);
    const body = {
      ...pad.body(true),
      fields: [],
      area: this.keepArea.checked ? pad.areaOf(pad.pattern).share : null,
      ...(target === null ? {} : { wanted: target }),
      ...(width > 0 ? { constraints: { min_feature: `${width} mm` } } : {}),
    };
    try {
      replace(this.progress, h("p", { class: "soft" }, "Following the gradient …"));
      await lines("sketch/improve", { body, signal: this.search.signal }, (step) => {
        if (step.error) throw Object.assign(new Error(step.error.message), { help: step.error.help });
        values.push(step.value);
        const pattern = Pattern.of(step.pattern);
        const off = (/** @type {number} */ value) => Math.abs(value - /** @type {number} */ (target));
        const better = !this.best || this.best.target !== target || (target === null ? step.value > this.best.value : off(step.value) < off(this.best.value));
        if (better) this.best = { pattern, value: step.value, target };
        pad.pattern.cells.set(pattern.cells);
        pad.changed(true);
        replace(this.progress, h("p", { id: "course" }, this.describe(step, values, target)), charts.line(values, "value, mm"));
        this.showBest();
      });
    } catch (error) {
      if (/** @type {any} */ (error).name !== "AbortError") replace(this.progress, problem(error));
      else this.progress.prepend(h("p", {}, "Stopped."));
    } finally {
      this.search = null;
      this.start.disabled = false;
      this.stop.disabled = true;
      if (!before.equals(pad.pattern)) pad.pen.history.push(before);
      pad.pen.remember();
      pad.soon();
    }
  }

  /** @param {any} step @param {number[]} values @param {number|null} target */
  describe(step, values, target) {
    const count = `${values.length} pattern${values.length === 1 ? "" : "s"}`;
    const text = `${count}, value ${number(values[0])} → ${number(step.value)} mm, ${this.pad.areaOf(Pattern.of(step.pattern)).text}`;
    if (!step.done) return text;
    if (target === null) return `Done: ${text}; no further improvement to first order.`;
    const against = compareWithTarget(step.value, target);
    if (against.reached) return `Reached: ${text}; target ${number(target, 6)} mm, ${against.words.replace("reached, ", "")} on biquadratic elements.`;
    return `Not reached: ${text}; nearest to the target ${number(target, 6)} mm, ${against.words}.`;
  }

  showBest() {
    const { best } = this;
    if (!best) return;
    const canvas = h("canvas", { class: "thumb", role: "img", "aria-label": "Best pattern" });
    const what = best.target === null ? "Best pattern" : `Nearest to ${number(best.target, 6)} mm`;
    replace(
      this.bestBox,
      canvas,
      h(
        "div",
        {},
        h("p", { title: `${best.value} mm`, "data-value": String(best.value) }, `${what}: ${number(best.value)} mm`),
        h("button", { type: "button", onclick: () => this.pad.pen.become(best.pattern) }, "Show"),
        " ",
        // Its values differ from those of a coarser mesh.
        h("button", { type: "button", onclick: () => this.pad.adopt(...MESH), title: "Compute the numbers with the method and mesh of the search" }, "Use its mesh"),
      ),
    );
    drawPattern(canvas, best.pattern);
  }
}
