// Reads patterns from files, and writes them.

import { ask, json } from "./server.js";
import { Pattern } from "./pattern.js";

/** Formats that can be opened. */
export const READ = ["png", "jpg", "jpeg", "tif", "tiff", "bmp", "csv", "npy", "svg", "dxf"];

/**
 * Reads the pattern of a file.
 * @param {File} file @param {{name: string}} scene @returns {Promise<{pattern: Pattern, notes: string[]}>} with what the reader did that a user should know
 */
export async function fromFile(file, scene) {
  const format = (file.name.split(".").pop() ?? "").toLowerCase();
  if (!READ.includes(format)) throw Object.assign(new Error(`cannot open “${file.name}”: unknown format`), { help: `allowed: ${READ.join(", ")}` });
  const query = new URLSearchParams({ format, scene: scene.name });
  const found = await json(`sketch/import?${query}`, { method: "POST", bytes: file });
  const count = found.patterns.length;
  return { pattern: Pattern.of(found.patterns[0]), notes: [...found.notes, ...(count > 1 ? [`the file has ${count} patterns; the first one is opened`] : [])] };
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
