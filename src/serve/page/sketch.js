// The sketchpad: a pattern, and the membrane that moves while it is drawn.

import { frame, json, lines } from "./server.js";
import { choice, copyable, h, labelled, number, problem, replace, seconds, settled, table } from "./elements.js";
import { charts } from "./chart.js";
import { drawBar, drawMembrane, drawPattern, magnitudes } from "./membrane.js";
import { range } from "./colours.js";
import { History, Mirrors, Pattern } from "./pattern.js";
import { fromFile, READ, saveAs } from "./files.js";
import { HINTS, quantity } from "./quantity.js";

/** After so many milliseconds without a stroke the critical voltage and the error are asked for. */
const STILL = 250;
/** A solution that takes longer does not keep the next from being asked for. */
const PATIENCE = 250;

/** What the membrane is coloured by: the array, its name, its unit, what its numbers are divided by, and whether its colours begin at zero. */
const COLOURINGS = {
  displacement: ["displacement", "mm", 1, true],
  stress: ["larger principal stress", "kPa", 1e3, false],
  least_stress: ["smaller principal stress", "kPa", 1e3, false],
  field: ["true electric field", "MV/m", 1e6, true],
  tension: ["tension: taut, wrinkled, slack", "", 1, true],
  electrode: ["electrodes", "", 1, true],
};

/** Tools that take two corners. */
const SHAPES = ["rectangle", "ellipse", "line"];

/** The highest voltage that is simulated, V. */
const MOST_VOLTS = 1e6;

/** Settings that are compared: method, elements per cell, order. */
const COMPARED = [["linear", 1, 1], ["chord:2", 1, 1], ["newton", 1, 1], ["newton", 2, 1], ["newton", 1, 2], ["newton", 2, 2]];

const TOOLS = [["brush", "Brush", "b"], ["eraser", "Eraser", "e"], ["rectangle", "Rectangle", "r"], ["ellipse", "Ellipse", "o"], ["line", "Line", "l"], ["fill", "Fill", "f"]];

/** @param {HTMLElement} view @param {{pattern?: number[][], scene?: string}} first @returns {Promise<() => void>} what ends it */
export async function sketchpad(view, first = {}) {
  const { scenes } = await json("scenes");
  const pad = new Sketchpad(view, scenes, first);
  pad.build();
  return () => pad.end();
}

class Sketchpad {
  /** @param {HTMLElement} view @param {any[]} scenes @param {{pattern?: number[][], scene?: string}} first */
  constructor(view, scenes, first) {
    this.view = view;
    this.scenes = scenes;
    this.scene = scenes.find((scene) => scene.name === first.scene) ?? scenes[0];
    const kept = kept_pattern(this.scene);
    const given = first.pattern?.length ? Pattern.of(first.pattern) : null;
    const fits = (/** @type {Pattern|null} */ found) => (found && found.columns === this.scene.columns && found.rows === this.scene.rows ? found : null);
    this.pattern = fits(given) ?? fits(kept) ?? new Pattern(this.scene.columns, this.scene.rows);
    this.history = new History();
    this.mirrors = new Mirrors();
    this.tool = "brush";
    this.diameter = 4;
    this.group = 1;
    /** @type {[number, number]} */ this.cursor = [Math.floor(this.scene.columns / 2), Math.floor(this.scene.rows / 2)];
    this.showCursor = false;
    this.voltage = this.scene.voltage;
    this.state = this.scene.states[0] ?? null;
    this.method = "newton";
    this.elements = 1;
    this.order = 1;
    this.colouring = "displacement";
    this.scale = 3;
    this.heat = false;
    /** @type {[number, number]} */ this.point = [this.scene.size_mm[0] / 2, this.scene.size_mm[1] / 2];
    this.direction = 0;
    /** @type {string[]|null} */ this.effects = null;
    this.critical = null;
    /** @type {any} */ this.shown = null;
    /** @type {{pattern: Pattern, value: number}|null} */ this.best = null;
    /** What is wanted of the point, mm; null where nothing is. @type {number|null} */ this.wanted = null;
    /** Fields that hold something wrong: what is shown belongs to values of before. @type {Set<string>} */ this.wrong = new Set();
    /** Whether the last question had no answer. */ this.failed = false;
    /** The first corner of a shape that is drawn by keys. @type {{from: [number, number], before: Pattern}|null} */ this.corner = null;
    this.version = 0;
    this.sent = -1;
    /** @type {{controller: AbortController, began: number, version: number}|null} */ this.flight = null;
    this.latest = -1;
    this.rate = { count: 0, since: performance.now(), told: 0 };
    this.frame = 0;
    this.fresh = false;
    /** What has to be drawn with the next frame. */
    this.stale = { pad: false, membrane: false };
    this.still = settled(() => this.refine(), STILL);
    /** @type {AbortController|null} */ this.search = null;
    this.ended = false;
    this.redraw = () => this.soon();
    window.addEventListener("resize", this.redraw);
    this.back = (/** @type {KeyboardEvent} */ event) => this.takeBack(event);
    window.addEventListener("keydown", this.back);
    this.dark = window.matchMedia("(prefers-color-scheme: dark)");
    this.dark.addEventListener("change", this.redraw);
  }

  end() {
    this.ended = true;
    cancelAnimationFrame(this.frame);
    this.flight?.controller.abort();
    this.search?.abort();
    window.removeEventListener("resize", this.redraw);
    window.removeEventListener("keydown", this.back);
    this.dark.removeEventListener("change", this.redraw);
  }

  build() {
    const label = "Drawing area. Arrow keys move the cursor, space draws, B E R O L F choose a tool, Ctrl Z takes back. Of a rectangle, an ellipse or a line, space sets the first corner and draws at the second; Escape drops it.";
    this.canvas = h("canvas", { class: "pad", tabindex: "0", role: "application", "aria-label": label, id: "pad" });
    this.membrane = h("canvas", { class: "membrane", role: "img", "aria-label": "The membrane as it deforms", id: "membrane" });
    this.bar = h("canvas", { class: "bar", "aria-hidden": "true" });
    this.legend = h("p", { class: "legend soft" });
    this.results = h("dl", { class: "results", "aria-live": "polite", id: "results" });
    this.notice = h("div", { id: "notice" });
    this.timing = h("p", { class: "soft small", id: "timing" });
    this.line = h("p", { class: "narrow-only sticky", id: "value-line", "aria-hidden": "true" });
    replace(
      this.view,
      h("h1", {}, "Sketchpad"),
      this.line,
      this.sceneControls(),
      h(
        "div",
        { class: "pads" },
        h("section", { "aria-label": "Draw" }, h("h2", {}, "Draw"), this.toolbar(), this.canvas, this.areaLine()),
        h("section", { "aria-label": "Membrane" }, h("h2", {}, "Membrane"), this.colouringControls(), this.membrane, this.bar, this.legend),
        h("section", { "aria-label": "Numbers", class: "numbers" }, h("h2", {}, "Numbers"), this.results, this.notice, this.timing, this.methodControls()),
      ),
      h("div", { class: "panels" }, this.pointPanel(), this.improvePanel(), this.filePanel(), this.comparePanel(), this.effectsPanel()),
    );
    this.listen();
    this.soon();
    this.changed(true);
  }

  sceneControls() {
    const scenes = this.scenes.map((scene) => [scene.name, scene.name]);
    this.voltageRange = h("input", { type: "range", min: "0", max: String(this.mostVoltage()), step: "10", value: String(this.voltage), id: "voltage", "aria-label": "Voltage", list: "critical" });
    this.voltageNumber = numeric(String(this.voltage), `Voltage, ${HINTS.voltage}`, { id: "volts", title: HINTS.voltage });
    this.criticalMark = h("option", {});
    this.criticalText = h("span", { class: "soft", id: "critical-voltage" });
    this.voltageTrouble = h("span", { class: "error", id: "voltage-trouble", role: "alert" });
    const changed = (/** @type {string} */ text) => {
      const { value, wrong } = quantity(text, "voltage", 0, MOST_VOLTS);
      this.said("voltage", this.voltageNumber, this.voltageTrouble, wrong);
      if (wrong) return;
      this.voltage = value;
      this.voltageRange.value = String(value);
      if (document.activeElement !== this.voltageNumber) this.voltageNumber.value = String(value);
      this.changed(false);
    };
    this.voltageRange.addEventListener("input", () => changed(this.voltageRange.value));
    this.voltageNumber.addEventListener("input", () => changed(this.voltageNumber.value));
    return h(
      "div",
      { class: "controls" },
      this.scenes.length > 1 ? labelled("Scene", choice("scene", /** @type {any} */ (scenes), this.scene.name, (name) => this.reopen({ scene: name }))) : h("span", {}, "Scene ", h("b", {}, this.scene.name)),
      this.scene.states.length ? labelled("State", choice("state", this.scene.states.map((/** @type {string} */ name) => [name, name]), this.state ?? "", (name) => this.take({ state: name }))) : null,
      this.scene.driven_by_charge
        ? h("span", { class: "soft" }, "driven by a charge")
        : h("span", { class: "control grow" }, h("span", {}, "Voltage"), this.voltageRange, this.voltageNumber, h("span", { class: "soft" }, "V, or 4 kV"), h("datalist", { id: "critical" }, this.criticalMark), this.voltageTrouble, this.criticalText),
    );
  }

  mostVoltage() {
    return Math.ceil((1.5 * Math.max(this.scene.voltage, this.critical ?? 0, 1000)) / 100) * 100;
  }

  toolbar() {
    const tool = (/** @type {string[]} */ [name, text, key]) =>
      h("button", { type: "button", "data-tool": name, "aria-pressed": String(this.tool === name), title: `${text} (${key.toUpperCase()})`, onclick: () => this.choose(name) }, text);
    const mirror = (/** @type {"across"|"along"|"quarter"} */ name, /** @type {string} */ text, /** @type {string} */ title) =>
      h("label", { class: "toggle", title }, h("input", { type: "checkbox", name, onchange: (/** @type {any} */ event) => (this.mirrors[name] = event.target.checked) }), text);
    const groups = Array.from({ length: this.scene.groups }, (_, at) => [String(at + 1), `group ${at + 1}`]);
    this.tools = h("div", { class: "tools", role: "group", "aria-label": "Tools" }, TOOLS.map(tool));
    return [
      this.tools,
      h(
        "div",
        { class: "tools" },
        labelled("Width", h("input", { type: "range", min: "1", max: "15", value: String(this.diameter), "aria-label": "Width of the brush in cells", oninput: (/** @type {any} */ event) => (this.diameter = Number(event.target.value)) })),
        groups.length > 1 ? labelled("Electrode", choice("group", /** @type {any} */ (groups), "1", (value) => (this.group = Number(value)))) : null,
        mirror("across", "⇆", "Mirror left and right while drawing"),
        mirror("along", "⇅", "Mirror up and down while drawing"),
        this.scene.columns === this.scene.rows ? mirror("quarter", "⟳", "Turn by quarters while drawing") : null,
      ),
      h(
        "div",
        { class: "tools" },
        (this.undoButton = h("button", { type: "button", disabled: true, name: "undo", onclick: () => this.undo(), title: "Ctrl Z" }, "Undo")),
        (this.redoButton = h("button", { type: "button", disabled: true, name: "redo", onclick: () => this.redo(), title: "Ctrl Y" }, "Redo")),
        h("button", { type: "button", onclick: () => this.become(new Pattern(this.scene.columns, this.scene.rows)) }, "Clear"),
        h("button", { type: "button", onclick: () => this.inverted() }, "Invert"),
        h("button", { type: "button", onclick: () => this.turned() }, this.scene.columns === this.scene.rows ? "Turn" : "Turn by half"),
      ),
    ];
  }

  areaLine() {
    this.area = h("p", { class: "soft small", id: "area" });
    return this.area;
  }

  colouringControls() {
    const options = Object.entries(COLOURINGS).map(([name, [text]]) => [name, String(text)]);
    const scales = [["1", "true to scale"], ["2", "×2"], ["3", "×3"], ["5", "×5"], ["10", "×10"]];
    return h(
      "div",
      { class: "tools" },
      labelled("Colour", choice("colouring", /** @type {any} */ (options), this.colouring, (name) => this.take({ colouring: name }))),
      labelled("Shown", choice("scale", /** @type {any} */ (scales), String(this.scale), (value) => {
        this.scale = Number(value);
        this.soon();
      })),
    );
  }

  methodControls() {
    const methods = [["newton", "Newton"], ["linear", "linear estimate"], ["chord:1", "1 chord step"], ["chord:2", "2 chord steps"], ["chord:4", "4 chord steps"]];
    const elements = ["1", "2", "3", "4", "8"].map((count) => [count, count]);
    return h(
      "fieldset",
      {},
      h("legend", {}, "Method and mesh"),
      labelled("Method", choice("method", /** @type {any} */ (methods), this.method, (method) => this.take({ method }))),
      labelled("Elements per cell", choice("elements", /** @type {any} */ (elements), String(this.elements), (count) => this.take({ elements: Number(count) }))),
      labelled("Order", choice("order", [["1", "bilinear"], ["2", "biquadratic"]], String(this.order), (order) => this.take({ order: Number(order) }))),
    );
  }

  pointPanel() {
    const [width, height] = this.scene.size_mm;
    const field = (/** @type {string} */ label, /** @type {"length"|"angle"} */ dimension, /** @type {number} */ value, /** @type {number} */ least, /** @type {number} */ most, /** @type {(value: number) => void} */ set) => {
      const trouble = h("span", { class: "error", role: "alert" });
      const input = numeric(String(value), label, { title: HINTS[dimension], oninput: () => {
        const found = quantity(input.value, dimension, least, most);
        this.said(label, input, trouble, found.wrong);
        if (found.wrong) return;
        set(found.value);
        this.changed(false);
      } });
      return labelled(label, input, trouble);
    };
    const trouble = h("span", { class: "error", role: "alert" });
    const wanted = numeric("", "wanted value", { name: "wanted", placeholder: "none", title: `${HINTS.length}; Improve stops once it is reached`, oninput: () => {
      const found = wanted.value.trim() ? quantity(wanted.value, "length", -1e3, 1e3) : { value: NaN, wrong: "" };
      said(wanted, trouble, found.wrong);
      if (found.wrong) return;
      this.wanted = Number.isFinite(found.value) ? found.value : null;
      if (this.shown) this.show();
    } });
    this.heatNote = h("p", { class: "soft small" });
    return h(
      "section",
      { class: "panel" },
      h("h2", {}, "Point to pull"),
      h(
        "div",
        { class: "tools" },
        field("x, mm", "length", this.point[0], 0, width, (value) => (this.point = [value, this.point[1]])),
        field("y, mm", "length", this.point[1], 0, height, (value) => (this.point = [this.point[0], value])),
        field("direction, °", "angle", this.direction, -360, 360, (value) => (this.direction = value)),
        labelled("wanted, mm", wanted, trouble),
      ),
      h("label", { class: "toggle" }, h("input", { type: "checkbox", name: "heat", onchange: (/** @type {any} */ event) => this.take({ heat: event.target.checked }) }), "Show what each cell would add or take (adjoint)"),
      this.heatNote,
    );
  }

  improvePanel() {
    this.keepArea = h("input", { type: "checkbox", name: "keep-area" });
    this.feature = numeric("", "Least width in mm", { name: "feature", placeholder: "any" });
    this.featureTrouble = h("span", { class: "error", role: "alert" });
    this.start = h("button", { type: "button", class: "main", onclick: () => this.improve(), id: "improve" }, "Improve");
    this.stop = h("button", { type: "button", disabled: true, onclick: () => this.search?.abort(), id: "stop" }, "Stop");
    this.course = h("div", {});
    this.bestBox = h("div", { class: "best" });
    return h(
      "section",
      { class: "panel" },
      h("h2", {}, "Improve"),
      h("p", { class: "soft small" }, "Follows the gradient of the point’s displacement with Newton’s method on biquadratic elements, and shows each pattern that it reaches."),
      h("div", { class: "tools" }, h("label", { class: "toggle" }, this.keepArea, "keep the area"), labelled("least width, mm", this.feature, this.featureTrouble)),
      h("div", { class: "tools" }, this.start, this.stop),
      this.course,
      this.bestBox,
    );
  }

  effectsPanel() {
    const known = this.scene.effects.filter((/** @type {any} */ effect) => effect.on !== null && !effect.in_time && !["charge_control", "rigid_inclusion"].includes(effect.name));
    /** @type {{name: string, box: any, refused: string|null}[]} */
    const boxes = known.map((/** @type {any} */ effect) => {
      const box = h("input", { type: "checkbox", name: effect.name, checked: effect.on, disabled: Boolean(effect.refused), onchange: () => this.take({ effects: boxes.filter((one) => one.box.checked).map((one) => one.name) }) });
      return { name: effect.name, box, refused: effect.refused ?? null };
    });
    this.screening = h("div", {});
    return h(
      "section",
      { class: "panel wide" },
      h("h2", {}, "Effects"),
      this.scene.auto ? h("p", { class: "soft small" }, "The scene leaves them to screening; a choice here takes their place.") : null,
      h("div", { class: "boxes" }, boxes.map((one) => h("label", { class: "toggle" }, one.box, h("span", {}, one.name.replaceAll("_", " "), one.refused ? h("span", { class: "soft small", "data-refused": one.name }, `: ${one.refused}`) : null)))),
      h("button", { type: "button", onclick: () => this.screen(), id: "screen" }, "Which does this pattern call for?"),
      this.screening,
    );
  }

  comparePanel() {
    this.comparison = h("div", {});
    return h(
      "section",
      { class: "panel wide" },
      h("h2", {}, "What accuracy costs"),
      h("p", { class: "soft small" }, "The same pattern by several methods and meshes, each with its error against Newton’s method on a finer mesh."),
      h("button", { type: "button", onclick: () => this.compare(), id: "compare" }, "Compare"),
      this.comparison,
    );
  }

  filePanel() {
    const file = h("input", { type: "file", accept: READ.map((format) => `.${format}`).join(","), "aria-label": "Open a pattern", onchange: async () => {
      const chosen = file.files?.[0];
      file.value = "";
      if (chosen) await this.attempt(this.saved, async () => this.become(await fromFile(chosen, this.scene)));
    } });
    this.saved = h("div", {});
    this.name = h("input", { type: "text", value: "mine", pattern: "[A-Za-z0-9_-]+", "aria-label": "Name of the file", name: "name" });
    const formats = ["csv", "npy", "png", "svg", "dxf", "gbr"].map((format) => h("button", { type: "button", "data-format": format, onclick: () => this.keep(format) }, format));
    this.stages = h("div", { id: "stages" });
    this.name.addEventListener("input", () => this.showStages());
    this.showStages();
    return h(
      "section",
      { class: "panel" },
      h("h2", {}, "Files"),
      labelled("Open png, csv, npy, svg or dxf", file),
      h("div", { class: "tools" }, labelled("Name", this.name)),
      h("div", { class: "tools", role: "group", "aria-label": "Save as a file" }, h("span", { class: "soft" }, "Save as"), formats),
      h("h3", {}, "Into a pipeline"),
      h("div", { class: "tools" }, h("button", { type: "button", class: "main", id: "into-pipeline", onclick: () => this.keep("csv") }, "Save to a pipeline")),
      this.stages,
      this.saved,
    );
  }

  /** @param {any} element @param {() => Promise<void>} act */
  async attempt(element, act) {
    try {
      replace(element);
      await act();
    } catch (error) {
      if (/** @type {any} */ (error).name !== "AbortError") replace(element, problem(error));
    }
  }

  /** @param {string} format */
  async keep(format) {
    const name = this.fileName();
    await this.attempt(this.saved, async () => {
      await saveAs(format, { scene: this.scene.name, pattern: this.pattern.asRows() }, name);
      if (["csv", "npy", "png"].includes(format)) this.showStages(format);
      replace(this.saved, h("p", { class: "small" }, `${name}.${format} is saved.`));
    });
  }

  fileName() {
    return this.name.value.replace(/[^A-Za-z0-9_-]/g, "_") || "mine";
  }

  /** The stages that put the pattern into a pipeline, as they stand there. @param {string} format */
  showStages(format = "csv") {
    const name = this.fileName();
    const text = `  ${name}: { kind: patterns, files: [${name}.${format}] }\n  ${name}-solved: { kind: solve, needs: [${name}], elements_per_cell: ${this.elements}, order: ${this.order} }\n`;
    replace(this.stages, h("p", { class: "small" }, `The button saves ${name}.csv. Put it beside a pipeline with this scene, and these stages into it:`), copyable(text), this.otherVoltage());
  }

  /** What has to be said where the pattern was drawn at another voltage than the scene's, which a pipeline would take. */
  otherVoltage() {
    if (this.scene.driven_by_charge || this.voltage === this.scene.voltage) return null;
    const set = `--set scene.drive.voltage="${this.voltage} V"`;
    return h("p", { class: "small" }, `The scene is at ${number(this.scene.voltage, 6)} V, and this was drawn at ${number(this.voltage, 6)} V: change it there, or run with `, h("code", {}, set), ".");
  }

  /** @param {{scene?: string}} first */
  reopen(first) {
    this.end();
    void sketchpad(this.view, first);
  }

  /** @param {Record<string, any>} values */
  take(values) {
    Object.assign(this, values);
    this.showStages();
    this.changed(false);
  }

  listen() {
    const canvas = this.canvas;
    /** @type {[number, number]|null} */ let from = null;
    /** @type {Pattern|null} */ let before = null;
    let value = 1;
    canvas.addEventListener("pointerdown", (/** @type {PointerEvent} */ event) => {
      if (event.button > 2) return;
      event.preventDefault();
      this.drop();
      canvas.focus({ preventScroll: true });
      this.showCursor = false;
      canvas.setPointerCapture(event.pointerId);
      from = this.cell(event);
      before = this.pattern.copy();
      value = this.tool === "eraser" || event.button === 2 ? 0 : this.group;
      if (this.tool === "fill") this.pattern.flood(from[0], from[1], value, this.mirrors);
      else this.apply(before, from, from, value);
      this.changed(true);
    });
    canvas.addEventListener("pointermove", (/** @type {PointerEvent} */ event) => {
      if (!from || !before) return;
      for (const one of event.getCoalescedEvents?.().length ? event.getCoalescedEvents() : [event]) {
        const to = this.cell(one);
        if (this.tool === "brush" || this.tool === "eraser") {
          this.pattern.stroke(from, to, this.diameter, value, this.mirrors);
          from = to;
        } else if (this.tool !== "fill") this.apply(before, from, to, value);
      }
      this.changed(true);
    });
    const up = () => {
      if (before && !before.equals(this.pattern)) this.history.push(before);
      from = before = null;
      remember(this.scene, this.pattern);
    };
    canvas.addEventListener("pointerup", up);
    canvas.addEventListener("pointercancel", up);
    canvas.addEventListener("contextmenu", (/** @type {Event} */ event) => event.preventDefault());
    canvas.addEventListener("keydown", (/** @type {KeyboardEvent} */ event) => this.key(event));
    canvas.addEventListener("blur", () => {
      this.drop();
      this.showCursor = false;
      this.soon();
    });
  }

  /** @param {Pattern} before @param {[number, number]} from @param {[number, number]} to @param {number} value */
  apply(before, from, to, value) {
    this.pattern.cells.set(before.cells);
    if (this.tool === "rectangle" || this.tool === "ellipse") this.pattern.shape(this.tool, from, to, value, this.mirrors);
    else this.pattern.stroke(from, to, this.diameter, value, this.mirrors);
  }

  /** @param {PointerEvent} event @returns {[number, number]} */
  cell(event) {
    const box = this.canvas.getBoundingClientRect();
    const { columns, rows } = this.pattern;
    const clamp = (/** @type {number} */ at, /** @type {number} */ most) => Math.max(0, Math.min(most - 1, Math.floor(at)));
    return [clamp(((event.clientX - box.left) / box.width) * columns, columns), clamp((1 - (event.clientY - box.top) / box.height) * rows, rows)];
  }

  /** @param {KeyboardEvent} event */
  key(event) {
    const moves = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1] };
    const move = /** @type {any} */ (moves)[event.key];
    const tool = TOOLS.find(([, , key]) => key === event.key.toLowerCase());
    if (event.ctrlKey || event.metaKey || event.altKey) return;
    const value = this.tool === "eraser" ? 0 : this.group;
    if (move) {
      const [columns, rows] = [this.pattern.columns, this.pattern.rows];
      const before = this.cursor;
      this.cursor = [Math.max(0, Math.min(columns - 1, before[0] + move[0])), Math.max(0, Math.min(rows - 1, before[1] + move[1]))];
      // With shift the pen is down.
      if (this.corner) {
        this.apply(this.corner.before, this.corner.from, this.cursor, value);
        this.changed(true);
      } else if (event.shiftKey) this.edit((pattern) => pattern.stroke(before, this.cursor, this.diameter, value, this.mirrors));
    } else if (event.key === "Escape") {
      if (!this.corner) return;
      this.drop();
    } else if ((event.key === " " || event.key === "Enter") && SHAPES.includes(this.tool)) this.setCorner(value);
    else if (event.key === " " || event.key === "Enter") {
      const [x, y] = this.cursor;
      this.edit((pattern) => (this.tool === "fill" ? pattern.flood(x, y, value, this.mirrors) : pattern.dab(x, y, this.diameter, value, this.mirrors)));
    } else if (tool) this.choose(tool[0]);
    else return;
    event.preventDefault();
    this.showCursor = true;
    this.soon();
  }

  /** The first corner of a shape, or the second, which draws it. @param {number} value */
  setCorner(value) {
    if (!this.corner) {
      this.corner = { from: this.cursor, before: this.pattern.copy() };
      this.apply(this.corner.before, this.cursor, this.cursor, value);
      this.changed(true);
      return;
    }
    const { before } = this.corner;
    this.corner = null;
    if (before.equals(this.pattern)) return;
    this.history.push(before);
    remember(this.scene, this.pattern);
    this.soon();
  }

  /** Takes back a shape that has one corner alone. */
  drop() {
    if (!this.corner) return;
    this.pattern.cells.set(this.corner.before.cells);
    this.corner = null;
    this.changed(true);
  }

  /** Ctrl Z and Ctrl Y anywhere on the page but where text is written. @param {KeyboardEvent} event */
  takeBack(event) {
    const key = event.key.toLowerCase();
    const writes = event.target instanceof HTMLInputElement && ["text", "search"].includes(event.target.type);
    if (!(event.ctrlKey || event.metaKey) || event.altKey || !["z", "y"].includes(key) || writes) return;
    event.preventDefault();
    if (this.corner) this.drop();
    else if (key === "y" || event.shiftKey) this.redo();
    else this.undo();
  }

  /** @param {string} name */
  choose(name) {
    this.drop();
    this.tool = name;
    for (const button of this.tools.children) button.setAttribute("aria-pressed", String(button.dataset.tool === name));
  }

  /** @param {(pattern: Pattern) => void} change */
  edit(change) {
    const before = this.pattern.copy();
    change(this.pattern);
    if (before.equals(this.pattern)) return;
    this.history.push(before);
    remember(this.scene, this.pattern);
    this.changed(true);
  }

  /** @param {Pattern} pattern */
  become(pattern) {
    this.edit((own) => own.cells.set(pattern.cells));
  }

  undo() {
    this.went(this.history.undo(this.pattern));
  }

  redo() {
    this.went(this.history.redo(this.pattern));
  }

  /** @param {Pattern|undefined} pattern */
  went(pattern) {
    if (!pattern) return;
    this.pattern = pattern;
    remember(this.scene, this.pattern);
    this.changed(true);
  }

  inverted() {
    this.edit((pattern) => pattern.cells.forEach((value, at) => (pattern.cells[at] = value ? 0 : this.group)));
  }

  turned() {
    const { columns, rows, cells } = this.pattern.copy();
    this.edit((pattern) => pattern.cells.forEach((_, at) => {
      const [x, y] = [at % columns, Math.floor(at / columns)];
      pattern.cells[at] = columns === rows ? cells[(rows - 1 - x) * columns + y] : cells[cells.length - 1 - at];
    }));
  }

  /** What the server is told. @param {boolean} quick */
  body(quick) {
    const fields = ["displacement"];
    if (["stress", "least_stress"].includes(this.colouring)) fields.push("stress");
    if (["field", "tension"].includes(this.colouring)) fields.push(this.colouring);
    if (this.heat) fields.push("sensitivity");
    return {
      scene: this.scene.name,
      pattern: this.pattern.asRows(),
      method: this.method,
      elements_per_cell: this.elements,
      order: this.order,
      point: this.point,
      direction: this.direction,
      quick,
      fields,
      ...(this.scene.driven_by_charge || this.voltage === this.scene.voltage ? {} : { voltage: this.voltage }),
      ...(this.state ? { state: this.state } : {}),
      ...(this.effects ? { effects: this.effects } : {}),
    };
  }

  /** Something is not as it was. @param {boolean} drawn whether the pattern changed */
  changed(drawn) {
    this.version += 1;
    this.results.dataset.settled = "false";
    this.still();
    this.next();
    // The membrane follows with its answer.
    this.soon(true, drawn && !this.shown?.arrays.displacement);
  }

  /** Asks for the latest: one request at a time, and a slow one is given up for it. */
  next() {
    if (this.ended || this.sent === this.version) return;
    if (this.flight) {
      const left = PATIENCE - (performance.now() - this.flight.began);
      if (left > 0) {
        setTimeout(() => this.next(), left);
        return;
      }
      this.flight.controller.abort();
    }
    this.sent = this.version;
    void this.solve(true);
  }

  refine() {
    if (this.ended) return;
    if (this.flight && this.sent !== this.version) {
      this.still();
      return;
    }
    void this.solve(false);
  }

  /** @param {boolean} quick */
  async solve(quick) {
    const flight = { controller: new AbortController(), began: performance.now(), version: this.version };
    if (quick) this.flight = flight;
    else if (this.refining) this.refining.abort();
    if (!quick) this.refining = flight.controller;
    const pattern = this.pattern.copy();
    try {
      const { document, arrays } = await frame("sketch", { body: this.body(quick), signal: flight.controller.signal });
      // An answer that was overtaken is not shown.
      if (this.ended || flight.version < this.latest || (!quick && flight.version !== this.version)) return;
      this.latest = flight.version;
      this.failed = false;
      const kept = quick && this.shown ? { critical_voltage: null, error: null } : {};
      this.shown = { pattern, document: { ...document, ...kept }, arrays, quick, took: performance.now() - flight.began };
      this.fresh = true;
      this.soon(this.heat, true);
    } catch (error) {
      if (/** @type {any} */ (error).name === "AbortError" || this.ended) return;
      // The failure of an older request says nothing of what is shown by now.
      if (flight.version < this.latest || flight.version !== this.version) return;
      this.failed ||= flight.version > this.latest;
      replace(this.notice, problem(error));
      this.grey();
    } finally {
      if (this.flight === flight) {
        this.flight = null;
        this.next();
      }
    }
  }

  /** Says what is wrong beside a field; numbers are greyed until it is right. @param {string} name @param {any} input @param {HTMLElement} place @param {string} wrong */
  said(name, input, place, wrong) {
    said(input, place, wrong);
    if (wrong) this.wrong.add(name);
    else this.wrong.delete(name);
    this.grey();
  }

  /** Whether what is shown is of before: a field is wrong, or the last question had no answer. */
  grey() {
    const old = this.failed || this.wrong.size > 0;
    for (const element of [this.results, this.membrane, this.bar, this.legend, this.line, this.criticalText]) element?.classList.toggle("old", old);
    this.results.title = old ? "of the values before" : "";
  }

  /** Draws with the next frame of the screen, once, whatever has changed until then: the server works meanwhile. */
  soon(pad = true, membrane = true) {
    this.stale.pad ||= pad;
    this.stale.membrane ||= membrane;
    if (this.frame || this.ended) return;
    this.frame = requestAnimationFrame(() => {
      this.frame = 0;
      if (this.ended) return;
      this.area.textContent = `area ${number(100 * this.pattern.area, 4)} %`;
      this.undoButton.disabled = !this.history.past.length;
      this.redoButton.disabled = !this.history.future.length;
      if (this.fresh) {
        this.fresh = false;
        this.count();
        this.show();
      }
      this.draw();
    });
  }

  /** Updates of the membrane a second, over the last half of a second. */
  count() {
    const now = performance.now();
    this.rate.count += 1;
    if (now - this.rate.since > 500) {
      this.rate = { count: 0, since: now, told: (1000 * this.rate.count) / (now - this.rate.since) };
    }
  }

  show() {
    const { document: found, quick, took } = this.shown;
    if (!quick) {
      this.critical = found.critical_voltage;
      this.voltageRange.max = String(Math.max(this.mostVoltage(), this.voltage));
      this.criticalMark.value = this.critical === null ? "" : String(this.critical);
      this.criticalText.textContent = this.critical === null ? "no loss of stability was found" : `stability is lost at ${number(this.critical, 5)} V${found.critical_voltage_error ? ` ± ${number(found.critical_voltage_error, 2)} V` : " on this mesh"}`;
      this.criticalText.title = found.critical_bracket ? `on this mesh alone between ${number(found.critical_bracket[0], 6)} and ${number(found.critical_bracket[1], 6)} V` : "";
    }
    const entry = (/** @type {string} */ name, /** @type {string} */ title, /** @type {string} */ text, /** @type {string} */ unit, /** @type {number|null} */ exact = null) => [
      h("dt", {}, title),
      h("dd", { id: name, "data-value": exact === null ? null : String(exact) }, text, unit && text !== "–" ? h("span", { class: "soft" }, ` ${unit}`) : null),
    ];
    replace(
      this.results,
      entry("outcome", "outcome", found.outcome, ""),
      entry("max-displacement", "largest displacement", number(found.max_displacement, 6), "mm", found.max_displacement),
      entry("value", "value at the point", number(found.value, 6), "mm", found.value),
      this.wanted === null || found.value === null ? null : entry("wanted", `wanted ${number(this.wanted, 6)} mm`, found.value >= this.wanted ? "reached" : `${number(this.wanted - found.value, 3)} mm short`, "", found.value - this.wanted),
      entry("error", "error of method and mesh", quick ? "…" : number(found.error, 2), quick ? "" : "mm", found.error),
      entry("seconds", "solution", seconds(found.seconds), ""),
    );
    this.line.textContent = found.max_displacement === null ? `no stable state: ${found.outcome}` : `value ${number(found.value, 4)} mm, largest ${number(found.max_displacement, 4)} mm`;
    this.grey();
    if (!quick) this.results.dataset.settled = "true";
    const lost = found.bracket;
    if (found.max_displacement === null) {
      const why = lost ? `stable up to ${number(lost[0], 6)} V, lost at ${number(lost[1], 6)} V` : "nothing is known about stability";
      replace(this.notice, h("div", { class: "box", role: "alert" }, h("b", {}, `No stable state at ${number(found.voltage, 6)} V: ${found.outcome}`), h("p", {}, why)));
    } else replace(this.notice);
    this.timing.textContent = `${this.rate.told ? `${number(this.rate.told, 2)} updates a second, ` : ""}${number(took, 3)} ms from pen to membrane`;
  }

  draw() {
    const { pad, membrane } = this.stale;
    this.stale = { pad: false, membrane: false };
    if (pad) this.drawPad();
    if (membrane) this.drawMembrane();
  }

  drawPad() {
    const { size_mm: size, parts } = this.scene;
    const sensitivity = this.heat ? this.shown?.arrays.sensitivity?.data : null;
    this.heatNote.textContent = this.heat
      ? sensitivity
        ? `vermillion: an electrode here adds, blue: it takes; the strongest cell changes the value by ${number(Math.max(...range(sensitivity).map(Math.abs)), 3)} mm to first order`
        : "there is no adjoint for this method, these effects or this outcome"
      : "";
    drawPattern(this.canvas, this.pattern, {
      ratio: size[1] / size[0],
      grid: true,
      parts,
      cursor: this.showCursor ? this.cursor : null,
      heat: sensitivity ?? null,
      point: [this.point[0] / size[0], this.point[1] / size[1]],
      direction: this.direction,
    });
  }

  drawMembrane() {
    const { columns, rows } = this.pattern;
    const { size_mm: size, parts } = this.scene;
    const shown = this.shown;
    const displacement = /** @type {Float32Array|null} */ (shown?.arrays.displacement?.data ?? null);
    const pattern = displacement ? shown.pattern : this.pattern;
    /** @type {ArrayLike<number>|null} */ let values = null;
    if (displacement && this.colouring === "displacement") values = magnitudes(displacement, columns, rows);
    else if (displacement && this.colouring !== "electrode") values = shown.arrays[this.colouring]?.data ?? null;
    const [name, unit, factor, fromZero] = /** @type {any} */ (COLOURINGS)[this.colouring];
    const [least, high] = values ? range(values) : [0, 0];
    const low = fromZero ? Math.min(0, least) : least;
    drawMembrane(this.membrane, pattern, displacement, { size, scale: this.scale, values, parts, low, high });
    if (values) {
      drawBar(this.bar, false);
      this.legend.textContent = `${name}: ${number(low / factor, 3)} to ${number(high / factor, 3)} ${unit}`;
    } else this.legend.textContent = this.colouring === "electrode" || !shown || displacement ? "electrodes" : "no state to be shown: the membrane at rest";
    this.bar.hidden = !values;
  }

  async screen() {
    await this.attempt(this.screening, async () => {
      replace(this.screening, h("p", { class: "soft" }, "Solving with each effect and without it …"));
      const found = await json("sketch/screen", { body: { ...this.body(true), fields: [] } });
      const rows = found.effects.map((/** @type {any} */ row) => [
        row.effect.replaceAll("_", " "),
        number(row.number, 3),
        number(row.threshold, 3),
        h("span", { class: row.called_for === "yes" ? "warning" : null }, row.called_for),
        row.status,
        row.change,
      ]);
      replace(this.screening, table("Screening", ["effect", { title: "number", number: true }, { title: "above", number: true }, "called for", "now", "what it changes"], rows));
    });
  }

  async compare() {
    await this.attempt(this.comparison, async () => {
      const body = this.body(false);
      /** @type {any[]} */ const rows = [];
      for (const [method, elements, order] of COMPARED) {
        if (this.ended) return;
        const own = { ...body, method, elements_per_cell: elements, order, fields: [] };
        // The first solution of a kind sets up its solver.
        await json("sketch", { body: { ...own, quick: true } });
        const found = await json("sketch", { body: own });
        rows.push([
          method, elements, order, number(found.max_displacement, 6), number(found.value, 6), number(found.error, 2), number(1000 * found.seconds, 3),
          h("button", { type: "button", onclick: () => this.adopt(String(method), Number(elements), Number(order)) }, "Take"),
        ]);
        const heads = ["method", { title: "elements per cell", number: true }, { title: "order", number: true }, { title: "largest, mm", number: true }, { title: "value, mm", number: true }, { title: "error, mm", number: true }, { title: "ms", number: true }, ""];
        replace(this.comparison, table("Methods", heads, rows));
      }
    });
  }

  /** @param {string} method @param {number} elements @param {number} order */
  adopt(method, elements, order) {
    const chosen = /** @type {[string, string][]} */ ([["method", method], ["elements", String(elements)], ["order", String(order)]]);
    for (const [name, value] of chosen) /** @type {HTMLSelectElement} */ (this.view.querySelector(`select[name=${name}]`)).value = value;
    this.take({ method, elements, order });
  }

  async improve() {
    if (this.search) return;
    const { value: width, wrong } = this.feature.value.trim() ? quantity(this.feature.value, "length", 0, Math.max(...this.scene.size_mm)) : { value: 0, wrong: "" };
    said(this.feature, this.featureTrouble, wrong);
    if (wrong) return;
    this.search = new AbortController();
    this.start.disabled = true;
    this.stop.disabled = false;
    const before = this.pattern.copy();
    /** @type {number[]} */ const values = [];
    let reached = false;
    const body = {
      ...this.body(true),
      fields: [],
      area: this.keepArea.checked ? this.pattern.area : null,
      ...(width > 0 ? { constraints: { min_feature: `${width} mm` } } : {}),
    };
    try {
      replace(this.course, h("p", { class: "soft" }, "Following the gradient …"));
      await lines("sketch/improve", { body, signal: this.search.signal }, (step) => {
        if (step.error) throw Object.assign(new Error(step.error.message), { help: step.error.help });
        values.push(step.value);
        const pattern = Pattern.of(step.pattern);
        if (!this.best || step.value > this.best.value) this.best = { pattern, value: step.value };
        this.pattern.cells.set(pattern.cells);
        this.changed(true);
        const told = `${values.length} patterns, value ${number(values[0], 5)} → ${number(step.value, 5)} mm, area ${number(100 * step.area, 4)} %`;
        if (this.wanted !== null && step.value >= this.wanted && !step.done) {
          reached = true;
          this.search?.abort();
        }
        replace(this.course, h("p", { id: "course" }, reached ? `Reached: ${told}.` : step.done ? `Done: ${told}; nothing to first order gains any more.` : told), charts.line(values, "value, mm"));
        this.showBest();
      });
    } catch (error) {
      if (/** @type {any} */ (error).name !== "AbortError") replace(this.course, problem(error));
      else if (!reached) this.course.prepend(h("p", {}, "Stopped."));
    } finally {
      this.search = null;
      this.start.disabled = false;
      this.stop.disabled = true;
      if (!before.equals(this.pattern)) this.history.push(before);
      remember(this.scene, this.pattern);
      this.soon();
    }
  }

  showBest() {
    const best = this.best;
    if (!best) return;
    const canvas = h("canvas", { class: "thumb", role: "img", "aria-label": "The best pattern found" });
    replace(this.bestBox, canvas, h("div", {}, h("p", {}, `Best found: ${number(best.value, 5)} mm`), h("button", { type: "button", onclick: () => this.become(best.pattern) }, "Show it")));
    drawPattern(canvas, best.pattern);
  }
}

/** A field for a number: one of the type `number` would say nothing of a text that is none. @param {string} value @param {string} label @param {Record<string, any>} more */
function numeric(value, label, more) {
  return h("input", { type: "text", inputmode: "decimal", autocomplete: "off", value, "aria-label": label, ...more });
}

/** Says what is wrong beside a field; nothing where nothing is. @param {any} input @param {HTMLElement} place @param {string} wrong */
function said(input, place, wrong) {
  place.textContent = wrong;
  if (wrong) input.setAttribute("aria-invalid", "true");
  else input.removeAttribute("aria-invalid");
}

/** What was drawn last stays in this browser. @param {any} scene */
function kept_pattern(scene) {
  try {
    // What another view has sent here goes before.
    const sent = sessionStorage.getItem("deaflow drawn");
    sessionStorage.removeItem("deaflow drawn");
    if (sent) return Pattern.of(JSON.parse(sent));
    const rows = JSON.parse(localStorage.getItem(`deaflow ${scene.name}`) ?? "null");
    return rows ? Pattern.of(rows) : null;
  } catch {
    return null;
  }
}

/** @param {any} scene @param {Pattern} pattern */
function remember(scene, pattern) {
  try {
    localStorage.setItem(`deaflow ${scene.name}`, JSON.stringify(pattern.asRows()));
  } catch {
    // A browser that keeps nothing draws as well.
  }
}

