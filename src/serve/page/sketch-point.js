// The point of the sketchpad and its direction: as fields, and dragged on the membrane.

import { h, labelled, numeric, showInvalid } from "./elements.js";
import { ARROW, Placement } from "./membrane.js";
import { HINTS, quantity } from "./quantity.js";

/** Distance within which a point is taken, px. */
const NEAR = 16;

/** A dragged point lies on tenths of a millimetre. */
const TENTHS = 10;

export class PointPanel {
  /** @param {any} pad */
  constructor(pad) {
    this.pad = pad;
    /** What is dragged. @type {"point"|"direction"|null} */ this.held = null;
  }

  panel() {
    const { pad } = this;
    const [width, height] = pad.scene.size_mm;
    const field = (/** @type {string} */ label, /** @type {"length"|"angle"} */ dimension, /** @type {number} */ value, /** @type {number} */ least, /** @type {number} */ most, /** @type {(value: number) => void} */ set) => {
      const errorText = h("span", { class: "error", role: "alert" });
      const input = numeric(String(value), label, { title: HINTS[dimension], oninput: () => {
        const found = quantity(input.value, dimension, least, most);
        pad.showInvalid(label, input, errorText, found.wrong);
        if (found.wrong) return;
        set(found.value);
        pad.changed(false);
      } });
      const show = (/** @type {number} */ number) => {
        input.value = String(number);
        pad.showInvalid(label, input, errorText, "");
      };
      return { control: labelled(label, input, errorText), show };
    };
    const errorText = h("span", { class: "error", role: "alert" });
    const target = numeric("", "target value", { name: "wanted", placeholder: "none", title: `${HINTS.length}; Improve searches for the nearest pattern`, oninput: () => {
      const found = target.value.trim() ? quantity(target.value, "length", -1e3, 1e3) : { value: NaN, wrong: "" };
      showInvalid(target, errorText, found.wrong);
      if (found.wrong) return;
      pad.target = Number.isFinite(found.value) ? found.value : null;
      if (pad.shown) pad.show();
    } });
    this.x = field("x, mm", "length", pad.point[0], 0, width, (value) => (pad.point = [value, pad.point[1]]));
    this.y = field("y, mm", "length", pad.point[1], 0, height, (value) => (pad.point = [pad.point[0], value]));
    this.angle = field("direction, °", "angle", pad.direction, -360, 360, (value) => (pad.direction = value));
    pad.heatNote = h("p", { class: "soft small" });
    return h(
      "section",
      { class: "panel" },
      h("h2", {}, "Point"),
      h("p", { class: "soft small" }, "Drag the point, or the tip of its arrow, on the membrane."),
      h("div", { class: "tools" }, this.x.control, this.y.control, this.angle.control, labelled("target, mm", target, errorText)),
      h("label", { class: "toggle" }, h("input", { type: "checkbox", name: "heat", onchange: (/** @type {any} */ event) => pad.take({ heat: event.target.checked }) }), "Show the effect of each cell (adjoint)"),
      pad.heatNote,
    );
  }

  /** @param {HTMLCanvasElement} canvas of the deformed membrane */
  listen(canvas) {
    canvas.addEventListener("pointerdown", (event) => {
      this.held = this.under(canvas, event);
      if (!this.held) return;
      event.preventDefault();
      canvas.setPointerCapture(event.pointerId);
    });
    // A finger that drags the point does not scroll the page.
    canvas.addEventListener("touchstart", (event) => event.touches.length === 1 && this.under(canvas, event.touches[0]) && event.preventDefault(), { passive: false });
    canvas.addEventListener("pointermove", (event) => {
      if (this.held) this.drag(canvas, event);
      else canvas.style.cursor = this.under(canvas, event) ? "grab" : "";
    });
    const up = () => (this.held = null);
    canvas.addEventListener("pointerup", up);
    canvas.addEventListener("pointercancel", up);
  }

  /** @param {HTMLCanvasElement} canvas @param {{clientX: number, clientY: number}} event @returns {[number, number]} */
  at(canvas, event) {
    const box = canvas.getBoundingClientRect();
    return [event.clientX - box.left, event.clientY - box.top];
  }

  /** @param {HTMLCanvasElement} canvas */
  placement(canvas) {
    const { scene, scale } = this.pad;
    const state = this.pad.stableState();
    return new Placement(canvas, scene.size_mm, state?.pattern ?? this.pad.pattern, state?.arrays.displacement.data ?? null, scale);
  }

  /** What lies under the pointer. @param {HTMLCanvasElement} canvas @param {{clientX: number, clientY: number}} event @returns {"point"|"direction"|null} */
  under(canvas, event) {
    const [x, y] = this.at(canvas, event);
    const [left, top] = this.placement(canvas).of(this.pad.point);
    const angle = (this.pad.direction * Math.PI) / 180;
    const length = ARROW * canvas.clientWidth;
    if (Math.hypot(x - left - length * Math.cos(angle), y - top + length * Math.sin(angle)) < NEAR) return "direction";
    return Math.hypot(x - left, y - top) < NEAR ? "point" : null;
  }

  /** @param {HTMLCanvasElement} canvas @param {PointerEvent} event */
  drag(canvas, event) {
    const { pad } = this;
    const placement = this.placement(canvas);
    const [x, y] = this.at(canvas, event);
    if (this.held === "point") {
      const { size_mm: size } = pad.scene;
      const tenths = placement.back([x, y]).map((value, axis) => Math.max(0, Math.min(Math.round(TENTHS * value) / TENTHS, size[axis])));
      pad.point = /** @type {[number, number]} */ (tenths);
      this.x.show(pad.point[0]);
      this.y.show(pad.point[1]);
    } else {
      const [left, top] = placement.of(pad.point);
      pad.direction = Math.round((Math.atan2(top - y, x - left) * 180) / Math.PI);
      this.angle.show(pad.direction);
    }
    pad.changed(false);
  }
}
