// The voltage of the sketchpad: a slider whose part above the critical voltage is red, a field, and what the limit is.

import { h, number, numeric, rangeEnds } from "./elements.js";
import { HINTS, quantity, withAssumedUnit } from "./quantity.js";

/** The highest voltage, V. */
const MOST_VOLTS = 1e6;

/** Half the width of the handle of a slider, px. */
const HANDLE = 8;

/** Digits of a voltage in its field: more would be rounding errors. */
const DIGITS = 7;

/** @param {number} value in V */
export function volts(value) {
  return `${Number(value.toPrecision(DIGITS))} V`;
}

/** @param {number} value in V */
export function kilovolts(value) {
  return value < 1000 ? `${number(value, 3)} V` : `${number(value / 1000, 3)} kV`;
}

/**
 * What limits the voltage of a drawing, the lowest first: in words as the limit, and as a voltage beside a lower one. Those before the loss of stability are
 * known only for the mesh of the drawing.
 * @param {any} found response with the critical voltage @returns {{voltage: number, what: string, beside: string}[]}
 */
export function limitsBefore(found) {
  const one = (/** @type {number|null|undefined} */ voltage, /** @type {string} */ what, /** @type {string} */ beside) => (voltage === null || voltage === undefined ? [] : [{ voltage, what, beside: `${beside} ${number(voltage)} V` }]);
  const all = [...one(found.breakdown_voltage, "breakdown field", "breakdown field at"), ...one(found.wrinkling_voltage, "wrinkles", "wrinkles from")];
  return all.sort((a, b) => a.voltage - b.voltage);
}

/** The highest voltage with three digits that is not above a limit. @param {number} limit */
function below(limit) {
  const unit = 10 ** (Math.floor(Math.log10(limit)) - 2);
  return Number((Math.floor(limit / unit) * unit).toPrecision(3));
}

export class Voltage {
  /** @param {any} pad */
  constructor(pad) {
    this.pad = pad;
    /** The lowest known limit of the drawing, V; null if it is unknown or there is none. @type {number|null} */ this.limit = null;
  }

  /** @param {any} more controls beside the slider */
  control(more) {
    const { pad } = this;
    this.range = h("input", { type: "range", min: "0", max: String(pad.mostVoltage()), step: "10", value: String(pad.voltage), id: "voltage", "aria-label": "Voltage", list: "critical" });
    this.field = numeric(volts(pad.voltage), `Voltage, ${HINTS.voltage}`, { id: "volts", title: HINTS.voltage });
    this.error = h("span", { class: "error", id: "voltage-trouble", role: "alert" });
    this.unit = h("span", { class: "soft", id: "voltage-unit", role: "status" });
    this.mark = h("option", {});
    this.zone = h("span", { class: "zone", id: "unstable-zone", hidden: true });
    this.text = h("span", { class: "soft", id: "critical-voltage" });
    this.go = h("button", { type: "button", id: "to-limit", hidden: true, onclick: () => this.limit !== null && this.set(below(this.limit)) });
    this.range.addEventListener("input", () => this.read(this.range.value));
    this.field.addEventListener("input", () => {
      const text = this.field.value;
      this.read(text);
      this.unit.textContent = this.field.hasAttribute("aria-invalid") ? "" : withAssumedUnit(text, "voltage");
    });
    this.field.addEventListener("blur", () => !this.field.hasAttribute("aria-invalid") && this.show());
    return h(
      "span",
      { class: "control grow" },
      h("span", {}, pad.scene.groups > 1 ? "Largest voltage" : "Voltage"),
      h("span", { class: "slider" }, this.range, this.zone),
      this.field,
      more,
      h("datalist", { id: "critical" }, this.mark),
      this.error,
      this.unit,
      this.text,
      this.go,
    );
  }

  /** @param {string} text */
  read(text) {
    const { value, wrong } = quantity(text, "voltage", 0, MOST_VOLTS);
    this.pad.showInvalid("voltage", this.field, this.error, wrong);
    if (!wrong) this.set(value);
  }

  /** @param {number} value */
  set(value) {
    const { pad } = this;
    pad.voltage = value;
    if (this.range) pad.showInvalid("voltage", this.field, this.error, "");
    if (this.range) this.unit.textContent = "";
    this.show();
    pad.changed(false);
  }

  /** Shows a voltage, which is that of the drawing unless another one is played. @param {number} [value] */
  show(value = this.pad.voltage) {
    if (!this.range) return;
    // It only grows, so that the handle stays where it is.
    this.range.max = String(Math.max(this.pad.mostVoltage(), value, Number(this.range.max)));
    this.range.value = String(value);
    // The text that somebody is writing stays.
    if (document.activeElement !== this.field) this.field.value = volts(value);
    this.place();
    this.pad.showGroupVoltages(value);
  }

  /** Marks the part of the slider above the limit, and offers to go there. */
  place() {
    const { limit } = this;
    const share = limit === null ? 1 : limit / Number(this.range.max);
    this.zone.hidden = limit === null;
    this.zone.style.left = `calc(${HANDLE}px + (100% - ${2 * HANDLE}px) * ${Math.min(share, 1)})`;
    this.go.hidden = limit === null || this.pad.voltage <= limit;
    if (limit !== null) this.go.textContent = `Go to ${kilovolts(below(limit))}`;
  }

  /** The limit is that of another drawing. */
  forget() {
    if (!this.range) return;
    this.limit = null;
    this.text.textContent = "computing the critical voltage …";
    this.text.title = "";
    this.mark.value = "";
    this.place();
  }

  /** The limit cannot be computed. */
  fail() {
    if (this.range && this.text.textContent.startsWith("computing")) this.text.textContent = "";
  }

  /** Shows the limits of a drawing, the lowest first. @param {any} found response with the critical voltage */
  showLimit(found) {
    if (!this.range) return;
    const { critical_voltage: at, critical_voltage_error: error } = found;
    const [stable, lost] = found.critical_bracket ?? [];
    const words = this.pad.numbers.critical(found);
    const [from, to] = stable === undefined ? ["", ""] : rangeEnds([stable, lost], error ?? 0);
    const own = stable === undefined ? "" : `this mesh alone: ${from === to ? from : `${from} to ${to}`} V`;
    // The command prints the limit of the mesh: if both differ, both are shown.
    const differs = own && error && (lost < at - error || stable > at + error);
    const [first, ...others] = limitsBefore(found);
    const stability = words === null ? null : `${words}${differs ? ` (${own})` : ""}`;
    this.limit = first?.voltage ?? (words === null ? null : Math.min(at, stable ?? at));
    this.mark.value = this.limit === null ? "" : String(first?.voltage ?? at);
    const beyond = [...others.map((one) => one.beside), stability === null ? "no instability found" : `stability is lost at ${stability}`];
    this.text.textContent = first ? `limit ${number(first.voltage)} V (${first.what}); ${beyond.join("; ")}` : stability === null ? "no instability found" : `limit ${stability}`;
    this.text.title = stable === undefined ? "" : `this mesh alone: ${stable} to ${lost} V`;
    this.show();
  }
}
