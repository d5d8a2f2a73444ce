// Filters of rows as texts: what the server reads (`look/filter.rs`), taken apart at the words between conditions.

/** The conditions of a filter: texts between the words `and`, in capitals or not, outside of quotes. @param {string} text @returns {string[]} */
export function conditions(text) {
  /** @type {string[]} */ const found = [""];
  for (const part of text.match(/(?:"[^"]*"?|[^\s"])+|\s+/g) ?? []) {
    if (part.toLowerCase() === "and") found.push("");
    else found[found.length - 1] += part;
  }
  return found.map((one) => one.trim()).filter(Boolean);
}

/** The column that a condition compares. @param {string} condition */
function column(condition) {
  return condition.split(/[=!<>~]/, 1)[0].trim();
}

/** The filter with one value of a column alone; with none where the value is empty. @param {string} text @param {string} name @param {string} value */
export function withOnly(text, name, value) {
  const others = conditions(text).filter((one) => !(column(one) === name && /^[^=!<>~]*=/.test(one)));
  return (value ? [...others, `${name} = "${value}"`] : others).join(" and ");
}

/** The value that the filter wants of a column; empty where it wants none. @param {string} text @param {string} name */
export function valueOf(text, name) {
  const own = conditions(text).find((one) => column(one) === name && /^[^=!<>~]*=/.test(one));
  return own ? own.slice(own.indexOf("=") + 1).trim().replace(/^"(.*)"$/, "$1") : "";
}

/** The filter with a range of a column in place of any that it has. @param {string} text @param {string} name @param {number} low @param {number} high */
export function within(text, name, low, high) {
  const others = conditions(text).filter((one) => !(column(one) === name && /^[^=!<>~]*[<>]=/.test(one)));
  return [...others, `${name} >= ${low}`, `${name} <= ${high}`].join(" and ");
}
