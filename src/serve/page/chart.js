// Small charts. The server draws the larger ones, as in reports.

import { h, number, svg } from "./elements.js";

const WIDTH = 320;
const HEIGHT = 120;
const LEFT = 8;
const BOTTOM = 18;

export const charts = {
  /** A curve. @param {number[]} values @param {string} title */
  line(values, title) {
    const [low, high] = [Math.min(...values), Math.max(...values)];
    const x = (/** @type {number} */ at) => LEFT + ((WIDTH - 2 * LEFT) * at) / Math.max(values.length - 1, 1);
    const y = (/** @type {number} */ value) => HEIGHT - BOTTOM - ((HEIGHT - BOTTOM - 10) * (value - low)) / (high - low || 1);
    const points = values.map((value, at) => `${x(at).toFixed(1)},${y(value).toFixed(1)}`).join(" ");
    return svg(
      "svg",
      { viewBox: `0 0 ${WIDTH} ${HEIGHT}`, class: "chart", role: "img", "aria-label": `${title}: ${number(values[0], 4)} to ${number(values[values.length - 1], 4)}` },
      svg("line", { x1: LEFT, x2: WIDTH - LEFT, y1: HEIGHT - BOTTOM, y2: HEIGHT - BOTTOM, class: "axis" }),
      svg("polyline", { points, class: "line" }),
      svg("text", { x: LEFT, y: HEIGHT - 4 }, `${title}: ${number(low, 4)} to ${number(high, 4)}`),
    );
  },

  /**
   * A histogram; a click on a bar selects its range.
   * @param {{edges: number[], counts: number[]}} found @param {string} title @param {(low: number, high: number) => void} select
   */
  bars(found, title, select) {
    const { edges, counts } = found;
    if (!counts.length) return h("p", { class: "soft" }, "no numbers");
    const most = Math.max(...counts);
    const step = (WIDTH - 2 * LEFT) / counts.length;
    const bar = (/** @type {number} */ count, /** @type {number} */ at) => {
      const height = ((HEIGHT - BOTTOM - 6) * count) / most;
      const label = `${number(edges[at], 4)} to ${number(edges[at + 1], 4)}: ${count}`;
      const act = () => select(edges[at], edges[at + 1]);
      return svg(
        "g",
        { role: "button", tabindex: count ? "0" : null, "aria-label": label, onclick: act, onkeydown: (/** @type {KeyboardEvent} */ event) => event.key === "Enter" && act() },
        svg("title", {}, label),
        svg("rect", { x: LEFT + at * step, y: 0, width: step, height: HEIGHT - BOTTOM, class: "under" }),
        svg("rect", { x: LEFT + at * step + 0.5, y: HEIGHT - BOTTOM - height, width: Math.max(step - 1, 0.5), height, class: "bar" }),
      );
    };
    return svg(
      "svg",
      { viewBox: `0 0 ${WIDTH} ${HEIGHT}`, class: "chart", role: "group", "aria-label": `Histogram of ${title}` },
      counts.map(bar),
      svg("line", { x1: LEFT, x2: WIDTH - LEFT, y1: HEIGHT - BOTTOM, y2: HEIGHT - BOTTOM, class: "axis" }),
      svg("text", { x: LEFT, y: HEIGHT - 4 }, number(edges[0], 4)),
      svg("text", { x: WIDTH - LEFT, y: HEIGHT - 4, "text-anchor": "end" }, number(edges[edges.length - 1], 4)),
      svg("text", { x: WIDTH / 2, y: HEIGHT - 4, "text-anchor": "middle" }, title),
    );
  },
};
