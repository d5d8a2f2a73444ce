// Past runs: one of them, and the comparison of several.

import { json } from "./server.js";
import { attempt, cell, h, near, number, pageOf, prose, replace, seconds, short, table, titled, changedValues, changes, when } from "./elements.js";
import { image } from "./pictures.js";

/** The order of results. */
const FIRST = [/\.displacement$/, /\.yield$/, /\.predicted$/, /\.(rmse|max_error)/, /\.value/, /\.max_displacement$/];

/** Sorts results by importance: displacements of verified designs, yields, then errors of models. @param {Record<string, any>} results @returns {[string, any][]} */
export function ranked(results) {
  const place = (/** @type {string} */ name) => {
    const at = FIRST.findIndex((one) => one.test(name));
    return at < 0 ? FIRST.length : at;
  };
  return Object.entries(results).sort(([a], [b]) => place(a) - place(b));
}

/**
 * The last runs of a pipeline: that with the values of its file, and a later one with others.
 * @param {{run: any, changed: any}} last
 */
export function lastRuns({ run, changed }) {
  const link = (/** @type {any} */ one) => h("a", { href: `#/runs/${one.id}` }, `${when(one.created).slice(0, 16)} UTC`);
  return [
    h("p", { class: "soft small" }, run ? ["Last run ", link(run), `, took ${seconds(run.seconds)}`] : changed ? "no run with the values of the file" : "never run"),
    changed ? h("div", { class: "soft small" }, h("p", {}, run ? "Later run " : "Last run ", link(changed), " with "), changes(changed.overrides)) : null,
  ];
}

/** @param {HTMLElement} view @param {string} id */
export async function runView(view, id) {
  const run = await json(`runs/${encodeURIComponent(id)}`);
  titled(`Run ${run.id} of ${run.pipeline}`);
  const pairs = (/** @type {Record<string, any>} */ of) => Object.entries(of).map(([name, value]) => [h("span", { class: "mono" }, name), typeof value === "number" ? h("span", { title: String(value) }, cell(value)) : String(value)]);
  const best = h("section", { class: "best", "aria-label": "Best design", id: "opening" }, h("p", { class: "soft" }, "Drawing the best design …"));
  replace(
    view,
    h("h1", {}, `Run ${run.id}`),
    h("p", {}, `${run.pipeline}, ${when(run.created)} UTC, on ${run.host}, took ${seconds(run.seconds)}${Object.keys(run.overrides).length ? `, with ${changedValues(run.overrides)}` : ""}`),
    h("p", { class: "mono soft" }, near(run.path)),
    best,
    (run.warnings ?? []).map((/** @type {string} */ text) => h("p", { class: "box" }, h("b", {}, "Warning: "), prose(text))),
    Object.keys(run.overrides).length ? [h("h2", {}, "Changed values"), table("Overrides", ["path", "value"], pairs(run.overrides))] : null,
    h("h2", {}, "Stages"),
    h("div", { class: "folded", id: "run-stages" }, byStage(run).map((one) => stageDetails(run, one))),
  );
  void attempt(best, async () => {
    const { sentence, facts, picture, caption } = await json(`runs/${encodeURIComponent(id)}/opening`);
    const lines = facts.length ? facts : run.headlines.slice(sentence ? 1 : 0);
    replace(
      best,
      picture ? h("figure", {}, image(picture, `Result of run ${run.id}`), h("figcaption", { class: "soft small" }, caption)) : null,
      h("div", {}, sentence ? h("p", { class: "headline" }, sentence) : h("p", { class: "soft" }, "no results"), lines.length ? h("ul", { id: "headlines" }, lines.map((/** @type {string} */ line) => h("li", {}, prose(line)))) : null),
    );
  });
}

/**
 * The stages of a run, each with its own results and parameters.
 * @param {any} run @returns {{stage: any, results: Record<string, number>, parameters: Record<string, any>}[]}
 */
function byStage(run) {
  const names = run.stages.map((/** @type {any} */ stage) => stage.name);
  return run.stages.map((/** @type {any} */ stage) => ({ stage, results: ofStage(run.results, "", stage.name, names), parameters: ofStage(run.parameters, "stages.", stage.name, names) }));
}

/**
 * The values of a stage, whose names are those of their stages with a text before and more after a dot.
 * @param {Record<string, any>} values @param {string} before @param {string} stage @param {string[]} names of all stages
 */
export function ofStage(values, before, stage, names) {
  // The name of a stage may begin with that of another one.
  const sorted = [...names].sort((a, b) => b.length - a.length);
  const own = Object.entries(values).filter(([name]) => sorted.find((one) => name.startsWith(`${before}${one}.`)) === stage);
  return Object.fromEntries(own);
}

/** Main results beside the name of a stage. */
const MAIN = 2;

/** A stage, folded: its results, figures and parameters. @param {any} run @param {ReturnType<typeof byStage>[number]} one */
function stageDetails(run, { stage, results, parameters }) {
  const short_name = (/** @type {string} */ name, /** @type {string} */ before) => h("span", { class: "mono" }, name.slice(before.length));
  const unit = (/** @type {string} */ name) => run.units?.[name] ?? "";
  const sorted = ranked(results);
  const main = sorted.slice(0, MAIN).map(([name, value]) => `${name.slice(stage.name.length + 1)} ${cell(value)}${unit(name) && ` ${unit(name)}`}`);
  const figures = h("div", {});
  const rows = Object.entries(parameters).map(([name, value]) => [short_name(name, `stages.${stage.name}.`), String(value)]);
  const open = () => {
    if (!stage.digest || stage.removed || figures.childElementCount) return;
    replace(figures, pageOf(stage.digest, `Figures of ${stage.name}`));
  };
  return h(
    "details",
    { "data-stage": stage.name, ontoggle: open },
    h("summary", {}, h("b", {}, stage.name), " ", h("span", { class: stage.outcome === "failed" ? "error" : "soft" }, stage.outcome), main.length ? h("span", { class: "soft" }, `: ${main.join(", ")}`) : null),
    stage.digest ? h("p", {}, "Artifact ", stage.removed ? [h("span", { class: "mono soft" }, stage.digest.slice(0, 12)), ` (removed by gc at ${when(stage.removed)} UTC)`] : short(stage.digest)) : null,
    sorted.length ? table(`Results of ${stage.name}`, ["result", { title: "value", number: true }, "unit"], sorted.map(([name, value]) => [short_name(name, `${stage.name}.`), h("span", { title: String(value) }, cell(value)), unit(name)])) : null,
    figures,
    rows.length ? h("details", {}, h("summary", {}, "Parameters"), table(`Parameters of ${stage.name}`, ["parameter", "value"], rows)) : null,
  );
}

/** @param {HTMLElement} view @param {string[]} ids */
export async function compareView(view, ids) {
  const runs = await Promise.all(ids.map((id) => json(`runs/${encodeURIComponent(id)}`)));
  // Overrides are compared as parameters; runs without the override have the value of the file.
  const changed = new Set(runs.flatMap((run) => Object.keys(run.overrides)));
  for (const run of runs) {
    for (const path of changed) run.parameters[path] = run.overrides[path] ?? run.parameters[path] ?? "value of the file";
  }
  // Stages that are not in all runs are not compared.
  const built = (/** @type {any} */ run) => new Set(run.stages.filter((/** @type {any} */ stage) => stage.digest).map((/** @type {any} */ stage) => stage.name));
  const inAll = runs.map(built).reduce((some, own) => new Set([...some].filter((name) => own.has(name))));
  const left = [...new Set(runs.flatMap((run) => [...built(run)]))].filter((name) => !inAll.has(name));
  const compares = (/** @type {"parameters"|"results"} */ key, /** @type {string} */ name) => {
    const stage = key === "parameters" ? /^stages\.(.+?)\./.exec(name)?.[1] : left.find((one) => name.startsWith(`${one}.`));
    return changed.has(name) || stage === undefined || !left.includes(stage);
  };
  /** @type {Record<string, string>} */ const units = Object.assign({}, ...runs.map((run) => run.units ?? {}));
  /** Rows of the differences, or of all values. @param {"parameters"|"results"} key @param {boolean} all */
  const rows = (key, all) => {
    const names = [...new Set(runs.flatMap((run) => Object.keys(run[key])))].sort();
    const differs = (/** @type {string} */ name) => new Set(runs.map((run) => JSON.stringify(run[key][name]))).size > 1;
    return names
      .filter((name) => compares(key, name) && (all || differs(name)))
      .map((name) => [h("span", { class: "mono" }, name, key === "results" && units[name] ? h("span", { class: "soft" }, `, ${units[name]}`) : null), ...runs.map((run) => {
        const value = run[key][name];
        return value === undefined ? "–" : typeof value === "number" ? h("span", { title: String(value) }, number(value, 6)) : h("span", { class: "mono" }, String(value));
      })]);
  };
  const heads = (/** @type {string} */ first, /** @type {boolean} */ are) => [first, ...runs.map((run) => ({ title: `${run.id}, ${when(run.created)}`, number: are }))];
  const figures = runs.map((run) => {
    // The same stage of all runs.
    const last = run.stages.filter((/** @type {any} */ stage) => inAll.has(stage.name)).slice(-1)[0];
    return h("div", {}, h("h3", {}, `${run.id}: ${last?.name ?? ""}`), last?.digest ? pageOf(last.digest, `Figures of ${last.name}`) : null);
  });
  const differing = rows("parameters", false);
  const results = rows("results", false);
  const equal = rows("results", true).length - results.length;
  const box = h("div", {});
  const fill = (/** @type {boolean} */ all) => {
    const shown = all ? rows("results", true) : results;
    replace(box, shown.length ? table("Results", heads("result", true), shown) : h("p", {}, "All results are equal."));
  };
  fill(false);
  replace(
    view,
    h("h1", {}, `${runs.length} runs`),
    left.length ? h("p", { class: "soft", id: "left-out" }, `Not compared, because not all of the runs have them: ${left.join(", ")}.`) : null,
    h("h2", {}, "Different parameters"),
    differing.length ? table("Parameters", heads("parameter", false), differing) : h("p", {}, "None."),
    h("h2", {}, "Results"),
    equal ? h("label", { class: "toggle" }, h("input", { type: "checkbox", name: "equal", onchange: (/** @type {any} */ event) => fill(event.target.checked) }), `Show ${equal} equal results`) : null,
    box,
    h("h2", {}, "Figures of the last common stage"),
    h("div", { class: "pair" }, figures),
  );
}
