// The pen of the sketchpad: tools, strokes of the pointer, keys, and undo.

import { choice, h, labelled, number } from "./elements.js";
import { Mirrors, Pattern } from "./pattern.js";
import { keep, keptHistory } from "./sketch-kept.js";

/** Tools with two corners. */
const SHAPES = ["rectangle", "ellipse", "line"];

const TOOLS = [["brush", "Brush", "b"], ["eraser", "Eraser", "e"], ["rectangle", "Rectangle", "r"], ["ellipse", "Ellipse", "o"], ["line", "Line", "l"], ["fill", "Fill", "f"]];

export class Pen {
  /** @param {any} pad the sketchpad, whose pattern is drawn */
  constructor(pad) {
    this.pad = pad;
    this.scene = pad.scene;
    this.history = keptHistory(pad.scene);
    this.mirrors = new Mirrors();
    this.tool = "brush";
    this.diameter = 4;
    this.group = 1;
    /** @type {[number, number]} */ this.cursor = [Math.floor(this.scene.columns / 2), Math.floor(this.scene.rows / 2)];
    this.showCursor = false;
    /** The first corner of a shape that is drawn with keys. @type {{from: [number, number], before: Pattern}|null} */ this.corner = null;
    this.undoKeys = (/** @type {KeyboardEvent} */ event) => this.undoOrRedo(event);
    window.addEventListener("keydown", this.undoKeys);
    /** Size of the shape that is being drawn, in words. */ this.size = "";
  }

  end() {
    window.removeEventListener("keydown", this.undoKeys);
  }

  get pattern() {
    return this.pad.pattern;
  }

  toolbar() {
    const { scene } = this;
    const tool = (/** @type {string[]} */ [name, text, key]) =>
      h("button", { type: "button", "data-tool": name, "aria-pressed": String(this.tool === name), title: `${text} (${key.toUpperCase()})`, onclick: () => this.choose(name) }, text);
    const mirror = (/** @type {"across"|"along"|"quarter"} */ name, /** @type {string} */ text, /** @type {string} */ title) =>
      h("label", { class: "toggle", title }, h("input", { type: "checkbox", name, "aria-label": title, onchange: (/** @type {any} */ event) => (this.mirrors[name] = event.target.checked) }), text);
    const groups = Array.from({ length: scene.groups }, (_, at) => [String(at + 1), `group ${at + 1}`]);
    this.tools = h("div", { class: "tools", role: "group", "aria-label": "Tools" }, TOOLS.map(tool));
    this.groups = groups.length > 1 ? choice("group", /** @type {any} */ (groups), String(this.group), (value) => (this.group = Number(value))) : null;
    return [
      this.tools,
      h(
        "div",
        { class: "tools" },
        labelled("Width", h("input", { type: "range", min: "1", max: "15", value: String(this.diameter), "aria-label": "Width of the brush in cells", oninput: (/** @type {any} */ event) => (this.diameter = Number(event.target.value)) })),
        this.groups ? labelled("Electrode", this.groups) : null,
        mirror("across", "⇆ mirror", "Mirror left and right while drawing"),
        mirror("along", "⇅ mirror", "Mirror up and down while drawing"),
        scene.columns === scene.rows ? mirror("quarter", "⟳ quarters", "Turn by quarters while drawing") : null,
      ),
      h(
        "div",
        { class: "tools" },
        (this.undoButton = h("button", { type: "button", disabled: true, name: "undo", onclick: () => this.undo(), title: "Ctrl Z" }, "Undo")),
        (this.redoButton = h("button", { type: "button", disabled: true, name: "redo", onclick: () => this.redo(), title: "Ctrl Y" }, "Redo")),
        h("button", { type: "button", name: "clear", onclick: () => this.become(new Pattern(scene.columns, scene.rows)) }, "Clear"),
        h("button", { type: "button", onclick: () => this.inverted() }, "Invert"),
        h("button", { type: "button", onclick: () => this.turned() }, scene.columns === scene.rows ? "Turn" : "Turn by half"),
      ),
    ];
  }

  /** Enables undo and redo if there are steps. */
  mark() {
    this.undoButton.disabled = !this.history.past.length;
    this.redoButton.disabled = !this.history.future.length;
  }

  /** @param {number} group */
  take(group) {
    this.group = group;
    if (this.groups) this.groups.value = String(group);
  }

  /** @param {HTMLCanvasElement} canvas */
  listen(canvas) {
    this.canvas = canvas;
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
      this.pad.changed(true);
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
      this.pad.changed(true);
    });
    const up = () => {
      if (before && !before.equals(this.pattern)) this.history.push(before);
      from = before = null;
      this.size = "";
      this.remember();
      this.pad.soon();
    };
    canvas.addEventListener("pointerup", up);
    canvas.addEventListener("pointercancel", up);
    canvas.addEventListener("contextmenu", (/** @type {Event} */ event) => event.preventDefault());
    canvas.addEventListener("keydown", (/** @type {KeyboardEvent} */ event) => this.key(event));
    canvas.addEventListener("blur", () => {
      this.drop();
      this.showCursor = false;
      this.pad.soon();
    });
  }

  remember() {
    keep(this.scene, this.pattern, this.history);
  }

  /** @param {Pattern} before @param {[number, number]} from @param {[number, number]} to @param {number} value */
  apply(before, from, to, value) {
    this.pattern.cells.set(before.cells);
    if (this.tool === "rectangle" || this.tool === "ellipse") {
      this.pattern.shape(this.tool, from, to, value, this.mirrors);
      const { size_mm: size, columns, rows } = this.scene;
      const sides = [[0, columns], [1, rows]].map(([axis, cells]) => `${number(((Math.abs(to[axis] - from[axis]) + 1) * size[axis]) / cells)} mm`);
      this.size = `${this.tool} ${sides.join(" × ")}`;
    } else this.pattern.stroke(from, to, this.diameter, value, this.mirrors);
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
      // With shift, the pen is down.
      if (this.corner) {
        this.apply(this.corner.before, this.corner.from, this.cursor, value);
        this.pad.changed(true);
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
    this.pad.soon();
  }

  /** Sets the first corner of a shape, or the second one, which completes it. @param {number} value */
  setCorner(value) {
    if (!this.corner) {
      this.corner = { from: this.cursor, before: this.pattern.copy() };
      this.apply(this.corner.before, this.cursor, this.cursor, value);
      this.pad.changed(true);
      return;
    }
    const { before } = this.corner;
    this.corner = null;
    this.size = "";
    if (before.equals(this.pattern)) return;
    this.history.push(before);
    this.remember();
    this.pad.soon();
  }

  /** Removes a shape with only one corner. */
  drop() {
    if (!this.corner) return;
    this.pattern.cells.set(this.corner.before.cells);
    this.corner = null;
    this.size = "";
    this.pad.changed(true);
  }

  /** Ctrl Z and Ctrl Y, except in text fields. @param {KeyboardEvent} event */
  undoOrRedo(event) {
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
    this.pad.trim();
    if (before.equals(this.pattern)) return;
    this.history.push(before);
    this.remember();
    this.pad.changed(true);
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
    this.pad.pattern = pattern;
    this.remember();
    this.pad.changed(true);
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
}
