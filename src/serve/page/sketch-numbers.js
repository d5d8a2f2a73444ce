// The numbers of the sketchpad: what came out, how far it is to be trusted, and the command that prints the same.

import { copyable, copying, h, number, replace, seconds } from "./elements.js";

/** Why there is no field, in words. @type {Record<string, string>} */
const OUTCOMES = {
  converged: "a stable state was found",
  estimated: "an estimate, which is no equilibrium",
  "pull-in": "the membrane thins until its electrodes pull together",
  "not-elliptic": "the membrane loses stability in a narrow band: the equations have no smooth solution any more (loss of ellipticity)",
  slack: "the membrane becomes slack, and bears no load in a direction",
  "iteration-limit": "the solver did not converge in so many steps; that says nothing of stability",
  "work-limit": "the solution took more work than is spent here; `deaflow solve --time-limit` spends more",
  "no-estimate": "the estimate is of no use here; Newton's method may find a state",
};

/** A wanted value counts as reached within this share of it, and within so many mm; as the search has it (`sketch/approach.rs`). */
const REACHED = 0.005;
const LEAST = 0.001;

/** Less than rounding leaves of what is nothing, mm. */
const NOTHING = 1e-9;

/** How a value stands to the wanted one, where it has an error of method and mesh, mm. @param {number} value @param {number} wanted @param {number} error */
export function againstWanted(value, wanted, error = 0) {
  const off = Math.abs(value - wanted) < NOTHING ? 0 : value - wanted;
  if (Math.abs(off) <= Math.max(REACHED * Math.abs(wanted), LEAST)) return { reached: true, words: off === 0 ? "reached" : `reached, to ${number(Math.abs(off), 2)} mm` };
  return { reached: false, words: `${number(Math.abs(off), 3)} mm ${off < 0 ? "short" : "too much"}${Math.abs(off) <= error ? ", within the error of method and mesh" : ""}` };
}

/** A mesh in words. @param {number} elements @param {number} order */
export function meshWords(elements, order) {
  return `${elements} ${order === 1 ? "bilinear" : "biquadratic"} element${elements === 1 ? "" : "s"} along a cell`;
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
    /** Of strokes alone: what is looked for in the background takes longer. @type {number|null} */ this.took = null;
    this.rate = { count: 0, since: performance.now(), last: 0, told: 0 };
  }

  panel(/** @type {any} */ controls) {
    this.copy = copying("Copy the numbers", () => this.text(), { id: "copy-numbers", title: "With all digits, and the command that prints the displacements" });
    return h("section", { "aria-label": "Numbers", class: "numbers" }, h("h2", {}, "Numbers"), this.results, h("div", { class: "tools" }, this.copy), this.notice, this.timing, controls, this.command);
  }

  /** Updates of the membrane a second while something is drawn. */
  count() {
    const now = performance.now();
    if (now - this.rate.last > 1000) this.rate = { count: 0, since: now, last: now, told: 0 };
    this.rate.last = now;
    this.rate.count += 1;
    if (now - this.rate.since > 500) {
      this.rate = { count: 0, since: now, last: now, told: (1000 * this.rate.count) / (now - this.rate.since) };
    }
  }

  /** All numbers with all their digits, and what prints them. */
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
      ...line("largest field, over the breakdown strength", found.breakdown_ratio),
      ...line("smallest eigenvalue of the tangent", found.smallest_eigenvalue),
      ...(this.results.dataset.settled === "true" ? [] : ["the error and where stability is lost were still being looked for"]),
      ...(this.reproduced ? [this.reproduced.command] : []),
      "",
    ].join("\n");
  }

  /** What prints the numbers, by the name that the pattern has as a file. @param {any} found @param {(text: string) => string} named */
  reproduce(found, named) {
    this.reproduced = found && { ...found, command: named(found.command) };
    if (!found) return;
    replace(this.command, h("p", { class: "small soft" }, "The same displacements in a terminal, with all digits; the pattern is saved as csv under Files, in the folder of the terminal:"), copyable(this.reproduced.command));
  }

  show() {
    const { pad } = this;
    const { document: found, quick, took } = pad.shown;
    if (quick) this.took = took;
    const entry = (/** @type {string} */ name, /** @type {string} */ title, /** @type {string} */ text, /** @type {string} */ unit, /** @type {number|null} */ exact = null, /** @type {string|null} */ about = null) => [
      h("dt", {}, title),
      h("dd", { id: name, title: about ?? (exact === null ? null : `${exact} ${unit}`.trim()), "data-value": exact === null ? null : String(exact) }, text, unit && text !== "–" ? h("span", { class: "soft" }, ` ${unit}`) : null),
    ];
    const against = pad.wanted === null || found.value === null ? null : againstWanted(found.value, pad.wanted, quick ? 0 : found.error ?? 0);
    replace(
      this.results,
      entry("outcome", "outcome", found.outcome, "", null, OUTCOMES[found.outcome] ?? null),
      entry("max-displacement", "largest displacement", number(found.max_displacement, 8), "mm", found.max_displacement),
      entry("value", "value at the point", number(Math.abs(found.value ?? NaN) < NOTHING ? 0 : found.value, 8), "mm", found.value),
      against ? entry("wanted", `wanted ${number(pad.wanted, 6)} mm`, against.words, "", found.value - pad.wanted) : null,
      entry("error", "error of method and mesh", quick ? "…" : number(found.error, 2), quick ? "" : "mm", found.error),
      (found.breakdown_ratio ?? null) === null ? null : entry("breakdown", "largest field, over the breakdown strength", number(found.breakdown_ratio, 4), "", found.breakdown_ratio),
      (found.smallest_eigenvalue ?? null) === null ? null : entry("eigenvalue", "smallest eigenvalue of the tangent (0: stability is lost)", number(found.smallest_eigenvalue, 4), "", found.smallest_eigenvalue),
      entry("seconds", "solution", seconds(found.seconds), ""),
    );
    if (!quick) this.results.dataset.settled = "true";
    replace(this.notice, found.max_displacement === null ? this.lost(found) : this.beyond(found));
    this.timing.textContent = this.took === null ? "" : `${this.rate.told ? `${number(this.rate.told, 2)} updates a second, ` : ""}${number(this.took, 3)} ms from pen to membrane`;
  }

  /** Where stability is lost by the finer meshes, in words. @param {any} found */
  critical(found) {
    if ((found.critical_voltage ?? null) === null) return null;
    const error = found.critical_voltage_error;
    if (error) return `${number(found.critical_voltage, 5)} V ± ${number(error, 2)} V`;
    const [stable, lost] = found.critical_bracket ?? [0, Infinity];
    const own = stable <= found.critical_voltage && found.critical_voltage <= lost;
    return `${number(found.critical_voltage, 5)} V ${own ? "on this mesh" : "on one finer mesh"}, with an unknown error`;
  }

  /** @param {any} found */
  lost(found) {
    const mesh = meshWords(found.elements_per_cell, found.order);
    const critical = found.critical_voltage_error ? this.critical(found) : null;
    const own = found.bracket ? `On this mesh alone (${mesh}) it is stable up to ${number(found.bracket[0], 6)} V and lost at ${number(found.bracket[1], 6)} V` : "Nothing is known about stability";
    return h(
      "div",
      { class: "box", role: "alert" },
      h("b", {}, `No stable state at ${number(found.voltage, 6)} V: ${found.outcome}`),
      OUTCOMES[found.outcome] ? h("p", {}, OUTCOMES[found.outcome], ".") : null,
      critical ? h("p", {}, `Stability is lost at ${critical}, by two finer meshes.`) : null,
      h("p", {}, own, critical ? "; a coarse mesh makes a membrane too stiff." : "."),
    );
  }

  /** A field at a voltage at which finer meshes may have none. @param {any} found */
  beyond(found) {
    const { critical_voltage: critical, critical_voltage_error: error } = found;
    if ((critical ?? null) === null || !error || found.voltage < critical - error) return null;
    const where = found.voltage > critical + error ? "lies beyond" : "is within the error of";
    return h("div", { class: "box", role: "alert", id: "beyond" }, h("b", {}, `${number(found.voltage, 6)} V ${where} the voltage at which stability is lost, ${this.critical(found)} by two finer meshes.`), h("p", {}, `That there is a state is true of this mesh alone (${meshWords(found.elements_per_cell, found.order)}).`));
  }
}
