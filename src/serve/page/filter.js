// Filters of rows as texts, with the syntax of the server (`browse/filter.rs`).

/** Splits a filter into its conditions at the words `and`, in upper or lower case, outside of quotes. @param {string} text @returns {string[]} */
export function conditions(text) {
  /** @type {string[]} */ const found = [""];
  for (const part of text.match(/(?:"[^"]*"?|[^\s"])+|\s+/g) ?? []) {
    if (part.toLowerCase() === "and") found.push("");
    else found[found.length - 1] += part;
  }
  return found.map((one) => one.trim()).filter(Boolean);
}

/** The column of a condition. @param {string} condition */
function column(condition) {
  return condition.split(/[=!<>~]/, 1)[0].trim();
}

/** Sets the value of a column in a filter; an empty value removes it. @param {string} text @param {string} name @param {string} value */
export function withOnly(text, name, value) {
  const others = conditions(text).filter((one) => !(column(one) === name && /^[^=!<>~]*=/.test(one)));
  return (value ? [...others, `${name} = "${value}"`] : others).join(" and ");
}

/** The value of a column in a filter; empty if there is none. @param {string} text @param {string} name */
export function valueOf(text, name) {
  const own = conditions(text).find((one) => column(one) === name && /^[^=!<>~]*=/.test(one));
  return own ? own.slice(own.indexOf("=") + 1).trim().replace(/^"(.*)"$/, "$1") : "";
}

/** Sets the range of a column in a filter. @param {string} text @param {string} name @param {number} low @param {number} high */
export function within(text, name, low, high) {
  const others = conditions(text).filter((one) => !(column(one) === name && /^[^=!<>~]*[<>]=/.test(one)));
  return [...others, `${name} >= ${low}`, `${name} <= ${high}`].join(" and ");
}
