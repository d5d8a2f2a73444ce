// The stages of a pipeline and their needs: drawn with the layout of the report, and as a list on narrow screens.

import { h, seconds, svg } from "./elements.js";

/** Width of a stage, and of the gap between two layers. */
const WIDTH = 176;
const BETWEEN = 44;

/** The scale at which the drawing starts to scroll. */
const SMALLEST = 0.72;

/** Space of a text within a stage, and the fonts of its lines, as in `page.css`. */
const LINE = WIDTH - 13 - 6;
const [BOLD, PLAIN] = ["650 13px", "400 11px"];

const ruler = /** @type {CanvasRenderingContext2D} */ (document.createElement("canvas").getContext("2d"));

/** @param {string} text @param {string} font */
function widthOf(text, font) {
  ruler.font = `${font} ${getComputedStyle(document.body).fontFamily}`;
  return ruler.measureText(text).width;
}

/** Cuts a text to a width: its end, or its beginning. @param {string} text @param {string} font @param {number} [most] @param {boolean} [keepsEnd] */
function cut(text, font, most = LINE, keepsEnd = false) {
  const letters = [...text];
  const shown = (/** @type {number} */ count) => (count === letters.length ? text : keepsEnd ? `…${letters.slice(letters.length - count).join("")}` : `${letters.slice(0, count).join("")}…`);
  let count = letters.length;
  while (count > 0 && widthOf(shown(count), font) > most) count -= 1;
  return shown(count);
}

/**
 * The name of a stage. The values of a sweep are smaller and keep their end, which has the unit, and in which stages differ.
 * @param {string} name
 */
function title(name) {
  const at = name.indexOf("@");
  if (at < 0 || widthOf(name, BOLD) <= LINE) return cut(name, BOLD);
  const stage = cut(name.slice(0, at), BOLD, LINE / 2);
  return [stage, svg("tspan", { class: "axes" }, cut(name.slice(at), PLAIN, LINE - widthOf(stage, BOLD), true))];
}

/** @param {any} stage @param {Record<string, any>} working @returns {[string, string]} the class and the text of its state */
export function state(stage, working) {
  const now = working[stage.name];
  if (now) return ["running", `building: ${now.text}`];
  if (stage.outcome !== "stale") return ["fresh", "up to date"];
  return ["stale", `to build${stage.price ? `, ${seconds(stage.price.seconds.likely)}` : ""}`];
}

/**
 * The progress of a running stage: from its own steps if they are known, else from its chunks, else from the elapsed and the estimated time.
 * @param {any} stage @param {any} now @returns {number|null}
 */
export function share(stage, now) {
  if (now.share !== null) return now.share;
  const chunks = stage.chunks_built + stage.chunks_reused;
  if (chunks > 1) return stage.chunks_reused / chunks;
  const estimate = stage.price?.seconds.likely;
  return estimate && now.since ? Math.min(0.99, (Date.now() - Date.parse(now.since)) / 1000 / estimate) : null;
}

/** @param {any} stage @param {any} now */
export function progress(stage, now) {
  const part = share(stage, now);
  return h("progress", { max: "1", value: part ?? undefined, "aria-label": `Progress of ${stage.name}`, title: part === null ? now.text : `${Math.round(100 * part)} %` });
}

/**
 * @param {any[]} stages @param {any} layout of the server @param {Record<string, any>} working @param {(stage: any) => {text: string, full: string}} last result of a stage
 */
export function drawing(stages, layout, working, last) {
  const high = layout.stage_height;
  const left = (/** @type {number} */ layer) => layer * (WIDTH + BETWEEN);
  const width = Math.max(left(layout.layers) - BETWEEN, WIDTH) + 4;
  const height = Math.max(layout.height, high) + 4;
  const line = (/** @type {any} */ one) => {
    const path = one.places.slice(1).map((/** @type {[number, number]} */ [layer, y], /** @type {number} */ k) => {
      const [before, from] = one.places[k];
      const [x, right, half] = [left(before) + WIDTH, left(layer), BETWEEN / 2];
      return `${k === 0 ? `M${x} ${from}` : `H${x}`}C${x + half} ${from} ${right - half} ${y} ${right} ${y}`;
    });
    return svg("path", { d: path.join(""), class: one.gate ? "gate" : null });
  };
  const box = (/** @type {any} */ stage) => {
    const place = layout.stages[stage.name];
    if (!place) return null;
    const [kind, words] = state(stage, working);
    const part = working[stage.name] ? share(stage, working[stage.name]) : null;
    return svg(
      "g",
      { class: kind, transform: `translate(${left(place[0])} ${place[1] - high / 2})` },
      svg("title", {}, [stage.name, stage.kind, words, ...stage.reasons, last(stage).full].filter(Boolean).join("\n")),
      svg("rect", { width: WIDTH, height: high, rx: 6 }),
      svg("rect", { class: "stripe", width: 5, height: high, rx: 2 }),
      svg("text", { class: "name", x: 13, y: 21 }, title(stage.name)),
      svg("text", { x: 13, y: 39 }, cut(`${stage.kind}: ${words}`, PLAIN)),
      svg("text", { x: 13, y: 56, class: "last" }, cut(last(stage).text, PLAIN)),
      part === null ? null : svg("rect", { class: "done", x: 5, y: high - 4, width: (WIDTH - 5) * part, height: 4 }),
    );
  };
  const names = stages.map((stage) => stage.name).join(", ");
  const made = svg("svg", { class: "dag", role: "img", "aria-label": `Pipeline of ${stages.length} stages: ${names}`, viewBox: `-2 -2 ${width} ${height}` }, layout.lines.map(line), stages.map(box));
  // It shrinks with the screen, and then scrolls.
  made.style.minWidth = `${SMALLEST * width}px`;
  made.style.maxWidth = `${width}px`;
  return made;
}

/**
 * The same as a list, for narrow screens.
 * @param {any[]} stages @param {Record<string, {needs: string[], gates: string[]}>} needs @param {Record<string, any>} working @param {(stage: any) => any} more
 */
export function list(stages, needs, working, more) {
  const item = (/** @type {any} */ stage) => {
    const [kind, words] = state(stage, working);
    const { needs: read = [], gates = [] } = needs[stage.name] ?? {};
    const before = [...read, ...gates.map((name) => `${name} (waits for)`)];
    return h(
      "li",
      { class: `stage ${kind}` },
      h("div", {}, h("b", {}, stage.name), " ", h("span", { class: "soft" }, stage.kind)),
      h("div", { class: kind }, words),
      working[stage.name] ? progress(stage, working[stage.name]) : null,
      before.length ? h("div", { class: "soft small" }, `from ${before.join(", ")}`) : null,
      stage.reasons.map((/** @type {string} */ reason) => h("div", { class: "small" }, reason)),
      more(stage),
    );
  };
  return h("ol", { class: "stages", "aria-label": "Stages" }, stages.map(item));
}
