// Pipelines: how they stand, and what a change would have built anew.

import { json } from "./server.js";
import { bytes, h, near, problem, replace, seconds, settled, short, table, titled } from "./elements.js";
import { drawing as dag, list as stageList, progress, state } from "./dag.js";
import { others, underWay } from "./live.js";

/** Values that are listed before more are asked for. */
const FIRST = 40;

/** Between two looks at a run, ms, and the longest where the server does not answer. */
const LOOK = 700;
const LONGEST = 30000;

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
  const keep = () => {
    const words = new URLSearchParams(Object.entries(set).map(([path, value]) => ["set", `${path}=${value}`]));
    const wanted = `#/pipelines/${encodeURIComponent(id)}${Object.keys(set).length ? `?${words}` : ""}`;
    if (location.hash !== wanted) history.replaceState(null, "", wanted);
  };
  let turn = 0;
  /** The value that is refused. @type {string|null} */ let refused = null;
  let mark = () => {};
  let ended = false;
  const drawing = h("div", { class: "scroll wide-only", tabindex: "0", role: "region", "aria-label": "Drawing of the stages" });
  const stages = h("div", { class: "wide-only" });
  const narrow = h("div", { class: "narrow-only" });
  /** @type {any} */ let planned = found;
  const bill = h("p", { id: "bill" });
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
    const chunks = (/** @type {any} */ stage) => (stage.chunks_built ? `${stage.chunks_built} of ${stage.chunks_built + stage.chunks_reused}` : "");
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
    try {
      const plan = Object.keys(set).length ? await json("plan", { body: { pipeline: id, set } }) : found;
      if (ended || own !== turn) return;
      keep();
      old(false);
      replace(trouble);
      refused = null;
      show(plan);
    } catch (error) {
      if (ended || own !== turn) return;
      refused = /** @type {any} */ (error).value ?? null;
      // What is drawn is the plan of the values before.
      bill.textContent = "No plan with these values; what is shown in grey is that of the values before.";
      bill.dataset.stale = "";
      old(true);
      replace(trouble, problem(error));
    }
    mark();
  };
  const soon = settled(() => void replan(), 250);

  const editor = () => {
    const search = h("input", { type: "search", placeholder: "part of a path, such as voltage", "aria-label": "Find a value", name: "find" });
    const list = h("div", { class: "values", role: "group", "aria-label": "Values" });
    let most = FIRST;
    const row = (/** @type {{path: string, value: string}} */ one) => {
      const before = h("span", { class: "soft small mono" });
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
      const line = h("label", { class: "value" }, h("span", { class: "mono" }, near(one.path)), input, before);
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
    const log = h("div", { "aria-live": "polite" });
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
      const last = told.events.slice(-12).map((/** @type {any} */ event) => event.text ?? [event.event, event.name ?? event.pipeline, event.why].filter(Boolean).join(" "));
      const state = told.running ? h("span", { class: "running" }, "running") : told.pipeline ? `ended with exit code ${told.exit_code}` : "";
      replace(log, h("p", {}, state), last.length ? h("pre", {}, last.join("\n")) : null);
      clearTimeout(timer);
      if (told.running) timer = setTimeout(() => void look(), pause);
      else if (told.pipeline) {
        found = await json(`pipelines/${encodeURIComponent(id)}`);
        await replan();
      }
    };
    const act = async (/** @type {() => Promise<any>} */ what) => {
      try {
        await what();
        await look();
      } catch (error) {
        replace(log, problem(error));
      }
    };
    void look();
    return h(
      "section",
      {},
      h("h2", {}, "Run"),
      h("div", { class: "tools" }, h("button", { type: "button", class: "main", onclick: () => act(() => json("run", { body: { pipeline: id, set } })) }, "Run with these values"), h("button", { type: "button", onclick: () => act(() => json("run", { method: "DELETE" })) }, "Stop")),
      log,
    );
  };

  if (found.problem) {
    replace(view, h("h1", {}, "Pipeline"), h("p", { class: "mono" }, near(found.path)), problem(found.problem), source(found.text, found.problem.line));
  } else {
    replace(view, h("h1", {}, found.pipeline), h("p", { class: "mono soft" }, near(found.path)), bill, elsewhere, trouble, drawing, stages, narrow, editor(), runBox, h("details", {}, h("summary", {}, "The file"), source(found.text, null)));
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
    if (!found.problem) await replan();
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

/** The text with its lines numbered, and one of them marked. @param {string} text @param {number|null} wrong */
function source(text, wrong) {
  const line = (/** @type {string} */ content, /** @type {number} */ at) => h("span", { class: at + 1 === wrong ? "wrong" : null }, content || " ");
  return h("pre", { class: "source", tabindex: "0" }, text.split("\n").map(line));
}
