// Designs: each target with its patterns compared with the best of the gradient search, and masks to download.

import { columnsOf, json } from "./server.js";
import { attempt, changes, h, measured, number, replace, when } from "./elements.js";
import { areaWords, card, image, patternsAt, rowLink } from "./pictures.js";
import { saveAs } from "./files.js";

const FORMATS = ["svg", "dxf", "gbr", "png", "csv"];

/** The role that others are compared with: the best of the gradient search. */
const REFERENCE = "optimum";

/** Roles for people. @type {Record<string, string>} */
const ROLES = { ga: "genetic algorithm", optimum: "gradient search", intuitive: "intuitive, own area", "intuitive-equal-area": "intuitive, equal area", own: "own pattern" };

/** The unit of forces of sides; all other values are in mm. */
const FORCE = "mN";

/** The unit of areas. */
const SHARE = "1";

/** Below a micrometre, the ratio of displacements means nothing. */
const LEAST_MM = 1e-3;

/**
 * A card for each artifact with designs: its best one as drawn, with its result and area. They are drawn when they come into sight.
 * @param {any[]} artifacts of the list @param {(one: any) => any} named the link to one, or its digest if it is gone
 */
export function designCards(artifacts, named) {
  const watch = new IntersectionObserver((seen) => {
    for (const { isIntersecting, target } of seen) {
      if (!isIntersecting) continue;
      watch.unobserve(target);
      const { one, picture, result } = /** @type {any} */ (cards.get(target));
      void attempt(result, () => showBest(one, picture, result));
    }
  });
  /** @type {Map<Element, any>} */ const cards = new Map();
  const card = (/** @type {any} */ one) => {
    const [picture, result] = [h("div", { class: "picture" }), h("div", {})];
    const title = one.removed ? one.stage : h("a", { href: `#/artifacts/${one.digest}` }, one.stage);
    const made = h("article", { class: "card pipeline design", "data-design": one.digest }, picture, h("div", { class: "text" }, h("h2", {}, title), result, h("p", { class: "soft small" }, `${one.kind} of ${one.pipeline}, ${when(one.created)} UTC`), Object.keys(one.overrides).length ? h("div", { class: "soft small" }, changes(one.overrides)) : null, h("p", { class: "soft small" }, named(one))));
    cards.set(made, { one, picture, result });
    if (!one.removed) watch.observe(made);
    return made;
  };
  return h("div", { class: "cards pipelines" }, artifacts.map(card));
}

/** How the fact about the area of a design begins. */
const AREA = "electrode on ";

/** @param {any} one @param {HTMLElement} picture @param {HTMLElement} result */
async function showBest(one, picture, result) {
  const { sentence, facts, picture: drawing, caption } = await json(`artifacts/${one.digest}/opening`);
  replace(result, h("p", { class: "headline" }, sentence), facts.filter((/** @type {string} */ fact, /** @type {number} */ at) => at === 0 || fact.startsWith(AREA)).map((/** @type {string} */ fact) => h("p", { class: "small" }, fact)));
  replace(picture, drawing ? [image(drawing, `Best design of ${one.stage}`), h("p", { class: "caption" }, caption)] : null);
}

/** @param {HTMLElement} place @param {any} found */
export async function designs(place, found) {
  const rows = await columnsOf(found.digest, "row");
  const { values, errors, unit } = await valuesOf(found, rows);
  const count = rows.name.length;
  const patterns = await patternsAt(found, Array.from({ length: count }, (_, at) => at));
  const errorBox = h("div", {});
  const keep = (/** @type {string} */ format, /** @type {number} */ row) => attempt(errorBox, async () => {
    replace(errorBox);
    const name = `${rows.name[row]}-${rows.role[row]}`.replace(/[^A-Za-z0-9_-]/g, "_");
    await saveAs(format, { ...(found.attributes.scene ? { scene: found.attributes.scene } : {}), pattern: patterns[row].asRows(), smooth: true }, name);
  });
  const target = (/** @type {string} */ name) => {
    const own = rows.name.map((_, at) => at).filter((at) => rows.name[at] === name);
    const order = own.slice().sort((a, b) => (values[b] ?? -Infinity) - (values[a] ?? -Infinity));
    const one = (/** @type {number} */ at) => {
      const outcome = rows.outcome?.[at];
      return h(
        "div",
        {},
        card(
          patterns[at] ?? null,
          rowLink(found.digest, at),
          h("div", {}, h("b", {}, ROLES[rows.role[at]] ?? rows.role[at]), rows.member?.[at] ? ` ${rows.member[at] + 1}` : ""),
          h("div", {}, values[at] === null ? outcome ?? "no value" : `${errors[at] === null ? number(values[at]) : measured(values[at], errors[at])} ${unit}${angle(found, rows.objective?.[at], values[at])}`, shareOf(rows, values, at)),
          h("div", { class: "soft" }, [areaWords(found, rows.area[at]), rows.case[at]].filter(Boolean).join(", ")),
          otherObjectives(rows, at).map((words) => h("div", { class: "soft" }, words)),
        ),
        h("div", { class: "tools tight", role: "group", "aria-label": `Mask of ${ROLES[rows.role[at]] ?? rows.role[at]}` }, FORMATS.map((format) => h("button", { type: "button", class: "slim", "data-mask": format, onclick: () => void keep(format, at) }, format))),
      );
    };
    return h("section", {}, h("h2", {}, name || "the target"), rows.objective ? h("p", { class: "soft small", title: rows.objective[own[0]] }, inWords(found, rows.objective[own[0]])) : null, h("div", { class: "cards large" }, order.map(one)));
  };
  const what = unit === FORCE ? `Changes of the force of sides on the membrane along the target direction, ${found.kind === "verify" ? "simulated" : "as predicted by the search; a verify stage simulates them"}.` : found.kind === "verify" ? "Simulated displacements along the target direction." : "Displacements along the target direction as predicted by the search; a verify stage simulates them.";
  replace(place, h("p", { class: "soft" }, what, " The buttons save masks at the size of the prestretched membrane."), errorBox, [...new Set(rows.name)].map(target));
}

/** An objective in words; as in the file if it cannot be read. @param {any} found @param {string} text */
function inWords(found, text) {
  const words = found.objectives?.[text]?.words;
  return words ? words[0].toUpperCase() + words.slice(1) : text;
}

/** The angle of an arc length. @param {any} found @param {string|undefined} text of the objective @param {number} value */
function angle(found, text, value) {
  const degrees = text === undefined ? null : found.objectives?.[text]?.degrees_per_mm;
  return degrees ? ` (${number(degrees * value)}°)` : "";
}

/** The objectives of a point of a front after the first; all designs have their area. @param {Record<string, any[]>} rows @param {number} at @returns {string[]} */
function otherObjectives(rows, at) {
  return ["second objective", "third objective"].flatMap((name, k) => {
    const [value, unit] = ["values", "unit"].map((part) => rows[`front/objectives/${part}.${k + 1}`]?.[at]);
    return value === undefined || unit === SHARE ? [] : [`${name} ${number(value)} ${unit}`];
  });
}

/**
 * The share of the best pattern that the gradient search found for the same case and target, preferably on the same units, and what that is. Nothing for the reference itself,
 * the intuitive design at its own area, and a displacement to be reached, where more is not better.
 * @param {Record<string, any[]>} rows @param {(number|null)[]} values @param {number} at
 */
function shareOf(rows, values, at) {
  const value = values[at];
  if (value === null || [REFERENCE, "intuitive"].includes(rows.role[at]) || /measure: distance/.test(rows.objective[at])) return null;
  const mm = (/** @type {number} */ row) => values[row] ?? -Infinity;
  const references = rows.name.map((_, row) => row).filter((row) => rows.role[row] === REFERENCE && rows.name[row] === rows.name[at] && rows.case[row] === rows.case[at]);
  const onUnits = references.filter((row) => rows.units[row] === rows.units[at] && values[row] !== null);
  const best = (onUnits.length ? onUnits : references).sort((a, b) => mm(b) - mm(a))[0];
  if (best === undefined || mm(best) <= LEAST_MM) return null;
  const same = rows.constraints[at] === rows.constraints[best] && [at, best].every((row) => rows.status[row] === "met");
  return `, ${number(100 * value / mm(best), 3)} % of the best pattern found by gradient search under ${same ? "the same" : "other"} constraints`;
}

/**
 * The value of each row in its unit, null without a field, and its error, null if it is not known. Columns have their unit in their name.
 * @param {any} found @param {Record<string, any[]>} rows @returns {Promise<{values: (number|null)[], errors: (number|null)[], unit: string}>}
 */
async function valuesOf(found, rows) {
  if (found.kind !== "verify") {
    const unit = rows[`value_${FORCE}`] ? FORCE : "mm";
    const values = rows[`value_${unit}`];
    return { values, errors: values.map(() => null), unit };
  }
  // There are simulated values only for the patterns with a field, in their order.
  const simulated = await columnsOf(found.digest, "simulated_row");
  let next = 0;
  const places = rows.outcome.map((outcome) => (["converged", "estimated"].includes(outcome) ? next++ : -1));
  const at = (/** @type {string} */ name) => places.map((place) => simulated[name]?.[place] ?? null);
  const known = at("component/error_known");
  const unit = simulated[`component/simulated_${FORCE}`] ? FORCE : "mm";
  return { values: at(`component/simulated_${unit}`), errors: at(`component/error_${unit}`).map((error, row) => (known[row] ? error : null)), unit };
}
