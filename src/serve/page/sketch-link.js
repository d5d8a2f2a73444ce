// A link that holds the drawing: pattern, scene, voltage, point and mesh as words of the address.

import { Pattern } from "./pattern.js";

/** Bits of a cell: enough for the number of its group, and a divisor of 8. @param {number} groups */
function bitsFor(groups) {
  return [1, 2, 4, 8].find((bits) => 2 ** bits > groups) ?? 8;
}

/** Writes cells as bits, the first cell in the highest ones, in base 64 for addresses (RFC 4648). @param {Uint8Array} cells @param {number} groups */
export function packed(cells, groups) {
  const bits = bitsFor(groups);
  const bytes = new Uint8Array(Math.ceil((cells.length * bits) / 8));
  cells.forEach((value, at) => {
    const bit = at * bits;
    bytes[bit >> 3] |= value << (8 - bits - (bit & 7));
  });
  return btoa(String.fromCharCode(...bytes)).replaceAll("+", "-").replaceAll("/", "_").replace(/=+$/, "");
}

/** Reads cells; null if the text is not the cells of such a pattern. @param {string} text @param {number} count @param {number} groups @returns {Uint8Array|null} */
export function unpacked(text, count, groups) {
  const bits = bitsFor(groups);
  /** @type {string} */ let bytes;
  try {
    bytes = atob(text.replaceAll("-", "+").replaceAll("_", "/"));
  } catch {
    return null;
  }
  if (bytes.length !== Math.ceil((count * bits) / 8)) return null;
  const cells = Uint8Array.from({ length: count }, (_, at) => {
    const bit = at * bits;
    return (bytes.charCodeAt(bit >> 3) >> (8 - bits - (bit & 7))) & (2 ** bits - 1);
  });
  return cells.every((value) => value <= groups) ? cells : null;
}

/** The address of a drawing. @param {any} pad */
export function linkTo(pad) {
  const { scene, point, pattern, state, effects } = pad;
  const words = new URLSearchParams({
    scene: scene.name,
    ...(state ? { state } : {}),
    volts: String(pad.voltage),
    x: String(point[0]),
    y: String(point[1]),
    angle: String(pad.direction),
    method: pad.method,
    elements: String(pad.elements),
    order: String(pad.order),
    ...(effects ? { effects: effects.join(",") } : {}),
    cells: packed(pattern.cells, scene.groups),
  });
  return `${location.origin}${location.pathname}#/sketch?${words}`;
}

/**
 * Reads the drawing of an address; null if it has none.
 * @param {URLSearchParams} query @param {any[]} scenes
 * @returns {{scene: any, pattern: Pattern, values: Record<string, any>}|null}
 */
export function linked(query, scenes) {
  const cells = query.get("cells");
  if (cells === null) return null;
  const name = query.get("scene");
  const scene = scenes.find((one) => one.name === name);
  if (!scene) throw Object.assign(new Error(`the link needs the scene “${name}”, which this server does not have`), { help: "start the server with that scene: deaflow sketch SCENE" });
  const found = unpacked(cells, scene.columns * scene.rows, scene.groups);
  const number = (/** @type {string} */ key) => Number(query.get(key) ?? NaN);
  const [x, y] = [number("x"), number("y")];
  const isPoint = x >= 0 && x <= scene.size_mm[0] && y >= 0 && y <= scene.size_mm[1];
  const state = query.get("state");
  const isWhole = found && isPoint && number("volts") >= 0 && Number.isFinite(number("angle")) && (state === null || scene.states.includes(state));
  if (!isWhole) throw Object.assign(new Error(`the link is incomplete, or the scene “${name}” has changed`), { help: "copy the link again from the sketchpad" });
  const effects = query.get("effects");
  return {
    scene,
    pattern: new Pattern(scene.columns, scene.rows, found),
    values: {
      state: state ?? scene.states[0] ?? null,
      voltage: number("volts"),
      point: [x, y],
      direction: number("angle"),
      method: query.get("method") ?? "newton",
      elements: number("elements") || 1,
      order: number("order") || 1,
      effects: effects === null ? null : effects.split(",").filter(Boolean),
    },
  };
}
