// The list of past runs: its columns are chosen and sorted, and the runs of a sweep are drawn as lines.

import { json } from "./server.js";
import { cell, changes, choice, h, labelled, replace, replaceUrl, seconds, table, when } from "./elements.js";
import { parallel, single, varied } from "./parallel.js";
import { ranked } from "./runs.js";

/** Runs that are read. */
const MOST = 200;

/** Results in a row. */
const MAX_RESULTS = 4;

/** Marked runs; they are kept when the view changes. @type {Set<string>} */
const CHOSEN = new Set();

/** The units of results. @type {Record<string, string>} */
let UNITS = {};

/** The name of a result with its unit. @param {string} name */
function withUnit(name) {
  return UNITS[name] ? `${name}, ${UNITS[name]}` : name;
}

/** @param {any} run @param {string} outcome */
function withOutcome(run, outcome) {
  return run.stages.filter((/** @type {any} */ stage) => stage.outcome === outcome).map((/** @type {any} */ stage) => stage.name);
}

/** @param {any} run */
function built(run) {
  const [done, failed, stopped] = ["built", "failed", "stopped"].map((outcome) => withOutcome(run, outcome));
  return h("span", {}, done.length > 5 ? `${done.length} of ${run.stages.length}` : done.join(", ") || "nothing", failed.length ? h("span", { class: "error" }, ` failed: ${failed.join(", ")}`) : null, stopped.length ? ` stopped: ${stopped.join(", ")}` : null);
}

/**
 * A column: its title, what is shown, and what it is sorted by.
 * @typedef {{title: string, number?: boolean, show: (run: any) => any, by: (run: any) => any}} Column
 */

/** Columns of all runs. @type {Record<string, Column>} */
const COLUMNS = {
  run: { title: "run", show: (run) => h("a", { class: "mono", href: `#/runs/${run.id}` }, run.id), by: (run) => run.id },
  ended: { title: "ended", show: (run) => when(run.created), by: (run) => run.created },
  pipeline: { title: "pipeline", show: (run) => (run.command === "run" ? run.pipeline : `${run.pipeline} (${run.command})`), by: (run) => run.pipeline },
  took: { title: "took", number: true, show: (run) => seconds(run.seconds), by: (run) => run.seconds },
  built: { title: "built", show: built, by: (run) => withOutcome(run, "built").length },
  changed: { title: "changed", show: (run) => changes(run.overrides), by: (run) => JSON.stringify(run.overrides) },
  results: { title: "results", show: (run) => h("span", {}, ranked(run.results).slice(0, MAX_RESULTS).map(([name, value]) => h("div", {}, `${name} ${cell(value)}${UNITS[name] ? ` ${UNITS[name]}` : ""}`))), by: (run) => Object.keys(run.results).length },
  host: { title: "machine", show: (run) => run.host, by: (run) => run.host },
};

/** Columns that are shown at first. */
const USUAL = ["run", "ended", "pipeline", "took", "built", "changed", "results"];

/** All columns of some runs: those of all runs, each changed value, and each result. @param {any[]} runs @returns {Record<string, Column>} */
function columnsOf(runs) {
  const names = (/** @type {"overrides"|"results"} */ key) => [...new Set(runs.flatMap((run) => Object.keys(run[key])))].sort();
  const changed = names("overrides").map((name) => [`set:${name}`, { title: name, show: (/** @type {any} */ run) => run.overrides[name] ?? "", by: (/** @type {any} */ run) => run.overrides[name] }]);
  const results = names("results").map((name) => [`result:${name}`, { title: withUnit(name), number: true, show: (/** @type {any} */ run) => (name in run.results ? h("span", { title: String(run.results[name]) }, cell(run.results[name])) : ""), by: (/** @type {any} */ run) => run.results[name] }]);
  return { ...COLUMNS, ...Object.fromEntries(changed), ...Object.fromEntries(results) };
}

/** Compares two values; what is missing comes last in both directions. @param {any} a @param {any} b @param {number} sign */
function compared(a, b, sign) {
  if (a === undefined || b === undefined) return Number(a === undefined) - Number(b === undefined);
  return sign * (typeof a === "number" && typeof b === "number" ? a - b : String(a).localeCompare(String(b), "en", { numeric: true }));
}

/** @param {HTMLElement} view @param {URLSearchParams} query @returns {Promise<() => void>} */
export async function runsView(view, query) {
  const list = new RunList(view, query);
  await list.read();
  const listen = () => void list.read().catch(() => {});
  window.addEventListener("news", listen);
  return () => {
    list.ended = true;
    window.removeEventListener("news", listen);
  };
}

class RunList {
  /** @param {HTMLElement} view @param {URLSearchParams} query */
  constructor(view, query) {
    this.ended = false;
    /** @type {any[]} */ this.runs = [];
    /** What the address holds. */
    this.shown = query.get("columns")?.split(",").filter(Boolean) ?? USUAL;
    this.sort = query.get("sort") ?? "";
    this.pipeline = query.get("pipeline") ?? "";
    this.result = query.get("result") ?? "";
    this.compare = h("button", { type: "button", disabled: CHOSEN.size < 2, onclick: () => (location.hash = `#/runs/compare/${[...CHOSEN].join("/")}`) }, "Compare");
    this.controls = h("span", { class: "tools" });
    this.chooser = h("div", { class: "boxes" });
    this.chart = h("div", { id: "parallel" });
    this.box = h("div", {});
    replace(
      view,
      h("h1", {}, "Runs"),
      h("div", { class: "tools" }, this.compare, h("span", { class: "soft" }, "mark two or more runs"), this.controls),
      h("details", { id: "columns" }, h("summary", {}, "Columns"), this.chooser),
      this.chart,
      this.box,
    );
  }

  async read() {
    let { runs, more, units } = await json(`runs?limit=${MOST}`);
    UNITS = units;
    const paths = varied(single(runs));
    if (paths.length) ({ runs, more } = await json(`runs?limit=${MOST}&values=${encodeURIComponent(paths.join(","))}`));
    if (this.ended) return;
    this.runs = runs;
    this.more = more;
    this.show();
  }

  /** @param {Record<string, any>} values */
  take(values) {
    Object.assign(this, values);
    this.show();
  }

  keep() {
    const words = new URLSearchParams();
    if (this.shown.join() !== USUAL.join()) words.set("columns", this.shown.join(","));
    for (const name of /** @type {const} */ (["sort", "pipeline", "result"])) if (this[name]) words.set(name, this[name]);
    replaceUrl(`#/runs${words.size ? `?${words}` : ""}`);
  }

  show() {
    this.keep();
    const pipelines = [...new Set(this.runs.map((run) => run.pipeline))].sort();
    const runs = this.runs.filter((run) => !this.pipeline || run.pipeline === this.pipeline);
    const columns = columnsOf(runs);
    const shown = this.shown.filter((name) => columns[name]);
    const [sign, by] = this.sort.startsWith("-") ? [-1, this.sort.slice(1)] : [1, this.sort];
    if (columns[by]) runs.sort((a, b) => compared(columns[by].by(a), columns[by].by(b), sign));
    const orders = shown.flatMap((name) => [[name, `${columns[name].title}, rising`], [`-${name}`, `${columns[name].title}, falling`]]);
    replace(
      this.controls,
      pipelines.length > 1 ? labelled("Pipeline", choice("pipeline", [["", "all"], ...pipelines.map((name) => /** @type {[string, string]} */ ([name, name]))], this.pipeline, (pipeline) => this.take({ pipeline }))) : null,
      labelled("Sort by", choice("sort", [["", "latest first"], .../** @type {[string, string][]} */ (orders)], this.sort, (sort) => this.take({ sort }))),
    );
    this.showChooser(columns);
    this.showChart(runs);
    const heads = shown.map((name) => this.head(name, columns[name], by === name ? sign : 0));
    const rows = runs.map((run) => [this.mark(run), ...shown.map((name) => columns[name].show(run))]);
    replace(this.box, runs.length ? table("Runs", ["", ...heads], rows, true) : h("p", {}, "There are no runs yet; start one with ", h("code", {}, "deaflow run pipeline.yaml"), "."), this.more ? h("p", { class: "soft" }, `The last ${this.runs.length} runs; deaflow log lists all.`) : null);
  }

  /** The head of a column, which sorts by it. @param {string} name @param {Column} column @param {number} sign how it is sorted now */
  head(name, column, sign) {
    const next = sign === 1 ? `-${name}` : sign === -1 ? "" : name;
    const arrow = sign === 1 ? " ▲" : sign === -1 ? " ▼" : "";
    const head = h("button", { type: "button", "data-sort": name, onclick: () => this.take({ sort: next }) }, `${column.title}${arrow}`);
    return { title: column.title, number: column.number, head, sort: sign === 1 ? "ascending" : sign === -1 ? "descending" : "none" };
  }

  /** @param {any} run */
  mark(run) {
    const mark = h("input", { type: "checkbox", checked: CHOSEN.has(run.id), "aria-label": `Compare run ${run.id}`, onchange: () => {
      if (mark.checked) CHOSEN.add(run.id);
      else CHOSEN.delete(run.id);
      this.compare.disabled = CHOSEN.size < 2;
    } });
    return mark;
  }

  /** @param {Record<string, Column>} columns */
  showChooser(columns) {
    // The boxes stay while somebody goes through them.
    const names = Object.keys(columns).join();
    if (this.chooser.dataset.names === names) return;
    this.chooser.dataset.names = names;
    const box = (/** @type {string} */ name) => h("label", { class: "toggle" }, h("input", { type: "checkbox", name: `column-${name}`, checked: this.shown.includes(name), onchange: (/** @type {any} */ event) => this.take({ shown: event.target.checked ? [...this.shown, name] : this.shown.filter((one) => one !== name) }) }), h("span", { class: name.includes(":") ? "mono" : null }, columns[name].title));
    replace(this.chooser, Object.keys(columns).map(box));
  }

  /** Draws the runs of a pipeline with changed values. @param {any[]} all */
  showChart(all) {
    const runs = single(all);
    const axes = varied(runs);
    const results = [...new Set(runs.flatMap((run) => ranked(run.results).map(([name]) => name)))];
    const ofOne = new Set(runs.map((run) => run.pipeline)).size === 1;
    if (!ofOne || !axes.length || !results.length) {
      const hint = !ofOne && varied(single(this.runs)).length ? "Choose a pipeline to see how its results depend on the changed values." : "";
      replace(this.chart, hint ? h("p", { class: "soft small" }, hint) : null);
      return;
    }
    const result = results.includes(this.result) ? this.result : results[0];
    const options = results.map((name) => /** @type {[string, string]} */ ([name, withUnit(name)]));
    replace(this.chart, h("div", { class: "tools" }, labelled("Result", choice("result", options, result, (chosen) => this.take({ result: chosen })))), parallel(runs, axes, result));
  }
}
