// Pipelines: how they stand, and what a change would have built anew.

import { json } from "./server.js";
import { bytes, h, problem, replace, seconds, settled, short, svg, table } from "./elements.js";

/** @param {HTMLElement} view @param {any} start */
export async function pipelinesView(view, start) {
  const { pipelines } = await json("pipelines");
  const rows = pipelines.map((/** @type {any} */ one) => [h("a", { href: `#/pipelines/${one.id}` }, one.name ?? "has a problem"), h("span", { class: "mono" }, one.path)]);
  replace(
    view,
    h("h1", {}, "Pipelines"),
    h("p", { class: "soft" }, `Store: ${start.store}`),
    rows.length ? table("Pipelines", ["name", "file"], rows) : h("p", {}, "None is named, and none has been run in this store. ", h("code", {}, "deaflow serve pipeline.yaml"), " shows one; the ", h("a", { href: "#/sketch" }, "sketchpad"), " needs none."),
  );
}

/** @param {HTMLElement} view @param {string} id @param {boolean} mayRun @returns {Promise<() => void>} */
export async function pipelineView(view, id, mayRun) {
  let found = await json(`pipelines/${encodeURIComponent(id)}`);
  /** @type {Record<string, string>} */ let set = {};
  let ended = false;
  const drawing = h("div", { class: "scroll", tabindex: "0", role: "region", "aria-label": "Stages" });
  const stages = h("div", {});
  const bill = h("p", { id: "bill" });
  const trouble = h("div", {});
  const runBox = h("div", {});

  /** @param {any} plan */
  const show = (plan) => {
    const stale = plan.stages.filter((/** @type {any} */ stage) => stage.outcome === "stale");
    const price = plan.price ? `about ${seconds(plan.price.seconds.likely)} (${seconds(plan.price.seconds.low)} to ${seconds(plan.price.seconds.high)}), ${bytes(plan.price.bytes.likely)}` : "";
    const rest = plan.unpriced ? `${price ? "; " : ""}${plan.unpriced} of them have no price yet` : "";
    bill.textContent = stale.length ? `${stale.length} of ${plan.stages.length} stages to build: ${price}${rest}` : `all ${plan.stages.length} stages are fresh`;
    bill.dataset.stale = stale.map((/** @type {any} */ stage) => stage.name).join(" ");
    replace(drawing, dag(plan.stages, found.needs));
    const row = (/** @type {any} */ stage) => [
      stage.name,
      stage.kind,
      h("span", { class: stage.outcome === "stale" ? "stale" : "fresh" }, stage.outcome === "stale" ? "to build" : "fresh"),
      stage.reasons.length ? h("span", {}, stage.reasons.map((/** @type {string} */ reason) => h("div", {}, reason))) : "",
      stage.chunks_built ? `${stage.chunks_built} of ${stage.chunks_built + stage.chunks_reused}` : "",
      stage.price ? seconds(stage.price.seconds.likely) : "",
      stage.digest && stage.outcome !== "stale" ? short(stage.digest) : "",
    ];
    replace(stages, table("Stages", ["stage", "kind", "state", "why", { title: "chunks to build", number: true }, { title: "takes about", number: true }, "artifact"], plan.stages.map(row)));
  };

  const replan = async () => {
    try {
      const plan = Object.keys(set).length ? await json("plan", { body: { pipeline: id, set } }) : found;
      if (ended) return;
      replace(trouble);
      show(plan);
    } catch (error) {
      replace(trouble, problem(error));
    }
  };
  const soon = settled(() => void replan(), 250);

  const editor = () => {
    const search = h("input", { type: "search", placeholder: "part of a path, such as voltage", "aria-label": "Find a value", name: "find" });
    const list = h("div", { class: "values" });
    const row = (/** @type {{path: string, value: string}} */ one) => {
      const input = h("input", { type: "text", value: set[one.path] ?? one.value, "aria-label": one.path, "data-path": one.path, oninput: () => {
        if (input.value === one.value) delete set[one.path];
        else set[one.path] = input.value;
        soon();
      } });
      return [h("span", { class: "mono" }, one.path), input, h("span", { class: "soft mono" }, one.value)];
    };
    const fill = () => {
      const wanted = search.value.trim().toLowerCase();
      const fits = found.values.filter((/** @type {any} */ one) => one.path.toLowerCase().includes(wanted));
      replace(list, table("Values", ["path", "value", "in the file"], fits.slice(0, 60).map(row)), fits.length > 60 ? h("p", { class: "soft" }, `and ${fits.length - 60} more`) : null);
    };
    search.addEventListener("input", fill);
    fill();
    const back = h("button", { type: "button", onclick: () => {
      set = {};
      fill();
      void replan();
    } }, "As in the file");
    return h("section", {}, h("h2", {}, "Change a value"), h("p", { class: "soft small" }, "What would be built anew is shown at once; nothing is built and no file is changed."), h("div", { class: "tools" }, search, back), list);
  };

  const runner = () => {
    if (!mayRun) return h("p", { class: "soft small" }, "Nothing is run from here; ", h("code", {}, "deaflow serve --allow-run"), " allows it.");
    const log = h("div", { "aria-live": "polite" });
    let timer = 0;
    const look = async () => {
      const told = await json("run");
      if (ended) return;
      const last = told.events.slice(-12).map((/** @type {any} */ event) => event.text ?? [event.event, event.stage, event.why].filter(Boolean).join(" "));
      const state = told.running ? h("span", { class: "running" }, "running") : told.pipeline ? `ended with exit code ${told.exit_code}` : "";
      replace(log, h("p", {}, state), last.length ? h("pre", {}, last.join("\n")) : null);
      clearTimeout(timer);
      if (told.running) timer = setTimeout(() => void look(), 700);
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
    replace(view, h("h1", {}, "Pipeline"), h("p", { class: "mono" }, found.path), problem(found.problem), source(found.text, found.problem.line));
  } else {
    replace(view, h("h1", {}, found.pipeline), h("p", { class: "mono soft" }, found.path), bill, trouble, drawing, stages, editor(), runBox, h("details", {}, h("summary", {}, "The file"), source(found.text, null)));
    replace(runBox, runner());
    show(found);
  }
  const news = async () => {
    if (ended) return;
    const fresh = await json(`pipelines/${encodeURIComponent(id)}`);
    if (ended || Boolean(fresh.problem) !== Boolean(found.problem)) return;
    found = fresh;
    if (!found.problem) await replan();
  };
  const listen = () => void news().catch(() => {});
  window.addEventListener("news", listen);
  return () => {
    ended = true;
    window.removeEventListener("news", listen);
  };
}

/** The text with its lines numbered, and one of them marked. @param {string} text @param {number|null} wrong */
function source(text, wrong) {
  const line = (/** @type {string} */ content, /** @type {number} */ at) => h("span", { class: at + 1 === wrong ? "wrong" : null }, content || " ");
  return h("pre", { class: "source", tabindex: "0" }, text.split("\n").map(line));
}

/** Sizes of a stage, and of the room between two. */
const BOX = [150, 44];
const ROOM = [46, 12];

/**
 * The stages in columns: each to the right of what it needs.
 * @param {any[]} stages @param {Record<string, {needs: string[], gates: string[]}>} needs
 */
function dag(stages, needs) {
  /** @type {Map<string, number>} */ const column = new Map();
  /** @type {Map<string, [number, number]>} */ const place = new Map();
  /** @type {number[]} */ const filled = [];
  for (const stage of stages) {
    const { needs: read = [], gates = [] } = needs[stage.name] ?? {};
    const at = Math.max(-1, ...[...read, ...gates].map((name) => column.get(name) ?? -1)) + 1;
    column.set(stage.name, at);
    filled[at] = (filled[at] ?? 0) + 1;
    place.set(stage.name, [at * (BOX[0] + ROOM[0]), (filled[at] - 1) * (BOX[1] + ROOM[1])]);
  }
  const width = filled.length * (BOX[0] + ROOM[0]) - ROOM[0] + 2;
  const height = Math.max(...filled, 1) * (BOX[1] + ROOM[1]) - ROOM[1] + 2;
  const link = (/** @type {string} */ from, /** @type {string} */ to, /** @type {boolean} */ gate) => {
    const [a, b] = [place.get(from), place.get(to)];
    if (!a || !b) return null;
    const [x, y, u, v] = [a[0] + BOX[0], a[1] + BOX[1] / 2, b[0], b[1] + BOX[1] / 2];
    const half = (x + u) / 2;
    return svg("path", { d: `M${x},${y} C${half},${y} ${half},${v} ${u},${v}`, class: gate ? "gate" : null });
  };
  const links = stages.flatMap((stage) => {
    const { needs: read = [], gates = [] } = needs[stage.name] ?? {};
    return [...read.map((name) => link(name, stage.name, false)), ...gates.map((name) => link(name, stage.name, true))];
  });
  const box = (/** @type {any} */ stage) => {
    const [x, y] = /** @type {[number, number]} */ (place.get(stage.name));
    const stale = stage.outcome === "stale";
    const note = stale ? `to build${stage.price ? `, ${seconds(stage.price.seconds.likely)}` : ""}` : "fresh";
    const cut = (/** @type {string} */ text, /** @type {number} */ most) => (text.length > most ? `${text.slice(0, most - 1)}…` : text);
    return svg(
      "g",
      { class: stale ? "stale" : "fresh", transform: `translate(${x + 1} ${y + 1})` },
      svg("title", {}, [stage.name, stage.kind, ...stage.reasons].join("\n")),
      svg("rect", { width: BOX[0], height: BOX[1], rx: 6 }),
      svg("rect", { class: "stripe", width: 5, height: BOX[1], rx: 2 }),
      svg("text", { class: "name", x: 13, y: 18 }, cut(stage.name, 18)),
      svg("text", { x: 13, y: 34 }, cut(`${stage.kind}: ${note}`, 24)),
    );
  };
  return svg("svg", { class: "dag", role: "img", "aria-label": "Stages and what they need", width, height, viewBox: `0 0 ${width} ${height}` }, links, stages.map(box));
}
