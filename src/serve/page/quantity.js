// Quantities as people write them: a number in the usual unit, or one with a unit, as pipelines have it.

/** Units by what they measure, in the unit that a number without one is in; those of `base/quantity.rs`. @type {Record<string, Record<string, number>>} */
const UNITS = {
  voltage: { V: 1, mV: 1e-3, kV: 1e3, MV: 1e6 },
  length: { mm: 1, m: 1e3, cm: 10, um: 1e-3, "µm": 1e-3, "μm": 1e-3, nm: 1e-6 },
  angle: { deg: 1, "°": 1 },
};

/** Units of what stages and scenes hold, as `base/quantity.rs` reads them, by what they measure. */
const KNOWN = [["mm", "m", "cm", "um", "µm", "μm", "nm"], ["V", "mV", "kV", "MV"], ["deg", "°"], ["Pa", "kPa", "MPa", "GPa"], ["s", "ms", "us", "min", "h"], ["Hz", "mHz", "kHz"]];

/**
 * What is wrong with a value that has no unit where the one in the file has: a number alone would be taken in the base unit, which few mean.
 * @param {string} text @param {string} inFile
 */
export function withoutUnit(text, inFile) {
  const unit = /^[+-]?[\d.]+(?:[eE][+-]?\d+)?\s*([A-Za-zµμ°][A-Za-zµμ°/0-9]*)$/.exec(inFile.trim())?.[1];
  if (!unit || !/^[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?$/.test(text.trim()) || Number(text) === 0) return "";
  const allowed = KNOWN.find((units) => units.includes(unit)) ?? [unit];
  return `“${text.trim()}” has no unit, and in the file it is ${inFile.trim()}; allowed: a number with ${allowed.join(", ")}`;
}

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
