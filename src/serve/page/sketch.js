// The sketchpad: a pattern, and the membrane that moves while it is drawn.

import { frame, json } from "./server.js";
import { attempt, bytes, choice, copying, h, labelled, near, number, problem, prose, replace, replaceUrl, roundedBy, seconds, settled, showInvalid } from "./elements.js";
import { SIDES, drawBar, drawMembrane, drawPattern, magnitudes } from "./membrane.js";
import { SEQUENTIAL, range, steps } from "./colours.js";
import { Pattern } from "./pattern.js";
import { firstPattern, gallery } from "./sketch-gallery.js";
import { kept } from "./sketch-kept.js";
import { linkTo, linked } from "./sketch-link.js";
import { Pen } from "./sketch-pen.js";
import { Numbers } from "./sketch-numbers.js";
import { Improve } from "./sketch-improve.js";
import { Files, PLACEHOLDER } from "./sketch-files.js";
import { pictureOf } from "./sketch-picture.js";
import { save } from "./files.js";
import { Compare, Effects } from "./sketch-panels.js";
import { PointPanel } from "./sketch-point.js";
import { Sweep } from "./sketch-sweep.js";
import { Voltage, volts } from "./sketch-voltage.js";

/** After this time without a stroke, critical voltage and error are computed, ms. */
const STILL = 250;
/** A request that takes longer is dropped for the next one, ms. */
const PATIENCE = 250;
/** Shorter solutions do not tell the pace of the machine, s. */
const SHORT = 0.01;

/** Colourings of the membrane: label, unit, divisor of the values, and whether the colours start at zero. */
const COLOURINGS = {
  displacement: ["displacement", "mm", 1, true],
  stress: ["larger principal stress", "kPa", 1e3, false],
  least_stress: ["smaller principal stress", "kPa", 1e3, false],
  field: ["true electric field", "MV/m", 1e6, true],
  tension: ["tension", "", 1, true],
  electrode: ["electrodes", "", 1, true],
};

/** The states of tension, by their codes. */
const TENSIONS = ["taut", "wrinkled", "slack"];

/** Their colours. */
const TENSION_COLOURS = [...steps(TENSIONS.map((_, code) => code), 0, TENSIONS.length - 1)].map((step) => SEQUENTIAL[step]);

/** On screens of this width the membrane is below the drawing, whose electrodes are then also drawn as they move. */
const NARROW = "(max-width: 49.99rem)";

/**
 * @typedef {{pattern?: number[][], scene?: string, query?: URLSearchParams, notes?: string[]}} First what the sketchpad opens with
 * @param {HTMLElement} view @param {First} first @returns {Promise<() => void>} a function that ends it
 */
export async function sketchpad(view, first = {}) {
  const found = await json("scenes");
  const pad = new Sketchpad(view, found, first);
  pad.build();
  return () => pad.end();
}

class Sketchpad {
  /** @param {HTMLElement} view @param {any} found scenes of the server @param {First} first */
  constructor(view, { scenes, examples, left_out: leftOut, refused, time_limit: limit }, first) {
    this.view = view;
    this.scenes = scenes;
    this.examples = examples;
    /** @type {any[]} */ this.refused = refused;
    /** Scenes that are not shown here. @type {{path: string, reason: string, help: string}[]} */ this.leftOut = leftOut;
    /** Time limit of a request, s. */ this.limit = limit;
    /** Time of a solution here, with these effects, relative to its price. */ this.pace = 1;
    /** What the reader of the first pattern did. @type {string[]} */ this.notes = first.notes ?? [];
    /** What is wrong with the link of the address. @type {any} */ this.linkError = null;
    const link = this.linkOf(first);
    this.scene = link?.scene ?? [...scenes, ...examples].find((scene) => scene.name === first.scene) ?? scenes[0];
    const before = kept(this.scene);
    const given = first.pattern?.length ? Pattern.of(first.pattern) : null;
    const fits = (/** @type {Pattern|null} */ pattern) => (pattern && pattern.columns === this.scene.columns && pattern.rows === this.scene.rows ? pattern : null);
    const known = link?.pattern ?? fits(given) ?? fits(before);
    /** Whether the sketchpad begins with a pattern of its own, which moves once. */ this.isFirst = known === null;
    /** The pattern; it has electrodes only on the membrane. */
    this.pattern = known ?? firstPattern(this.scene);
    this.trim();
    this.state = this.scene.states[0] ?? null;
    this.voltage = this.ownVoltage();
    this.pen = new Pen(this);
    this.pen.group = this.driven()[0] ?? 1;
    this.numbers = new Numbers(this);
    this.improving = new Improve(this);
    this.files = new Files(this);
    this.comparing = new Compare(this);
    this.screening = new Effects(this);
    this.drive = new Voltage(this);
    this.sweeping = new Sweep(this);
    this.pointing = new PointPanel(this);
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
    /** @type {number|null} */ this.criticalError = null;
    /** The drawing whose critical voltage is known. */ this.criticalOf = "";
    /** @type {any} */ this.shown = null;
    /** A stable state, with the drawing that it belongs to, and whether it is the last one along the voltage. @type {{key: string, shown: any, isLast: boolean, at?: number}|null} */ this.stable = null;
    /** The drawing and the fields whose last stable state is being computed. */ this.finding = "";
    /** The target of the point, mm; null without one. @type {number|null} */ this.target = null;
    /** Fields with an invalid value: the numbers are for the values before. @type {Set<string>} */ this.invalid = new Set();
    /** Whether the last request failed. */ this.failed = false;
    this.version = 0;
    this.sent = -1;
    /** @type {{controller: AbortController, began: number, version: number}|null} */ this.flight = null;
    this.latest = -1;
    this.frame = 0;
    this.fresh = false;
    /** What has to be drawn in the next frame. */
    this.stale = { pad: false, membrane: false };
    this.still = settled(() => this.refine(), STILL);
    this.ended = false;
    if (link) {
      Object.assign(this, link.values);
      if (before && fits(before)) this.pen.history.push(/** @type {Pattern} */ (before));
      this.pen.take(this.driven()[0] ?? 1);
    }
    this.narrow = window.matchMedia(NARROW);
    this.redraw = () => this.soon();
    window.addEventListener("resize", this.redraw);
    this.dark = window.matchMedia("(prefers-color-scheme: dark)");
    this.dark.addEventListener("change", this.redraw);
  }

  /** Reads the drawing of a link, once. @param {First} first */
  linkOf({ query }) {
    if (!query?.has("cells")) return null;
    // After a reload, the drawing of the tab is shown.
    replaceUrl("#/sketch");
    try {
      return linked(query, [...this.scenes, ...this.examples]);
    } catch (error) {
      this.linkError = error;
      return null;
    }
  }

  end() {
    this.ended = true;
    this.sweeping.stop();
    cancelAnimationFrame(this.frame);
    this.flight?.controller.abort();
    this.improving.end();
    this.pen.end();
    window.removeEventListener("resize", this.redraw);
    this.dark.removeEventListener("change", this.redraw);
  }

  build() {
    const label = "Drawing area. Arrow keys move the cursor, space draws, B E R O L F choose a tool, Ctrl Z undoes. For a rectangle, an ellipse or a line, space sets the first and then the second corner; Escape cancels.";
    this.canvas = h("canvas", { class: "pad", tabindex: "0", role: "application", "aria-label": label, id: "pad" });
    this.membrane = h("canvas", { class: "membrane", role: "img", "aria-label": "Deformed membrane", id: "membrane" });
    this.bar = h("canvas", { class: "bar", "aria-hidden": "true" });
    this.legend = h("p", { class: "legend soft" });
    this.line = h("p", { class: "narrow-only sticky", id: "value-line", "aria-hidden": "true" });
    replace(
      this.view,
      h("h1", {}, "Sketchpad"),
      this.line,
      this.linkError ? problem(this.linkError) : null,
      this.sceneControls(),
      this.leftOutLine(),
      this.refusals(),
      h(
        "div",
        { class: "pads" },
        h("section", { "aria-label": "Draw" }, h("h2", {}, "Draw"), this.pen.toolbar(), this.canvas, this.areaLine()),
        h("section", { "aria-label": "Membrane" }, h("h2", {}, "Membrane"), this.colouringControls(), this.membrane, this.bar, this.legend, this.sweeping.panel()),
        this.numbers.panel(this.methodControls()),
      ),
      h("div", { class: "panels" }, gallery(this), this.pointing.panel(), this.improving.panel(), this.files.panel(), this.comparing.panel(), this.screening.panel()),
    );
    this.pen.listen(this.canvas);
    this.pointing.listen(this.membrane);
    this.soon();
    this.changed(true);
  }

  /** The scenes that are not shown here, in one line; it opens to the reasons. */
  leftOutLine() {
    if (!this.leftOut.length) return null;
    const reason = (/** @type {any} */ { path, reason, help }) => h("p", {}, h("span", { class: "mono" }, near(path)), ": ", prose(`${reason}. ${help[0].toUpperCase()}${help.slice(1).replaceAll(path, near(path))}.`));
    return h("details", { class: "small soft", id: "left-out" }, h("summary", {}, `Not shown here: ${this.leftOut.map(({ path }) => near(path)).join(", ")}`), this.leftOut.map(reason));
  }

  /** How numbers without a unit in the scene were read, how the first pattern was, and scenes that cannot be used, with their errors. */
  refusals() {
    const one = (/** @type {any} */ { path, error }) => h("details", { class: "small refused", open: true }, h("summary", {}, h("span", { class: "error" }, "invalid scene: "), h("span", { class: "mono" }, near(path))), problem(error));
    const note = this.scene.note ? h("p", { class: "small warning", id: "scene-note" }, this.scene.note) : null;
    const read = this.notes.map((text) => h("p", { class: "small warning", "data-note": "pattern" }, text));
    return h("div", {}, note, read, this.refused.map(one));
  }

  sceneControls() {
    const all = this.scenes.includes(this.scene) ? this.scenes : [...this.scenes, this.scene];
    const scenes = all.map((scene) => [scene.name, scene.name]);
    const play = this.scene.driven_by_charge ? null : this.sweeping.button();
    this.groupText = h("span", { class: "soft", id: "group-voltages" });
    return h(
      "div",
      { class: "controls" },
      all.length > 1 ? labelled("Scene", choice("scene", /** @type {any} */ (scenes), this.scene.name, (name) => this.reopen({ scene: name }))) : h("span", {}, "Scene ", h("b", {}, this.scene.name)),
      this.scene.states.length ? labelled("State", choice("state", this.scene.states.map((/** @type {string} */ name) => [name, name]), this.state ?? "", (name) => this.setState(name))) : null,
      this.scene.driven_by_charge
        ? h("span", { class: "soft" }, "driven by a charge")
        : this.drive.control(play),
      this.groupText,
    );
  }

  /** The voltages of the groups in the present state, as in the scene, V. @returns {number[]} */
  ownVoltages() {
    const own = this.scene.voltages[Math.max(this.scene.states.indexOf(this.state), 0)] ?? [];
    // Conversion from kV leaves rounding errors.
    return own.map((/** @type {number} */ voltage) => Number(voltage.toPrecision(12)));
  }

  /** The largest of them. */
  ownVoltage() {
    return Math.max(...this.ownVoltages(), 0);
  }

  /** The groups that have a voltage in this state. @returns {number[]} */
  driven() {
    return this.ownVoltages().flatMap((voltage, at) => (voltage > 0 ? [at + 1] : []));
  }

  /** Shows the voltage of each group; the others are proportional to the largest one. @param {number} [largest] */
  showGroupVoltages(largest = this.voltage) {
    if (this.scene.groups < 2 || this.scene.driven_by_charge) return;
    const most = this.ownVoltage();
    const words = this.ownVoltages().map((voltage, at) => `group ${at + 1}: ${number(most ? (voltage * largest) / most : 0, 6)} V`);
    this.groupText.textContent = words.join(", ");
  }

  /** Switches to another state of the device, with its own voltages. @param {string} name */
  setState(name) {
    this.state = name;
    const driven = this.driven();
    if (!driven.includes(this.pen.group)) this.pen.take(driven[0] ?? 1);
    this.drive.set(this.ownVoltage());
  }

  /** Removes electrodes outside of the membrane. */
  trim() {
    const { parts } = this.scene;
    if (parts) this.pattern.cells.forEach((value, at) => value && parts[at] && (this.pattern.cells[at] = 0));
  }

  /** The area of a pattern: the share of the membrane that is neither frame nor body, and mm² on the prestretched membrane. @param {Pattern} pattern */
  areaOf(pattern) {
    const { parts, size_mm: [width, height] } = this.scene;
    const free = parts ? parts.filter((/** @type {number} */ part) => !part).length : pattern.cells.length;
    const active = pattern.cells.reduce((sum, cell, at) => sum + (cell && !parts?.[at] ? 1 : 0), 0);
    const share = active / Math.max(free, 1);
    return { share, text: `area ${number(100 * share, 4)} %${parts ? " of the membrane" : ""}, ${number((active * width * height) / pattern.cells.length)} mm²` };
  }

  /** The end of the slider: 1, 2 or 5 times a power of ten, so that the limits of most drawings need the same. */
  mostVoltage() {
    const least = 1.2 * Math.max(this.ownVoltage(), this.critical ?? 0, 1000);
    const power = 10 ** Math.floor(Math.log10(least));
    return power * ([1, 2, 5].find((step) => step * power >= least) ?? 10);
  }

  areaLine() {
    this.area = h("p", { class: "soft small", id: "area" });
    this.invitation = h("p", { id: "invitation" });
    const link = copying("Copy a link that holds the drawing", () => linkTo(this), { id: "copy-link", title: "Pattern, scene, voltage, point and mesh are in the link" });
    const where = h("span", { class: "soft small" }, "It opens on this machine, while this server runs.");
    return [this.invitation, this.area, h("div", { class: "tools" }, link, where)];
  }

  colouringControls() {
    const options = Object.entries(COLOURINGS).map(([name, [text]]) => [name, String(text)]);
    const scales = [["1", "true to scale"], ["2", "×2"], ["3", "×3"], ["5", "×5"], ["10", "×10"]];
    return h(
      "div",
      { class: "tools" },
      labelled("Colour", choice("colouring", /** @type {any} */ (options), this.colouring, (name) => this.take({ colouring: name }))),
      labelled("Scale", choice("scale", /** @type {any} */ (scales), String(this.scale), (value) => {
        this.scale = Number(value);
        this.soon();
      })),
      h("button", { type: "button", id: "save-picture", title: "The coloured, deformed membrane as PNG", onclick: () => void this.savePicture() }, "Save the picture"),
    );
  }

  /** Saves the membrane as it is drawn, with its colours, as PNG. */
  async savePicture() {
    this.sweeping.stop();
    const drawn = this.membraneDrawing();
    const [low, high] = drawn.ends;
    const colours = drawn.values ? (drawn.isTension ? TENSIONS.map((text, code) => ({ text, colour: TENSION_COLOURS[code] })) : null) : [];
    const voltage = this.scene.driven_by_charge ? "" : `, ${volts(drawn.voltage)}`;
    const lines = [`${this.scene.name}${this.state ? `, ${this.state}` : ""}${voltage}`, `${this.scale === 1 ? "displacements true to scale" : `displacements drawn ${this.scale} times as large`}`];
    const blob = await pictureOf({ lines, name: drawn.name, ends: [low, high], colours, draw: (canvas) => this.drawMembraneOn(canvas, drawn) });
    if (blob) save(blob, `${this.files.fileName()}-membrane.png`);
  }

  methodControls() {
    const methods = [["newton", "Newton"], ["linear", "linear estimate"], ["chord:1", "1 chord step"], ["chord:2", "2 chord steps"], ["chord:4", "4 chord steps"]];
    const elements = ["1", "2", "3", "4", "8"].map((count) => [count, count]);
    this.elementsChoice = choice("elements", /** @type {any} */ (elements), String(this.elements), (count) => this.take({ elements: Number(count) }));
    this.orderChoice = choice("order", [["1", "bilinear"], ["2", "biquadratic"]], String(this.order), (order) => this.take({ order: Number(order) }));
    this.priceText = h("p", { class: "soft small", id: "price" });
    this.showPrices();
    return h(
      "fieldset",
      {},
      h("legend", {}, "Method and mesh"),
      labelled("Method", choice("method", /** @type {any} */ (methods), this.method, (method) => this.take({ method }))),
      labelled("Elements per cell", this.elementsChoice),
      labelled("Order", this.orderChoice),
      this.priceText,
    );
  }

  /** The price of a mesh; undefined if the page does not solve it. @param {number} elements @param {number} order */
  price(elements, order) {
    return this.scene.prices.find((/** @type {any} */ price) => price.elements_per_cell === elements && price.order === order);
  }

  /** Shows what each mesh costs, before it is chosen. */
  showPrices() {
    const words = (/** @type {number} */ elements, /** @type {number} */ order) => {
      const price = this.price(elements, order);
      return price ? `about ${seconds(Number((this.pace * price.seconds).toPrecision(1)))}, ${bytes(Number(price.bytes.toPrecision(1)))}` : "too fine for the page";
    };
    for (const option of this.elementsChoice.options) option.textContent = `${option.value} (${words(Number(option.value), this.order)})`;
    for (const option of this.orderChoice.options) option.textContent = `${option.value === "1" ? "bilinear" : "biquadratic"} (${words(this.elements, Number(option.value))})`;
    const own = this.price(this.elements, this.order);
    const isLong = own && this.pace * own.seconds > this.limit;
    this.priceText.textContent = `Time and memory with the critical voltage and the error; a request ends after ${seconds(this.limit)}.${isLong ? " This mesh probably takes longer." : ""}`;
  }

  /** Adapts the prices to this machine, pattern and effects, by the time of a solution. @param {any} found */
  learnPace(found) {
    const price = this.price(found.elements_per_cell, found.order);
    if (!price || found.method !== "newton") return;
    this.pace = Math.min(Math.max(found.seconds, SHORT) / Math.max(price.solution, SHORT), 100);
    this.showPrices();
  }

  /** Clears an element, and runs an action whose error it shows. @param {any} element @param {() => Promise<void>} act */
  async attempt(element, act) {
    replace(element);
    await attempt(element, act);
  }

  /** @param {First} first */
  reopen(first) {
    this.end();
    void sketchpad(this.view, first);
  }

  /** @param {Record<string, any>} values */
  take(values) {
    Object.assign(this, values);
    if ("elements" in values || "order" in values) this.showPrices();
    this.changed(false);
  }

  /** The body of a request. @param {boolean} quick */
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
      ...(this.scene.driven_by_charge || this.voltage === this.ownVoltage() ? {} : { voltage: this.voltage }),
      ...(this.state ? { state: this.state } : {}),
      ...(this.effects ? { effects: this.effects } : {}),
    };
  }

  /** Identifies what the critical voltage depends on: the drawing, the state, effects, method and mesh. */
  setupKey() {
    return [this.pattern.cells.join(""), this.state, this.effects, this.method, this.elements, this.order].join(" ");
  }

  /** Reacts to a change. @param {boolean} drawn whether the pattern changed */
  changed(drawn) {
    if (drawn) this.trim();
    this.version += 1;
    this.numbers.results.dataset.settled = "false";
    const key = this.setupKey();
    // Nothing is claimed of another drawing.
    if (this.criticalOf !== key) this.drive.forget();
    if (this.stable?.key !== key) this.stable = null;
    this.sweeping.check();
    this.comparing.check();
    this.screening.check();
    this.grey();
    this.still();
    this.next();
    // The membrane is drawn with the response.
    this.soon(true, drawn && !this.shown?.arrays.displacement);
  }

  /** Requests the latest solution: one request at a time, and a slow one is dropped for it. */
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
    this.waiting();
    void this.reproduce();
  }

  /** Shows how long the error is being computed: with effects, it takes seconds. */
  waiting() {
    const [{ version }, began] = [this, performance.now()];
    const tick = () => {
      const place = this.view.querySelector("#error");
      if (this.ended || version !== this.version || !this.shown?.quick || this.failed || !place) return;
      const passed = Math.round((performance.now() - began) / 1000);
      if (passed > 0) place.textContent = `computing (${passed} s)`;
      setTimeout(tick, 1000);
    };
    tick();
  }

  /** Requests the command and the stages that reproduce the numbers. */
  async reproduce() {
    const { version } = this;
    try {
      const found = await json("sketch/reproduce", { body: { ...this.body(true), fields: [], name: PLACEHOLDER } });
      if (this.ended || version !== this.version) return;
      this.reproduced = version;
      this.files.take(found);
      this.grey();
    } catch {
      // The request of the solution reports the same error.
    }
  }

  /** @param {boolean} quick */
  async solve(quick) {
    const flight = { controller: new AbortController(), began: performance.now(), version: this.version };
    if (quick) this.flight = flight;
    else if (this.refining) this.refining.abort();
    if (!quick) this.refining = flight.controller;
    const pattern = this.pattern.copy();
    const key = this.setupKey();
    try {
      const { document, arrays } = await frame("sketch", { body: this.body(quick), signal: flight.controller.signal });
      // A response that is older than the shown one is dropped.
      if (this.ended || flight.version < this.latest || (!quick && flight.version !== this.version)) return;
      this.latest = flight.version;
      this.failed = false;
      const kept = quick && this.shown ? { critical_voltage: null, error: null } : {};
      this.shown = { pattern, document: { ...document, ...kept }, arrays, quick, took: performance.now() - flight.began };
      // The last stable state stays: dragging the slider around the limit must not compute it each time.
      if (!quick) [this.criticalOf, this.critical, this.criticalError] = [key, document.critical_voltage, document.critical_voltage_error];
      // The numbers are those of finer meshes: beyond their limit, the state at it is drawn.
      const last = document.bracket ? Math.min(document.bracket[0], (this.criticalOf === key ? this.critical : null) ?? Infinity) : null;
      if (arrays.displacement && !this.lastStable(key)) this.stable = key === this.setupKey() ? { key, shown: this.shown, isLast: false } : null;
      else if (!arrays.displacement && last !== null && this.lastStable(key)?.at !== last) void this.findStable(key, pattern, last);
      this.fresh = true;
      this.soon(this.heat || this.narrow.matches, true);
    } catch (error) {
      if (/** @type {any} */ (error).name === "AbortError" || this.ended) return;
      // The error of an older request does not matter any more.
      if (flight.version < this.latest || flight.version !== this.version) return;
      this.failed ||= flight.version > this.latest;
      replace(this.numbers.notice, problem(error));
      this.drive.fail();
      this.grey();
    } finally {
      if (this.flight === flight) {
        this.flight = null;
        this.next();
      }
    }
  }

  /** Requests the last stable state of a drawing that has none at its voltage. @param {string} key @param {Pattern} pattern @param {number} voltage */
  async findStable(key, pattern, voltage) {
    const body = { ...this.body(true), voltage };
    const wanted = `${key} ${body.fields} ${voltage}`;
    if (this.finding === wanted) return;
    this.finding = wanted;
    try {
      const { document, arrays } = await frame("sketch", { body });
      if (this.ended || key !== this.setupKey() || !arrays.displacement) return;
      this.stable = { key, shown: { pattern, document, arrays, quick: true }, isLast: true, at: voltage };
      this.soon(true, true);
    } catch {
      // Another stable state or the membrane at rest stays; the request of the solution reports errors.
    } finally {
      if (this.finding === wanted) this.finding = "";
    }
  }

  /** The last stable state of a drawing along the voltage, with the fields of the present colouring; null if it is not known. @param {string} key */
  lastStable(key) {
    const known = this.stable?.key === key && this.stable.isLast && this.body(true).fields.every((name) => name === "sensitivity" || name in (this.stable?.shown.arrays ?? {}));
    return known ? this.stable : null;
  }

  /** The state that is drawn: that of the last response, or else a stable one of the drawing. */
  stableState() {
    if (this.shown?.arrays.displacement) return this.shown;
    return this.stable?.key === this.setupKey() ? this.stable.shown : null;
  }

  /** Shows an invalid value beside its field, and turns the numbers grey until it is corrected. @param {string} name @param {any} input @param {HTMLElement} place @param {string} wrong */
  showInvalid(name, input, place, wrong) {
    showInvalid(input, place, wrong);
    if (wrong) this.invalid.add(name);
    else this.invalid.delete(name);
    this.grey();
  }

  /** Turns grey what is for the values before: a field is invalid, or the last request failed. */
  grey() {
    const old = this.failed || this.invalid.size > 0;
    const { results } = this.numbers;
    for (const element of [results, this.membrane, this.bar, this.legend, this.line, this.numbers.notice]) element?.classList.toggle("old", old);
    // The critical voltage is computed after a pause.
    this.drive.text?.classList.toggle("old", old || results.dataset.settled !== "true");
    // Obsolete numbers must not be copied.
    if (this.numbers.copy) this.numbers.copy.disabled = old;
    results.title = old ? "for the values before" : "";
    // Command and stages follow after a pause.
    const other = old || this.reproduced !== this.version;
    for (const element of [this.numbers.command, this.files.stages]) element?.classList.toggle("old", other);
  }

  /** Draws in the next frame, once for all changes until then. */
  soon(pad = true, membrane = true) {
    this.stale.pad ||= pad;
    this.stale.membrane ||= membrane;
    if (this.frame || this.ended) return;
    this.frame = requestAnimationFrame(() => {
      this.frame = 0;
      if (this.ended) return;
      const area = this.areaOf(this.pattern);
      this.area.textContent = this.pen.size ? `${area.text}; ${this.pen.size}` : area.text;
      this.invitation.textContent = area.share > 0 ? "" : "Draw an electrode here, or open a file under Files.";
      this.pen.mark();
      if (this.fresh) {
        this.fresh = false;
        this.numbers.count();
        this.show();
      }
      this.draw();
    });
  }

  show() {
    const { document: found, quick } = this.shown;
    if (!quick) {
      this.drive.showLimit(found);
      if (this.isFirst && found.max_displacement !== null && !this.scene.driven_by_charge && !this.sweeping.still.matches) void this.sweeping.start();
      this.isFirst = false;
    }
    this.learnPace(found);
    if (!this.sweeping.isPlaying) this.showNumbers();
    else if (!quick) this.sweeping.isSettled = true;
    this.grey();
  }

  /** Shows the numbers of the last response. */
  showNumbers() {
    if (!this.shown) return;
    const { document: found, quick } = this.shown;
    this.numbers.show();
    const known = quick ? null : found.error;
    this.line.textContent = found.max_displacement === null ? `no stable state: ${found.outcome}` : `value ${roundedBy(found.value, known)} mm, largest ${roundedBy(found.max_displacement, known)} mm`;
  }

  draw() {
    const { pad, membrane } = this.stale;
    this.stale = { pad: false, membrane: false };
    if (pad) this.drawPad();
    if (membrane) this.drawMembrane();
  }

  /** @param {{pattern: Pattern, displacement: Float32Array}|null} [played] the state of a sweep */
  drawPad(played = null) {
    const { size_mm: size, parts, borders } = this.scene;
    const shown = this.narrow.matches ? this.stableState() : null;
    const moved = played ?? (shown ? { pattern: shown.pattern, displacement: shown.arrays.displacement.data } : null);
    const sensitivity = this.heat ? this.shown?.arrays.sensitivity?.data : null;
    this.heatNote.textContent = this.heat
      ? sensitivity
        ? `vermillion: an electrode here increases the value, blue: it decreases it; at most ${number(Math.max(...range(sensitivity).map(Math.abs)), 3)} mm for one cell, to first order`
        : "not available for this method, these effects or this outcome"
      : "";
    drawPattern(this.canvas, this.pattern, {
      ratio: size[1] / size[0],
      grid: true,
      parts,
      borders,
      sides: this.scene.sides,
      cursor: this.pen.showCursor ? this.pen.cursor : null,
      heat: sensitivity ?? null,
      point: [this.point[0] / size[0], this.point[1] / size[1]],
      direction: this.direction,
      moved: moved ? { ...moved, size, scale: this.scale } : null,
    });
  }

  /** What is drawn of the membrane: the state, its values, and the ends of their colours in words. */
  membraneDrawing() {
    const { columns, rows } = this.pattern;
    const shown = this.stableState();
    const displacement = /** @type {Float32Array|null} */ (shown?.arrays.displacement.data ?? null);
    const pattern = displacement ? shown.pattern : this.pattern;
    /** @type {ArrayLike<number>|null} */ let values = null;
    if (displacement && this.colouring === "displacement") values = magnitudes(displacement, columns, rows);
    else if (displacement && this.colouring !== "electrode") values = shown.arrays[this.colouring]?.data ?? null;
    const [title, unit, factor, fromZero] = /** @type {any} */ (COLOURINGS)[this.colouring];
    const isTension = this.colouring === "tension";
    const [least, most] = values ? range(values) : [0, 0];
    const [low, high] = isTension ? [0, TENSIONS.length - 1] : [fromZero ? Math.min(0, least) : least, most];
    // The error is that of displacements.
    const known = this.colouring === "displacement" && shown && !shown.quick ? shown.document.error : null;
    const ends = [low, high].map((end) => (end === 0 ? "0" : roundedBy(end / factor, known, 3)));
    ends[1] += ` ${unit}`;
    return { shown, displacement, pattern, values, low, high, ends, isTension, name: values ? title : "electrodes", voltage: shown?.document.voltage ?? this.voltage };
  }

  /** @param {HTMLCanvasElement} canvas @param {ReturnType<Sketchpad["membraneDrawing"]>} drawn */
  drawMembraneOn(canvas, { pattern, displacement, values, low, high }) {
    const { size_mm: size, parts, borders, sides } = this.scene;
    drawMembrane(canvas, pattern, displacement, { size, scale: this.scale, values, parts, borders, sides, low, high, point: this.point, direction: this.direction });
  }

  /** A hidden bar has no width to be drawn in. @param {boolean} isShown */
  showBar(isShown) {
    this.bar.hidden = !isShown;
    if (isShown) drawBar(this.bar, false);
  }

  drawMembrane() {
    // A sweep draws the membrane itself.
    if (this.sweeping.isPlaying) return;
    const drawn = this.membraneDrawing();
    const { shown, displacement, values, isTension } = drawn;
    const isOther = shown !== null && shown !== this.shown;
    this.drawMembraneOn(this.membrane, drawn);
    this.legend.classList.toggle("error", isOther);
    this.showBar(Boolean(values) && !isTension);
    const swatch = (/** @type {string} */ text, /** @type {number} */ code) => {
      const mark = h("span", { class: "swatch" });
      mark.style.background = TENSION_COLOURS[code];
      return h("span", { class: "named" }, mark, text);
    };
    /** @type {any[]} */ let words;
    if (values) words = isTension ? ["tension: ", TENSIONS.map(swatch)] : [`${drawn.name}: ${drawn.ends.join(" to ").trim()}`];
    else words = [this.colouring === "electrode" || !this.shown || displacement ? "electrodes" : "no stable state: the membrane is shown at rest"];
    if (isOther) words.unshift(`no stable state at ${volts(this.voltage)}; this is ${this.otherState()}: `);
    if (this.scene.sides) words.push(`; ${SIDES}`);
    replace(this.legend, words);
  }

  /** Which state is drawn in place of one that is not stable. */
  otherState() {
    const stable = /** @type {NonNullable<Sketchpad["stable"]>} */ (this.stable);
    const { voltage } = stable.shown.document;
    if (!stable.isLast) return `a stable one, at ${number(voltage)} V`;
    if (this.criticalOf === stable.key && this.critical === stable.at) return `the last stable one, at ${roundedBy(voltage, this.criticalError)} V`;
    return `the last stable one on this mesh, at ${number(voltage)} V`;
  }

  /** @param {string} method @param {number} elements @param {number} order */
  adopt(method, elements, order) {
    const chosen = /** @type {[string, string][]} */ ([["method", method], ["elements", String(elements)], ["order", String(order)]]);
    for (const [name, value] of chosen) /** @type {HTMLSelectElement} */ (this.view.querySelector(`select[name=${name}]`)).value = value;
    this.take({ method, elements, order });
  }
}
