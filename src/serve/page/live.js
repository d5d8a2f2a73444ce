// The status of the store, sent by the server when it changes: runs of this page, of other processes, and workers.

import { lines } from "./server.js";

/** Pause in ms before the server is asked again after an error: doubled each time, up to a limit. */
const PAUSE = 1000;
const LONGEST = 30000;

/** The last status. @type {any} */
let last = null;

/** The last status, as from `/api/status`; null before the first one. @returns {any} */
export function standing() {
  return last;
}

/**
 * Listens as long as the page is open and visible: a browser has few connections.
 * @param {(found: any) => void} received @param {(message: string) => void} failed
 */
export async function listen(received, failed) {
  let pause = PAUSE;
  for (;;) {
    if (document.hidden) await new Promise((resolve) => document.addEventListener("visibilitychange", resolve, { once: true }));
    const controller = new AbortController();
    const hide = () => document.hidden && controller.abort();
    document.addEventListener("visibilitychange", hide);
    try {
      await lines("events", { signal: controller.signal }, (found) => {
        if (found.error) throw new Error(found.error.message);
        pause = PAUSE;
        const before = last;
        last = found;
        received(found);
        window.dispatchEvent(new CustomEvent("standing"));
        if (before && key(before) !== key(found)) window.dispatchEvent(new CustomEvent("news"));
      });
    } catch (error) {
      if (!controller.signal.aborted) failed(/** @type {any} */ (error).message);
    } finally {
      document.removeEventListener("visibilitychange", hide);
    }
    await new Promise((resolve) => setTimeout(resolve, pause));
    pause = Math.min(2 * pause, LONGEST);
  }
}

/** What views of runs and plans depend on. @param {any} found */
function key(found) {
  return `${found.last_run?.id ?? ""} ${found.in_flight ?? 0} ${found.objects ?? 0} ${JSON.stringify((found.runs ?? []).map((/** @type {any} */ run) => [run.pid, run.stages]))}`;
}

/** Whether two sets of changed values are equal. @param {Record<string, string>} one @param {Record<string, string>} other */
function equal(one, other) {
  const names = Object.keys(one);
  return names.length === Object.keys(other).length && names.every((name) => one[name].trim() === other[name]?.trim());
}

/**
 * Running runs of a pipeline with other values than the shown ones.
 * @param {string} pipeline its name @param {Record<string, string>} set @returns {any[]}
 */
export function others(pipeline, set) {
  return (last?.runs ?? []).filter((/** @type {any} */ run) => run.pipeline === pipeline && run.set && !equal(run.set, set));
}

/**
 * The progress of the stages of a pipeline that are being built with these values, by their names.
 * @param {string} pipeline its name @param {string} path its file @param {Record<string, string>} set
 * @returns {Record<string, {text: string, share: number|null, since: string|null}>}
 */
export function underWay(pipeline, path, set) {
  const elsewhere = new Set(others(pipeline, set).map((run) => run.pid));
  /** @type {Record<string, {text: string, share: number|null, since: string|null}>} */
  const found = {};
  for (const run of last?.runs ?? []) {
    if (run.pipeline !== pipeline || elsewhere.has(run.pid)) continue;
    for (const stage of run.stages) found[stage.name] = { text: stage.told.replace(/ \(.*/, ""), share: null, since: stage.since };
  }
  // For a run that this page started, the number of steps is known.
  if (last?.begun?.pipeline === path && !elsewhere.has(last.begun.pid)) {
    for (const stage of last.begun.stages) {
      const done = `${Math.floor(stage.done)} of ${stage.steps} ${stage.unit}`;
      found[stage.name] = { text: stage.note ? `${done}, ${stage.note}` : done, share: stage.steps ? stage.done / stage.steps : null, since: found[stage.name]?.since ?? null };
    }
  }
  return found;
}
