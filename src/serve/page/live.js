// What goes on in the store, told by the server as it happens: runs of this page, of other processes, and of workers.

import { lines } from "./server.js";

/** Before the server is asked again that has not answered, ms: each time twice as long, up to a limit. */
const PAUSE = 1000;
const LONGEST = 30000;

/** What was told last. @type {any} */
let last = null;

/** What goes on, as `/api/status` has it; null before anything was told. @returns {any} */
export function standing() {
  return last;
}

/**
 * Listens as long as the page is open and shown: a browser has few connections, and one that nobody looks at takes none.
 * @param {(found: any) => void} told @param {(message: string) => void} failed
 */
export async function listen(told, failed) {
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
        told(found);
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

/** What makes a difference to views of runs and plans. @param {any} found */
function key(found) {
  return `${found.last_run?.id ?? ""} ${found.in_flight ?? 0} ${found.objects ?? 0} ${JSON.stringify((found.runs ?? []).map((/** @type {any} */ run) => [run.pid, run.stages]))}`;
}

/** Whether two sets of changed values are the same. @param {Record<string, string>} one @param {Record<string, string>} other */
function alike(one, other) {
  const names = Object.keys(one);
  return names.length === Object.keys(other).length && names.every((name) => one[name].trim() === other[name]?.trim());
}

/**
 * Runs of a pipeline that go on with other values than those that are looked at.
 * @param {string} pipeline its name @param {Record<string, string>} set @returns {any[]}
 */
export function others(pipeline, set) {
  return (last?.runs ?? []).filter((/** @type {any} */ run) => run.pipeline === pipeline && run.set && !alike(run.set, set));
}

/**
 * How far the stages of a pipeline have come that are being built with these values, by their names.
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
  // Of a run that was begun here every step is known.
  if (last?.begun?.pipeline === path && !elsewhere.has(last.begun.pid)) {
    for (const stage of last.begun.stages) {
      const done = `${Math.floor(stage.done)} of ${stage.steps} ${stage.unit}`;
      found[stage.name] = { text: stage.note ? `${done}, ${stage.note}` : done, share: stage.steps ? stage.done / stage.steps : null, since: found[stage.name]?.since ?? null };
    }
  }
  return found;
}
