// Reads patterns from files, and writes them.

import { ask, json } from "./server.js";
import { Pattern } from "./pattern.js";

/** Formats that can be opened. */
export const READ = ["png", "csv", "npy", "svg", "dxf"];

/** Sample points along the side of a cell. */
const SAMPLES = 8;

/**
 * Reads the pattern of a file. The server reads tables, arrays and images, this page reads drawings, cell by cell.
 * @param {File} file @param {{name: string, columns: number, rows: number, size_mm: [number, number]}} scene @returns {Promise<{pattern: Pattern, notes: string[]}>} with what the reader did that a user should know
 */
export async function fromFile(file, scene) {
  const format = (file.name.split(".").pop() ?? "").toLowerCase();
  if (!READ.includes(format)) throw Object.assign(new Error(`cannot open “${file.name}”: unknown format`), { help: `allowed: ${READ.join(", ")}` });
  if (format === "svg") return { pattern: await fromDrawing(file, scene), notes: [] };
  if (format === "dxf") return { pattern: fromPolygons(await file.text(), scene), notes: [] };
  const query = new URLSearchParams({ format, scene: scene.name });
  const found = await json(`sketch/import?${query}`, { method: "POST", bytes: file });
  const count = found.patterns.length;
  return { pattern: Pattern.of(found.patterns[0]), notes: [...found.notes, ...(count > 1 ? [`the file has ${count} patterns; the first one is opened`] : [])] };
}

/** Reads a drawing of the whole membrane: a cell is an electrode if more than half of it is dark. @param {Blob} file @param {{columns: number, rows: number}} scene */
async function fromDrawing(file, { columns, rows }) {
  const address = URL.createObjectURL(new Blob([file], { type: "image/svg+xml" }));
  try {
    const image = new Image();
    image.src = address;
    await image.decode();
    const canvas = document.createElement("canvas");
    [canvas.width, canvas.height] = [columns * SAMPLES, rows * SAMPLES];
    const context = /** @type {CanvasRenderingContext2D} */ (canvas.getContext("2d", { willReadFrequently: true }));
    context.fillStyle = "#fff";
    context.fillRect(0, 0, canvas.width, canvas.height);
    context.drawImage(image, 0, 0, canvas.width, canvas.height);
    const { data } = context.getImageData(0, 0, canvas.width, canvas.height);
    const pattern = new Pattern(columns, rows);
    for (let cell = 0; cell < pattern.cells.length; cell += 1) {
      const [x, y] = [cell % columns, rows - 1 - Math.floor(cell / columns)];
      let dark = 0;
      for (let k = 0; k < SAMPLES * SAMPLES; k += 1) {
        const at = 4 * ((y * SAMPLES + Math.floor(k / SAMPLES)) * canvas.width + x * SAMPLES + (k % SAMPLES));
        dark += data[at] + data[at + 1] + data[at + 2] < 384 ? 1 : 0;
      }
      pattern.cells[cell] = dark * 2 > SAMPLES * SAMPLES ? 1 : 0;
    }
    return pattern;
  } catch {
    throw new Error(`this browser cannot show ${/** @type {any} */ (file).name ?? "the file"} as a drawing`);
  } finally {
    URL.revokeObjectURL(address);
  }
}

/**
 * Reads closed polylines in mm from the lower left corner, on layers that begin with ELECTRODE if there are any; a cell is an electrode if
 * its centre lies within an odd number of them.
 * @param {string} text @param {{columns: number, rows: number, size_mm: [number, number]}} scene
 */
export function fromPolygons(text, { columns, rows, size_mm }) {
  const parts = text.split(/\r?\n/);
  /** @type {{layer: string, points: [number, number][]}[]} */
  const rings = [];
  /** @type {{layer: string, points: [number, number][]}|null} */
  let ring = null;
  for (let at = 0; at + 1 < parts.length; at += 2) {
    const [code, value] = [Number(parts[at].trim()), parts[at + 1].trim()];
    if (code === 0) {
      if (ring && ring.points.length > 2) rings.push(ring);
      ring = value === "LWPOLYLINE" ? { layer: "", points: [] } : null;
    } else if (ring && code === 8) ring.layer = value.toUpperCase();
    else if (ring && code === 10) ring.points.push([Number(value), 0]);
    else if (ring && code === 20 && ring.points.length) ring.points[ring.points.length - 1][1] = Number(value);
  }
  const named = rings.filter((found) => found.layer.startsWith("ELECTRODE"));
  const outlines = named.length ? named : rings;
  if (!outlines.length) throw new Error("the file has no closed polyline (LWPOLYLINE)");
  const pattern = new Pattern(columns, rows);
  pattern.cells.forEach((_, cell) => {
    const x = ((cell % columns) + 0.5) * (size_mm[0] / columns);
    const y = (Math.floor(cell / columns) + 0.5) * (size_mm[1] / rows);
    let inside = false;
    for (const { points } of outlines) {
      for (let i = 0, j = points.length - 1; i < points.length; j = i, i += 1) {
        const [[ax, ay], [bx, by]] = [points[i], points[j]];
        if (ay > y !== by > y && x < ((bx - ax) * (y - ay)) / (by - ay) + ax) inside = !inside;
      }
    }
    pattern.cells[cell] = inside ? 1 : 0;
  });
  return pattern;
}

/** Saves a file. @param {BlobPart} content @param {string} name */
export function save(content, name) {
  const address = URL.createObjectURL(new Blob([content]));
  const link = document.createElement("a");
  link.href = address;
  link.download = name;
  link.click();
  setTimeout(() => URL.revokeObjectURL(address), 10000);
}

/**
 * Saves a list of rows, which `without` in a pipeline drops. @param {Set<number>} rows @param {string} dataset digest of their dataset
 * @param {string} name
 */
export function saveRows(rows, dataset, name) {
  const lines = [`# rows of ${dataset}`, ...[...rows].sort((a, b) => a - b)];
  save(lines.join("\n") + "\n", `${name}-${dataset.slice(0, 12)}.txt`);
}

/** Saves a pattern in a format. @param {string} format @param {Record<string, any>} body of the request @param {string} name */
export async function saveAs(format, body, name) {
  const response = await ask("sketch/export", { body: { ...body, format } });
  save(await response.blob(), `${name}.${format}`);
}
