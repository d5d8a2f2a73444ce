// A pattern of electrodes on cells; row 0 is the lowest.

/** The images of a cell under the enabled symmetries. */
export class Mirrors {
  across = false; // left and right
  along = false; // up and down
  quarter = false; // four quarter turns

  /** @param {number} x @param {number} y @param {number} columns @param {number} rows @returns {[number, number][]} */
  images(x, y, columns, rows) {
    /** @type {[number, number][]} */
    let found = [[x, y]];
    if (this.across) found = found.concat(found.map(([a, b]) => [columns - 1 - a, b]));
    if (this.along) found = found.concat(found.map(([a, b]) => [a, rows - 1 - b]));
    if (this.quarter && columns === rows) {
      const turn = (/** @type {[number, number]} */ [a, b]) => /** @type {[number, number]} */ ([rows - 1 - b, a]);
      let turned = found;
      for (let k = 0; k < 3; k += 1) {
        turned = turned.map(turn);
        found = found.concat(turned);
      }
    }
    return found;
  }
}

export class Pattern {
  /** @param {number} columns @param {number} rows @param {Uint8Array} [cells] */
  constructor(columns, rows, cells) {
    this.columns = columns;
    this.rows = rows;
    this.cells = cells ?? new Uint8Array(columns * rows);
    /** Shapes that elements follow instead of cells, in fractions of the sides. @type {{group: number, ring: [number, number][]}[]|null} */
    this.shapes = null;
    /** The covered share of each cell and its group, if cells are covered in part. @type {{share: ArrayLike<number>, group: ArrayLike<number>}|null} */
    this.covered = null;
  }

  /** @param {number[][]} rows */
  static of(rows) {
    return new Pattern(rows[0].length, rows.length, Uint8Array.from(rows.flat()));
  }

  copy() {
    return new Pattern(this.columns, this.rows, this.cells.slice());
  }

  /** @returns {number[][]} row by row from below */
  asRows() {
    return Array.from({ length: this.rows }, (_, y) => Array.from(this.cells.subarray(y * this.columns, (y + 1) * this.columns)));
  }

  /** @param {Pattern} other */
  equals(other) {
    return this.columns === other.columns && this.rows === other.rows && this.cells.every((cell, at) => cell === other.cells[at]);
  }

  /** @param {number} x @param {number} y @param {number} value @param {Mirrors} mirrors */
  set(x, y, value, mirrors) {
    for (const [a, b] of mirrors.images(x, y, this.columns, this.rows)) {
      if (a >= 0 && b >= 0 && a < this.columns && b < this.rows) this.cells[b * this.columns + a] = value;
    }
  }

  /** Draws a disc of cells. @param {number} x @param {number} y @param {number} diameter @param {number} value @param {Mirrors} mirrors */
  dab(x, y, diameter, value, mirrors) {
    const reach = (diameter - 1) / 2;
    const limit = (diameter / 2) ** 2;
    for (let b = Math.floor(y - reach); b <= Math.ceil(y + reach); b += 1) {
      for (let a = Math.floor(x - reach); a <= Math.ceil(x + reach); a += 1) {
        if ((a - x) ** 2 + (b - y) ** 2 <= limit) this.set(a, b, value, mirrors);
      }
    }
  }

  /** Draws discs along a line. @param {[number, number]} from @param {[number, number]} to @param {number} diameter @param {number} value @param {Mirrors} mirrors */
  stroke(from, to, diameter, value, mirrors) {
    const count = Math.max(Math.abs(to[0] - from[0]), Math.abs(to[1] - from[1]), 1);
    for (let k = 0; k <= count; k += 1) {
      const at = (/** @type {number} */ axis) => Math.round(from[axis] + ((to[axis] - from[axis]) * k) / count);
      this.dab(at(0), at(1), diameter, value, mirrors);
    }
  }

  /** Fills a shape between two corners. @param {"rectangle"|"ellipse"} shape @param {[number, number]} from @param {[number, number]} to @param {number} value @param {Mirrors} mirrors */
  shape(shape, from, to, value, mirrors) {
    const [left, right] = [Math.min(from[0], to[0]), Math.max(from[0], to[0])];
    const [low, high] = [Math.min(from[1], to[1]), Math.max(from[1], to[1])];
    const centre = [(left + right) / 2, (low + high) / 2];
    const half = [(right - left + 1) / 2, (high - low + 1) / 2];
    for (let y = low; y <= high; y += 1) {
      for (let x = left; x <= right; x += 1) {
        const inside = shape === "rectangle" || ((x - centre[0]) / half[0]) ** 2 + ((y - centre[1]) / half[1]) ** 2 <= 1;
        if (inside) this.set(x, y, value, mirrors);
      }
    }
  }

  /** Fills the connected cells of one value around a cell. @param {number} x @param {number} y @param {number} value @param {Mirrors} mirrors */
  flood(x, y, value, mirrors) {
    const before = this.cells[y * this.columns + x];
    if (before === value) return;
    const open = [[x, y]];
    const found = new Set([y * this.columns + x]);
    while (open.length) {
      const [a, b] = /** @type {number[]} */ (open.pop());
      for (const [c, d] of [[a + 1, b], [a - 1, b], [a, b + 1], [a, b - 1]]) {
        const at = d * this.columns + c;
        if (c < 0 || d < 0 || c >= this.columns || d >= this.rows || found.has(at) || this.cells[at] !== before) continue;
        found.add(at);
        open.push([c, d]);
      }
    }
    for (const at of found) this.set(at % this.columns, Math.floor(at / this.columns), value, mirrors);
  }
}

/** Steps for undo and redo. Patterns in it are replaced, never changed. */
export class History {
  /** @type {Pattern[]} */ past = [];
  /** @type {Pattern[]} */ future = [];

  /** @param {Pattern} before */
  push(before) {
    this.past.push(before.copy());
    if (this.past.length > 200) this.past.shift();
    this.future = [];
  }

  /** @param {Pattern} now @returns {Pattern|undefined} */
  undo(now) {
    const before = this.past.pop();
    if (before) this.future.push(now.copy());
    return before;
  }

  /** @param {Pattern} now @returns {Pattern|undefined} */
  redo(now) {
    const after = this.future.pop();
    if (after) this.past.push(now.copy());
    return after;
  }
}
