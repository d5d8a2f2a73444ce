// A sweep of the voltage that plays: from rest to the critical voltage, with the displacement over the voltage.

import { frame } from "./server.js";
import { attempt, h, number, replace, svg } from "./elements.js";
import { drawMembrane, magnitudes } from "./membrane.js";
import { kilovolts } from "./sketch-voltage.js";

/** Duration of the sweep, ms, and how long its end stays. */
const DURATION = 2000;
const STAYS = 900;

const [WIDTH, HEIGHT, LEFT, RIGHT, TOP, BOTTOM] = [380, 150, 40, 14, 22, 30];

/** Share of the frame that the curve takes along the voltage; the rest is beyond the limit. */
const UP_TO_LIMIT = 0.9;

export class Sweep {
  /** @param {any} pad */
  constructor(pad) {
    this.pad = pad;
    /** @type {{key: string, points: any[], displacement: Float32Array, pattern: any, critical: number|null, error: number, broken: number|null, isAssumed: boolean}|null} */ this.found = null;
    /** Whether membrane and numbers show the sweep. */ this.isPlaying = false;
    /** Whether the error of the drawing is known, whose numbers are shown at the end. */ this.isSettled = false;
    this.timer = 0;
    this.still = window.matchMedia("(prefers-reduced-motion: reduce)");
  }

  button() {
    this.play = h("button", { type: "button", id: "play", onclick: () => (this.isBusy() ? this.stop() : void this.start()) }, "▶ Play");
    return this.play;
  }

  panel() {
    this.box = h("div", { id: "sweep" });
    return this.box;
  }

  isBusy() {
    return this.isPlaying || Boolean(this.request);
  }

  /** Asks for the solutions of the drawing, unless they are known, and plays them. */
  async start() {
    this.stop();
    const { pad } = this;
    const key = pad.setupKey();
    if (this.found?.key !== key || this.found.critical === null) {
      const request = new AbortController();
      this.request = request;
      this.play.textContent = "■ Stop";
      await attempt(this.box, async () => {
        const pattern = pad.pattern.copy();
        const { document: found, arrays } = await frame("sketch/sweep", { body: { ...pad.body(true), fields: [] }, signal: request.signal });
        if (pad.ended || pad.setupKey() !== key) return;
        this.found = { key, points: found.points, displacement: /** @type {Float32Array} */ (arrays.displacement.data), pattern, critical: found.critical_voltage, error: found.critical_voltage_error ?? 0, broken: found.breakdown_voltage, isAssumed: found.breakdown_assumed };
      });
      if (this.request !== request) return;
      this.request = null;
      if (this.found?.key !== key || pad.ended) {
        this.play.textContent = "▶ Play";
        return;
      }
    }
    if (!this.found || this.found.points.length < 2) return;
    this.draw();
    // Somebody who wants nothing to move sees the curve.
    if (!this.still.matches) this.run();
    else this.play.textContent = "▶ Play";
  }

  stop() {
    this.request?.abort();
    this.request = null;
    cancelAnimationFrame(this.timer);
    if (this.play) this.play.textContent = "▶ Play";
    if (!this.isPlaying) return;
    this.isPlaying = false;
    this.pad.drive.show();
    this.pad.showNumbers();
    this.pad.numbers.results.dataset.settled = String(this.isSettled);
    this.pad.soon();
    this.mark();
  }

  run() {
    const found = /** @type {NonNullable<typeof this.found>} */ (this.found);
    this.isPlaying = true;
    // The numbers are those of the sweep.
    const { dataset } = this.pad.numbers.results;
    this.isSettled = dataset.settled === "true";
    dataset.settled = "false";
    this.play.textContent = "■ Stop";
    const { voltage: last, max_displacement: most } = found.points[found.points.length - 1];
    /** The range of the colours, which stays. */
    this.colours = `; colours 0 to ${number(most, 3)} mm`;
    this.pad.showBar(true);
    const began = performance.now();
    const step = () => {
      if (!this.isPlaying || this.pad.ended) return;
      const passed = performance.now() - began;
      if (passed > DURATION + STAYS) {
        this.stop();
        return;
      }
      this.showAt(last * Math.min(passed / DURATION, 1), passed >= DURATION);
      this.timer = requestAnimationFrame(step);
    };
    step();
  }

  /** The place of a voltage between two solutions: the index of the lower one, and the share of the upper one. @param {number} voltage @returns {[number, number]} */
  between(voltage) {
    const { points } = /** @type {NonNullable<typeof this.found>} */ (this.found);
    const above = points.findIndex((point) => point.voltage > voltage);
    const low = above < 0 ? points.length - 2 : Math.max(above - 1, 0);
    const [from, to] = [points[low].voltage, points[low + 1].voltage];
    return [low, Math.max(0, Math.min((voltage - from) / (to - from), 1))];
  }

  /** Shows the membrane at a voltage of the sweep. @param {number} voltage @param {boolean} isEnd */
  showAt(voltage, isEnd) {
    const { pad } = this;
    const { points, displacement, pattern, critical, isAssumed } = /** @type {NonNullable<typeof this.found>} */ (this.found);
    const [low, share] = this.between(voltage);
    const of = (/** @type {string} */ name) => (points[low][name] === null || points[low + 1][name] === null ? null : (1 - share) * points[low][name] + share * points[low + 1][name]);
    const each = displacement.length / points.length;
    const moved = new Float32Array(each);
    for (let at = 0, from = low * each; at < each; at += 1, from += 1) moved[at] = (1 - share) * displacement[from] + share * displacement[from + each];
    const { size_mm: size, parts, borders, sides } = pad.scene;
    const values = magnitudes(moved, pattern.columns, pattern.rows);
    drawMembrane(pad.membrane, pattern, moved, { size, scale: pad.scale, values, parts, borders, sides, low: 0, high: points[points.length - 1].max_displacement, point: pad.point, direction: pad.direction });
    if (pad.narrow.matches) pad.drawPad({ pattern, displacement: moved });
    pad.drive.show(Math.round(voltage));
    const state = { voltage, largest: /** @type {number} */ (of("max_displacement")), value: of("value"), breakdown: of("breakdown_ratio") };
    pad.numbers.play(state, isAssumed);
    pad.line.textContent = state.value === null ? `largest ${number(state.largest)} mm` : `value ${number(state.value)} mm, largest ${number(state.largest)} mm`;
    const end = critical === null ? `end of the sweep, ${kilovolts(voltage)}` : this.pullIn(voltage);
    const field = state.breakdown === null ? "" : state.breakdown < 1 ? `, field ${number(100 * state.breakdown, 3)} % of breakdown` : ", above the breakdown field";
    pad.legend.textContent = isEnd ? `${end}${field}${this.colours}` : `${kilovolts(voltage)}: displacement at most ${number(state.largest, 3)} mm${field}${this.colours}`;
    pad.legend.classList.toggle("error", (isEnd && critical !== null) || (state.breakdown ?? 0) >= 1);
    this.mark(voltage, isEnd && critical !== null);
  }

  /** Says where the membrane pulls in: at the limit beside the voltage, unless this mesh alone loses stability clearly before. @param {number} voltage */
  pullIn(voltage) {
    const { critical, error } = /** @type {NonNullable<typeof this.found>} */ (this.found);
    const isOwn = critical !== null && voltage < critical - error;
    return isOwn ? `pull-in on this mesh: no stable state above ${kilovolts(voltage)}` : "pull-in: no stable state above the limit";
  }

  /** @param {number} voltage @returns {[number, number]} */
  place(voltage) {
    const { points } = /** @type {NonNullable<typeof this.found>} */ (this.found);
    const [low, share] = this.between(voltage);
    const last = points[points.length - 1];
    const most = Math.max(...points.map((point) => point.max_displacement)) || 1;
    const value = (1 - share) * points[low].max_displacement + share * points[low + 1].max_displacement;
    const x = LEFT + ((WIDTH - LEFT - RIGHT) * UP_TO_LIMIT * Math.min(voltage, last.voltage)) / last.voltage;
    return [x, HEIGHT - BOTTOM - ((HEIGHT - BOTTOM - TOP) * value) / most];
  }

  /** Draws the curve. */
  draw() {
    const found = /** @type {NonNullable<typeof this.found>} */ (this.found);
    const { points, critical, broken, isAssumed } = found;
    const last = points[points.length - 1];
    const brokenAt = broken === null ? 0 : this.place(broken)[0];
    const line = points.map((point) => this.place(point.voltage).map((at) => at.toFixed(1)).join(",")).join(" ");
    const [end] = this.place(last.voltage);
    const floor = HEIGHT - BOTTOM;
    this.dot = svg("circle", { r: 5, class: "dot" });
    const label = `Largest displacement over the voltage: ${number(last.max_displacement, 3)} mm at ${kilovolts(last.voltage)}${critical === null ? "" : ", where the membrane pulls in"}${broken === null ? "" : `; the electric field reaches the breakdown field at ${kilovolts(broken)}`}`;
    replace(
      this.box,
      svg(
        "svg",
        { viewBox: `0 0 ${WIDTH} ${HEIGHT}`, class: "chart sweep", role: "img", "aria-label": label, "data-points": points.length, "data-last": last.voltage },
        critical === null ? null : svg("rect", { class: "beyond", x: end, y: TOP, width: WIDTH - RIGHT - end, height: floor - TOP }),
        svg("line", { x1: LEFT, x2: WIDTH - RIGHT, y1: floor, y2: floor, class: "axis" }),
        svg("line", { x1: LEFT, x2: LEFT, y1: TOP, y2: floor, class: "axis" }),
        svg("polyline", { points: line, class: "line" }),
        broken === null ? null : svg("line", { class: "broken", x1: brokenAt, x2: brokenAt, y1: TOP, y2: floor }),
        broken === null ? null : svg("text", { x: brokenAt - 4, y: TOP + 5, "text-anchor": "end", class: "broken" }, `breakdown field${isAssumed ? " (VHB 4910)" : ""}, ${kilovolts(broken)}`),
        svg("text", { x: 2, y: 12 }, "largest displacement, mm"),
        svg("text", { x: LEFT - 5, y: TOP + 5, "text-anchor": "end" }, number(last.max_displacement, 3)),
        svg("text", { x: LEFT - 5, y: floor, "text-anchor": "end" }, "0"),
        svg("text", { x: LEFT, y: floor + 14, "text-anchor": "middle" }, "0"),
        svg("text", { x: end, y: floor + 14, "text-anchor": "middle" }, kilovolts(last.voltage)),
        svg("text", { x: (LEFT + end) / 2, y: floor + 26, "text-anchor": "middle" }, "voltage"),
        this.dot,
      ),
    );
    this.age();
    this.mark();
  }

  /** Moves the dot to a voltage: that of the drawing, unless another one is played. @param {number} [voltage] @param {boolean} [isLost] */
  mark(voltage = this.pad.voltage, isLost = false) {
    if (!this.found || !this.dot) return;
    const { points } = this.found;
    // The curve of another drawing has no place for this one.
    this.dot.setAttribute("visibility", this.isOld() ? "hidden" : "visible");
    const [x, y] = this.place(voltage);
    const beyond = voltage > points[points.length - 1].voltage;
    this.dot.setAttribute("cx", x.toFixed(1));
    this.dot.setAttribute("cy", y.toFixed(1));
    this.dot.classList.toggle("lost", isLost || beyond);
  }

  /** Stops, and turns the curve grey if it is that of another drawing. */
  check() {
    this.isSettled = false;
    this.stop();
    if (!this.box || !this.found) return;
    this.age();
    this.mark();
  }

  /** Whether the curve is that of another drawing. */
  isOld() {
    return this.found?.key !== this.pad.setupKey();
  }

  /** Turns the curve of another drawing grey. */
  age() {
    this.box.classList.toggle("old", this.isOld());
  }
}
