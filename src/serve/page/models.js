// Models: their errors by family, the patterns with the largest errors, and possible reasons.

import { columnsOf, json } from "./server.js";
import { attempt, choice, h, labelled, number, replace, short, table } from "./elements.js";
import { areaWords, card, patternsAt, rowLink } from "./pictures.js";

/** @typedef {import("./pattern.js").Pattern} Pattern */

/** Patterns that are shown for each predictor. */
const WORST = 8;

/** A small fraction of the training set. */
const RARE = 0.05;

/** If the nearest training pattern is farther than that of the best predictions by this factor, it may be a reason. */
const FARTHER = 1.2;

/** Evaluations that are searched for those of a model. */
const MOST = 20;

/** Names of the parts of a dataset. */
const PARTS = { test: "test", validation: "validation", train: "training" };

/** A trained network: its errors on its own dataset, and its evaluations. @param {HTMLElement} place @param {any} found @param {URLSearchParams} query with the shown part of the dataset */
export async function model(place, found, query) {
  const metrics = await columnsOf(found.digest, "metric");
  const splits = [...new Set(metrics["metrics/split"])];
  const families = [...new Set(metrics["metrics/family"])];
  const value = (/** @type {string} */ name, /** @type {string} */ family, /** @type {string} */ split) => metrics[`metrics/${name}`]?.[metrics["metrics/family"].findIndex((own, at) => own === family && metrics["metrics/split"][at] === split)];
  const rows = families.map((family) => [family, ...splits.flatMap((split) => [number(value("rmse_mm", family, split), 3), number(value("max_error_mm", family, split), 3)])]);
  const heads = splits.flatMap((split) => [{ title: `${split}: RMS error, mm`, number: true }, { title: `${split}: largest, mm`, number: true }]);
  const own = h("div", {});
  const requested = query.get("split") ?? "";
  const first = Object.hasOwn(PARTS, requested) ? requested : "test";
  const part = labelled("Rows of", choice("judged-split", Object.entries(PARTS), first, (split) => {
    history.replaceState(null, "", `#/artifacts/${found.digest}?${new URLSearchParams({ tab: "errors", split })}`);
    void evaluate(split);
  }));
  const elsewhere = h("div", {}, h("p", { class: "soft" }, "Searching for evaluations …"));
  replace(place, h("h2", {}, "Errors of a component, by family"), table("Errors by family", ["family", ...heads], rows), h("section", {}, h("h2", {}, "Largest errors on its own dataset"), h("div", { class: "tools" }, part), own), elsewhere);
  let turn = 0;
  /** @param {string} split */
  const evaluate = async (split) => {
    turn += 1;
    const now = turn;
    replace(own, h("p", { class: "soft" }, `Predicting the ${split} rows …`));
    const box = h("div", {});
    await attempt(box, () => ownWorst(box, found.digest, split));
    // Cards are drawn at their place, which determines their width.
    if (now === turn) replace(own, box);
  };
  await evaluate(first);
  const { artifacts } = await json(`artifacts?kind=evaluate&limit=${MOST}`);
  /** @type {any[]} */ const evaluations = [];
  for (const one of artifacts) {
    const other = await json(`artifacts/${one.digest}`);
    const made = other.ancestry.find((/** @type {any} */ ancestor) => ancestor.digest === other.digest);
    if (made?.inputs.includes(found.digest)) evaluations.push({ ...other, stage: one.stage });
  }
  if (!evaluations.length) {
    replace(elsewhere, h("p", { class: "soft" }, "The last runs have no evaluation of this model on other patterns; an ", h("code", {}, "evaluate"), " stage builds one."));
    return;
  }
  const sections = evaluations.map((other) => ({ other, box: h("div", {}) }));
  replace(elsewhere, sections.map(({ other, box }) => h("section", {}, h("h2", {}, `Evaluated by ${other.stage} `, short(other.digest)), box)));
  for (const { other, box } of sections) await evaluation(box, other, found.digest);
}

/** The rows of a part of its own dataset with the largest errors. @param {HTMLElement} place @param {string} digest @param {string} split */
async function ownWorst(place, digest, split) {
  const found = await json(`artifacts/${digest}/judged?split=${split}&limit=${WORST}`);
  if (!found.judged) {
    replace(place, h("p", { class: "soft" }, `Its dataset has no ${split} rows; an `, h("code", {}, "evaluate"), " stage evaluates it on other patterns."));
    return;
  }
  /** @type {Map<string, any>} */ const sets = new Map();
  for (const set of found.sets) sets.set(set, await json(`artifacts/${set}`));
  const families = new Map(found.families.map((/** @type {any} */ one) => [one.family, one]));
  // A training pattern is its own nearest one.
  const far = async (/** @type {any} */ row) => (split === "train" ? null : nearest(found.sets, row.set, row.row));
  const usual = split === "train" ? new Map() : await nearestOfBest(found.best, found.rows, far);
  /** @type {(() => HTMLElement)[]} */ const cards = [];
  for (const row of found.rows) {
    const [pattern] = await patternsAt(sets.get(row.set), [row.row]);
    const near = await far(row);
    const family = families.get(row.family);
    const share = found.learned ? family.learned / found.learned : null;
    const moves = `its displacement is larger than that of ${number(100 * row.moves_more_than, 3)} % of the training rows`;
    const why = [
      family.learned === 0 ? "the training set has no pattern of this family" : share !== null && share < RARE ? `only ${family.learned} of the ${found.learned} training rows are of this family` : "",
      row.moves_more_than >= 1 - RARE ? moves : "",
      family.rmse_mm > 0 && row.rms_mm > 2 * family.rmse_mm ? `RMS error ${number(row.rms_mm / family.rmse_mm, 2)} times that of its family` : "",
    ];
    const values = { error: row.max_error_mm, family: row.family, area: row.area, simulated: row.simulated_max_mm, predicted: row.predicted_max_mm };
    const facts = [
      family.learned ? `the training set has ${family.learned} rows of ${row.family}, of ${found.learned}` : "",
      row.moves_more_than < 1 - RARE ? moves : "",
    ];
    cards.push(() => worstCard(sets.get(row.set), pattern, rowLink(row.set, row.row, digest), values, why, near, facts, usual.get(row.family)));
  }
  const all = families.get("all");
  const beyond = found.total - found.judged;
  replace(
    place,
    h("p", { class: "soft" }, `Predicted: ${found.judged} ${split} rows of `, found.sets.map((/** @type {string} */ set) => [short(set), " "]), `with an RMS error of a component of ${number(all.rmse_mm, 3)} mm. Click on a card to see the prediction beside its label, and their difference.`),
    h("div", { class: "cards large", "data-own": String(found.judged), "data-split": split }, cards.map((made) => made())),
    beyond > 0 ? h("p", { class: "soft" }, `${beyond} more rows are not predicted here.`) : null,
  );
}

/**
 * The distance of the nearest training pattern for the rows of each family with the smallest errors, as a fraction of the cells: a reason for a large error must not hold for them as well.
 * @param {any[]} best @param {any[]} rows the shown rows @param {(row: any) => Promise<{distance: number, cells: number}|null>} far @returns {Promise<Map<string, number>>}
 */
async function nearestOfBest(best, rows, far) {
  const shown = new Set(rows.map((row) => row.family));
  /** @type {Map<string, number[]>} */ const shares = new Map();
  for (const row of best.filter((one) => shown.has(one.family))) {
    const near = await far(row);
    if (near) shares.set(row.family, [...(shares.get(row.family) ?? []), near.distance / near.cells]);
  }
  return new Map([...shares].map(([family, some]) => [family, some.sort((a, b) => a - b)[Math.floor(some.length / 2)]]));
}

/** Describes the distance of the nearest training pattern, and whether it may be a reason. @param {{distance: number, cells: number}} near @param {string} family @param {number} [usual] */
function nearness(near, family, usual) {
  const share = near.distance / near.cells;
  const words = `the nearest training pattern differs in ${number(100 * share, 3)} % of the cells`;
  if (usual === undefined) return [words];
  const against = `; for the best predictions of ${family}, in ${number(100 * usual, 3)} %`;
  if (share > FARTHER * usual) return [words, against, ": ", h("span", { class: "warning" }, "it is farther from the training set")];
  return [words, against, ": this is not the reason"];
}

/** A card of a pattern of a dataset with a large error. @param {any} set @param {Pattern|null} pattern @param {string|null} link @param {{error: number, family: string, area: number, simulated: number, predicted: number}} values @param {string[]} why @param {{distance: number, cells: number}|null} near @param {string[]} [facts] that are no reasons @param {number} [usual] */
function worstCard(set, pattern, link, values, why, near, facts = [], usual) {
  return card(
    pattern,
    link,
    h("div", {}, h("b", {}, `error of a component ${number(values.error, 3)} mm`), values.simulated > 0 ? `, ${number((100 * values.error) / values.simulated, 3)} % of its largest displacement` : null),
    h("div", {}, `${values.family}, ${areaWords(set, values.area)}`),
    h("div", {}, `largest: ${number(values.simulated, 4)} mm, predicted ${number(values.predicted, 4)} mm`),
    why.filter(Boolean).map((words) => h("div", { class: "warning" }, words)),
    near ? h("div", {}, ...nearness(near, values.family, usual)) : null,
    facts.filter(Boolean).map((words) => h("div", { class: "soft" }, words)),
  );
}

/** An evaluation: errors by family, and the largest errors of each predictor. @param {HTMLElement} place @param {any} found @param {string} [only] the digest of the only predictor to be shown */
export async function evaluation(place, found, only = "") {
  const predictors = await columnsOf(found.digest, "predictors");
  const families = (await columnsOf(found.digest, "families")).families;
  const scores = await columnsOf(found.digest, "predictors");
  const shown = predictors.predictors.map((/** @type {string} */ name, /** @type {number} */ at) => ({ name, at, digest: predictors.predictor_digests[at] })).filter((/** @type {any} */ one) => !only || one.digest === only);
  const named = (/** @type {any} */ one) => h("span", {}, one.name, one.digest ? [" ", short(one.digest)] : null);
  const cells = (/** @type {any} */ one) => families.map((/** @type {string} */ _, /** @type {number} */ family) => number(scores[`score/rmse.${family}_mm`]?.[one.at], 3));
  const sections = shown.map((/** @type {any} */ one) => ({ one, box: h("div", {}, h("p", { class: "soft" }, "Reading …")) }));
  replace(
    place,
    h("p", { class: "soft" }, "Root mean square error of a component, in mm, by family."),
    table("Errors by family", ["", ...families.map((/** @type {string} */ family) => ({ title: family, number: true }))], shown.map((/** @type {any} */ one) => [named(one), ...cells(one)])),
    sections.map(({ one, box }) => h("section", {}, h("h3", {}, "Largest errors of ", named(one)), box)),
  );
  for (const { one, box } of sections) await attempt(box, () => worst(box, found, one, families, scores));
}

/** @param {HTMLElement} box @param {any} found @param {any} predictor @param {string[]} families @param {Record<string, any[]>} scores */
async function worst(box, found, predictor, families, scores) {
  const error = `pattern/max_error.${predictor.at}_mm`;
  const answer = await json(`artifacts/${found.digest}/rows?along=row&limit=${WORST}&sort=-${encodeURIComponent(error)}`);
  const at = (/** @type {string} */ name) => answer.columns.findIndex((/** @type {any} */ column) => column.name === name);
  const places = Object.fromEntries(["pattern/family", "pattern/area", "pattern/simulated_max_mm", "set", "set_row"].map((name) => [name, at(name)]));
  const [worstAt, rmsAt, predictedAt] = [at(error), at(`pattern/rms.${predictor.at}_mm`), at(`pattern/predicted_max.${predictor.at}_mm`)];
  if (worstAt < 0) throw new Error("the evaluation has no errors of single patterns");
  const known = places.set >= 0;
  /** @type {Map<string, any>} */ const sets = new Map();
  if (known) {
    for (const digest of new Set(answer.rows.map((/** @type {any[]} */ row) => row[places.set]))) sets.set(/** @type {string} */ (digest), await json(`artifacts/${digest}`));
  }
  const training = predictor.digest ? await trainedOn(predictor.digest) : [];
  /** @type {(() => HTMLElement)[]} */ const cards = [];
  for (const row of answer.rows) {
    const of = (/** @type {string} */ name) => row[places[name]];
    const set = known ? sets.get(of("set")) : null;
    const [pattern] = set ? await patternsAt(set, [of("set_row")]) : [null];
    const family = of("pattern/family");
    const column = families.indexOf(family);
    const usual = scores[`score/rmse.${column}_mm`]?.[predictor.at];
    const learned = scores[`trained.${column}`]?.[predictor.at];
    const near = training.length && set ? await nearest(training, set.digest, of("set_row")) : null;
    const why = [
      predictor.digest && learned === 0 ? "the training set has no pattern of this family" : "",
      usual > 0 && row[rmsAt] > 2 * usual ? `RMS error ${number(row[rmsAt] / usual, 2)} times that of its family` : "",
    ];
    const values = { error: row[worstAt], family, area: of("pattern/area"), simulated: of("pattern/simulated_max_mm"), predicted: row[predictedAt] };
    // Cards are drawn at their place, which determines their width.
    cards.push(() => worstCard(set, pattern, set ? rowLink(set.digest, of("set_row"), predictor.digest) : null, values, why, near));
  }
  replace(box, h("div", { class: "cards large", "data-worst": predictor.name }, cards.map((made) => made())), known ? null : h("p", { class: "soft" }, "The patterns are not shown: the datasets of the evaluation are not in the store."));
}

/** The balanced datasets that a model was trained on; none if they are not in the store. @param {string} digest @returns {Promise<string[]>} */
async function trainedOn(digest) {
  try {
    const found = await json(`artifacts/${digest}`);
    const own = found.ancestry.find((/** @type {any} */ one) => one.digest === found.digest);
    return found.ancestry.filter((/** @type {any} */ one) => own.inputs.includes(one.digest) && one.kind === "balance").map((/** @type {any} */ one) => one.digest);
  } catch {
    return [];
  }
}

/** The distance of the nearest training pattern. @param {string[]} training @param {string} set @param {number} row @returns {Promise<{distance: number, cells: number}|null>} */
async function nearest(training, set, row) {
  try {
    /** @type {{distance: number, cells: number}|null} */ let best = null;
    for (const one of training) {
      // Only rows of the training part count; the pattern itself may be a test row.
      const found = await json(`artifacts/${one}/neighbours?row=${row}&of=${set}&limit=1&split=train`);
      const first = found.neighbours[0];
      if (first && (!best || first.distance < best.distance)) best = { distance: first.distance, cells: found.cells };
    }
    return best;
  } catch {
    return null;
  }
}
