// Drawings in the storage of the browser: those of a tab with undo steps, and the last one of all tabs, with which a new tab starts.

import { History, Pattern } from "./pattern.js";

/** Undo steps that are stored, and cells of all of them. */
const STEPS = 50;
const CELLS = 500000;

/** @param {Storage} storage @param {string} key */
function read(storage, key) {
  try {
    return JSON.parse(storage.getItem(key) ?? "null");
  } catch {
    return null;
  }
}

/** The pattern that another view has sent, which is opened once. @returns {Pattern|null} */
function sent() {
  const found = read(sessionStorage, "deaflow drawn");
  try {
    sessionStorage.removeItem("deaflow drawn");
  } catch {
    // The browser has no storage, so nothing was sent.
  }
  return found ? Pattern.of(found) : null;
}

/** The first drawing: the sent pattern, or that of this tab, or the last one of all tabs. @param {any} scene @returns {Pattern|null} */
export function kept(scene) {
  const before = sent();
  if (before) return before;
  const rows = read(sessionStorage, `deaflow ${scene.name}`) ?? read(localStorage, `deaflow ${scene.name}`);
  try {
    return rows ? Pattern.of(rows) : null;
  } catch {
    return null;
  }
}

/** The undo steps of this tab. @param {any} scene @returns {History} */
export function keptHistory(scene) {
  const history = new History();
  const found = read(sessionStorage, `deaflow steps ${scene.name}`);
  const pattern = (/** @type {string} */ cells) => new Pattern(scene.columns, scene.rows, Uint8Array.from(cells, Number));
  const fits = (/** @type {any} */ cells) => typeof cells === "string" && cells.length === scene.columns * scene.rows;
  if (Array.isArray(found?.past) && found.past.every(fits)) history.past = found.past.map(pattern);
  if (Array.isArray(found?.future) && found.future.every(fits)) history.future = found.future.map(pattern);
  return history;
}

/** @param {any} scene @param {Pattern} pattern @param {History} history */
export function keep(scene, pattern, history) {
  const most = Math.min(STEPS, Math.floor(CELLS / pattern.cells.length));
  const cells = (/** @type {Pattern} */ one) => one.cells.join("");
  const steps = { past: most ? history.past.slice(-most).map(cells) : [], future: most ? history.future.slice(-most).map(cells) : [] };
  try {
    const rows = JSON.stringify(pattern.asRows());
    sessionStorage.setItem(`deaflow ${scene.name}`, rows);
    localStorage.setItem(`deaflow ${scene.name}`, rows);
    sessionStorage.setItem(`deaflow steps ${scene.name}`, JSON.stringify(steps));
  } catch {
    // Drawing works without storage as well.
  }
}
