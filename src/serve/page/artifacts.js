// Artifacts: the list, and the details of one.

import { json } from "./server.js";
import { attempt, changes, choice, h, labelled, pageOf, replace, short, table, titled, when } from "./elements.js";
import { rowsView } from "./rows.js";
import { findings } from "./audit.js";
import { evaluation, model } from "./models.js";
import { designCards, designs } from "./designs.js";
import { accuracy } from "./accuracy.js";

/** Longer attributes are shown on demand. */
const LONG = 160;

/** @param {HTMLElement} view @param {URLSearchParams} query @param {string[]} only kinds; none for all @param {string} title */
export async function artifactsView(view, query, only, title) {
  const found = await json(`artifacts?limit=2000${only.length === 1 ? `&kind=${only[0]}` : ""}`);
  const artifacts = found.artifacts.filter((/** @type {any} */ one) => !only.length || only.includes(one.kind));
  const older = found.total - found.artifacts.length;
  const kinds = [...new Set(artifacts.map((/** @type {any} */ one) => one.kind))].sort();
  let chosen = query.get("kind") ?? "";
  const box = h("div", {});
  const fill = () => {
    const row = (/** @type {any} */ one) => [named(one), one.kind, one.stage, one.pipeline, changes(one.overrides), when(one.created), h("a", { class: "mono", href: `#/runs/${one.run}` }, one.run)];
    const some = artifacts.filter((/** @type {any} */ one) => !chosen || one.kind === chosen);
    if (some.length && only.includes("design")) replace(box, designCards(some, named));
    else replace(box, some.length ? table(title, ["artifact", "kind", "stage", "pipeline", "changed", "run ended", "run"], some.map(row)) : h("p", {}, "The last runs built none. ", how(only)));
  };
  const kindsShown = [["", "all kinds"], ...kinds.map((one) => [one, one])];
  replace(
    view,
    h("h1", {}, title),
    only.length ? null : h("div", { class: "tools" }, labelled("Kind", choice("kind", /** @type {any} */ (kindsShown), chosen, (value) => {
      chosen = value;
      history.replaceState(null, "", value ? `#/artifacts?kind=${value}` : "#/artifacts");
      fill();
    }))),
    box,
    older > 0 ? h("p", { class: "soft" }, `and ${older} older ones`) : null,
  );
  fill();
  // A single artifact is opened at once.
  if (only.length && artifacts.length === 1 && !artifacts[0].removed && view.isConnected) location.replace(`#/artifacts/${artifacts[0].digest}`);
}

/** An artifact of the list: a link, unless it is gone. @param {any} one */
function named(one) {
  if (!one.removed) return short(one.digest);
  return h("span", {}, h("span", { class: "mono soft", title: one.digest }, one.digest.slice(0, 12)), h("div", { class: "soft small" }, `removed by gc at ${when(one.removed)} UTC`));
}

/** How to build an artifact of some kinds. @param {string[]} only */
function how(only) {
  const command = (/** @type {string} */ text) => h("code", {}, text);
  if (only.includes("audit")) return ["A stage of ", command("kind: audit"), " audits a dataset of the pipeline; ", command("deaflow audit pipeline.yaml:STAGE"), " audits one and keeps the result as well."];
  if (only.includes("accuracy")) return ["A stage of ", command("kind: accuracy"), " builds one; ", command("pipelines/accuracy.yaml"), " has one."];
  if (only.includes("train")) return ["Stages of ", command("kind: train"), ", ", command("calibrate"), " and ", command("evaluate"), " build them; ", command("deaflow init"), " writes a first pipeline."];
  if (only.includes("design")) return ["Stages of ", command("kind: design"), " and ", command("verify"), " build them; ", command("deaflow init"), " writes a first pipeline."];
  return [command("deaflow run pipeline.yaml"), " builds them; ", command("deaflow init"), " writes a first pipeline."];
}

/** @param {HTMLElement} view @param {string} digest @param {URLSearchParams} query @returns {Promise<() => void>} */
export async function artifactView(view, digest, query) {
  const found = await json(`artifacts/${encodeURIComponent(digest)}`);
  const hasRows = found.datasets.some((/** @type {any} */ one) => one.axes.length > 0);
  /** @type {Record<string, [string, (place: HTMLElement) => Promise<any>|any]>} */
  const tabs = {
    ...(found.kind === "train" ? { errors: ["Errors", (/** @type {HTMLElement} */ place) => model(place, found, query)] } : {}),
    ...(found.kind === "evaluate" ? { errors: ["Errors", (/** @type {HTMLElement} */ place) => evaluation(place, found)] } : {}),
    ...(["design", "verify"].includes(found.kind) ? { designs: ["Designs", (/** @type {HTMLElement} */ place) => designs(place, found)] } : {}),
    ...(found.kind === "accuracy" ? { accuracy: ["Settings", (/** @type {HTMLElement} */ place) => accuracy(place, found, (box) => replace(box, pageOf(found.digest, "Figures")))] } : {}),
    ...(found.kind === "audit" ? { findings: ["Findings", (/** @type {HTMLElement} */ place) => findings(place, found, query)] } : {}),
    ...(hasRows ? { rows: ["Rows", (/** @type {HTMLElement} */ place) => rowsView(place, found, query)] } : {}),
    figures: ["Figures", (/** @type {HTMLElement} */ place) => replace(place, pageOf(found.digest, "Figures"))],
    arrays: ["Arrays", (/** @type {HTMLElement} */ place) => replace(place, arrays(found))],
    origin: ["Origin", (/** @type {HTMLElement} */ place) => replace(place, origin(found))],
  };
  const first = found.kind === "balance" ? "figures" : Object.keys(tabs)[0];
  let open = query.get("tab") ?? first;
  if (!tabs[open]) open = first;
  const place = h("div", { role: "tabpanel", id: "panel", "aria-labelledby": `tab-${open}` });
  const names = Object.keys(tabs);
  /** @param {string} name */
  const turn = (name) => {
    open = name;
    const words = new URLSearchParams(location.hash.split("?")[1] ?? "");
    words.set("tab", name);
    history.pushState(null, "", `#/artifacts/${found.digest}?${words}`);
    void show();
  };
  // Arrow keys change the tab, as in the pattern of tabs (WAI-ARIA Authoring Practices).
  const key = (/** @type {KeyboardEvent} */ event) => {
    const at = names.indexOf(open);
    const to = /** @type {Record<string, number>} */ ({ ArrowRight: at + 1, ArrowLeft: at - 1 + names.length, Home: 0, End: names.length - 1 })[event.key];
    if (to === undefined) return;
    event.preventDefault();
    turn(names[to % names.length]);
    /** @type {HTMLElement|null} */ (buttons.querySelector("[aria-selected=true]"))?.focus();
  };
  const buttons = h("div", { class: "tabs", role: "tablist", "aria-label": "Details of the artifact", onkeydown: key });
  const tab = (/** @type {string} */ name) => h("button", { type: "button", role: "tab", id: `tab-${name}`, "aria-controls": "panel", tabindex: name === open ? "0" : "-1", "aria-selected": String(name === open), onclick: () => turn(name) }, tabs[name][0]);
  const show = async () => {
    replace(buttons, names.map(tab));
    place.setAttribute("aria-labelledby", `tab-${open}`);
    replace(place);
    await attempt(place, () => tabs[open][1](place));
  };
  const { stage } = found;
  highlight(found.kind);
  titled([stage, found.kind || "artifact", found.digest.slice(0, 12)].filter(Boolean).join(" "));
  replace(view, h("h1", {}, stage ? `${stage}: ` : "", `${found.kind || "artifact"} `, h("span", { class: "mono soft" }, found.digest.slice(0, 12))), buttons, place);
  await show();
  return () => {};
}

/** Marks the view of a kind in the menu. @param {string} kind */
function highlight(kind) {
  const view = { train: "models", evaluate: "models", calibrate: "models", design: "designs", verify: "designs", audit: "audits", accuracy: "accuracy" }[kind] ?? "artifacts";
  for (const link of document.querySelectorAll("#views a")) {
    if (link.getAttribute("href") === `#/${view}`) link.setAttribute("aria-current", "page");
    else link.removeAttribute("aria-current");
  }
}

/** @param {any} found */
function arrays(found) {
  const row = (/** @type {any} */ one) => [h("span", { class: "mono" }, one.path), one.type, one.shape.join(" × "), one.axes.join(", "), one.units, one.description];
  return table("Arrays", ["array", "type", "shape", "axes", "unit", "description"], found.datasets.map(row));
}

/** @param {any} found */
function origin(found) {
  const text = (/** @type {string} */ value) => (value.length > LONG ? h("details", {}, h("summary", {}, `${value.slice(0, 60)}…`), h("pre", {}, value)) : h("span", { class: "mono" }, value));
  const pairs = (/** @type {Record<string, string>} */ of) => Object.entries(of).map(([name, value]) => [name, text(value)]);
  const ancestor = (/** @type {any} */ one) => [one.kind || "unknown", short(one.digest), h("span", {}, one.inputs.map((/** @type {string} */ input) => [short(input), " "])), text(one.entries.parameters ?? ""), one.entries.created ? when(one.entries.created) : ""];
  return h(
    "div",
    {},
    h("p", { class: "mono small" }, found.digest),
    h("h2", {}, "Attributes"),
    table("Attributes", ["attribute", "value"], pairs(found.attributes)),
    h("h2", {}, "Built by"),
    table("Provenance", ["", "value"], pairs(found.provenance)),
    h("h2", {}, "Built from"),
    table("Ancestry", ["kind", "artifact", "inputs", "parameters", "time"], found.ancestry.map(ancestor)),
    found.parts.length ? [h("h2", {}, `${found.parts.length} chunks`), h("p", {}, found.parts.slice(0, 200).map((/** @type {string} */ part) => [short(part), " "]))] : null,
  );
}
