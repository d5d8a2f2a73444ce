// The first view: a card for each pipeline, with its state, its last run, and the best design.

import { json } from "./server.js";
import { h, near, problem, replace, seconds } from "./elements.js";
import { standing } from "./live.js";
import { image } from "./pictures.js";
import { lastRuns } from "./runs.js";

/** @param {HTMLElement} view @param {any} start @returns {Promise<() => void>} */
export async function overview(view, start) {
  const { pipelines } = await json("pipelines");
  const cards = pipelines.map((/** @type {any} */ one) => new Card(one));
  replace(
    view,
    h("h1", {}, "Pipelines"),
    h("p", { class: "soft" }, `Store: ${near(start.store)}`),
    cards.length ? h("div", { class: "cards pipelines" }, cards.map((/** @type {Card} */ card) => card.element)) : none(),
  );
  let ended = false;
  const fill = () => cards.forEach((/** @type {Card} */ card) => void card.fill(() => ended));
  const mark = () => cards.forEach((/** @type {Card} */ card) => card.showState());
  window.addEventListener("news", fill);
  window.addEventListener("standing", mark);
  fill();
  return () => {
    ended = true;
    window.removeEventListener("news", fill);
    window.removeEventListener("standing", mark);
  };
}

function none() {
  return h("p", {}, "There are no pipelines: none was named, and none was run in this store. ", h("code", {}, "deaflow serve pipeline.yaml"), " shows one; the ", h("a", { href: "#/sketch" }, "sketchpad"), " needs none.");
}

class Card {
  /** @param {any} listed */
  constructor(listed) {
    this.listed = listed;
    /** @type {any} */ this.found = null;
    /** The run whose results are shown. */ this.shown = "";
    this.picture = h("div", { class: "picture" });
    this.state = h("p", { class: "state soft", "data-state": "" }, "checking …");
    this.result = h("div", {});
    this.run = h("div", {});
    this.element = h(
      "article",
      { class: "card pipeline", "data-pipeline": listed.id },
      this.picture,
      h("div", { class: "text" }, h("h2", {}, h("a", { href: `#/pipelines/${listed.id}` }, listed.name ?? "invalid")), this.state, this.result, this.run, h("p", { class: "soft small mono" }, near(listed.path))),
    );
  }

  /** @param {() => boolean} isOver whether another view is shown by now */
  async fill(isOver) {
    try {
      const found = await json(`pipelines/${this.listed.id}/summary`);
      if (isOver()) return;
      this.found = found;
      this.showState();
      this.showRun();
      const id = found.shown ?? "";
      if (found.problem || id === this.shown) return;
      if (!id) {
        this.shown = "";
        replace(this.result);
        replace(this.picture);
        return;
      }
      const opening = await json(`runs/${id}/opening`);
      if (isOver()) return;
      this.shown = id;
      replace(this.result, opening.sentence ? h("p", { class: "headline" }, opening.sentence) : null, opening.facts[0] ? h("p", { class: "small" }, opening.facts[0]) : null);
      replace(this.picture, opening.picture ? [image(opening.picture, `Result of ${this.listed.name}`), h("p", { class: "caption" }, opening.caption)] : null);
    } catch (error) {
      if (!isOver()) replace(this.result, problem(error));
    }
  }

  showState() {
    const { found } = this;
    if (!found) return;
    const [kind, words] = stateOf(found, this.listed.name);
    this.state.className = `state ${kind}`;
    this.state.dataset.state = kind;
    this.state.textContent = words;
    if (found.problem) replace(this.result, problem(found.problem));
  }

  showRun() {
    replace(this.run, this.found.problem ? null : lastRuns(this.found));
  }
}

/** The state of a pipeline: its class and its words. @param {any} found summary of the server @param {string} name @returns {[string, string]} */
function stateOf(found, name) {
  if (found.problem) return ["failed", "invalid file"];
  const running = (standing()?.runs ?? []).find((/** @type {any} */ run) => run.pipeline === name);
  if (running) return ["running", ["running", running.stages.map((/** @type {any} */ stage) => stage.name).join(", ")].filter(Boolean).join(": ")];
  // As `deaflow status`: a failed run stays in sight until one succeeds.
  const [failures, stopped] = [found.run?.failed ?? [], found.run?.stopped ?? []];
  if (!found.stale.length && failures.length) return ["failed", `last run failed: ${failures.join(", ")}; results are up to date`];
  if (!found.stale.length && stopped.length) return ["stale", `last run was stopped in ${stopped.join(", ")}; results are up to date`];
  if (!found.stale.length) return ["fresh", "up to date"];
  const price = found.price ? `, about ${seconds(found.price.seconds.likely)}` : "";
  const rest = `${found.stale.length} of ${found.stages} stages${price}`;
  const failed = failures.filter((/** @type {string} */ stage) => found.stale.includes(stage));
  return failed.length ? ["failed", `failed: ${failed.join(", ")}; ${rest} to run`] : ["stale", `has to run: ${rest}`];
}
