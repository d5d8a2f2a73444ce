// The gallery of the sketchpad: patterns for every scene, and devices with scenes of their own.

import { h } from "./elements.js";
import { drawPattern } from "./membrane.js";
import { Pattern } from "./pattern.js";

/**
 * Patterns: the group of a place, whose coordinates are counted from the middle of the membrane in halves of its shorter side.
 * @type {Record<string, (x: number, y: number) => number>}
 */
const SHAPES = {
  half: (x) => Number(x < 0),
  disc: (x, y) => Number(Math.hypot(x + 0.35, y) < 0.45),
  ring: (x, y) => Number(Math.abs(Math.hypot(x, y) - 0.55) < 0.2),
  bars: (x, y) => Number(Math.abs(y) < 0.8 && Math.abs((((x + 4) * 2.5) % 1) - 0.5) < 0.25),
  cross: (x, y) => Number(Math.min(Math.abs(x), Math.abs(y)) < 0.2 && Math.max(Math.abs(x), Math.abs(y)) < 0.85),
  pinwheel: (x, y) => Number(Math.hypot(x, y) < 0.85 && Math.sin(4 * (Math.atan2(y, x) + 1.2 * Math.hypot(x, y))) > 0.2),
  lens: (x, y) => Number(Math.hypot(x, y) > 0.4 && Math.hypot(x, y) < 0.8),
  "push-pull": (x) => (x < 0 ? 1 : 2),
};

/** What the gallery shows: name, words, and the scene of a device. @type {[string, string, string?][]} */
const GALLERY = [
  ["half", "One half: pulls the middle"],
  ["disc", "Disc beside the middle"],
  ["ring", "Ring: squeezes the middle"],
  ["bars", "Bars"],
  ["cross", "Cross"],
  ["pinwheel", "Pinwheel: turns the middle"],
  ["lens", "Lens: a ring in a round frame", "lens (example)"],
  ["push-pull", "Stage that is pushed and pulled", "push-pull (example)"],
];

/** The number of the group with the largest voltage in a state: electrodes of a group without voltage do not move. @param {any} scene @param {string|null} state */
function drivenGroup(scene, state) {
  const voltages = scene.voltages[Math.max(scene.states.indexOf(state), 0)] ?? [];
  return Math.max(voltages.indexOf(Math.max(...voltages)), 0) + 1;
}

/**
 * Draws a pattern on the cells of a scene; those with one group have the driven one.
 * @param {string} name @param {any} scene @param {string|null} state
 */
export function patternOf(name, scene, state) {
  const { columns, rows, size_mm: [width, height], parts, groups } = scene;
  const driven = drivenGroup(scene, state);
  const half = Math.min(width, height) / 2;
  const cells = Uint8Array.from({ length: columns * rows }, (_, at) => {
    if (parts?.[at]) return 0;
    const x = (((at % columns) + 0.5) * width) / columns - width / 2;
    const y = ((Math.floor(at / columns) + 0.5) * height) / rows - height / 2;
    const group = SHAPES[name](x / half, y / half);
    return name === "push-pull" && groups > 1 ? group : group && driven;
  });
  return new Pattern(columns, rows, cells);
}

/** The pattern that an empty sketchpad begins with. @param {any} scene */
export function firstPattern(scene) {
  const first = scene.states[0] ?? null;
  return patternOf(scene.groups > 1 && drivenGroup(scene, first) <= 2 ? "push-pull" : "half", scene, first);
}

/** @param {any} pad */
export function gallery(pad) {
  const card = (/** @type {[string, string, string?]} */ [name, words, device]) => {
    const scene = device ? pad.examples.find((/** @type {any} */ one) => one.name === device) : pad.scene;
    const drawn = () => patternOf(name, scene, scene === pad.scene ? pad.state : (scene.states[0] ?? null));
    const pattern = drawn();
    const canvas = h("canvas", { "aria-hidden": "true" });
    // The canvas has its width once it is on the page.
    requestAnimationFrame(() => drawPattern(canvas, pattern, { ratio: scene.size_mm[1] / scene.size_mm[0], parts: scene.parts, borders: scene.borders }));
    const open = () => (scene === pad.scene ? pad.pen.become(drawn()) : pad.reopen({ scene: scene.name, pattern: pattern.asRows() }));
    return h("button", { type: "button", class: "card", "data-gallery": name, onclick: open }, canvas, words);
  };
  const back = pad.scenes.includes(pad.scene) ? null : h("button", { type: "button", id: "own-scene", onclick: () => pad.reopen({ scene: pad.scenes[0].name }) }, `Back to the scene ${pad.scenes[0].name}`);
  return h("section", { class: "panel wide" }, h("h2", {}, "Gallery"), back ? h("div", { class: "tools" }, back) : null, h("div", { class: "cards gallery" }, GALLERY.map(card)));
}
