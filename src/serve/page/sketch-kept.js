// Drawings that are kept: those of a tab with what can be taken back, and the last of all tabs, with which a new tab begins.

import { History, Pattern } from "./pattern.js";

/** Steps that can be taken back after the page is read again, and cells of all of them. */
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

/** What another view has sent here, which is opened once. @returns {Pattern|null} */
function sent() {
  const found = read(sessionStorage, "deaflow drawn");
  try {
    sessionStorage.removeItem("deaflow drawn");
  } catch {
    // A browser that keeps nothing has sent nothing.
  }
  return found ? Pattern.of(found) : null;
}

/** The drawing that goes on: what was sent here, else that of this tab, else the last of any tab. @param {any} scene @returns {Pattern|null} */
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

/** What can be taken back in this tab. @param {any} scene @returns {History} */
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
    // A browser that keeps nothing draws as well.
  }
}
