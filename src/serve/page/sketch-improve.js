// Improve: a search along the gradient from the drawn pattern, shown as it goes.

import { lines } from "./server.js";
import { h, labelled, number, numeric, problem, replace, said } from "./elements.js";
import { charts } from "./chart.js";
import { drawPattern } from "./membrane.js";
import { Pattern } from "./pattern.js";
import { quantity } from "./quantity.js";
import { againstWanted } from "./sketch-numbers.js";

/** Method, elements along a cell and order of the search. @type {[string, number, number]} */
const MESH = ["newton", 1, 2];

export class Improve {
  /** @param {any} pad */
  constructor(pad) {
    this.pad = pad;
    /** @type {{pattern: Pattern, value: number, wanted: number|null}|null} */ this.best = null;
    /** @type {AbortController|null} */ this.search = null;
  }

  end() {
    this.search?.abort();
  }

  panel() {
    this.keepArea = h("input", { type: "checkbox", name: "keep-area" });
    this.feature = numeric("", "Least width in mm", { name: "feature", placeholder: "any" });
    this.trouble = h("span", { class: "error", role: "alert" });
    this.start = h("button", { type: "button", class: "main", onclick: () => this.run(), id: "improve" }, "Improve");
    this.stop = h("button", { type: "button", disabled: true, onclick: () => this.search?.abort(), id: "stop" }, "Stop");
    this.course = h("div", { "aria-live": "polite" });
    this.bestBox = h("div", { class: "best" });
    return h(
      "section",
      { class: "panel" },
      h("h2", {}, "Improve"),
      h("p", { class: "soft small" }, "Follows the gradient of the point’s displacement with Newton’s method on biquadratic elements, and shows each pattern that it reaches. Towards a wanted value it goes up or down, and takes as few changes as come nearest to it."),
      h("div", { class: "tools" }, h("label", { class: "toggle" }, this.keepArea, "keep the area"), labelled("least width, mm", this.feature, this.trouble)),
      h("div", { class: "tools" }, this.start, this.stop),
      this.course,
      this.bestBox,
    );
  }

  async run() {
    if (this.search) return;
    const { pad } = this;
    const { value: width, wrong } = this.feature.value.trim() ? quantity(this.feature.value, "length", 0, Math.max(...pad.scene.size_mm)) : { value: 0, wrong: "" };
    said(this.feature, this.trouble, wrong);
    if (wrong) return;
    this.search = new AbortController();
    this.start.disabled = true;
    this.stop.disabled = false;
    const before = pad.pattern.copy();
    const { wanted } = pad;
    /** @type {number[]} */ const values = [];
    // That of another search may be of other voltages and points.
    this.best = null;
    replace(this.bestBox);
    const body = {
      ...pad.body(true),
      fields: [],
      area: this.keepArea.checked ? pad.pattern.area : null,
      ...(wanted === null ? {} : { wanted }),
      ...(width > 0 ? { constraints: { min_feature: `${width} mm` } } : {}),
    };
    try {
      replace(this.course, h("p", { class: "soft" }, "Following the gradient …"));
      await lines("sketch/improve", { body, signal: this.search.signal }, (step) => {
        if (step.error) throw Object.assign(new Error(step.error.message), { help: step.error.help });
        values.push(step.value);
        const pattern = Pattern.of(step.pattern);
        const off = (/** @type {number} */ value) => Math.abs(value - /** @type {number} */ (wanted));
        const better = !this.best || this.best.wanted !== wanted || (wanted === null ? step.value > this.best.value : off(step.value) < off(this.best.value));
        if (better) this.best = { pattern, value: step.value, wanted };
        pad.pattern.cells.set(pattern.cells);
        pad.changed(true);
        replace(this.course, h("p", { id: "course" }, this.told(step, values, wanted)), charts.line(values, "value, mm"));
        this.showBest();
      });
    } catch (error) {
      if (/** @type {any} */ (error).name !== "AbortError") replace(this.course, problem(error));
      else this.course.prepend(h("p", {}, "Stopped."));
    } finally {
      this.search = null;
      this.start.disabled = false;
      this.stop.disabled = true;
      if (!before.equals(pad.pattern)) pad.pen.history.push(before);
      pad.pen.remember();
      pad.soon();
    }
  }

  /** @param {any} step @param {number[]} values @param {number|null} wanted */
  told(step, values, wanted) {
    const count = `${values.length} pattern${values.length === 1 ? "" : "s"}`;
    const told = `${count}, value ${number(values[0], 5)} → ${number(step.value, 6)} mm, area ${number(100 * this.pad.share(Pattern.of(step.pattern)), 4)} %`;
    if (!step.done) return told;
    if (wanted === null) return `Done: ${told}; nothing to first order gains any more.`;
    const against = againstWanted(step.value, wanted);
    if (against.reached) return `Reached: ${told}; wanted ${number(wanted, 6)} mm, ${against.words.replace("reached, ", "")} on biquadratic elements.`;
    return `Not reached: ${told}; the nearest that was found to the wanted ${number(wanted, 6)} mm, ${against.words}.`;
  }

  showBest() {
    const { best } = this;
    if (!best) return;
    const canvas = h("canvas", { class: "thumb", role: "img", "aria-label": "The best pattern found" });
    const what = best.wanted === null ? "Best found" : `Nearest to ${number(best.wanted, 6)} mm`;
    replace(
      this.bestBox,
      canvas,
      h(
        "div",
        {},
        h("p", {}, `${what}: ${number(best.value, 6)} mm`),
        h("button", { type: "button", onclick: () => this.pad.pen.become(best.pattern) }, "Show it"),
        " ",
        // Its values are not those of a coarser mesh.
        h("button", { type: "button", onclick: () => this.pad.adopt(...MESH), title: "The numbers of the page by the method and mesh of the search" }, "Numbers on its mesh"),
      ),
    );
    drawPattern(canvas, best.pattern);
  }
}
