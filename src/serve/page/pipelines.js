// Pipelines: how they stand, and what a change would have built anew.

import { json } from "./server.js";
import { bytes, h, near, problem, replace, seconds, settled, short, table, titled } from "./elements.js";
import { drawing as dag, list as stageList, progress, state } from "./dag.js";
import { others, underWay } from "./live.js";
import { withoutUnit } from "./quantity.js";

/** Values that are listed before more are asked for. */
const FIRST = 40;

/** Between two looks at a run, ms, and the longest where the server does not answer. */
const LOOK = 700;
const LONGEST = 30000;

/** What the numbers mean with which a run ends (`cli/output.rs`). @type {Record<number, string>} */
const ENDINGS = {
  0: "done",
  1: "it failed",
  2: "its input cannot be used",
  3: "done, but for some samples no stable solution was found",
  4: "the store is damaged",
  5: "an audit found errors",
  6: "it is not what its lock file says",
  75: "it was stopped, or the machine refused; to run it again goes on where it was",
};

/** @param {HTMLElement} view @param {any} start */
export async function pipelinesView(view, start) {
  const { pipelines } = await json("pipelines");
  const rows = pipelines.map((/** @type {any} */ one) => [h("a", { href: `#/pipelines/${one.id}` }, one.name ?? "has a problem"), h("span", { class: "mono" }, near(one.path))]);
  replace(
    view,
    h("h1", {}, "Pipelines"),
    h("p", { class: "soft" }, `Store: ${near(start.store)}`),
    rows.length ? table("Pipelines", ["name", "file"], rows) : h("p", {}, "None is named, and none has been run in this store. ", h("code", {}, "deaflow serve pipeline.yaml"), " shows one; the ", h("a", { href: "#/sketch" }, "sketchpad"), " needs none."),
  );
}

/** @param {HTMLElement} view @param {string} id @param {boolean} mayRun @param {URLSearchParams} query @returns {Promise<() => void>} */
export async function pipelineView(view, id, mayRun, query) {
  let found = await json(`pipelines/${encodeURIComponent(id)}`);
  // What is changed stands in the address, so that a plan has a link of its own.
  /** @type {Record<string, string>} */ let set = Object.fromEntries(query.getAll("set").filter((one) => one.includes("=")).map((one) => [one.slice(0, one.indexOf("=")), one.slice(one.indexOf("=") + 1)]));
  const address = (/** @type {Record<string, string>} */ values) => {
    const words = new URLSearchParams(Object.entries(values).map(([path, value]) => ["set", `${path}=${value}`]));
    return `#/pipelines/${encodeURIComponent(id)}${Object.keys(values).length ? `?${words}` : ""}`;
  };
  const keep = () => {
    const wanted = address(set);
    if (location.hash !== wanted) history.replaceState(null, "", wanted);
  };
  let turn = 0;
  /** The value that is refused, and why. @type {string|null} */ let refused = null;
  let reason = "";
  let able = () => {};
  /** Looks at the run that was begun here, which may be that of another tab. @type {() => Promise<void>} */ let attend = async () => {};
  let mark = () => {};
  let ended = false;
  const drawing = h("div", { class: "scroll wide-only", tabindex: "0", role: "region", "aria-label": "Drawing of the stages" });
  const stages = h("div", { class: "wide-only" });
  const narrow = h("div", { class: "narrow-only" });
  /** @type {any} */ let planned = found;
  const bill = h("p", { id: "bill" });
  const warnings = h("div", { id: "warnings", "aria-live": "polite" });
  const elsewhere = h("div", { id: "elsewhere", "aria-live": "polite" });
  const trouble = h("div", {});
  const runBox = h("div", {});

  /** @param {any} plan */
  const show = (plan) => {
    const stale = plan.stages.filter((/** @type {any} */ stage) => stage.outcome === "stale");
    const price = plan.price ? `about ${seconds(plan.price.seconds.likely)} (${seconds(plan.price.seconds.low)} to ${seconds(plan.price.seconds.high)}), ${bytes(plan.price.bytes.likely)}` : "";
    const rest = plan.unpriced ? `${price ? "; " : ""}${plan.unpriced} of them have no price yet` : "";
    bill.textContent = stale.length ? `${stale.length} of ${plan.stages.length} stages to build: ${price}${rest}` : `all ${plan.stages.length} stages are fresh`;
    bill.dataset.stale = stale.map((/** @type {any} */ stage) => stage.name).join(" ");
    planned = plan;
    replace(warnings, (plan.warnings ?? []).map((/** @type {string} */ text) => h("p", { class: "box" }, h("b", {}, "Warning: "), text)));
    show_stages();
  };

  const show_stages = () => {
    const working = underWay(found.pipeline, found.path, set);
    const told = others(found.pipeline, set).map((run) => {
      const values = Object.entries(run.set).map(([path, value]) => `${path}=${value}`).join(", ") || "the values of the file";
      return h("p", { class: "box" }, `Another run of this pipeline goes on, with ${values} (process ${run.pid})${run.stages.length ? `: ${run.stages.map((/** @type {any} */ stage) => stage.name).join(", ")}` : ""}.`);
    });
    replace(elsewhere, told);
    replace(drawing, dag(planned.stages, found.layout, working));
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
        made(stage),
      ];
    };
    replace(stages, table("Stages", ["stage", "kind", "state", "why", { title: "chunks to build", number: true }, { title: "takes about", number: true }, "artifact"], planned.stages.map(row)));
    replace(narrow, stageList(planned.stages, found.needs, working, (stage) => h("div", { class: "small" }, chunks(stage) ? `${chunks(stage)} chunks to build ` : "", made(stage))));
  };

  const old = (/** @type {boolean} */ is) => [drawing, stages, narrow].forEach((element) => element.classList.toggle("old", is));

  const replan = async () => {
    turn += 1;
    const own = turn;
    // A number without a unit is not asked about: the server would take it in the base unit.
    const bare = Object.entries(set).map(([path, value]) => [path, withoutUnit(value, found.values.find((/** @type {any} */ one) => one.path === path)?.value ?? "")]).find(([, wrong]) => wrong);
    try {
      if (bare) throw Object.assign(new Error(bare[1]), { value: bare[0] });
      const plan = Object.keys(set).length ? await json("plan", { body: { pipeline: id, set } }) : found;
      if (ended || own !== turn) return;
      keep();
      old(false);
      replace(trouble);
      refused = null;
      reason = "";
      show(plan);
    } catch (error) {
      if (ended || own !== turn) return;
      refused = /** @type {any} */ (error).value ?? null;
      reason = [/** @type {any} */ (error).message, /** @type {any} */ (error).help].filter(Boolean).join(": ");
      // What is drawn is the plan of the values before.
      bill.textContent = "No plan with these values; what is shown in grey is that of the values before.";
      bill.dataset.stale = "";
      old(true);
      replace(trouble, problem(error));
      replace(warnings);
    }
    mark();
    able();
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
    const fill = () => {
      const wanted = search.value.trim().toLowerCase();
      const fits = found.values.filter((/** @type {any} */ one) => one.path.toLowerCase().includes(wanted));
      const all = () => {
        most = Infinity;
        fill();
      };
      replace(list, fits.length ? fits.slice(0, most).map(row) : h("p", { class: "soft" }, "No path has that in it."), fits.length > most ? h("button", { type: "button", onclick: all, name: "all-values" }, `Show ${fits.length - most} more`) : null);
      mark();
    };
    mark = () => {
      for (const input of list.querySelectorAll("input")) {
        if (input.dataset.path === refused) input.setAttribute("aria-invalid", "true");
        else input.removeAttribute("aria-invalid");
      }
      for (const place of list.querySelectorAll("[data-wrong]")) place.textContent = place.dataset.wrong === refused ? reason : "";
    };
    search.addEventListener("input", fill);
    fill();
    const back = h("button", { type: "button", onclick: () => {
      set = {};
      fill();
      void replan();
    } }, "As in the file");
    return h("section", {}, h("h2", {}, "Change a value"), h("p", { class: "soft small" }, "What would be built anew is shown at once; nothing is built and no file is changed. Paths are those of ", h("code", {}, "--set"), "; quantities have their unit: ", h("code", {}, "4 kV"), ", ", h("code", {}, "25 mm"), "."), h("div", { class: "tools" }, search, back), list);
  };

  const runner = () => {
    if (!mayRun) return h("p", { class: "soft small" }, "Nothing is run from here; ", h("code", {}, "deaflow serve --allow-run"), " allows it.");
    const log = h("div", { "aria-live": "polite", id: "run-log" });
    const refusal = h("div", {});
    let running = false;
    let stopping = false;
    let timer = 0;
    let pause = LOOK;
    const look = async () => {
      clearTimeout(timer);
      /** @type {any} */ let told;
      try {
        told = await json("run");
        pause = LOOK;
      } catch (error) {
        if (ended) return;
        replace(log, problem(error));
        // A server that does not answer is asked ever more seldom.
        pause = Math.min(2 * pause, LONGEST);
        timer = setTimeout(() => void look(), pause);
        return;
      }
      if (ended) return;
      // What another page was refused, while a run went on, is over with that run.
      const has_ended = running && !told.running;
      if (has_ended) replace(refusal);
      running = told.running;
      stopping = Boolean(told.stopped);
      able();
      if (told.pipeline) replace(log, await report(told, told.pipeline === found.path ? address(told.set ?? {}) : null));
      clearTimeout(timer);
      if (told.running) timer = setTimeout(() => void look(), pause);
      else if (has_ended) {
        found = await json(`pipelines/${encodeURIComponent(id)}`);
        await replan();
      }
    };
    const act = async (/** @type {() => Promise<any>} */ what) => {
      replace(refusal);
      try {
        await what();
      } catch (error) {
        replace(refusal, problem(error));
      }
      await look();
    };
    const begin = h("button", { type: "button", class: "main", id: "run", onclick: () => act(() => json("run", { body: { pipeline: id, set } })) }, "Run with these values");
    const stop = h("button", { type: "button", id: "stop-run", disabled: true, onclick: () => act(() => json("run", { method: "DELETE" })) }, "Stop");
    able = () => {
      begin.disabled = running || bill.textContent.startsWith("No plan");
      stop.disabled = !running || stopping;
    };
    attend = look;
    void look();
    return h(
      "section",
      {},
      h("h2", {}, "Run"),
      h("div", { class: "tools" }, begin, stop),
      refusal,
      log,
    );
  };

  if (found.problem) {
    replace(view, h("h1", {}, "Pipeline"), h("p", { class: "mono" }, near(found.path)), problem(found.problem), source(found.text, found.problem.file === found.path ? found.problem.line : null));
  } else {
    replace(view, h("h1", {}, found.pipeline), h("p", { class: "mono soft" }, near(found.path)), bill, elsewhere, trouble, warnings, drawing, stages, narrow, editor(), runBox, h("details", {}, h("summary", {}, "The file"), source(found.text, null)));
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
    await attend();
  };
  const listen = () => void news().catch(() => {});
  // A stage under way goes on between two plans.
  const stand = () => {
    if (!found.problem) show_stages();
  };
  window.addEventListener("news", listen);
  window.addEventListener("standing", stand);
  return () => {
    ended = true;
    window.removeEventListener("news", listen);
    window.removeEventListener("standing", stand);
  };
}

/** What has become of the run that was begun here: of which pipeline with which values, its events, and what it has printed at its end. @param {any} told @param {string|null} plan the address of the plan with its values */
async function report(told, plan) {
  const values = Object.entries(told.set ?? {}).map(([path, value]) => `${path}=${value}`).join(", ");
  const with_values = values || "the values of the file";
  const of = ["Run of ", near(told.pipeline), " with ", plan ? h("a", { href: plan }, with_values) : with_values];
  if (told.running) {
    const last = told.events.slice(-12).map(words);
    const state = told.stopped ? "stopping: what is under way is written down" : "running";
    return [h("p", {}, h("span", { class: "running" }, state), ` for ${seconds(told.seconds)}. `, of, "."), last.length ? h("pre", {}, last.join("\n")) : null];
  }
  const ending = told.stopped && told.exit_code === 75 ? "stopped; to run it again with the same values goes on where it was" : ENDINGS[told.exit_code] ?? `ended with exit code ${told.exit_code}`;
  const id = await runOf(told.pid);
  const failed = told.exit_code === 0 ? [] : told.events.slice(-12).map(words);
  return [
    h("p", { id: "run-end", "data-code": String(told.exit_code) }, h("b", { class: told.exit_code === 0 || told.stopped ? null : "error" }, ending), `, after ${seconds(told.seconds)}. `, of, ". ", id ? h("a", { href: `#/runs/${id}` }, "Its results and artifacts") : null),
    told.printed || failed.length ? h("pre", { tabindex: "0" }, [...failed, told.printed.trim()].filter(Boolean).join("\n")) : null,
  ];
}

/** An event in words. @param {any} event */
function words(event) {
  if (event.text) return event.event === "warning" ? `warning: ${event.text}` : event.text;
  const what = (event.event ?? "").replace(/^stage-/, "").replace(/^run-/, "run ").replaceAll("-", " ");
  // What was stopped has not failed.
  if (what === "failed" && event.why?.startsWith("stopped")) return `${event.name ?? ""}: ${event.why}`;
  return [`${event.name ?? event.pipeline ?? ""}:`, what, event.why && `(${event.why})`].filter(Boolean).join(" ");
}

/** The run that a process has written down, by its log, which has its number; none of one that has built nothing. @param {number} process */
async function runOf(process) {
  try {
    const { runs } = await json("runs?limit=20");
    return runs.find((/** @type {any} */ run) => run.log?.endsWith(`-${process}.log`))?.id ?? null;
  } catch {
    return null;
  }
}

/** The text with its lines numbered, and one of them marked. @param {string} text @param {number|null} wrong */
function source(text, wrong) {
  const line = (/** @type {string} */ content, /** @type {number} */ at) => h("span", { class: at + 1 === wrong ? "wrong" : null }, content || " ");
  return h("pre", { class: "source", tabindex: "0" }, text.split("\n").map(line));
}
