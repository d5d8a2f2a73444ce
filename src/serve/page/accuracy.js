// Accuracy stages: the chart of error over time, and the settings of each method to be copied.

import { choice, copyable, h, labelled, number, replace, table } from "./elements.js";
import { columnsOf } from "./server.js";

/** @param {HTMLElement} place @param {any} found @param {(place: HTMLElement) => void} figures */
export async function accuracy(place, found, figures) {
  const methods = await columnsOf(found.digest, "methods");
  const families = (await columnsOf(found.digest, "families")).families;
  /** Seconds of one core by `setting; family`: times are measurements in the provenance. @type {Map<string, number>} */
  const times = new Map();
  for (const line of (found.provenance.measurements ?? "").split("\n")) {
    const at = line.lastIndexOf(": ");
    if (at > 0) times.set(line.slice(0, at), Number(line.slice(at + 2)));
  }
  let family = families.includes("all") ? "all" : families[0];
  const list = h("div", {});
  const chosen = h("div", {});
  const fill = () => {
    const at = families.indexOf(family);
    const points = methods.methods
      .map((/** @type {string} */ setting, /** @type {number} */ row) => ({ setting, error: methods[`error/rms.${at}_mm`]?.[row], largest: methods[`error/max.${at}_mm`]?.[row], time: times.get(`${setting}; ${family}`) ?? null }))
      .sort((/** @type {any} */ a, /** @type {any} */ b) => (a.time ?? Infinity) - (b.time ?? Infinity));
    let least = Infinity;
    const row = (/** @type {any} */ point) => {
      // No faster method is as accurate.
      const best = point.time !== null && point.error < least;
      if (best) least = point.error;
      const take = () => replace(chosen, h("p", {}, "Keys for a stage:"), copyable(`{ ${point.setting} }`));
      return [h("span", { class: "mono" }, point.setting), best ? h("b", {}, "best") : "", number(1000 * point.time, 3), number(point.error, 3), number(point.largest, 3), h("button", { type: "button", class: "slim", "data-setting": point.setting, onclick: take }, "Setting")];
    };
    replace(list, table("Methods", ["setting", "", { title: "time of one core, ms", number: true }, { title: "RMS error, mm", number: true }, { title: "largest, mm", number: true }, ""], points.map(row)));
  };
  const chart = h("div", {});
  replace(
    place,
    chart,
    h("div", { class: "tools" }, labelled("Family", choice("family", families.map((/** @type {string} */ name) => [name, name]), family, (name) => {
      family = name;
      fill();
    }))),
    h("p", { class: "soft small" }, "Sorted by time; “best” means that no other method is better in both time and error."),
    list,
    chosen,
  );
  fill();
  figures(chart);
}
