// The rows of an artifact: a table that the server filters, sorts and pages, a histogram, and pictures of patterns and fields.

import { frame, json } from "./server.js";
import { attempt, cell, choice, h, labelled, number, problem, replace, replaceUrl, settled, short } from "./elements.js";
import { charts } from "./chart.js";
import { drawBar, drawMembrane, drawPattern, magnitudes } from "./membrane.js";
import { card, drawField, drawn, patternsAt, rowLink, size, withEdges } from "./pictures.js";
import { lineage } from "./origin.js";
import { Pattern } from "./pattern.js";
import { valueOf, within, withOnly } from "./filter.js";
import { saveRows } from "./files.js";

const PAGE = 24;

/** Longer texts are clipped in the table; the row itself has all of them. */
const LONG = 24;

/** Marked rows by the digests of their artifacts; they are kept when the view changes. @type {Map<string, Set<number>>} */
const MARKED = new Map();

/** Text columns with a menu of their values, and the largest number of values. */
const CHOSEN = /(^|\/)(family|split|outcome|role|name|case|set|why|status)$/;
const MANY = 40;

/** Whether a value is a digest, which is abbreviated. @param {any} value */
function isDigest(value) {
  return typeof value === "string" && /^[0-9a-f]{32,}$/.test(value);
}

/** Similar patterns that are shown. */
const NEAR = 6;

/** @param {HTMLElement} place @param {any} found @param {URLSearchParams} query */
export async function rowsView(place, found, query) {
  const axes = [...new Set(found.datasets.map((/** @type {any} */ one) => one.axes[0]).filter(Boolean))];
  const state = { along: query.get("along") ?? "", filter: query.get("filter") ?? "", sort: query.get("sort") ?? "", offset: Number(query.get("offset") ?? 0) || 0, histogram: query.get("histogram") ?? "" };
  let chosen = query.get("row") === null ? null : Number(query.get("row"));
  const model = query.get("model") ?? "";
  const marked = MARKED.get(found.digest) ?? new Set();
  MARKED.set(found.digest, marked);
  const filter = h("input", { type: "search", value: state.filter, placeholder: "max_displacement_mm > 1 and family = bezier", "aria-label": "Filter", name: "filter" });
  const errorBox = h("div", {});
  const unknown = h("div", { id: "unknown" });
  const matched = h("p", { class: "soft", id: "matched", "aria-live": "polite" });
  const histogram = h("div", {});
  const cards = h("div", { class: "cards" });
  const tableBox = h("div", {});
  const pages = h("div", { class: "tools" });
  const one = h("div", { id: "sample" });
  const counted = h("span", {}, marked.size ? `${marked.size} marked` : "");
  let turn = 0;
  const old = (/** @type {boolean} */ is) => [matched, histogram, cards, tableBox, pages].forEach((element) => element.classList.toggle("old", is));

  /** @param {boolean} first whether the URL already has this state, so that no step back is added */
  const fill = async (first = false) => {
    turn += 1;
    const own = turn;
    const words = new URLSearchParams({ limit: String(PAGE), offset: String(state.offset) });
    for (const name of /** @type {const} */ (["along", "filter", "sort", "histogram"])) if (state[name]) words.set(name, state[name]);
    const link = new URLSearchParams(words);
    link.delete("limit");
    link.set("tab", "rows");
    if (chosen !== null) link.set("row", String(chosen));
    if (model) link.set("model", model);
    const url = `#/artifacts/${found.digest}?${link}`;
    if (first) replaceUrl(url);
    else if (location.hash !== url) history.pushState(null, "", url);
    try {
      const began = performance.now();
      const answer = await json(`artifacts/${found.digest}/rows?${words}`);
      if (own !== turn) return;
      replace(errorBox);
      for (const select of quick.querySelectorAll("select")) select.value = valueOf(filter.value, select.name.replace("only-", ""));
      old(false);
      replace(unknown, answer.unknown.map((/** @type {any} */ one) => h("p", { class: "box", role: "alert" }, `No row has ${one.column} “${one.value}”; values: ${one.known.join(", ")}.`)));
      matched.textContent = `${answer.matched} of ${answer.total} rows`;
      matched.dataset.matched = String(answer.matched);
      matched.title = `${number(performance.now() - began, 3)} ms`;
      state.along = answer.axis;
      show(answer);
      void offer(answer).catch(() => {});
      await pictures(answer);
    } catch (error) {
      if (own !== turn) return;
      // The rows below are those of the filter before.
      matched.textContent = state.filter ? "invalid filter" : "no rows";
      delete matched.dataset.matched;
      replace(unknown);
      old(true);
      replace(errorBox, problem(error));
    }
  };
  const soon = settled(() => {
    state.filter = filter.value;
    state.offset = 0;
    void fill();
  }, 200);
  filter.addEventListener("input", soon);

  /** Filters a range of a column. @param {string} name @param {number} low @param {number} high */
  const between = (name, low, high) => {
    filter.value = within(filter.value, name, low, high);
    soon();
  };
  /** Filters a value of a column. @param {string} name @param {string} value */
  const only = (name, value) => {
    filter.value = withOnly(filter.value, name, value);
    soon();
  };
  const quick = h("div", { class: "tools" });
  /** Adds menus of the values of text columns; the values are counted once. @param {any} answer */
  const offer = async (answer) => {
    if (quick.dataset.axis === answer.axis) return;
    quick.dataset.axis = answer.axis;
    const texts = answer.columns.filter((/** @type {any} */ column) => column.is_text && CHOSEN.test(column.name));
    const made = [];
    for (const column of texts) {
      const words = new URLSearchParams({ limit: "0", along: answer.axis, histogram: column.name });
      const counted = (await json(`artifacts/${found.digest}/rows?${words}`)).histogram?.texts ?? [];
      if (counted.length < 2 || counted.length > MANY) continue;
      const options = [["", "all"], ...counted.map((/** @type {[string, number]} */ [text, count]) => [text, `${text} (${count})`])];
      made.push(labelled(column.name, choice(`only-${column.name}`, /** @type {any} */ (options), valueOf(filter.value, column.name), (value) => only(column.name, value))));
    }
    const worst = answer.columns.find((/** @type {any} */ column) => /max_error|(^|\/)error/.test(column.name));
    if (worst) made.push(h("button", { type: "button", name: "worst", onclick: () => {
      Object.assign(state, { sort: `-${worst.name}`, offset: 0 });
      void fill();
    } }, "Largest error first"));
    replace(quick, made);
  };

  /** @param {any} answer */
  const show = (answer) => {
    const sorted = state.sort.replace(/^-/, "");
    const head = (/** @type {any} */ column) => h(
      "th",
      { scope: "col", class: column.is_text ? null : "number", title: column.description, "aria-sort": sorted === column.name ? (state.sort.startsWith("-") ? "descending" : "ascending") : null },
      h("button", { type: "button", onclick: () => {
          state.sort = state.sort === column.name ? `-${column.name}` : state.sort === `-${column.name}` ? "" : column.name;
          state.offset = 0;
          void fill();
        } }, column.name, sorted === column.name ? (state.sort.startsWith("-") ? " ↓" : " ↑") : ""),
    );
    const row = (/** @type {any[]} */ values, /** @type {number} */ at) => {
      const id = answer.numbers[at];
      const mark = h("input", { type: "checkbox", checked: marked.has(id), "aria-label": `Mark row ${id}`, onchange: () => {
        if (mark.checked) marked.add(id);
        else marked.delete(id);
        counted.textContent = `${marked.size} marked`;
      } });
      return h("tr", { "aria-selected": String(id === chosen) }, h("td", {}, mark), h("td", {}, h("button", { type: "button", onclick: () => choose(id) }, String(id))), values.map((value, k) => h("td", { class: answer.columns[k].is_text ? "cut" : "number", title: isDigest(value) || typeof value === "number" ? String(value) : null }, typeof value === "number" ? cell(value) : isDigest(value) ? `${value.slice(0, 12)}…` : typeof value === "string" && value.length > LONG ? h("div", { class: "clipped", title: value }, value) : value ?? "–")));
    };
    replace(tableBox, h("div", { class: "scroll", tabindex: "0", role: "region", "aria-label": "Rows" }, h("table", {}, h("thead", {}, h("tr", {}, h("th", {}, ""), h("th", { scope: "col" }, "row"), answer.columns.map(head))), h("tbody", {}, answer.rows.map(row)))));
    const last = Math.min(state.offset + answer.rows.length, answer.matched);
    const page = (/** @type {string} */ text, /** @type {number} */ offset, /** @type {boolean} */ off) => h("button", { type: "button", disabled: off, onclick: () => {
      state.offset = offset;
      void fill();
    } }, text);
    replace(pages, page("Previous", Math.max(0, state.offset - PAGE), state.offset === 0), h("span", {}, answer.matched ? `${state.offset + 1} to ${last} of ${answer.matched}` : "none"), page("Next", state.offset + PAGE, last >= answer.matched));
    const columns = [["", "no histogram"], ...answer.columns.map((/** @type {any} */ column) => [column.name, column.name])];
    const counts = answer.histogram;
    replace(
      histogram,
      labelled("Histogram of", choice("histogram", /** @type {any} */ (columns), state.histogram, (name) => {
        state.histogram = name;
        void fill();
      })),
      counts?.texts ? h("div", { class: "tools" }, counts.texts.map((/** @type {[string, number]} */ [text, count]) => h("button", { type: "button", onclick: () => only(state.histogram, text) }, `${text}: ${count}`))) : null,
      counts?.counts ? charts.bars(counts, state.histogram, (low, high) => between(state.histogram, low, high)) : null,
    );
  };

  /** @param {any} answer */
  const pictures = async (answer) => {
    const { patterns } = drawn(found, answer.axis);
    if (!patterns || !answer.numbers.length) {
      replace(cards);
      replace(one);
      return;
    }
    const { arrays } = await frame(`artifacts/${found.digest}/arrays?paths=${encodeURIComponent(patterns.path)}&rows=${answer.numbers.join(",")}`);
    const { shape, data } = arrays[patterns.path];
    const cells = shape[1] * shape[2];
    const label = answer.columns.findIndex((/** @type {any} */ column) => /max_displacement|value_mm|error/.test(column.name));
    const card = (/** @type {number} */ id, /** @type {number} */ at) => {
      const canvas = h("canvas", { "aria-hidden": "true" });
      const text = label < 0 ? "" : ` ${number(answer.rows[at][label], 4)}`;
      const button = h("button", { type: "button", class: "card", "aria-pressed": String(id === chosen), onclick: () => choose(id) }, canvas, `row ${id}${text}`);
      return { button, canvas, pattern: new Pattern(shape[2], shape[1], Uint8Array.from(data.slice(at * cells, (at + 1) * cells))) };
    };
    const made = answer.numbers.map(card);
    await withEdges(found, answer.numbers, made.map((/** @type {any} */ one) => one.pattern));
    replace(cards, made.map((/** @type {any} */ one) => one.button));
    made.forEach((/** @type {any} */ one) => drawPattern(one.canvas, one.pattern));
    if (chosen !== null) await sample(chosen, answer);
  };

  /** @param {number} id */
  const choose = (id) => {
    chosen = id;
    void fill();
  };

  /** Shows a row with its field, its images, and its origin. @param {number} id @param {any} answer */
  const sample = async (id, answer) => {
    const { patterns, field } = drawn(found, answer.axis);
    const paths = [patterns, field].filter(Boolean).map((/** @type {any} */ array) => array.path);
    const { arrays } = await frame(`artifacts/${found.digest}/arrays?paths=${encodeURIComponent(paths.join(","))}&rows=${id}`);
    const { shape, data } = arrays[patterns.path];
    const [pattern] = await withEdges(found, [id], [new Pattern(shape[2], shape[1], Uint8Array.from(data))]);
    // The row of a link may be on another page.
    const at = answer.numbers.indexOf(id);
    const row = at < 0 ? (await json(`artifacts/${found.digest}/rows?limit=1&offset=${id}&along=${encodeURIComponent(answer.axis)}`)).rows[0] ?? [] : answer.rows[at];
    const values = row.length ? answer.columns.map((/** @type {any} */ column, /** @type {number} */ k) => [column.name, row[k]]) : [];
    const left = h("canvas", { role: "img", "aria-label": "Pattern" });
    const right = h("canvas", { role: "img", "aria-label": "Field" });
    const images = Array.from({ length: pattern.columns === pattern.rows ? 8 : 4 }, () => h("canvas", { "aria-hidden": "true" }));
    const displacement = field ? /** @type {Float32Array} */ (arrays[field.path].data) : null;
    const value = (/** @type {string} */ name) => values.find((/** @type {[string, any]} */ [own]) => own === name)?.[1];
    // Filters for similar rows.
    const alike = ["orbit", "family", "split", "set"].flatMap((name) => {
      const own = value(name);
      return own ? [h("button", { type: "button", "data-alike": name, onclick: () => only(name, own) }, `Same ${name}`)] : [];
    });
    const predicted = h("div", {});
    const from = h("div", {}, h("p", { class: "soft" }, "Searching …"));
    const near = h("div", {}, h("p", { class: "soft" }, "Searching …"));
    replace(
      one,
      h("h2", {}, `Row ${id}`),
      h("div", { class: "pair pictures" }, left, displacement ? h("figure", {}, right, h("figcaption", { class: "small soft" }, `Displacement: largest ${number(largest(displacement), 4)} mm, from dark to bright`)) : null, h("dl", { class: "results" }, values.map((/** @type {[string, any]} */ [name, value]) => [h("dt", {}, name), typeof value === "number" ? h("dd", { title: String(value) }, cell(value)) : h("dd", {}, value ?? "–")]))),
      h("div", { class: "tools" }, alike),
      predicted,
      h("h3", {}, "Origin"),
      from,
      h("h3", {}, "Most similar patterns"),
      near,
      h("h3", {}, "Images under the symmetries"),
      h("div", { class: "eight" }, images),
      h("div", { class: "tools" }, h("button", { type: "button", onclick: () => {
        try {
          sessionStorage.setItem("deaflow drawn", JSON.stringify(pattern.asRows()));
        } catch {
          return;
        }
        location.hash = "#/sketch";
      } }, "Open in the sketchpad")),
    );
    drawPattern(left, pattern, { grid: true });
    if (displacement) {
      drawField(right, found, pattern, displacement);
    }
    images.forEach((canvas, k) => drawPattern(canvas, image(pattern, k)));
    if (model) void attempt(predicted, () => prediction(predicted, found, id, model));
    void attempt(from, () => lineage(from, found, Object.fromEntries(values)));
    void neighbours(near, found, id);
  };

  replace(
    place,
    h(
      "div",
      { class: "controls" },
      axes.length > 1 ? labelled("Rows along", choice("along", /** @type {any} */ ([["", "main axis"], ...axes.map((name) => [name, name])]), state.along, (axis) => {
        Object.assign(state, { along: axis, sort: "", offset: 0, histogram: "" });
        // Rows along another axis have other numbers.
        marked.clear();
        counted.textContent = "";
        chosen = null;
        void fill();
      })) : null,
      labelled("Filter", filter),
      matched,
    ),
    quick,
    errorBox,
    unknown,
    histogram,
    one,
    cards,
    pages,
    tableBox,
    h("div", { class: "tools" }, h("button", { type: "button", onclick: () => saveRows(marked, found.digest, "rows") }, "Save the list of marked rows"), counted),
  );
  await fill(true);
}

/** The largest magnitude of a field over the cell corners. @param {Float32Array} field */
function largest(field) {
  let most = 0;
  for (let at = 0; at < field.length; at += 2) most = Math.max(most, Math.hypot(field[at], field[at + 1]));
  return most;
}

/** Shows the prediction of a model for a row, its label, and the error. @param {HTMLElement} place @param {any} found @param {number} row @param {string} model */
async function prediction(place, found, row, model) {
  replace(place, h("p", { class: "soft" }, "Predicting …"));
  const { document: score, arrays } = await frame(`artifacts/${model}/prediction?row=${row}&of=${found.digest}`);
  const { shape, data } = arrays.pattern;
  const pattern = new Pattern(shape[1], shape[0], Uint8Array.from(data));
  const [label, predicted] = [arrays.label, arrays.predicted].map((array) => /** @type {Float32Array} */ (array.data));
  const difference = label.map((value, at) => predicted[at] - value);
  const [most, wrong] = [[label, predicted], [difference]].map((fields) => Math.max(...fields.flatMap((field) => Array.from(magnitudes(field, pattern.columns, pattern.rows)))));
  /** @type {[string, Float32Array, number, number][]} */
  const views = [["Label", label, 2, most], ["Prediction", predicted, 2, most], ["Error", difference, 1, wrong]];
  const made = views.map(([name]) => ({ canvas: h("canvas", { role: "img", "aria-label": name }), bar: h("canvas", { class: "bar", "aria-hidden": "true" }), note: h("figcaption", { class: "small soft" }) }));
  replace(
    place,
    h("h3", {}, "Prediction of ", short(model)),
    h("p", { "data-error": String(score.max_error_mm) }, `${score.network}: largest error of a component ${number(score.max_error_mm, 4)} mm, RMS ${number(score.rms_mm, 4)} mm`),
    h("p", { class: "soft small" }, "Errors of models are those of a component, x or y; the drawings show the magnitude of the vector at the cell corners, which is up to 1.41 times as large."),
    h("div", { class: "pair pictures", id: "prediction" }, made.map(({ canvas, bar, note }) => h("figure", {}, canvas, bar, note))),
  );
  views.forEach(([name, field, scale, high], at) => {
    const values = magnitudes(field, pattern.columns, pattern.rows);
    // Label and prediction share a colour scale; the error has its own, on the undeformed membrane.
    drawMembrane(made[at].canvas, pattern, name === "Error" ? new Float32Array(field.length) : field, { size: size(found, pattern), scale, values, low: 0, high });
    drawBar(made[at].bar, false);
    made[at].note.textContent = `${name}: largest ${number(largest(field), 4)} mm; colours from 0 to ${number(high, 4)} mm${name === "Error" ? ", on a separate scale" : ""}`;
  });
}

/** Shows the rows with the most similar patterns. @param {HTMLElement} place @param {any} found @param {number} row */
export async function neighbours(place, found, row) {
  await attempt(place, async () => {
    const near = await json(`artifacts/${found.digest}/neighbours?row=${row}&limit=${NEAR}`);
    const rows = near.neighbours.map((/** @type {any} */ one) => one.row);
    const patterns = await patternsAt(found, rows);
    const words = (/** @type {any} */ one) => (one.distance === 0 ? "the same, or an image" : `${one.distance} cells differ (${number((100 * one.distance) / near.cells, 2)} %)`);
    const named = await Promise.all(rows.map((/** @type {number} */ one) => families(found.digest, one)));
    const cards = near.neighbours.map((/** @type {any} */ one, /** @type {number} */ at) => card(patterns[at], rowLink(found.digest, one.row), h("div", {}, `row ${one.row}${named[at] ? `, ${named[at]}` : ""}`), h("div", { class: "soft" }, words(one))));
    replace(place, rows.length ? h("div", { class: "cards", "data-neighbours": rows.join(" ") }, cards) : h("p", { class: "soft" }, "There is no other pattern."), near.searched < near.total ? h("p", { class: "soft small" }, `Only the first ${near.searched} of ${near.total} rows were searched.`) : null);
  });
}

/** The family and the part of a row, if the dataset has them. @param {string} digest @param {number} row */
async function families(digest, row) {
  const answer = await json(`artifacts/${digest}/rows?limit=1&offset=${row}`);
  const value = (/** @type {string} */ name) => answer.rows[0]?.[answer.columns.findIndex((/** @type {any} */ column) => column.name === name)];
  return ["family", "split"].map(value).filter(Boolean).join(", ");
}

/** The pattern rotated by quarters, or by halves if it is not a square, and mirrored. @param {Pattern} pattern @param {number} k */
function image(pattern, k) {
  const { columns, rows } = pattern;
  const turned = new Pattern(columns, rows);
  const square = columns === rows;
  pattern.cells.forEach((value, at) => {
    let [x, y] = [at % columns, Math.floor(at / columns)];
    for (let turn = 0; turn < (square ? k % 4 : k % 2); turn += 1) [x, y] = square ? [rows - 1 - y, x] : [columns - 1 - x, rows - 1 - y];
    if (k >= (square ? 4 : 2)) x = columns - 1 - x;
    turned.cells[y * columns + x] = value;
  });
  return turned;
}
