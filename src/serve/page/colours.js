// Colour maps.

/** Nine colours of viridis (van der Walt and Smith, matplotlib 2015). */
const VIRIDIS = [[68, 1, 84], [71, 44, 122], [59, 81, 139], [44, 113, 142], [33, 144, 141], [39, 173, 129], [92, 200, 99], [170, 220, 50], [253, 231, 37]];
/** From blue through white to vermillion. */
const DIVERGING = [[0, 84, 150], [86, 180, 233], [245, 245, 245], [240, 150, 90], [178, 50, 0]];

/** Number of colours: cells of one colour are filled together. */
export const STEPS = 64;

/** @param {number[][]} stops @returns {string[]} */
function scale(stops) {
  return Array.from({ length: STEPS }, (_, step) => {
    const at = (step / (STEPS - 1)) * (stops.length - 1);
    const low = Math.min(Math.floor(at), stops.length - 2);
    const mixed = stops[low].map((value, k) => Math.round(value + (at - low) * (stops[low + 1][k] - value)));
    return `#${mixed.map((value) => value.toString(16).padStart(2, "0")).join("")}`;
  });
}

/** Converts a colour `#rrggbb` to a pixel of an image. @param {string} text */
export function pixel(text) {
  const [red, green, blue] = [1, 3, 5].map((at) => parseInt(text.slice(at, at + 2), 16) || 0);
  return new Uint32Array(Uint8Array.of(red, green, blue, 255).buffer)[0];
}

export const SEQUENTIAL = scale(VIRIDIS);
export const SIGNED = scale(DIVERGING);

/**
 * The step of each value between two bounds.
 * @param {ArrayLike<number>} values @param {number} low @param {number} high @returns {Uint8Array}
 */
export function steps(values, low, high) {
  const factor = high > low ? STEPS / (high - low) : 0;
  return Uint8Array.from({ length: values.length }, (_, at) => Math.max(0, Math.min(STEPS - 1, Math.floor((values[at] - low) * factor))));
}

/** @param {ArrayLike<number>} values @returns {[number, number]} */
export function range(values) {
  let low = Infinity;
  let high = -Infinity;
  for (let at = 0; at < values.length; at += 1) {
    if (values[at] < low) low = values[at];
    if (values[at] > high) high = values[at];
  }
  return low <= high ? [low, high] : [0, 0];
}
