// Drawings of patterns and of deformed membranes.

import { SEQUENTIAL, SIGNED, pixel, range, steps } from "./colours.js";
import { Pattern } from "./pattern.js";

/** Colours of electrode groups. */
const GROUPS = ["", "#2b83ba", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9"];
const FRAME = "#8a929b";
const BODY = "#59636e";

/** @param {HTMLElement} element @param {string} name */
function colour(element, name) {
  return getComputedStyle(element).getPropertyValue(name).trim() || "#888";
}

/** @param {number} group */
export function groupColour(group) {
  return GROUPS[((group - 1) % (GROUPS.length - 1)) + 1];
}

/** How each canvas is drawn, to draw it again in other colours or at another width. @type {Map<HTMLCanvasElement, () => void>} */
const shown = new Map();

/** Number of canvases after which those that were removed from the page are forgotten. */
const MANY = 400;

/** @param {HTMLCanvasElement} canvas @param {() => void} draw */
function remember(canvas, draw) {
  shown.set(canvas, draw);
  if (shown.size > MANY) forget();
}

function forget() {
  for (const canvas of shown.keys()) if (!canvas.isConnected) shown.delete(canvas);
}

function again() {
  forget();
  for (const draw of [...shown.values()]) draw();
}

window.matchMedia("(prefers-color-scheme: dark)").addEventListener("change", again);
window.addEventListener("resize", again);

/**
 * Returns the width of a canvas in pixels of the page; 300 while it is not laid out.
 * @param {HTMLCanvasElement} canvas
 */
function widthOf(canvas) {
  return canvas.clientWidth || 300;
}

/**
 * Prepares a canvas at the resolution of the screen.
 * @param {HTMLCanvasElement} canvas @param {number} ratio height over width
 * @returns {{context: CanvasRenderingContext2D, width: number, height: number}}
 */
export function prepared(canvas, ratio) {
  const width = widthOf(canvas);
  const height = Math.round(width * ratio);
  const scale = window.devicePixelRatio || 1;
  if (canvas.width !== Math.round(width * scale) || canvas.height !== Math.round(height * scale)) {
    canvas.width = Math.round(width * scale);
    canvas.height = Math.round(height * scale);
    canvas.style.height = `${height}px`;
  }
  const context = /** @type {CanvasRenderingContext2D} */ (canvas.getContext("2d"));
  context.setTransform(scale, 0, 0, scale, 0, 0);
  context.clearRect(0, 0, width, height);
  return { context, width, height };
}

/**
 * Draws the cells of a pattern.
 * @param {HTMLCanvasElement} canvas @param {Pattern} pattern
 * @param {{ratio?: number, grid?: boolean, parts?: number[]|null, borders?: Borders|null, cursor?: [number, number]|null, heat?: ArrayLike<number>|null, point?: [number, number]|null, direction?: number, sides?: Supports|null, moved?: {pattern: Pattern, displacement: Float32Array, size: [number, number], scale: number}|null}} [more]
 */
export function drawPattern(canvas, pattern, more = {}) {
  remember(canvas, () => drawPattern(canvas, pattern, more));
  const { columns, rows } = pattern;
  const { context, width, height } = prepared(canvas, more.ratio ?? rows / columns);
  const [dx, dy] = [width / columns, height / rows];
  context.fillStyle = colour(canvas, "--paper");
  context.fillRect(0, 0, width, height);
  const rectangle = (/** @type {number} */ from, /** @type {number} */ to, /** @type {number} */ y) => {
    const [left, top] = [Math.floor(from * dx), Math.floor((rows - 1 - y) * dy)];
    context.fillRect(left, top, Math.ceil(to * dx) - left, Math.ceil((rows - y) * dy) - top);
  };
  const cell = (/** @type {number} */ at) => rectangle(at % columns, (at % columns) + 1, Math.floor(at / columns));
  if (more.heat) {
    const most = Math.max(...range(more.heat).map(Math.abs)) || 1;
    const of = steps(more.heat, -most, most);
    of.forEach((step, at) => {
      context.fillStyle = SIGNED[step];
      cell(at);
    });
    // Electrodes have a mark in each of their cells.
    context.fillStyle = "rgba(0,0,0,.55)";
    pattern.cells.forEach((value, at) => {
      if (!value) return;
      const [x, y] = [at % columns, rows - 1 - Math.floor(at / columns)];
      context.fillRect((x + 0.35) * dx, (y + 0.35) * dy, 0.3 * dx, 0.3 * dy);
    });
  } else if (pattern.shapes) {
    const groups = new Set(pattern.shapes.map((shape) => shape.group));
    for (const group of groups) {
      const path = new Path2D();
      for (const shape of pattern.shapes) if (shape.group === group) ring(path, shape.ring.map(([x, y]) => [x * width, (1 - y) * height]));
      context.fillStyle = groupColour(group);
      context.fill(path, "evenodd");
    }
  } else if (pattern.covered) {
    const { share, group } = pattern.covered;
    for (let at = 0; at < columns * rows; at += 1) {
      if (!share[at]) continue;
      context.globalAlpha = share[at];
      context.fillStyle = groupColour(group[at]);
      // Cells must not overlap, since they are transparent.
      const [x, y] = [at % columns, rows - 1 - Math.floor(at / columns)];
      const [left, top] = [Math.round(x * dx), Math.round(y * dy)];
      context.fillRect(left, top, Math.round((x + 1) * dx) - left, Math.round((y + 1) * dy) - top);
    }
    context.globalAlpha = 1;
  } else {
    const drawn = more.borders && more.parts ? extended(pattern, more.parts) : pattern;
    const groups = drawn.cells.reduce((most, value) => Math.max(most, value), 0);
    for (let group = 1; group <= groups; group += 1) {
      context.fillStyle = groupColour(group);
      for (let y = 0; y < rows; y += 1) runs(drawn, y, group, (from, to) => rectangle(from, to, y));
    }
  }
  if (more.borders) drawBorders(context, more.borders, (/** @type {[number, number]} */ [x, y]) => [x * width, (1 - y) * height]);
  else if (more.parts) {
    more.parts.forEach((part, at) => {
      if (!part) return;
      context.fillStyle = part === 1 ? FRAME : BODY;
      cell(at);
    });
  }
  if (more.grid) {
    context.strokeStyle = colour(canvas, "--hair");
    context.lineWidth = 1;
    context.beginPath();
    for (let x = 5; x < columns; x += 5) line(context, x * dx, 0, x * dx, height);
    for (let y = 5; y < rows; y += 5) line(context, 0, height - y * dy, width, height - y * dy);
    context.stroke();
  }
  if (more.sides) drawSides(canvas, context, more.sides, columns, rows, (x, y) => [(x * width) / columns, height - (y * height) / rows]);
  else {
    context.strokeStyle = FRAME;
    context.lineWidth = 2;
    context.strokeRect(0, 0, width, height);
  }
  if (more.moved) {
    const { pattern: own, displacement, size: [across, up], scale } = more.moved;
    const [px, py] = cornersOf(own, displacement, (x, y, u, v) => [((x * across) / columns + scale * u) * (width / across), height - ((y * up) / rows + scale * v) * (height / up)]);
    // A light edge makes the line visible on electrodes.
    const curved = more.borders ? more.parts : null;
    outline(context, own, px, py, "#fff", 3.5, curved);
    outline(context, own, px, py, colour(canvas, "--moved"), 1.5, curved);
  }
  if (more.point) arrow(context, more.point[0] * width, height - more.point[1] * height, more.direction ?? 0, ARROW * width);
  if (more.cursor) {
    context.strokeStyle = colour(canvas, "--vermillion");
    context.lineWidth = 2;
    context.strokeRect(more.cursor[0] * dx, (rows - 1 - more.cursor[1]) * dy, dx, dy);
  }
}

/**
 * The borders of frame and bodies where elements follow curves, as closed polygons in shares of the sides of the membrane.
 * @typedef {{opening: [number, number][][]|null, bodies: [number, number][][][]}} Borders
 */

/**
 * A pattern whose electrodes reach below frame and bodies: what the curves do not cover of a cell is membrane.
 * @param {Pattern} pattern @param {number[]} parts
 */
function extended(pattern, parts) {
  const { columns, rows, cells } = pattern;
  const wider = cells.slice();
  parts.forEach((part, at) => {
    if (!part) return;
    const [x, y] = [at % columns, Math.floor(at / columns)];
    for (const [dx, dy] of [[1, 0], [-1, 0], [0, 1], [0, -1], [1, 1], [1, -1], [-1, 1], [-1, -1]]) {
      const [left, low] = [x + dx, y + dy];
      if (left < 0 || low < 0 || left >= columns || low >= rows || parts[low * columns + left]) continue;
      wider[at] ||= cells[low * columns + left];
    }
  });
  return new Pattern(columns, rows, wider);
}

/** Fills the frame and the bodies. @param {CanvasRenderingContext2D} context @param {Borders} borders @param {(share: [number, number]) => [number, number]} place of a point */
function drawBorders(context, { opening, bodies }, place) {
  const fill = (/** @type {[number, number][][]} */ rings, /** @type {string} */ style) => {
    const path = new Path2D();
    for (const own of rings) ring(path, own.map(place));
    context.fillStyle = style;
    context.fill(path, "evenodd");
  };
  if (opening) fill([[[0, 0], [1, 0], [1, 1], [0, 1]], ...opening], FRAME);
  for (const body of bodies) fill(body, BODY);
}

/** Adds a closed polygon to a path. @param {Path2D|CanvasRenderingContext2D} path @param {number[][]} corners */
function ring(path, corners) {
  corners.forEach(([x, y], at) => (at ? path.lineTo(x, y) : path.moveTo(x, y)));
  path.closePath();
}

/** Calls a function for runs of cells of a row with one value: first cell, and cell after the last. @param {Pattern} pattern @param {number} y @param {number} value @param {(from: number, to: number) => void} each */
function runs(pattern, y, value, each) {
  const { columns, cells } = pattern;
  for (let x = 0; x < columns; x += 1) {
    if (cells[y * columns + x] !== value) continue;
    const from = x;
    while (x < columns && cells[y * columns + x] === value) x += 1;
    each(from, x);
  }
}

/** @param {CanvasRenderingContext2D} context @param {number} a @param {number} b @param {number} c @param {number} d */
function line(context, a, b, c, d) {
  context.moveTo(Math.round(a) + 0.5, Math.round(b) + 0.5);
  context.lineTo(Math.round(c) + 0.5, Math.round(d) + 0.5);
}

/** @param {CanvasRenderingContext2D} context @param {number} x @param {number} y @param {number} degrees @param {number} length */
function arrow(context, x, y, degrees, length) {
  const angle = (-degrees * Math.PI) / 180;
  const [c, s] = [Math.cos(angle), Math.sin(angle)];
  const shaft = new Path2D();
  shaft.moveTo(x, y);
  shaft.lineTo(x + 0.8 * length * c, y + 0.8 * length * s);
  const head = new Path2D();
  head.moveTo(x + length * c, y + length * s);
  head.lineTo(x + 0.7 * length * c - 0.15 * length * s, y + 0.7 * length * s + 0.15 * length * c);
  head.lineTo(x + 0.7 * length * c + 0.15 * length * s, y + 0.7 * length * s - 0.15 * length * c);
  head.closePath();
  head.moveTo(x + 4, y);
  head.arc(x, y, 4, 0, 7);
  // A white edge makes it visible on electrodes of any colour.
  context.lineJoin = "round";
  context.strokeStyle = "#fff";
  context.lineWidth = 6;
  context.stroke(shaft);
  context.lineWidth = 3;
  context.stroke(head);
  context.strokeStyle = context.fillStyle = "#a33b00";
  context.lineWidth = 3;
  context.stroke(shaft);
  context.fill(head);
}

/** Margin around a deformed membrane, a fraction of its width. */
const MARGIN = 0.04;

/** Length of the arrow of a direction, a fraction of the width. */
export const ARROW = 0.12;

/** Places the corners of cells. @param {Pattern} pattern @param {Float32Array|null} displacement mm @param {(x: number, y: number, u: number, v: number) => [number, number]} place of a corner and its displacement @returns {[Float32Array, Float32Array]} */
function cornersOf({ columns, rows }, displacement, place) {
  const count = (columns + 1) * (rows + 1);
  const [px, py] = [new Float32Array(count), new Float32Array(count)];
  for (let y = 0, at = 0; y <= rows; y += 1) {
    for (let x = 0; x <= columns; x += 1, at += 1) {
      [px[at], py[at]] = place(x, y, displacement ? displacement[2 * at] : 0, displacement ? displacement[2 * at + 1] : 0);
    }
  }
  return [px, py];
}

/** Where points of a deformed membrane are drawn, and which points are drawn at a place. */
export class Placement {
  /** @param {HTMLCanvasElement} canvas @param {[number, number]} size @param {Pattern} pattern @param {Float32Array|null} displacement @param {number} scale */
  constructor(canvas, size, pattern, displacement, scale) {
    this.width = canvas.clientWidth || 300;
    this.height = Math.round((this.width * size[1]) / size[0]);
    this.size = size;
    this.pattern = pattern;
    this.displacement = displacement;
    this.scale = scale;
    this.unit = (this.width * (1 - 2 * MARGIN)) / size[0];
  }

  /** The displacement of a point between four corners, times the scale, mm. @param {[number, number]} point @returns {[number, number]} */
  moved([x, y]) {
    if (!this.displacement) return [0, 0];
    const { columns, rows } = this.pattern;
    const [a, b] = [Math.max(0, Math.min((x / this.size[0]) * columns, columns)), Math.max(0, Math.min((y / this.size[1]) * rows, rows))];
    const [left, low] = [Math.min(Math.floor(a), columns - 1), Math.min(Math.floor(b), rows - 1)];
    const [s, t, corner] = [a - left, b - low, low * (columns + 1) + left];
    const of = (/** @type {number} */ axis) => {
      const at = (/** @type {number} */ k) => /** @type {Float32Array} */ (this.displacement)[2 * k + axis];
      return this.scale * ((1 - t) * ((1 - s) * at(corner) + s * at(corner + 1)) + t * ((1 - s) * at(corner + columns + 1) + s * at(corner + columns + 2)));
    };
    return [of(0), of(1)];
  }

  /** @param {[number, number]} point mm @returns {[number, number]} px */
  of(point) {
    const [u, v] = this.moved(point);
    return [MARGIN * this.width + (point[0] + u) * this.unit, this.height - MARGIN * this.height - (point[1] + v) * this.unit];
  }

  /** The point that is drawn at a place, by fixed-point iteration. @param {[number, number]} place px @returns {[number, number]} mm */
  back([left, top]) {
    const [x, y] = [(left - MARGIN * this.width) / this.unit, (this.height - MARGIN * this.height - top) / this.unit];
    /** @type {[number, number]} */ let point = [x, y];
    for (let k = 0; k < 12; k += 1) {
      const [u, v] = this.moved(point);
      point = [x - u, y - v];
    }
    return point;
  }
}

/** The image of each canvas, which is reused. @type {WeakMap<HTMLCanvasElement, ImageData>} */
const images = new WeakMap();

/**
 * Draws the deformed membrane with coloured cells. Cells are filled pixel by pixel, which is several times faster than paths.
 * @param {HTMLCanvasElement} canvas @param {Pattern} pattern @param {Float32Array|null} displacement corners, mm
 * @param {{size: [number, number], scale?: number, values?: ArrayLike<number>|null, signed?: boolean, low?: number, high?: number, parts?: number[]|null, borders?: Borders|null, sides?: Supports|null, point?: [number, number]|null, direction?: number}} more
 */
export function drawMembrane(canvas, pattern, displacement, more) {
  remember(canvas, () => drawMembrane(canvas, pattern, displacement, more));
  const { columns, rows } = pattern;
  const [sizeX, sizeY] = more.size;
  const { context, width, height } = prepared(canvas, sizeY / sizeX);
  const unit = (width * (1 - 2 * MARGIN)) / sizeX;
  const scale = more.scale ?? 1;
  const [px, py] = cornersOf(pattern, displacement, (x, y, u, v) => [
    MARGIN * width + ((x * sizeX) / columns + scale * u) * unit,
    height - MARGIN * height - ((y * sizeY) / rows + scale * v) * unit,
  ]);
  const corners = px.length;
  const image = imageOf(canvas, context);
  const pixels = new Uint32Array(image.data.buffer);
  pixels.fill(pixel(colour(canvas, "--card")));
  const dense = canvas.width / width;
  if (dense !== 1) for (let at = 0; at < corners; at += 1) [px[at], py[at]] = [px[at] * dense, py[at] * dense];
  const fill = (/** @type {number} */ cell, /** @type {number} */ value) => {
    const at = Math.floor(cell / columns) * (columns + 1) + (cell % columns);
    quad(image.width, image.height, pixels, value, px, py, at, at + columns + 1);
  };
  const parts = more.parts ?? null;
  const drawn = more.borders && parts && !pattern.shapes ? extended(pattern, parts) : pattern;
  if (more.values) {
    const [low, high] = more.low !== undefined && more.high !== undefined ? [more.low, more.high] : range(more.values);
    const colours = (more.signed ? SIGNED : SEQUENTIAL).map(pixel);
    steps(more.values, low, high).forEach((step, cell) => fill(cell, colours[step]));
  } else {
    const colours = [colour(canvas, "--paper"), ...Array.from({ length: 16 }, (_, group) => groupColour(group + 1))].map(pixel);
    drawn.cells.forEach((value, cell) => fill(cell, colours[value] ?? colours[1]));
  }
  if (parts && !more.borders) {
    const colours = [0, pixel(FRAME), pixel(BODY)];
    parts.forEach((part, cell) => part && fill(cell, colours[part]));
  }
  context.putImageData(image, 0, 0);
  if (dense !== 1) for (let at = 0; at < corners; at += 1) [px[at], py[at]] = [px[at] / dense, py[at] / dense];
  if (more.values) outline(context, drawn, px, py);
  if (more.borders) {
    const placement = new Placement(canvas, more.size, pattern, displacement, scale);
    drawBorders(context, more.borders, ([x, y]) => placement.of([x * sizeX, y * sizeY]));
  }
  context.strokeStyle = FRAME;
  // Where sides are not held, this is the mount.
  context.lineWidth = more.sides ? 0.5 : 2;
  context.strokeRect(MARGIN * width, MARGIN * height, width * (1 - 2 * MARGIN), height * (1 - 2 * MARGIN));
  if (more.sides) drawSides(canvas, context, more.sides, columns, rows, (x, y) => [px[y * (columns + 1) + x], py[y * (columns + 1) + x]]);
  if (more.point) {
    const [x, y] = new Placement(canvas, more.size, pattern, displacement, scale).of(more.point);
    arrow(context, x, y, more.direction ?? 0, ARROW * width);
  }
}

/**
 * What supports each side: held, free, roller, load or bar, and the force on it, at a share of its length.
 * @typedef {Record<string, {support: string, load: {newtons: [number, number], at: number}|null}>} Supports
 */

/** What the lines of sides mean. */
export const SIDES = "sides: thick grey is held, thin is free, circles are rollers, thick dark is a bar, an arrow is a load";

/** Length of the arrow of a load, as a share of the longer side of the picture. */
const LOAD = 0.09;

/**
 * Draws each side as what supports it.
 * @param {HTMLCanvasElement} canvas @param {CanvasRenderingContext2D} context @param {Supports} sides @param {number} columns @param {number} rows
 * @param {(x: number, y: number) => [number, number]} at the place of a corner of cells
 */
function drawSides(canvas, context, sides, columns, rows, at) {
  for (const [name, { support }] of Object.entries(sides)) {
    const upright = name === "left" || name === "right";
    const cells = upright ? rows : columns;
    const end = name === "right" ? columns : name === "top" ? rows : 0;
    const corner = (/** @type {number} */ k) => (upright ? at(end, k) : at(k, end));
    context.strokeStyle = support === "bar" ? colour(canvas, "--ink") : FRAME;
    context.lineWidth = support === "bar" ? 8 : support === "held" ? 6 : 1.5;
    context.beginPath();
    for (let k = 0; k <= cells; k += 1) context.lineTo(...corner(k));
    context.stroke();
    if (support !== "roller") continue;
    context.fillStyle = colour(canvas, "--paper");
    for (let k = 0; k < 6; k += 1) {
      context.beginPath();
      context.arc(...corner(Math.round(((k + 0.5) / 6) * cells)), 4, 0, 7);
      context.fill();
      context.stroke();
    }
  }
  for (const [name, { load }] of Object.entries(sides)) {
    if (!load) continue;
    const upright = name === "left" || name === "right";
    const place = Math.round(load.at * (upright ? rows : columns));
    const end = name === "right" ? columns : name === "top" ? rows : 0;
    const side = upright ? at(end, place) : at(place, end);
    loadArrow(canvas, context, side, load.newtons, upright ? [end ? 1 : -1, 0] : [0, end ? 1 : -1]);
  }
}

/**
 * Draws the arrow of a force within the membrane: it pulls with its tip at the side, or pushes from there.
 * @param {HTMLCanvasElement} canvas @param {CanvasRenderingContext2D} context @param {[number, number]} side @param {[number, number]} force
 * @param {[number, number]} outwards
 */
function loadArrow(canvas, context, [x, y], [fx, fy], outwards) {
  const length = LOAD * Math.max(canvas.width, canvas.height);
  const size = Math.hypot(fx, fy);
  const [dx, dy] = [(length * fx) / size, (-length * fy) / size];
  const pulls = fx * outwards[0] + fy * outwards[1] >= 0;
  const [tipX, tipY] = pulls ? [x, y] : [x + dx, y + dy];
  context.strokeStyle = colour(canvas, "--ink");
  context.fillStyle = context.strokeStyle;
  context.lineWidth = 3;
  context.beginPath();
  context.moveTo(tipX - dx, tipY - dy);
  context.lineTo(tipX - 0.2 * dx, tipY - 0.2 * dy);
  context.stroke();
  context.beginPath();
  context.moveTo(tipX, tipY);
  context.lineTo(tipX - 0.3 * dx - 0.12 * dy, tipY - 0.3 * dy + 0.12 * dx);
  context.lineTo(tipX - 0.3 * dx + 0.12 * dy, tipY - 0.3 * dy - 0.12 * dx);
  context.fill();
}

/** @param {HTMLCanvasElement} canvas @param {CanvasRenderingContext2D} context */
function imageOf(canvas, context) {
  const known = images.get(canvas);
  if (known && known.width === canvas.width && known.height === canvas.height) return known;
  const made = context.createImageData(Math.max(canvas.width, 1), Math.max(canvas.height, 1));
  images.set(canvas, made);
  return made;
}

/**
 * Fills the pixels whose centres lie in a cell, line by line: from the first to the last crossing of its edges with the line.
 * @param {number} width @param {number} height @param {Uint32Array} pixels @param {number} value
 * @param {Float32Array} px @param {Float32Array} py corners in pixels @param {number} low the left lower corner @param {number} high the one above it
 */
function quad(width, height, pixels, value, px, py, low, high) {
  const [ax, ay, bx, by] = [px[low], py[low], px[low + 1], py[low + 1]];
  const [cx, cy, dx, dy] = [px[high + 1], py[high + 1], px[high], py[high]];
  const top = Math.min(ay, by, cy, dy);
  const bottom = Math.max(ay, by, cy, dy);
  const first = top < 0.5 ? 0 : Math.ceil(top - 0.5);
  const last = bottom > height - 0.5 ? height - 1 : Math.floor(bottom - 0.5);
  for (let row = first; row <= last; row += 1) {
    const y = row + 0.5;
    let left = width;
    let right = 0;
    let x = 0;
    if (ay <= y !== by <= y) {
      x = ax + ((y - ay) / (by - ay)) * (bx - ax);
      if (x < left) left = x;
      if (x > right) right = x;
    }
    if (by <= y !== cy <= y) {
      x = bx + ((y - by) / (cy - by)) * (cx - bx);
      if (x < left) left = x;
      if (x > right) right = x;
    }
    if (cy <= y !== dy <= y) {
      x = cx + ((y - cy) / (dy - cy)) * (dx - cx);
      if (x < left) left = x;
      if (x > right) right = x;
    }
    if (dy <= y !== ay <= y) {
      x = dx + ((y - dy) / (ay - dy)) * (ax - dx);
      if (x < left) left = x;
      if (x > right) right = x;
    }
    const end = row * width + (right > width - 0.5 ? width - 1 : Math.floor(right - 0.5));
    for (let at = row * width + (left < 0.5 ? 0 : Math.ceil(left - 0.5)); at <= end; at += 1) pixels[at] = value;
  }
}

/** Draws the edges of electrodes, but not those at cells of frame and bodies whose borders are curves. @param {CanvasRenderingContext2D} context @param {Pattern} pattern @param {Float32Array} px @param {Float32Array} py @param {string} [style] @param {number} [thick] @param {number[]|null} [curved] */
function outline(context, pattern, px, py, style = "rgba(255,255,255,.75)", thick = 1, curved = null) {
  const { columns, rows, cells } = pattern;
  const at = (/** @type {number} */ x, /** @type {number} */ y) => (x < 0 || y < 0 || x >= columns || y >= rows ? 0 : cells[y * columns + x]);
  context.beginPath();
  context.strokeStyle = style;
  context.lineWidth = thick;
  if (pattern.shapes) {
    // Between the corners of cells they move as these do.
    const moved = (/** @type {[number, number]} */ [u, v]) => {
      const [x, y] = [u * columns, v * rows];
      const [left, low] = [Math.min(Math.floor(x), columns - 1), Math.min(Math.floor(y), rows - 1)];
      const [s, t, corner] = [x - left, y - low, low * (columns + 1) + left];
      const of = (/** @type {Float32Array} */ p) => (1 - t) * ((1 - s) * p[corner] + s * p[corner + 1]) + t * ((1 - s) * p[corner + columns + 1] + s * p[corner + columns + 2]);
      return [of(px), of(py)];
    };
    for (const shape of pattern.shapes) ring(context, shape.ring.map(moved));
    context.stroke();
    return;
  }
  const edge = (/** @type {number} */ a, /** @type {number} */ b) => {
    context.moveTo(px[a], py[a]);
    context.lineTo(px[b], py[b]);
  };
  for (let y = 0; y <= rows; y += 1) {
    for (let x = 0; x <= columns; x += 1) {
      const corner = y * (columns + 1) + x;
      const cell = y * columns + x;
      if (x < columns && at(x, y) !== at(x, y - 1) && !curved?.[cell] && !curved?.[cell - columns]) edge(corner, corner + 1);
      if (y < rows && at(x, y) !== at(x - 1, y) && !(x < columns && curved?.[cell]) && !(x && curved?.[cell - 1])) edge(corner, corner + columns + 1);
    }
  }
  context.stroke();
}

/** The largest magnitude of the displacement at the corners of each cell. @param {Float32Array} displacement @param {number} columns @param {number} rows */
export function magnitudes(displacement, columns, rows) {
  const corners = Float32Array.from({ length: displacement.length / 2 }, (_, at) => Math.hypot(displacement[2 * at], displacement[2 * at + 1]));
  const found = new Float32Array(columns * rows);
  for (let y = 0, cell = 0; y < rows; y += 1) {
    for (let x = 0; x < columns; x += 1, cell += 1) {
      const at = y * (columns + 1) + x;
      const above = at + columns + 1;
      found[cell] = Math.max(corners[at], corners[at + 1], corners[above], corners[above + 1]);
    }
  }
  return found;
}

/** Draws a colour bar. @param {HTMLCanvasElement} canvas @param {boolean} signed */
export function drawBar(canvas, signed) {
  // Ten pixels high, also while it is not laid out and has no width.
  const { context, width, height } = prepared(canvas, 10 / widthOf(canvas));
  const colours = signed ? SIGNED : SEQUENTIAL;
  colours.forEach((style, step) => {
    context.fillStyle = style;
    context.fillRect((step * width) / colours.length, 0, Math.ceil(width / colours.length) + 1, height);
  });
}
