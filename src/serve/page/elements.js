// Elements of the page. Text is set as text: content of files is never parsed as markup.

/** @typedef {Node|string|number|null|undefined|false|(Node|string|number|null|undefined|false)[]} Child */

const SVG = "http://www.w3.org/2000/svg";

/**
 * @param {string} tag @param {Record<string, any>} [properties] @param {Child[]} children
 * @returns {any}
 */
export function h(tag, properties = {}, ...children) {
  return fill(document.createElement(tag), properties, children);
}

/** @param {string} tag @param {Record<string, any>} [properties] @param {Child[]} children @returns {any} */
export function svg(tag, properties = {}, ...children) {
  return fill(document.createElementNS(SVG, tag), properties, children);
}

/** @param {Element} element @param {Record<string, any>} properties @param {Child[]} children */
function fill(element, properties, children) {
  for (const [name, value] of Object.entries(properties)) {
    if (value === undefined || value === null || value === false) continue;
    if (name.startsWith("on")) element.addEventListener(name.slice(2), value);
    else if (name === "value" || name === "checked" || name === "disabled" || name === "selected") /** @type {any} */ (element)[name] = value;
    else element.setAttribute(name, value === true ? "" : String(value));
  }
  for (const child of children.flat(3)) {
    if (child === null || child === undefined || child === false) continue;
    element.append(child instanceof Node ? child : String(child));
  }
  return element;
}

/** @param {Element} element @param {Child[]} children */
export function replace(element, ...children) {
  const fragment = document.createDocumentFragment();
  fill(/** @type {any} */ (fragment), {}, children);
  element.replaceChildren(fragment);
}

/** Replaces hyphens by minus signs, as in `base/digits.rs`. @param {string} text */
function withMinus(text) {
  return text.replaceAll("-", "−");
}

/** Writes a number for people, without a known error. @param {number|null|undefined} value @param {number} [digits] */
export function number(value, digits = 4) {
  if (value === null || value === undefined || !Number.isFinite(value)) return "–";
  if (value === 0) return "0";
  const size = Math.abs(value);
  return withMinus(size >= 1e6 || size < 1e-3 ? value.toExponential(Math.max(digits - 2, 1)) : String(Number(value.toPrecision(digits))));
}

/** Writes a number of a column: integers in full. @param {number} value */
export function cell(value) {
  return Number.isSafeInteger(value) ? withMinus(String(value)) : number(value);
}

/** The most decimals of a number with an error; as in `base/digits.rs`. */
const MOST_DECIMALS = 6;

/**
 * Writes a number to the decimal of the second digit of its estimated error; without one, with some digits.
 * @param {number|null|undefined} value @param {number|null|undefined} error @param {number} [digits]
 */
export function roundedBy(value, error, digits = 4) {
  if (value === null || value === undefined || !Number.isFinite(value)) return "–";
  if (error === null || error === undefined || !Number.isFinite(error)) return number(value, digits);
  const place = error === 0 ? -MOST_DECIMALS : Math.max(Number(error.toExponential(1).split("e")[1]) - 1, -MOST_DECIMALS);
  const text = place > 0 ? String(Math.round(value / 10 ** place) * 10 ** place) : value.toFixed(-place);
  return Number(text) === 0 ? text.replace("-", "") : withMinus(text);
}

/** Writes the ends of a range within which a value lies, each rounded by the width of the range. @param {[number, number]} ends @param {number} [error] a larger error of both */
export function rangeEnds([low, high], error = 0) {
  return [low, high].map((end) => roundedBy(end, Math.max(high - low, error)));
}

/** Writes the size of an estimated error with two digits. @param {number|null|undefined} error */
export function errorDigits(error) {
  const size = Math.abs(error ?? NaN);
  return size < 1e-6 ? "< 0.000001" : roundedBy(size, size);
}

/** Writes a number and its estimated error, as in `0.787 ± 0.022`. @param {number} value @param {number} error */
export function measured(value, error) {
  return `${roundedBy(value, error)} ± ${errorDigits(error)}`;
}

/** @param {number} bytes */
export function bytes(bytes) {
  for (const unit of ["B", "kB", "MB", "GB"]) {
    if (bytes < 1000 || unit === "GB") return `${Number(bytes.toPrecision(3))} ${unit}`;
    bytes /= 1000;
  }
  return "";
}

/** @param {number|null|undefined} value */
export function seconds(value) {
  if (value === null || value === undefined) return "–";
  if (value < 1) return `${number(1000 * value, 3)} ms`;
  if (value < 120) return `${number(value, 3)} s`;
  return value < 7200 ? `${number(value / 60, 3)} min` : `${number(value / 3600, 3)} h`;
}

/** @param {string} time RFC 3339 */
export function when(time) {
  return time.replace("T", " ").slice(0, 19);
}

/**
 * Replaces the URL of the shown view. A URL of another view stays: the user has just followed a link, and the view is about to change.
 * @param {string} url
 */
export function replaceUrl(url) {
  const view = (/** @type {string} */ hash) => hash.split("?")[0];
  if (location.hash !== url && view(location.hash) === view(url)) history.replaceState(null, "", url);
}

/** Sets the title of the window. @param {string} what */
export function titled(what) {
  document.title = what ? `${what} – deaflow` : "deaflow";
}

/** The working directory of the server. */
let folder = "";

/** @param {string|null} path */
export function startedIn(path) {
  folder = path ? `${path}/` : "";
}

/** A path relative to the working directory of the server. @param {string} path */
export function near(path) {
  return folder && path.startsWith(folder) ? path.slice(folder.length) : path;
}

/** @param {string} digest */
export function short(digest) {
  return h("a", { class: "mono", href: `#/artifacts/${digest}`, title: digest }, digest.slice(0, 12));
}

/** The `--set` values of a run on one line. @param {Record<string, any>} set */
export function changedValues(set) {
  return Object.entries(set).map(([path, value]) => `${near(path)}=${value}`).join(", ") || "the values of the file";
}

/** A text with places for line breaks after dots and equals signs, so that narrow screens do not break words. @param {string} text @returns {Child[]} */
function breakable(text) {
  return text.split(/(?<=[.=/])/).flatMap((part, at) => (at ? [h("wbr"), part] : [part]));
}

/** The `--set` values of a run. @param {Record<string, string>} set */
export function changes(set) {
  return h("span", {}, Object.entries(set).map(([path, value]) => h("div", { class: "mono" }, breakable(`${near(path)}=${value}`))));
}

/** A table with more columns scrolls on a narrow screen. */
const MANY = 4;

/**
 * A table that scrolls within its own box; a stacked one has its cells below each other on a narrow screen. The head of a column may be an element
 * in place of its title, and say how the column is sorted.
 * @param {string} what @param {(string|{title: string, number?: boolean, head?: Node, sort?: string|null})[]} columns @param {Child[][]} rows @param {boolean} [stacked]
 */
export function table(what, columns, rows, stacked = false) {
  const heads = columns.map((column) => (typeof column === "string" ? { title: column } : column));
  // Cells that are blocks need explicit roles for screen readers.
  const role = (/** @type {string} */ name) => (stacked ? name : null);
  const cell = (/** @type {Child} */ content, /** @type {number} */ at) => h("td", { class: /** @type {any} */ (heads[at])?.number ? "number" : null, role: role("cell"), "data-title": stacked ? heads[at]?.title : null }, content);
  const shape = stacked ? "stacked" : heads.length > MANY ? "wide" : null;
  return h(
    "div",
    { class: "scroll", tabindex: "0", role: "region", "aria-label": what },
    h(
      "table",
      { class: shape, role: role("table") },
      h("thead", { role: role("rowgroup") }, h("tr", { role: role("row") }, heads.map((head) => h("th", { scope: "col", role: role("columnheader"), class: /** @type {any} */ (head).number ? "number" : null, "aria-sort": /** @type {any} */ (head).sort ?? null }, /** @type {any} */ (head).head ?? head.title)))),
      h("tbody", { role: role("rowgroup") }, rows.map((row) => h("tr", { role: role("row") }, row.map(cell)))),
    ),
  );
}

/** A text whose parts between backticks are code. @param {string} text @returns {Child[]} */
export function prose(text) {
  const parts = text.split("`");
  // A single backtick was written by a user.
  return parts.length % 2 ? parts.map((part, at) => (at % 2 ? h("code", {}, part) : part)) : [text];
}

/** @param {any} error */
export function problem(error) {
  const place = error.line ? ` (${[error.file && near(error.file), `line ${error.line}`, `column ${error.column}`].filter(Boolean).join(", ")})` : "";
  return h("div", { class: "box", role: "alert" }, h("p", {}, h("b", {}, prose(`${error.message}${place}`))), error.help ? h("p", {}, prose(error.help)) : null);
}

/** Runs an action; its error is shown in an element, unless the request was aborted. @param {Element} place @param {() => any} act */
export async function attempt(place, act) {
  try {
    await act();
  } catch (error) {
    if (/** @type {any} */ (error).name !== "AbortError") replace(place, problem(error));
  }
}

/** The page of an artifact, as in reports, in a frame without scripts that is as high as the page. @param {string} digest @param {string} title */
export function pageOf(digest, title) {
  const frame = h("iframe", { sandbox: "allow-same-origin", title, src: `/api/artifacts/${digest}/page` });
  frame.addEventListener("load", () => {
    const height = frame.contentDocument?.documentElement.scrollHeight ?? 0;
    if (height) frame.style.height = `${height + 20}px`;
  });
  return frame;
}

/** A labelled control. @param {string} label @param {any} control @param {Child} [after] */
export function labelled(label, control, after) {
  return h("label", { class: "control" }, h("span", {}, label), control, after);
}

/** @param {string} name @param {[string, string][]} options value and text @param {string} chosen @param {(value: string) => void} changed */
export function choice(name, options, chosen, changed) {
  const each = options.map(([value, text]) => h("option", { value, selected: value === chosen }, text));
  return h("select", { name, onchange: (/** @type {any} */ event) => changed(event.target.value) }, each);
}

/** @param {string} text */
export function copyable(text) {
  return h("div", { class: "copyable" }, h("pre", { tabindex: "0" }, text), copying("Copy", () => text));
}

/** A button that copies a text. @param {string} label @param {() => string} text @param {Record<string, any>} [more] */
export function copying(label, text, more = {}) {
  const button = h("button", { type: "button", ...more, onclick: async () => {
    try {
      await navigator.clipboard.writeText(text());
      button.textContent = "Copied";
    } catch {
      button.textContent = "Copying is not possible in this browser";
    }
    setTimeout(() => (button.textContent = label), 2000);
  } }, label);
  return button;
}

/** A field for a number. The type `number` would hide invalid texts. @param {string} value @param {string} label @param {Record<string, any>} more */
export function numeric(value, label, more) {
  return h("input", { type: "text", inputmode: "decimal", autocomplete: "off", value, "aria-label": label, ...more });
}

/** Shows what is wrong beside a field; nothing if it is valid. @param {any} input @param {HTMLElement} place @param {string} wrong */
export function showInvalid(input, place, wrong) {
  place.textContent = wrong;
  if (wrong) input.setAttribute("aria-invalid", "true");
  else input.removeAttribute("aria-invalid");
}

/** Delays a function until there was no call for a while. @param {() => void} act @param {number} milliseconds */
export function settled(act, milliseconds) {
  let timer = 0;
  return () => {
    clearTimeout(timer);
    timer = setTimeout(act, milliseconds);
  };
}
