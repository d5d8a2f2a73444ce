// What goes on in the store, told by the server as it happens: runs of this page, of other processes, and of workers.

import { lines } from "./server.js";

/** Before the server is asked again that has not answered, ms. */
const PAUSE = 1000;

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
  for (;;) {
    if (document.hidden) await new Promise((resolve) => document.addEventListener("visibilitychange", resolve, { once: true }));
    const controller = new AbortController();
    const hide = () => document.hidden && controller.abort();
    document.addEventListener("visibilitychange", hide);
    try {
      await lines("events", { signal: controller.signal }, (found) => {
        if (found.error) throw new Error(found.error.message);
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
    await new Promise((resolve) => setTimeout(resolve, PAUSE));
  }
}

/** What makes a difference to views of runs and plans. @param {any} found */
function key(found) {
  return `${found.last_run?.id ?? ""} ${found.in_flight ?? 0} ${found.objects ?? 0} ${JSON.stringify((found.runs ?? []).map((/** @type {any} */ run) => [run.pid, run.stages]))}`;
}

/**
 * How far the stages of a pipeline have come that are being built, by their names.
 * @param {string} pipeline its name @param {string} path its file
 * @returns {Record<string, {text: string, share: number|null, since: string|null}>}
 */
export function underWay(pipeline, path) {
  /** @type {Record<string, {text: string, share: number|null, since: string|null}>} */
  const found = {};
  for (const run of last?.runs ?? []) {
    if (run.pipeline !== pipeline) continue;
    for (const stage of run.stages) found[stage.name] = { text: stage.told.replace(/ \(.*/, ""), share: null, since: stage.since };
  }
  // Of a run that was begun here every step is known.
  if (last?.begun?.pipeline === path) {
    for (const stage of last.begun.stages) {
      const done = `${Math.floor(stage.done)} of ${stage.steps} ${stage.unit}`;
      found[stage.name] = { text: stage.note ? `${done}, ${stage.note}` : done, share: stage.steps ? stage.done / stage.steps : null, since: found[stage.name]?.since ?? null };
    }
  }
  return found;
}
