// Quantities as people write them: a number in the usual unit, or one with a unit, as pipelines have it.

/** Units by what they measure, in the unit that a number without one is in; those of `base/quantity.rs`. @type {Record<string, Record<string, number>>} */
const UNITS = {
  voltage: { V: 1, mV: 1e-3, kV: 1e3, MV: 1e6 },
  length: { mm: 1, m: 1e3, cm: 10, um: 1e-3, "µm": 1e-3, "μm": 1e-3, nm: 1e-6 },
  angle: { deg: 1, "°": 1 },
};

/** What is said of a field for a quantity. @type {Record<string, string>} */
export const HINTS = { voltage: "in V, or with a unit: 4 kV", length: "in mm, or with a unit: 250 um", angle: "in degrees" };

/**
 * The number that a text means, or what is wrong with it.
 * @param {string} text @param {"voltage"|"length"|"angle"} dimension @param {number} least @param {number} most
 * @returns {{value: number, wrong: string}}
 */
export function quantity(text, dimension, least, most) {
  const units = UNITS[dimension];
  const usual = Object.keys(units)[0];
  const refused = (/** @type {string} */ wrong) => ({ value: NaN, wrong });
  if (!text.trim()) return refused(`a number is wanted, ${HINTS[dimension]}`);
  const parts = /^([+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?)\s*(\S*)$/.exec(text.trim());
  if (!parts) return refused(`“${text}” is no number`);
  if (parts[2] && !(parts[2] in units)) return refused(`“${parts[2]}” is no unit of this; allowed: ${Object.keys(units).join(", ")}`);
  // Twelve digits: 4.1 kV are 4100 V, and not a little less.
  const value = Number((Number(parts[1]) * (units[parts[2]] ?? 1)).toPrecision(12));
  return value >= least && value <= most ? { value, wrong: "" } : refused(`allowed: ${least} to ${most} ${usual}`);
}
