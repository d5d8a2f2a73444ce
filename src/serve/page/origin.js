// The origin of a row: its dataset, its sample, and the seed of the sample.

import { json } from "./server.js";
import { h, short } from "./elements.js";
import { patternsOf, rowLink } from "./pictures.js";

/** The largest number of steps back. */
const MOST = 6;

/** The values of one row, by column. @param {string} digest @param {string} query @returns {Promise<{row: number, values: Record<string, any>}|null>} */
async function only(digest, query) {
  const answer = await json(`artifacts/${digest}/rows?limit=2&${query}`);
  if (answer.rows.length !== 1) return null;
  return { row: answer.numbers[0], values: Object.fromEntries(answer.columns.map((/** @type {any} */ column, /** @type {number} */ at) => [column.name, answer.rows[0][at]])) };
}

/** @param {any} found @returns {Promise<any[]>} its inputs that hold patterns */
async function sources(found) {
  const own = found.ancestry.find((/** @type {any} */ one) => one.digest === found.digest);
  const all = [];
  for (const input of own?.inputs ?? []) all.push(await json(`artifacts/${input}`));
  return all.filter(patternsOf);
}

/**
 * The origins of a row, the nearest first; a sample has its number within its family and the seed.
 * @param {any} found @param {Record<string, any>} values the row's @returns {Promise<{found: any, row: number, values: Record<string, any>, seed: string|null}[]>}
 */
async function trace(found, values) {
  const steps = [];
  for (let step = 0; step < MOST; step += 1) {
    let next = null;
    // The rows of a balanced set are numbered over all of its inputs.
    let before = values.source === undefined ? null : Number(values.source);
    for (const input of await sources(found)) {
      const count = patternsOf(input).shape[0];
      if (before !== null && before >= count) {
        before -= count;
        continue;
      }
      const query = before !== null ? `offset=${before}&limit=1` : values.index === undefined ? null : `filter=${encodeURIComponent(`family = "${values.family}" and index = ${values.index}${values.units === undefined ? "" : ` and units = ${values.units}`}`)}`;
      const one = query === null ? null : await only(input.digest, query);
      if (one) {
        next = { found: input, ...one };
        break;
      }
    }
    if (!next) break;
    const own = next.found.ancestry.find((/** @type {any} */ one) => one.digest === next.found.digest);
    const seed = next.found.kind === "sample" ? /"?seed"?:\s*(\d+)/.exec(own?.entries.parameters ?? "")?.[1] ?? null : null;
    steps.push({ ...next, seed });
    ({ found, values } = next);
  }
  return steps;
}

/** @param {HTMLElement} place @param {any} found @param {Record<string, any>} values */
export async function lineage(place, found, values) {
  const steps = await trace(found, values);
  const texts = steps.map((step) => {
    const drawn = step.seed === null ? null : [`: number ${step.values.index} of family ${step.values.family}, drawn by seed `, h("b", { "data-seed": step.seed }, step.seed)];
    return h("li", {}, h("a", { href: rowLink(step.found.digest, step.row) }, `row ${step.row}`), ` of ${step.found.kind} `, short(step.found.digest), drawn);
  });
  if (texts.length) place.replaceChildren(h("ol", {}, texts));
  else place.replaceChildren(h("p", { class: "soft" }, "It has no origin, or the origin is not in the store."));
}
