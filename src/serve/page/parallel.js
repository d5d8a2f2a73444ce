// Parallel coordinates: an axis for each changed value and one for a result, and a line for each run.

import { range } from "./colours.js";
import { cell, changedValues, h, near, number, svg, when } from "./elements.js";
import { inBaseUnit } from "./quantity.js";

const [HEIGHT, TOP, BOTTOM, SIDE, BETWEEN] = [260, 44, 34, 90, 190];

/** Space below an axis for runs whose value is not known. */
const BELOW = 38;

/** Letters of the title of an axis. */
const LETTERS = 26;

/** The runs of a pipeline that are drawn: the stages of a sweep are not those of the file. @param {any[]} runs @returns {any[]} */
export function single(runs) {
  return runs.filter((run) => run.command !== "sweep");
}

/** The changed values that differ between runs. @param {any[]} runs @returns {string[]} */
export function varied(runs) {
  const names = [...new Set(runs.flatMap((run) => Object.keys(run.overrides)))].sort();
  return names.filter((name) => new Set(runs.map((run) => String(run.overrides[name] ?? ""))).size > 1);
}

/**
 * An axis: the share of its height for each run, null for a value that is not known, and its ends.
 * @param {string} title @param {(string|number|undefined)[]} values
 * @returns {{title: string, shares: (number|null)[], low: string, high: string}}
 */
function axis(title, values) {
  const known = values.filter((value) => value !== undefined);
  const numbers = values.map((value) => (value === undefined ? NaN : typeof value === "number" ? value : inBaseUnit(value)));
  if (numbers.filter((value) => !Number.isNaN(value)).length === known.length) {
    const [low, high] = range(numbers.filter((value) => !Number.isNaN(value)));
    const text = (/** @type {number} */ end) => {
      const value = values[numbers.indexOf(end)];
      return typeof value === "number" ? number(value) : value ?? "";
    };
    return { title, shares: numbers.map((value) => (Number.isNaN(value) ? null : high > low ? (value - low) / (high - low) : 0.5)), low: text(low), high: text(high) };
  }
  // Words are placed in their order.
  const words = [...new Set(known.map(String))].sort();
  const share = (/** @type {string|number|undefined} */ value) => (value === undefined ? null : words.length > 1 ? words.indexOf(String(value)) / (words.length - 1) : 0.5);
  return { title, shares: values.map(share), low: words[0], high: words[words.length - 1] };
}

/** The end of a long path, which says more than its beginning. @param {string} text */
function end(text) {
  return text.length > LETTERS ? `…${text.slice(1 - LETTERS)}` : text;
}

/** Colours a line from blue to vermillion, which can be seen on light and dark pages. @param {any} line @param {number} share */
function coloured(line, share) {
  line.style.stroke = `color-mix(in oklab, var(--vermillion) ${(100 * share).toFixed(0)}%, var(--blue))`;
  return line;
}

/** @param {any[]} all runs of one pipeline @param {string[]} names of changed values @param {string} result */
export function parallel(all, names, result) {
  const runs = all.filter((run) => Number.isFinite(run.results[result]));
  const values = runs.map((run) => run.results[result]);
  // A run without a change has the value that the file had, if its record tells.
  const axes = [...names.map((name) => axis(near(name), runs.map((run) => run.overrides[name] ?? run.values?.[name]))), axis(result, values)];
  const [lowest, highest] = range(values);
  const isKnown = axes.every(({ shares }) => !shares.includes(null));
  const height = HEIGHT + (isKnown ? 0 : BELOW);
  const width = 2 * SIDE + (axes.length - 1) * BETWEEN;
  const x = (/** @type {number} */ at) => SIDE + at * BETWEEN;
  const y = (/** @type {number|null} */ share) => (share === null ? HEIGHT - BOTTOM + BELOW : HEIGHT - BOTTOM - (HEIGHT - TOP - BOTTOM) * share);
  const told = h("p", { class: "small", id: "hovered", "aria-live": "polite" }, "Point at a line to see its run.");
  const line = (/** @type {any} */ run, /** @type {number} */ at) => {
    const points = axes.map(({ shares }, k) => `${x(k)},${y(shares[at]).toFixed(1)}`).join(" ");
    const words = `run ${run.id}, ${when(run.created)}: ${changedValues(run.overrides)}; ${result} ${cell(values[at])}`;
    const show = () => (told.textContent = words);
    const go = () => (location.hash = `#/runs/${run.id}`);
    return svg(
      "a",
      { href: `#/runs/${run.id}`, "data-run": run.id, "aria-label": words, onmouseenter: show, onfocus: show, onclick: go },
      svg("title", {}, words),
      svg("polyline", { points, class: "under" }),
      coloured(svg("polyline", { points, class: "run" }), highest > lowest ? (values[at] - lowest) / (highest - lowest) : 1),
    );
  };
  const drawn = (/** @type {ReturnType<typeof axis>} */ one, /** @type {number} */ at) => [
    svg("line", { x1: x(at), x2: x(at), y1: y(0), y2: y(1), class: "axis" }),
    svg("text", { x: x(at), y: 16, "text-anchor": "middle", class: "ink" }, end(one.title), svg("title", {}, one.title)),
    svg("text", { x: x(at), y: y(1) - 8, "text-anchor": "middle" }, one.high),
    svg("text", { x: x(at), y: y(0) + 16, "text-anchor": "middle" }, one.low),
    one.shares.includes(null) ? svg("text", { x: x(at), y: y(null) + 16, "text-anchor": "middle" }, "as in the file") : null,
  ];
  const drawing = svg("svg", { viewBox: `0 0 ${width} ${height}`, class: "chart parallel", role: "group", "aria-label": `${runs.length} runs: ${axes.map((one) => one.title).join(", ")}` }, axes.map(drawn), runs.map(line));
  drawing.style.minWidth = `${0.75 * width}px`;
  drawing.style.maxWidth = `${width}px`;
  return h("div", {}, h("div", { class: "scroll", tabindex: "0", role: "region", "aria-label": "Parallel coordinates" }, drawing), told);
}
