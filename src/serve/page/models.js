// Models: their errors by family, the patterns that they predict worst, and what tells why.

import { columnsOf, json } from "./server.js";
import { choice, h, labelled, number, problem, replace, short, table } from "./elements.js";
import { card, patternsAt, rowLink } from "./pictures.js";

/** @typedef {import("./pattern.js").Pattern} Pattern */

/** Patterns that are shown of each predictor. */
const WORST = 8;

/** A share of what was learned from that is small. */
const RARE = 0.05;

/** By so much the nearest learned pattern is farther than that of the best predicted, where this tells anything. */
const FARTHER = 1.2;

/** Evaluations that are looked through for those of a model. */
const MOST = 20;

/** Parts of a set, by their names, in words. */
const PARTS = { test: "test", validation: "validation", train: "training" };

/** A trained network: how it errs on its own set, and where it was evaluated. @param {HTMLElement} place @param {any} found @param {URLSearchParams} query with the part of its set that is shown */
export async function model(place, found, query) {
  const metrics = await columnsOf(found.digest, "metric");
  const splits = [...new Set(metrics["metrics/split"])];
  const families = [...new Set(metrics["metrics/family"])];
  const value = (/** @type {string} */ name, /** @type {string} */ family, /** @type {string} */ split) => metrics[`metrics/${name}`]?.[metrics["metrics/family"].findIndex((own, at) => own === family && metrics["metrics/split"][at] === split)];
  const rows = families.map((family) => [family, ...splits.flatMap((split) => [number(value("rmse_mm", family, split), 3), number(value("max_error_mm", family, split), 3)])]);
  const heads = splits.flatMap((split) => [{ title: `${split}: RMS error, mm`, number: true }, { title: `${split}: largest, mm`, number: true }]);
  const own = h("div", {});
  const asked = query.get("split") ?? "";
  const first = Object.hasOwn(PARTS, asked) ? asked : "test";
  const part = labelled("Rows of", choice("judged-split", Object.entries(PARTS), first, (split) => {
    history.replaceState(null, "", `#/artifacts/${found.digest}?${new URLSearchParams({ tab: "errors", split })}`);
    void judge(split);
  }));
  const elsewhere = h("div", {}, h("p", { class: "soft" }, "Looking for evaluations …"));
  replace(place, h("h2", {}, "Errors by family, of a component"), table("Errors by family", ["family", ...heads], rows), h("section", {}, h("h2", {}, "Worst patterns of its own set"), h("div", { class: "tools" }, part), own), elsewhere);
  let turn = 0;
  /** @param {string} split */
  const judge = async (split) => {
    turn += 1;
    const now = turn;
    replace(own, h("p", { class: "soft" }, `Predicting the ${split} rows …`));
    const box = h("div", {});
    try {
      await ownWorst(box, found.digest, split);
    } catch (error) {
      replace(box, problem(error));
    }
    // Cards are as wide as their place, and are drawn where they stand.
    if (now === turn) replace(own, box);
  };
  await judge(first);
  const { artifacts } = await json(`artifacts?kind=evaluate&limit=${MOST}`);
  /** @type {any[]} */ const evaluations = [];
  for (const one of artifacts) {
    const other = await json(`artifacts/${one.digest}`);
    const made = other.ancestry.find((/** @type {any} */ ancestor) => ancestor.digest === other.digest);
    if (made?.inputs.includes(found.digest)) evaluations.push({ ...other, stage: one.stage });
  }
  if (!evaluations.length) {
    replace(elsewhere, h("p", { class: "soft" }, "No evaluation of this model by other patterns is among what the last runs made; an ", h("code", {}, "evaluate"), " stage makes one."));
    return;
  }
  const sections = evaluations.map((other) => ({ other, box: h("div", {}) }));
  replace(elsewhere, sections.map(({ other, box }) => h("section", {}, h("h2", {}, `Evaluated by ${other.stage} `, short(other.digest)), box)));
  for (const { other, box } of sections) await evaluation(box, other, found.digest);
}

/** The rows of a part of its own set that a model predicts worst. @param {HTMLElement} place @param {string} digest @param {string} split */
async function ownWorst(place, digest, split) {
  const found = await json(`artifacts/${digest}/judged?split=${split}&limit=${WORST}`);
  if (!found.judged) {
    replace(place, h("p", { class: "soft" }, `Its set has no ${split} rows; an `, h("code", {}, "evaluate"), " stage judges it by other patterns."));
    return;
  }
  /** @type {Map<string, any>} */ const sets = new Map();
  for (const set of found.sets) sets.set(set, await json(`artifacts/${set}`));
  const families = new Map(found.families.map((/** @type {any} */ one) => [one.family, one]));
  // A pattern that was learned from is its own nearest.
  const far = async (/** @type {any} */ row) => (split === "train" ? null : nearest(found.sets, row.set, row.row));
  const usual = split === "train" ? new Map() : await nearestOfBest(found.best, found.rows, far);
  /** @type {(() => HTMLElement)[]} */ const cards = [];
  for (const row of found.rows) {
    const [pattern] = await patternsAt(sets.get(row.set), [row.row]);
    const near = await far(row);
    const family = families.get(row.family);
    const share = found.learned ? family.learned / found.learned : null;
    const moves = `it moves more than ${number(100 * row.moves_more_than, 3)} % of the rows that were learned from`;
    const why = [
      family.learned === 0 ? "it has learned from no pattern of this family" : share !== null && share < RARE ? `only ${family.learned} of the ${found.learned} rows that it has learned from are of this family` : "",
      row.moves_more_than >= 1 - RARE ? moves : "",
      family.rmse_mm > 0 && row.rms_mm > 2 * family.rmse_mm ? `RMS error ${number(row.rms_mm / family.rmse_mm, 2)} times that of its family` : "",
    ];
    const told = { error: row.max_error_mm, family: row.family, area: row.area, simulated: row.simulated_max_mm, predicted: row.predicted_max_mm };
    const facts = [
      family.learned ? `it has learned from ${family.learned} rows of ${row.family}, of ${found.learned}` : "",
      row.moves_more_than < 1 - RARE ? moves : "",
    ];
    cards.push(() => worstCard(pattern, rowLink(row.set, row.row, digest), told, why, near, facts, usual.get(row.family)));
  }
  const all = families.get("all");
  const beyond = found.total - found.judged;
  replace(
    place,
    h("p", { class: "soft" }, `Predicted here: ${found.judged} ${split} rows of `, found.sets.map((/** @type {string} */ set) => [short(set), " "]), `with an RMS error of a component of ${number(all.rmse_mm, 3)} mm. A card leads to the row, with the prediction beside its label and their difference.`),
    h("div", { class: "cards large", "data-own": String(found.judged), "data-split": split }, cards.map((made) => made())),
    beyond > 0 ? h("p", { class: "soft" }, `${beyond} more of them are left out here.`) : null,
  );
}

/**
 * How far the nearest learned pattern is from those of a family that are predicted best, as shares of the cells: what seems to explain a large error must not be as true of them.
 * @param {any[]} best @param {any[]} rows those that are shown @param {(row: any) => Promise<{distance: number, cells: number}|null>} far @returns {Promise<Map<string, number>>}
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

/** How far the nearest learned pattern is, and whether that tells anything. @param {{distance: number, cells: number}} near @param {string} family @param {number} [usual] */
function nearness(near, family, usual) {
  const share = near.distance / near.cells;
  const words = `its nearest pattern in training differs in ${number(100 * share, 3)} % of the cells`;
  if (usual === undefined) return [words];
  const against = `; of the best predicted ${family} it does in ${number(100 * usual, 3)} %`;
  if (share > FARTHER * usual) return [words, against, ": ", h("span", { class: "warning" }, "it is farther from what was learned")];
  return [words, against, ": that explains nothing"];
}

/** What a card says of a pattern that is predicted badly. @param {Pattern|null} pattern @param {string|null} link @param {{error: number, family: string, area: number, simulated: number, predicted: number}} told @param {string[]} why @param {{distance: number, cells: number}|null} near @param {string[]} [facts] that are true of it and alarm nobody @param {number} [usual] */
function worstCard(pattern, link, told, why, near, facts = [], usual) {
  return card(
    pattern,
    link,
    h("div", {}, h("b", {}, `error of a component ${number(told.error, 3)} mm`), told.simulated > 0 ? `, ${number((100 * told.error) / told.simulated, 3)} % of its largest displacement` : null),
    h("div", {}, `${told.family}, area ${number(100 * told.area, 3)} %`),
    h("div", {}, `largest: ${number(told.simulated, 4)} mm, predicted ${number(told.predicted, 4)} mm`),
    why.filter(Boolean).map((words) => h("div", { class: "warning" }, words)),
    near ? h("div", {}, ...nearness(near, told.family, usual)) : null,
    facts.filter(Boolean).map((words) => h("div", { class: "soft" }, words)),
  );
}

/** An evaluation: errors by family, and the worst patterns of each predictor. @param {HTMLElement} place @param {any} found @param {string} [only] the digest of the one predictor that is shown */
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
    sections.map(({ one, box }) => h("section", {}, h("h3", {}, "Worst patterns of ", named(one)), box)),
  );
  for (const { one, box } of sections) {
    try {
      await worst(box, found, one, families, scores);
    } catch (error) {
      replace(box, problem(error));
    }
  }
}

/** @param {HTMLElement} box @param {any} found @param {any} predictor @param {string[]} families @param {Record<string, any[]>} scores */
async function worst(box, found, predictor, families, scores) {
  const error = `pattern/max_error.${predictor.at}_mm`;
  const answer = await json(`artifacts/${found.digest}/rows?along=row&limit=${WORST}&sort=-${encodeURIComponent(error)}`);
  const at = (/** @type {string} */ name) => answer.columns.findIndex((/** @type {any} */ column) => column.name === name);
  const places = Object.fromEntries(["pattern/family", "pattern/area", "pattern/simulated_max_mm", "set", "set_row"].map((name) => [name, at(name)]));
  const [worstAt, rmsAt, predictedAt] = [at(error), at(`pattern/rms.${predictor.at}_mm`), at(`pattern/predicted_max.${predictor.at}_mm`)];
  if (worstAt < 0) throw new Error("the evaluation holds no errors of patterns");
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
      predictor.digest && learned === 0 ? "it has learned from no pattern of this family" : "",
      usual > 0 && row[rmsAt] > 2 * usual ? `RMS error ${number(row[rmsAt] / usual, 2)} times that of its family` : "",
    ];
    const told = { error: row[worstAt], family, area: of("pattern/area"), simulated: of("pattern/simulated_max_mm"), predicted: row[predictedAt] };
    // Drawn when all are there: a picture is as wide as its place.
    cards.push(() => worstCard(pattern, set ? rowLink(set.digest, of("set_row"), predictor.digest) : null, told, why, near));
  }
  replace(box, h("div", { class: "cards large", "data-worst": predictor.name }, cards.map((made) => made())), known ? null : h("p", { class: "soft" }, "The sets that were judged by are not in the store, so there are no pictures."));
}

/** The balanced sets that a model was trained on; none where they are not in the store. @param {string} digest @returns {Promise<string[]>} */
async function trainedOn(digest) {
  try {
    const found = await json(`artifacts/${digest}`);
    const own = found.ancestry.find((/** @type {any} */ one) => one.digest === found.digest);
    return found.ancestry.filter((/** @type {any} */ one) => own.inputs.includes(one.digest) && one.kind === "balance").map((/** @type {any} */ one) => one.digest);
  } catch {
    return [];
  }
}

/** How far the nearest pattern is that was learned from. @param {string[]} training @param {string} set @param {number} row @returns {Promise<{distance: number, cells: number}|null>} */
async function nearest(training, set, row) {
  try {
    /** @type {{distance: number, cells: number}|null} */ let best = null;
    for (const one of training) {
      // Rows that were kept for tests, the pattern itself among them, have taught nothing.
      const found = await json(`artifacts/${one}/neighbours?row=${row}&of=${set}&limit=1&split=train`);
      const first = found.neighbours[0];
      if (first && (!best || first.distance < best.distance)) best = { distance: first.distance, cells: found.cells };
    }
    return best;
  } catch {
    return null;
  }
}
