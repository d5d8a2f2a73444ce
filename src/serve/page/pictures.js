// Pictures of rows of artifacts: patterns, and fields if there are any.

import { frame, json } from "./server.js";
import { h, number } from "./elements.js";
import { drawMembrane, drawPattern, magnitudes } from "./membrane.js";
import { Pattern } from "./pattern.js";

/** The arrays of patterns and of fields along an axis. @param {any} found @param {string} axis */
export function drawn(found, axis) {
  const of = (/** @type {(axes: string[]) => boolean} */ fits) => found.datasets.find((/** @type {any} */ one) => one.axes[0] === axis && !isShare(one) && fits(one.axes.slice(1)));
  return {
    patterns: of((axes) => axes.length === 2 && axes.every((name) => name === "y" || name === "x")),
    field: of((axes) => axes.length === 3 && axes[2] === "xy" && axes.every((name) => name !== "time")),
  };
}

/** Whether an array has the covered shares of cells. @param {any} one */
function isShare(one) {
  return one.path.startsWith("covered/");
}

/** The array of patterns of an artifact. @param {any} found */
export function patternsOf(found) {
  return found.datasets.find((/** @type {any} */ one) => !isShare(one) && one.axes.length === 3 && one.axes[1] === "y" && one.axes[2] === "x");
}

/** Reads the patterns of rows. @param {any} found @param {number[]} rows @returns {Promise<Pattern[]>} */
export async function patternsAt(found, rows) {
  const array = patternsOf(found);
  if (!array || !rows.length) return [];
  const { arrays } = await frame(`artifacts/${found.digest}/arrays?paths=${encodeURIComponent(array.path)}&rows=${rows.join(",")}`);
  const { shape, data } = arrays[array.path];
  const cells = shape[1] * shape[2];
  return withEdges(found, rows, rows.map((_, at) => new Pattern(shape[2], shape[1], Uint8Array.from(data.slice(at * cells, (at + 1) * cells)))));
}

/** Adds to the patterns of rows the shapes that elements follow, or the shares of cells that are covered in part. @param {any} found @param {number[]} rows @param {Pattern[]} patterns @returns {Promise<Pattern[]>} */
export async function withEdges(found, rows, patterns) {
  const has = (/** @type {string} */ path) => found.datasets.some((/** @type {any} */ one) => one.path === path);
  if (!rows.length) return patterns;
  if (has("electrodes/polygons")) {
    const { shapes } = await json(`artifacts/${found.digest}/shapes?rows=${rows.join(",")}`);
    patterns.forEach((pattern, at) => {
      if (shapes[at].length) pattern.shapes = shapes[at];
    });
  }
  if (has("covered/share")) {
    const { arrays } = await frame(`artifacts/${found.digest}/arrays?paths=${encodeURIComponent("covered/share,covered/group")}&rows=${rows.join(",")}`);
    patterns.forEach((pattern, at) => {
      const own = (/** @type {string} */ path) => arrays[path].data.slice(at * pattern.cells.length, (at + 1) * pattern.cells.length);
      pattern.covered = { share: own("covered/share"), group: own("covered/group") };
    });
  }
  return patterns;
}

/** Sides of the membrane in mm from the scene of the artifact; numbers of cells without a scene. @param {any} found @param {Pattern} pattern @returns {[number, number]} */
export function size(found, pattern) {
  const text = found.attributes.scene ?? "";
  const side = /side: ([\d.]+) mm/.exec(text);
  if (side) return [Number(side[1]), Number(side[1])];
  const both = /size: \[([\d.]+) mm, ([\d.]+) mm\]/.exec(text);
  return both ? [Number(both[1]), Number(both[2])] : [pattern.columns, pattern.rows];
}

/** An area: its share of the free membrane, and mm² if the artifact has a scene. @param {any} found @param {number} share */
export function areaWords(found, share) {
  const free = found?.free_area_mm2 ?? null;
  return `area ${number(100 * share, 3)} %${free === null ? "" : `, ${number(share * free)} mm²`}`;
}

/** @param {HTMLCanvasElement} canvas @param {any} found @param {Pattern} pattern @param {Float32Array} displacement */
export function drawField(canvas, found, pattern, displacement) {
  const values = magnitudes(displacement, pattern.columns, pattern.rows);
  drawMembrane(canvas, pattern, displacement, { size: size(found, pattern), scale: 2, values, low: 0, high: Math.max(...values) });
}

/**
 * A card with a pattern, and a link if there is one.
 * @param {Pattern|null} pattern @param {string|null} href @param {any[]} words
 */
export function card(pattern, href, ...words) {
  const canvas = h("canvas", { "aria-hidden": "true" });
  const made = href ? h("a", { class: "card", href }, canvas, words) : h("div", { class: "card" }, canvas, words);
  // The canvas has its width once it is on the page.
  if (pattern) requestAnimationFrame(() => drawPattern(canvas, pattern));
  return made;
}

/** The link to a row, with the prediction of a model if one is given. @param {string} digest @param {number} row @param {string} [model] its digest */
export function rowLink(digest, row, model = "") {
  return `#/artifacts/${digest}?tab=rows&row=${row}${model ? `&model=${model}` : ""}`;
}

/** A drawing of the server as an image, which runs nothing and loads nothing. @param {string} drawing an SVG document @param {string} what */
export function image(drawing, what) {
  return h("img", { class: "drawing", alt: what, src: `data:image/svg+xml,${encodeURIComponent(drawing)}` });
}
