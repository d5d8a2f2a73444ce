// Quantities: a number in the default unit, or one with a unit, as in pipelines.

/** Units by dimension, with their factors to the first one, which is the default; those of `base/quantity.rs`. @type {Record<string, Record<string, number>>} */
const UNITS = {
  voltage: { V: 1, mV: 1e-3, kV: 1e3, MV: 1e6 },
  length: { mm: 1, m: 1e3, cm: 10, um: 1e-3, "µm": 1e-3, "μm": 1e-3, nm: 1e-6 },
  angle: { deg: 1, "°": 1 },
  pressure: { Pa: 1, kPa: 1e3, MPa: 1e6, GPa: 1e9 },
  time: { s: 1, ms: 1e-3, us: 1e-6, min: 60, h: 3600 },
  frequency: { Hz: 1, mHz: 1e-3, kHz: 1e3 },
  share: { "": 1, "%": 0.01 },
};

/** Units of the values of pipelines by dimension. */
const KNOWN = Object.values(UNITS).map((units) => Object.keys(units));

/**
 * Refuses a number without a unit if the value in the file has one: it would be taken in the base unit.
 * @param {string} text @param {string} inFile
 */
export function withoutUnit(text, inFile) {
  const unit = /^[+-]?[\d.]+(?:[eE][+-]?\d+)?\s*([A-Za-zµμ°][A-Za-zµμ°/0-9]*)$/.exec(inFile.trim())?.[1];
  if (!unit || !/^[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?$/.test(text.trim()) || Number(text) === 0) return "";
  const allowed = KNOWN.find((units) => units.includes(unit)) ?? [unit];
  return `“${text.trim()}” has no unit; in the file it is ${inFile.trim()}. Allowed: a number with ${allowed.join(", ")}`;
}

/** Converts a text to a number, in the first unit of its dimension; NaN if it is not a number with a known unit, or without one. @param {string} text */
export function inBaseUnit(text) {
  const parts = /^([+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?)\s*(\S*)$/.exec(text.trim());
  if (!parts) return NaN;
  const units = Object.values(UNITS).find((known) => parts[2] in known);
  const factor = parts[2] ? units?.[parts[2]] ?? NaN : 1;
  return Number((Number(parts[1]) * factor).toPrecision(12));
}

/** Hints for fields of a dimension. @type {Record<string, string>} */
export const HINTS = { voltage: "in V, or with a unit: 4 kV", length: "in mm, or with a unit: 250 um", angle: "in degrees" };

/**
 * Says how a number without a unit is read, as the command line does; empty for zero and with a unit.
 * @param {string} text @param {"voltage"|"length"|"angle"} dimension
 */
export function withAssumedUnit(text, dimension) {
  const bare = /^[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?$/.test(text.trim());
  return bare && Number(text) !== 0 ? `no unit: read as ${text.trim()} ${Object.keys(UNITS[dimension])[0]}` : "";
}

/**
 * Parses a quantity; `wrong` describes an invalid text.
 * @param {string} text @param {"voltage"|"length"|"angle"} dimension @param {number} least @param {number} most
 * @returns {{value: number, wrong: string}}
 */
export function quantity(text, dimension, least, most) {
  const units = UNITS[dimension];
  const usual = Object.keys(units)[0];
  const refused = (/** @type {string} */ wrong) => ({ value: NaN, wrong });
  if (!text.trim()) return refused(`enter a number ${HINTS[dimension]}`);
  const parts = /^([+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?)\s*(\S*)$/.exec(text.trim());
  if (!parts) return refused(`“${text}” is not a number`);
  if (parts[2] && !(parts[2] in units)) return refused(`unknown unit “${parts[2]}”; allowed: ${Object.keys(units).join(", ")}`);
  // Twelve digits, so that 4.1 kV are exactly 4100 V.
  const value = Number((Number(parts[1]) * (units[parts[2]] ?? 1)).toPrecision(12));
  return value >= least && value <= most ? { value, wrong: "" } : refused(`allowed: ${least} to ${most} ${usual}`);
}
