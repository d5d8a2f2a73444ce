// The numbers of the sketchpad: results, their errors, and the command that prints them.

import { copyable, copying, errorDigits, h, measured, number, prose, rangeEnds, replace, roundedBy, seconds } from "./elements.js";
import { limitsBefore } from "./sketch-voltage.js";

/** Explanations of outcomes. @type {Record<string, string>} */
const OUTCOMES = {
  converged: "a stable state was found",
  estimated: "an estimate, not an equilibrium",
  "pull-in": "the electrodes pull the membrane together (electromechanical instability)",
  "not-elliptic": "the membrane loses stability in a narrow band (loss of ellipticity)",
  slack: "the membrane is slack: it bears no load in one direction",
  "iteration-limit": "the solver did not converge; this does not mean that the membrane is unstable",
  "work-limit": "the solution takes too long for this page; use `deaflow solve --time-limit`",
  "no-estimate": "the estimate is not valid here; try Newton’s method",
};

/** A target is reached within this fraction of it, or within this difference in mm; as in `sketch/bisection.rs`. */
const TOLERANCE = 0.005;
const TOLERANCE_MM = 0.001;

/** Smaller values are rounding errors, mm. */
const ROUNDING = 1e-9;

/** Compares a value with its target; `error` is the error of method and mesh, mm. @param {number} value @param {number} target @param {number} error */
export function compareWithTarget(value, target, error = 0) {
  const off = Math.abs(value - target) < ROUNDING ? 0 : value - target;
  if (Math.abs(off) <= Math.max(TOLERANCE * Math.abs(target), TOLERANCE_MM)) return { reached: true, words: off === 0 ? "reached" : `reached, within ${number(Math.abs(off), 2)} mm` };
  return { reached: false, words: `${number(Math.abs(off), 3)} mm too ${off < 0 ? "small" : "large"}${Math.abs(off) <= error ? ", within the error of method and mesh" : ""}` };
}

/** Describes a mesh. @param {number} elements @param {number} order */
export function meshWords(elements, order) {
  return `${elements} ${order === 1 ? "bilinear" : "biquadratic"} element${elements === 1 ? "" : "s"} along a cell`;
}

/**
 * A number with its name. @param {string} name @param {string} title @param {string} text @param {string} unit @param {number|null} [exact]
 * @param {string|null} [about] what is shown over it
 */
function entry(name, title, text, unit, exact = null, about = null) {
  return [
    h("dt", {}, title),
    h("dd", { id: name, title: about ?? (exact === null ? null : `${exact} ${unit}`.trim()), "data-value": exact === null ? null : String(exact) }, text, unit && text !== "–" ? h("span", { class: "soft" }, ` ${unit}`) : null),
  ];
}

export class Numbers {
  /** @param {any} pad */
  constructor(pad) {
    this.pad = pad;
    this.results = h("dl", { class: "results", "aria-live": "polite", id: "results" });
    this.notice = h("div", { id: "notice" });
    this.timing = h("p", { class: "soft small", id: "timing" });
    this.command = h("div", { id: "command" });
    /** @type {any} */ this.reproduced = null;
    /** Time of a quick solution, without error and critical voltage, ms. @type {number|null} */ this.took = null;
    this.rate = { count: 0, since: performance.now(), last: 0, perSecond: 0 };
  }

  panel(/** @type {any} */ controls) {
    this.copy = copying("Copy the numbers", () => this.text(), { id: "copy-numbers", title: "With all digits, and the command that prints them" });
    return h("section", { "aria-label": "Numbers", class: "numbers" }, h("h2", {}, "Numbers"), this.results, h("div", { class: "tools" }, this.copy), this.notice, this.timing, controls, this.command);
  }

  /** Counts the updates of the membrane per second while somebody draws. */
  count() {
    const now = performance.now();
    if (now - this.rate.last > 1000) this.rate = { count: 0, since: now, last: now, perSecond: 0 };
    this.rate.last = now;
    this.rate.count += 1;
    if (now - this.rate.since > 500) {
      this.rate = { count: 0, since: now, last: now, perSecond: (1000 * this.rate.count) / (now - this.rate.since) };
    }
  }

  /** All numbers with all digits, and the command that prints them. */
  text() {
    const found = this.pad.shown?.document;
    if (!found) return "";
    const line = (/** @type {string} */ name, /** @type {any} */ value, /** @type {string} */ unit = "") => (value === null || value === undefined ? [] : [`${name}: ${value}${unit && ` ${unit}`}`]);
    return [
      ...line("outcome", found.outcome),
      ...line("largest displacement of the cell corners", found.max_displacement, "mm"),
      ...line("value at the point", found.value, "mm"),
      ...line("error of method and mesh", found.error, "mm"),
      ...line("critical voltage", found.critical_voltage, "V"),
      ...line("error of the critical voltage", found.critical_voltage_error, "V"),
      ...line("voltage at which the breakdown field is reached, on this mesh", found.breakdown_voltage, "V"),
      ...line("voltage from which the membrane wrinkles, on this mesh", found.wrinkling_voltage, "V"),
      ...line("largest field over breakdown strength", found.breakdown_ratio),
      ...line("smallest eigenvalue of the tangent", found.smallest_eigenvalue),
      ...(this.results.dataset.settled === "true" ? [] : ["error and critical voltage were still being computed"]),
      ...(this.reproduced ? [this.reproduced.command] : []),
      "",
    ].join("\n");
  }

  /** Shows the command that prints the numbers. @param {any} found @param {(text: string) => string} named inserts the name of the pattern */
  reproduce(found, named) {
    this.reproduced = found && { ...found, command: named(found.command) };
    if (!found) return;
    replace(this.command, h("p", { class: "small soft" }, `This command prints the same displacements with all digits; save the pattern as csv under Files${found.saved ? `, and the complete pipeline with this scene beside it as ${named(found.saved)}` : ""}, in the folder of the terminal:`), copyable(this.reproduced.command));
  }

  /** Shows the numbers of a state of a sweep in place of those of the drawing. @param {{voltage: number, largest: number, value: number|null, breakdown: number|null}} state @param {boolean} isAssumed whether the breakdown field is not that of the scene */
  play({ voltage, largest, value, breakdown }, isAssumed) {
    replace(
      this.results,
      entry("swept", "voltage of the sweep", number(voltage, 4), "V", voltage),
      entry("max-displacement", "largest displacement", number(largest), "mm", largest),
      value === null ? null : entry("value", "value at the point", number(Math.abs(value) < ROUNDING ? 0 : value), "mm", value),
      breakdown === null ? null : entry("breakdown", `largest field over breakdown strength${isAssumed ? " (of VHB 4910, as the scene has none)" : ""}`, number(breakdown, 3), "", breakdown),
    );
    replace(this.notice);
  }

  show() {
    const { pad } = this;
    const { document: found, quick, took } = pad.shown;
    if (quick) this.took = took;
    const against = pad.target === null || found.value === null ? null : compareWithTarget(found.value, pad.target, quick ? 0 : found.error ?? 0);
    // A quick answer has no error yet.
    const known = quick ? null : found.error;
    replace(
      this.results,
      entry("outcome", "outcome", this.isOfMesh(found) ? `${found.outcome}, on this mesh only` : found.outcome, "", null, OUTCOMES[found.outcome]?.replaceAll("`", "") ?? null),
      entry("max-displacement", "largest displacement", roundedBy(found.max_displacement, known), "mm", found.max_displacement),
      entry("value", "value at the point", roundedBy(Math.abs(found.value ?? NaN) < ROUNDING ? 0 : found.value, known), "mm", found.value),
      against ? entry("wanted", `target ${number(pad.target, 6)} mm`, against.words, "", found.value - pad.target) : null,
      entry("error", "error of method and mesh", quick ? "…" : errorDigits(found.error), quick ? "" : "mm", found.error),
      (found.breakdown_ratio ?? null) === null ? null : entry("breakdown", "largest field over breakdown strength", number(found.breakdown_ratio, 4), "", found.breakdown_ratio),
      (found.smallest_eigenvalue ?? null) === null ? null : entry("eigenvalue", "smallest eigenvalue of the tangent (0: instability)", number(found.smallest_eigenvalue, 4), "", found.smallest_eigenvalue),
      entry("seconds", "time of the solution", seconds(found.seconds), ""),
    );
    if (!quick) this.results.dataset.settled = "true";
    replace(this.notice, found.max_displacement === null ? this.unstable(found) : this.beyond(found));
    this.timing.textContent = this.took === null ? "" : `${this.rate.perSecond ? `${number(this.rate.perSecond, 2)} updates per second; ` : ""}an update takes ${number(this.took, 3)} ms`;
  }

  /** Describes the critical voltage. @param {any} found */
  critical(found) {
    if ((found.critical_voltage ?? null) === null) return null;
    const error = found.critical_voltage_error;
    if (error) return `${measured(found.critical_voltage, error)} V`;
    const [stable, lost] = found.critical_bracket ?? [0, Infinity];
    const own = stable <= found.critical_voltage && found.critical_voltage <= lost;
    return `${number(found.critical_voltage)} V (${own ? "this mesh" : "one finer mesh"}, error unknown)`;
  }

  /** @param {any} found */
  unstable(found) {
    const mesh = meshWords(found.elements_per_cell, found.order);
    const critical = found.critical_voltage_error ? this.critical(found) : null;
    const [stable, lost] = rangeEnds(found.bracket ?? [0, 0]);
    const own = found.bracket ? `With this mesh (${mesh}), it is stable up to ${stable} V and unstable at ${lost} V` : "The stability is unknown";
    return h(
      "div",
      { class: "box", role: "alert" },
      h("b", {}, `No stable state at ${number(found.voltage, 6)} V: ${found.outcome}`),
      OUTCOMES[found.outcome] ? h("p", {}, prose(OUTCOMES[found.outcome]), ".") : null,
      critical ? h("p", {}, `Critical voltage: ${critical} (two finer meshes).`) : null,
      h("p", {}, own, critical ? "; a coarse mesh is too stiff." : "."),
    );
  }

  /** Whether only this mesh has the state: finer ones are unstable. @param {any} found */
  isOfMesh(found) {
    const { critical_voltage: critical, critical_voltage_error: error } = found;
    return found.max_displacement !== null && (critical ?? null) !== null && error && found.voltage > critical + error;
  }

  /** Warns of a voltage above a limit, or at which finer meshes may be unstable. @param {any} found */
  beyond(found) {
    const { critical_voltage: critical, critical_voltage_error: error } = found;
    const passed = limitsBefore(found).filter((one) => found.voltage > one.voltage);
    const words = (/** @type {string} */ what) => (what === "wrinkles" ? "the membrane wrinkles; switch on the effect wrinkling to simulate it" : "the electric field is above the breakdown field");
    const before = passed.map((one) => h("p", {}, `From ${number(one.voltage)} V, ${words(one.what)}.`));
    const at = `${number(found.voltage, 6)} V`;
    if ((critical ?? null) === null || !error || found.voltage < critical - error) {
      return passed.length ? h("div", { class: "box", role: "alert", id: "passed" }, h("b", {}, `${at} is above the limit.`), before) : null;
    }
    const where = found.voltage > critical + error ? "above" : "within the error of";
    return h("div", { class: "box", role: "alert", id: "beyond" }, h("b", {}, `${at} is ${where} the critical voltage, ${this.critical(found)} (two finer meshes).`), h("p", {}, `The membrane is stable only with this mesh (${meshWords(found.elements_per_cell, found.order)}).`), before);
  }
}
