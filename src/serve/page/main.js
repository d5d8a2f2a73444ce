// Shows the view of the URL: the part after # names it, so that each view has a link.

import { ENDED, json } from "./server.js";
import { attempt, bytes, h, problem, replace, startedIn, titled, when } from "./elements.js";
import { listen } from "./live.js";
import { sketchpad } from "./sketch.js";
import { overview } from "./overview.js";
import { pipelineView } from "./pipelines.js";
import { runsView } from "./run-list.js";
import { compareView, runView } from "./runs.js";
import { artifactView, artifactsView } from "./artifacts.js";

const view = /** @type {HTMLElement} */ (document.getElementById("view"));
const status = /** @type {HTMLElement} */ (document.getElementById("status"));

/** @type {Record<string, string>} */
const VIEWS = { pipelines: "Pipelines", runs: "Runs", artifacts: "Artifacts", models: "Models", designs: "Designs", audits: "Audits", accuracy: "Accuracy", sketch: "Sketchpad" };

/** @type {() => void} */ let end = () => {};
/** @type {any} */ let start = {};
/** Number of the view: responses for earlier views are dropped. */
let shown = 0;

/** @returns {{steps: string[], query: URLSearchParams}} */
function address() {
  const [path, query] = location.hash.replace(/^#\/?/, "").split("?");
  return { steps: path.split("/").filter(Boolean).map(decodeURIComponent), query: new URLSearchParams(query ?? "") };
}

async function show() {
  end();
  end = () => {};
  shown += 1;
  const turn = shown;
  const { steps, query } = address();
  const [name = "pipelines", ...rest] = steps;
  for (const link of document.querySelectorAll("#views a")) {
    if (link.getAttribute("href") === `#/${name}`) link.setAttribute("aria-current", "page");
    else link.removeAttribute("aria-current");
  }
  titled(VIEWS[name] ?? "");
  const place = h("div", {});
  await attempt(place, async () => {
    const made = await opened(name, rest, query, place);
    if (turn !== shown) made?.();
    else end = made ?? (() => {});
  });
  if (turn === shown && !place.isConnected) view.replaceChildren(place);
}

/** @param {string} name @param {string[]} rest @param {URLSearchParams} query @param {HTMLElement} place @returns {Promise<(() => void)|void>} */
async function opened(name, rest, query, place) {
  // Drawings need their width.
  view.replaceChildren(place);
  switch (name) {
    case "sketch": {
      const pattern = start.pattern;
      // The pattern of the command line is only for the first drawing.
      start.pattern = [];
      return sketchpad(place, { pattern, query, notes: pattern.length ? start.pattern_notes : [] });
    }
    case "runs":
      if (rest[0] === "compare") return compareView(place, rest.slice(1));
      return rest.length ? runView(place, rest[0]) : runsView(place, query);
    case "artifacts":
      return rest.length ? artifactView(place, rest[0], query) : artifactsView(place, query, [], "Artifacts");
    case "models":
      return artifactsView(place, query, ["evaluate", "train", "calibrate"], "Models and their evaluations");
    case "designs":
      return artifactsView(place, query, ["verify", "design"], "Designs and their simulations");
    case "audits":
      return artifactsView(place, query, ["audit"], "Audits");
    case "accuracy":
      return artifactsView(place, query, ["accuracy"], "Accuracy");
    case "pipelines":
      return rest.length ? pipelineView(place, rest[0], start.allow_run, query) : overview(place, start);
    default:
      throw new Error(`unknown view “${name}”`);
  }
}

/** Shows the status in one line. @param {any} found */
function stand(found) {
  const parts = [];
  if (found.store) parts.push(`${found.objects} artifact files, ${bytes(found.bytes)}`);
  else parts.push("no store yet");
  for (const run of found.runs ?? []) parts.push(`${run.pipeline} is running (process ${run.pid})${run.stages.length ? `: ${run.stages.map((/** @type {any} */ stage) => stage.name).join(", ")}` : ""}`);
  if (found.in_flight && !found.runs?.length) parts.push(`building ${found.in_flight} artifacts`);
  if (found.workers?.length) parts.push(`${found.workers.length} workers`);
  if (found.last_run) parts.push(`last run ${when(found.last_run.created)}`);
  const text = parts.join(", ");
  if (status.textContent !== text) status.textContent = text;
}

async function main() {
  // The token is in a cookie by now, and is removed from the URL.
  if (location.search) history.replaceState(null, "", location.pathname + location.hash);
  const links = Object.entries(VIEWS).map(([name, title]) => h("a", { href: `#/${name}` }, title));
  replace(/** @type {HTMLElement} */ (document.getElementById("views")), links);
  try {
    start = await json("start");
    startedIn(start.folder);
  } catch (error) {
    replace(view, problem(error));
    return;
  }
  window.addEventListener("hashchange", () => void show());
  await show();
  void listen(stand, (message) => (status.textContent = `${message}: ${ENDED}`));
}

void main();
