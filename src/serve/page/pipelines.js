// Pipelines: the state of their stages, and what would be built after a change.

import { json } from "./server.js";
import { attempt, bytes, cell, h, near, problem, prose, replace, replaceUrl, seconds, settled, short, table, titled, changedValues } from "./elements.js";
import { drawing as dag, list as stageList, progress, state } from "./dag.js";
import { others, underWay } from "./live.js";
import { withoutUnit } from "./quantity.js";
import { lastRuns, ofStage, ranked } from "./runs.js";

/** Values that are listed at first. */
const FIRST = 40;

/** Values that stand above all others: what a design is made for. */
const MAIN = /\.(voltages?|area|points?|direction)$/;

/** Time between two checks of a run, ms, and the longest one while the server does not respond. */
const INTERVAL = 700;
const LONGEST = 30000;

/** Exit codes of a run (`cli/output.rs`). @type {Record<number, string>} */
const ENDINGS = {
  0: "done",
  1: "failed",
  2: "invalid input",
  3: "done, but for some samples no stable solution was found",
  4: "the store is damaged",
  5: "an audit found errors",
  6: "the results differ from the lock file",
  75: "stopped, or refused by the machine; run it again to continue",
};

/** @param {HTMLElement} view @param {string} id @param {boolean} mayRun @param {URLSearchParams} query @returns {Promise<() => void>} */
export async function pipelineView(view, id, mayRun, query) {
  let found = await json(`pipelines/${encodeURIComponent(id)}`);
  // The changes are in the URL, so that a plan has a link.
  /** @type {Record<string, string>} */ let set = Object.fromEntries(query.getAll("set").filter((one) => one.includes("=")).map((one) => [one.slice(0, one.indexOf("=")), one.slice(one.indexOf("=") + 1)]));
  const address = (/** @type {Record<string, string>} */ values) => {
    const words = new URLSearchParams(Object.entries(values).map(([path, value]) => ["set", `${path}=${value}`]));
    return `#/pipelines/${encodeURIComponent(id)}${Object.keys(values).length ? `?${words}` : ""}`;
  };
  let turn = 0;
  /** The path of the refused value. @type {string|null} */ let refused = null;
  let reason = "";
  let enableButtons = () => {};
  /** Checks the run that this server started, maybe from another tab. @type {() => Promise<void>} */ let checkRun = async () => {};
  let markInvalid = () => {};
  let ended = false;
  const drawing = h("div", { class: "scroll wide-only", tabindex: "0", role: "region", "aria-label": "Drawing of the stages" });
  const stages = h("div", { class: "wide-only" });
  const narrow = h("div", { class: "narrow-only" });
  /** @type {any} */ let planned = found;
  const estimate = h("p", { id: "bill" });
  const warnings = h("div", { id: "warnings", "aria-live": "polite" });
  const elsewhere = h("div", { id: "elsewhere", "aria-live": "polite" });
  const errorBox = h("div", {});
  const runBox = h("div", {});
  const lastBox = h("div", { id: "last-runs" });

  /** @param {any} plan */
  const show = (plan) => {
    const stale = plan.stages.filter((/** @type {any} */ stage) => stage.outcome === "stale");
    const price = plan.price ? `about ${seconds(plan.price.seconds.likely)} (${seconds(plan.price.seconds.low)} to ${seconds(plan.price.seconds.high)}), ${bytes(plan.price.bytes.likely)}` : "";
    const rest = plan.unpriced ? `${price ? "; " : ""}${plan.unpriced} of them without an estimate` : "";
    estimate.textContent = stale.length ? `${stale.length} of ${plan.stages.length} stages to build: ${price}${rest}` : `up to date (${plan.stages.length} stages)`;
    estimate.dataset.stale = stale.map((/** @type {any} */ stage) => stage.name).join(" ");
    planned = plan;
    replace(warnings, (plan.warnings ?? []).map((/** @type {string} */ text) => h("p", { class: "box" }, h("b", {}, "Warning: "), prose(text))));
    showStages();
  };

  /** The main result of a stage in the last run with the values of the file, and the time that it took. @param {any} stage */
  const last = (stage) => {
    const { results, units, seconds: took } = found.last ?? {};
    const own = ranked(ofStage(results ?? {}, "", stage.name, found.stages.map((/** @type {any} */ one) => one.name)))[0];
    const name = own?.[0].slice(stage.name.length + 1) ?? "";
    const unit = own ? units?.[own[0]] ?? "" : "";
    const time = took?.[stage.name] === undefined ? "" : seconds(took[stage.name]);
    const join = (/** @type {string} */ value) => [value, time && `(${time})`].filter(Boolean).join(" ");
    const full = join(own ? `${name} ${cell(own[1])} ${unit}`.trim() : "");
    // The plan is that of changed values, the results are those of the file.
    if (Object.keys(set).length) return { text: "", full: full && `of the file: ${full}` };
    return { text: join(own ? (unit ? `${cell(own[1])} ${unit}` : `${name} ${cell(own[1])}`) : ""), full };
  };

  const showStages = () => {
    replace(lastBox, found.last ? lastRuns(found.last) : null);
    const working = underWay(found.pipeline, found.path, set);
    const texts = others(found.pipeline, set).map((run) => {
      return h("p", { class: "box" }, `Another run of this pipeline is in progress, with ${changedValues(run.set)} (process ${run.pid})${run.stages.length ? `: ${run.stages.map((/** @type {any} */ stage) => stage.name).join(", ")}` : ""}.`);
    });
    replace(elsewhere, texts);
    replace(drawing, dag(planned.stages, found.layout, working, last));
    const made = (/** @type {any} */ stage) => (stage.digest && stage.outcome !== "stale" ? short(stage.digest) : "");
    const chunks = (/** @type {any} */ stage) => (stage.chunks_built + stage.chunks_reused > 1 && stage.chunks_built ? `${stage.chunks_built} of ${stage.chunks_built + stage.chunks_reused}` : "");
    const row = (/** @type {any} */ stage) => {
      const [kind, words] = state(stage, working);
      const now = working[stage.name];
      return [
        stage.name,
        stage.kind,
        h("span", { class: kind, "data-state": kind }, kind === "stale" ? "to build" : words, now ? progress(stage, now) : null),
        stage.reasons.length ? h("span", {}, stage.reasons.map((/** @type {string} */ reason) => h("div", {}, reason))) : "",
        chunks(stage),
        stage.price ? seconds(stage.price.seconds.likely) : "",
        last(stage).full,
        made(stage),
      ];
    };
    replace(stages, table("Stages", ["stage", "kind", "state", "reason", { title: "chunks to build", number: true }, { title: "estimated time", number: true }, "last result", "artifact"], planned.stages.map(row)));
    replace(narrow, stageList(planned.stages, found.needs, working, (stage) => h("div", { class: "small" }, last(stage).full ? h("div", {}, last(stage).full) : null, chunks(stage) ? `${chunks(stage)} chunks to build ` : "", made(stage))));
  };

  const old = (/** @type {boolean} */ is) => [drawing, stages, narrow].forEach((element) => element.classList.toggle("old", is));

  const replan = async () => {
    turn += 1;
    const own = turn;
    // A number without a unit is refused here: the server would take it in the base unit.
    const bare = Object.entries(set).map(([path, value]) => [path, withoutUnit(value, found.values.find((/** @type {any} */ one) => one.path === path)?.value ?? "")]).find(([, wrong]) => wrong);
    try {
      if (bare) throw Object.assign(new Error(bare[1]), { value: bare[0] });
      const plan = Object.keys(set).length ? await json("plan", { body: { pipeline: id, set } }) : found;
      if (ended || own !== turn) return;
      replaceUrl(address(set));
      old(false);
      replace(errorBox);
      refused = null;
      reason = "";
      show(plan);
    } catch (error) {
      if (ended || own !== turn) return;
      refused = /** @type {any} */ (error).value ?? null;
      reason = [/** @type {any} */ (error).message, /** @type {any} */ (error).help].filter(Boolean).join(": ");
      // The drawing still shows the plan before.
      estimate.textContent = "No plan with these values; the plan in grey is for the values before.";
      estimate.dataset.stale = "";
      old(true);
      replace(errorBox, problem(error));
      replace(warnings);
    }
    markInvalid();
    enableButtons();
  };
  const soon = settled(() => void replan(), 250);

  const editor = () => {
    const search = h("input", { type: "search", placeholder: "part of a path, such as voltage", "aria-label": "Find a value", name: "find" });
    const list = h("div", { class: "values", role: "group", "aria-label": "Values" });
    let most = FIRST;
    const row = (/** @type {{path: string, value: string}} */ one) => {
      const before = h("span", { class: "soft small mono" });
      const wrong = h("span", { class: "error small", "data-wrong": one.path, role: "alert" });
      const note = () => {
        const changed = one.path in set;
        before.textContent = changed ? `in the file: ${one.value}` : "";
        line.classList.toggle("changed", changed);
      };
      const input = h("input", { type: "text", value: set[one.path] ?? one.value, "aria-label": one.path, "data-path": one.path, spellcheck: "false", oninput: () => {
        if (input.value === one.value) delete set[one.path];
        else set[one.path] = input.value;
        note();
        soon();
      } });
      const line = h("label", { class: "value" }, h("span", { class: "mono" }, near(one.path)), input, before, wrong);
      note();
      return line;
    };
    const main = h("div", { class: "values", role: "group", "aria-label": "Main values" });
    const isMain = (/** @type {any} */ one) => MAIN.test(one.path);
    const rest = found.values.filter((/** @type {any} */ one) => !isMain(one));
    const fill = () => {
      const search_text = search.value.trim().toLowerCase();
      const fits = rest.filter((/** @type {any} */ one) => one.path.toLowerCase().includes(search_text));
      const all = () => {
        most = Infinity;
        fill();
      };
      replace(list, fits.length ? fits.slice(0, most).map(row) : h("p", { class: "soft" }, "No path contains this text."), fits.length > most ? h("button", { type: "button", onclick: all, name: "all-values" }, `Show ${fits.length - most} more`) : null);
      markInvalid();
    };
    const fillMain = () => replace(main, found.values.filter(isMain).map(row));
    const both = (/** @type {string} */ selector) => [main, list].flatMap((/** @type {any} */ part) => [...part.querySelectorAll(selector)]);
    markInvalid = () => {
      for (const input of both("input")) {
        if (input.dataset.path === refused) input.setAttribute("aria-invalid", "true");
        else input.removeAttribute("aria-invalid");
      }
      for (const place of both("[data-wrong]")) place.textContent = place.dataset.wrong === refused ? reason : "";
    };
    search.addEventListener("input", fill);
    fillMain();
    fill();
    const back = h("button", { type: "button", onclick: () => {
      set = {};
      fillMain();
      fill();
      void replan();
    } }, "Reset to the file");
    return h("section", {}, h("h2", {}, "Change a value"), h("p", { class: "soft small" }, "The plan is updated at once; nothing is built, and no file is changed. Paths are those of ", h("code", {}, "--set"), "; give quantities with a unit: ", h("code", {}, "4 kV"), ", ", h("code", {}, "25 mm"), "."), main, h("div", { class: "tools" }, back), rest.length ? h("details", { id: "other-values", open: Object.keys(set).some((path) => !MAIN.test(path)) }, h("summary", {}, `${rest.length} other values`), h("div", { class: "tools" }, search), list) : null);
  };

  const runner = () => {
    if (!mayRun) return h("p", { class: "soft small" }, "This page cannot start runs; ", h("code", {}, "deaflow serve --allow-run"), " allows it.");
    const log = h("div", { "aria-live": "polite", id: "run-log" });
    const refusal = h("div", {});
    let running = false;
    let stopping = false;
    let timer = 0;
    let pause = INTERVAL;
    const look = async () => {
      clearTimeout(timer);
      /** @type {any} */ let status;
      try {
        status = await json("run");
        pause = INTERVAL;
      } catch (error) {
        if (ended) return;
        replace(log, problem(error));
        // A server that does not respond is asked less and less often.
        pause = Math.min(2 * pause, LONGEST);
        timer = setTimeout(() => void look(), pause);
        return;
      }
      if (ended) return;
      // A refusal because of another run is obsolete after its end.
      const hasEnded = running && !status.running;
      if (hasEnded) replace(refusal);
      running = status.running;
      stopping = Boolean(status.stopped);
      enableButtons();
      if (status.pipeline) replace(log, await report(status, status.pipeline === found.path ? address(status.set ?? {}) : null));
      clearTimeout(timer);
      if (status.running) timer = setTimeout(() => void look(), pause);
      else if (hasEnded) {
        found = await json(`pipelines/${encodeURIComponent(id)}`);
        await replan();
      }
    };
    const act = async (/** @type {() => Promise<any>} */ what) => {
      replace(refusal);
      await attempt(refusal, what);
      await look();
    };
    const begin = h("button", { type: "button", class: "main", id: "run", onclick: () => act(() => json("run", { body: { pipeline: id, set } })) }, "Run with these values");
    const stop = h("button", { type: "button", id: "stop-run", disabled: true, onclick: () => act(() => json("run", { method: "DELETE" })) }, "Stop");
    enableButtons = () => {
      begin.disabled = running || estimate.textContent.startsWith("No plan");
      stop.disabled = !running || stopping;
    };
    checkRun = look;
    void look();
    return h("section", { "aria-label": "Run" }, h("div", { class: "tools" }, begin, stop), refusal, log);
  };

  if (found.problem) {
    replace(view, h("h1", {}, "Pipeline"), h("p", { class: "mono" }, near(found.path)), problem(found.problem), source(found.text, found.problem.file === found.path ? found.problem.line : null));
  } else {
    replace(view, h("h1", {}, found.pipeline), h("p", { class: "mono soft" }, near(found.path)), h("div", { class: "planned" }, estimate, runBox), lastBox, elsewhere, errorBox, warnings, drawing, narrow, editor(), stages, h("details", {}, h("summary", {}, "The file"), source(found.text, null)));
    replace(runBox, runner());
    titled(`${found.pipeline} – Pipelines`);
    show(found);
    if (Object.keys(set).length) void replan();
  }
  const news = async () => {
    if (ended) return;
    const fresh = await json(`pipelines/${encodeURIComponent(id)}`);
    if (ended || Boolean(fresh.problem) !== Boolean(found.problem)) return;
    found = fresh;
    if (found.problem) return;
    await replan();
    await checkRun();
  };
  const listen = () => void news().catch(() => {});
  // A running stage makes progress between two plans.
  const update = () => {
    if (!found.problem) showStages();
  };
  window.addEventListener("news", listen);
  window.addEventListener("standing", update);
  return () => {
    ended = true;
    window.removeEventListener("news", listen);
    window.removeEventListener("standing", update);
  };
}

/** The state of the run that this server started: its pipeline and values, its events, and its output. @param {any} status @param {string|null} plan the URL of the plan with its values */
async function report(status, plan) {
  const values = changedValues(status.set ?? {});
  const of = ["Run of ", near(status.pipeline), " with ", plan ? h("a", { href: plan }, values) : values];
  if (status.running) {
    const last = status.events.slice(-12).map(words);
    const state = status.stopped ? "stopping: finishing the current step" : "running";
    return [h("p", {}, h("span", { class: "running" }, state), ` for ${seconds(status.seconds)}. `, of, "."), last.length ? h("pre", {}, last.join("\n")) : null];
  }
  const ending = status.stopped && status.exit_code === 75 ? "stopped; run it again with the same values to continue" : ENDINGS[status.exit_code] ?? `ended with exit code ${status.exit_code}`;
  const id = await runOf(status.pid);
  const failed = status.exit_code === 0 ? [] : status.events.slice(-12).map(words);
  return [
    h("p", { id: "run-end", "data-code": String(status.exit_code) }, h("b", { class: status.exit_code === 0 || status.stopped ? null : "error" }, ending), `, after ${seconds(status.seconds)}. `, of, ". ", id ? h("a", { href: `#/runs/${id}` }, "Results and artifacts") : null),
    status.printed || failed.length ? h("pre", { tabindex: "0" }, [...failed, status.printed.trim()].filter(Boolean).join("\n")) : null,
  ];
}

/** Describes an event. @param {any} event */
function words(event) {
  if (event.text) return event.event === "warning" ? `warning: ${event.text}` : event.text;
  const what = (event.event ?? "").replace(/^stage-/, "").replace(/^run-/, "run ").replaceAll("-", " ");
  // A stopped stage has not failed.
  if (what === "failed" && event.why?.startsWith("stopped")) return `${event.name ?? ""}: ${event.why}`;
  return [`${event.name ?? event.pipeline ?? ""}:`, what, event.why && `(${event.why})`].filter(Boolean).join(" ");
}

/** The id of the run of a process, from the name of its log; null if it has built nothing. @param {number} process */
async function runOf(process) {
  try {
    const { runs } = await json("runs?limit=20");
    return runs.find((/** @type {any} */ run) => run.log?.endsWith(`-${process}.log`))?.id ?? null;
  } catch {
    return null;
  }
}

/** The text with line numbers, and a marked line. @param {string} text @param {number|null} wrong */
function source(text, wrong) {
  const line = (/** @type {string} */ content, /** @type {number} */ at) => h("span", { class: at + 1 === wrong ? "wrong" : null }, content || " ");
  return h("pre", { class: "source", tabindex: "0" }, text.split("\n").map(line));
}
