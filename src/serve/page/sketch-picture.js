// A picture of the membrane as a file: the drawing with its colours, what they mean, and the voltage.

import { SEQUENTIAL } from "./colours.js";

/** Width of the drawing, space around it, and height of a line of text, px. */
const WIDTH = 1200;
const SPACE = 36;
const LINE = 40;

/** Height of the bar of colours, px. */
const BAR = 24;

/**
 * Draws a picture, and writes it as PNG.
 * @param {{lines: string[], name: string, ends: string[], colours: {text: string, colour: string}[]|null, draw: (canvas: HTMLCanvasElement) => void}} what lines of text, what the
 * colours are, their ends or, for few values, each colour; and a function that draws the membrane
 * @returns {Promise<Blob|null>}
 */
export async function pictureOf({ lines, name, ends, colours, draw }) {
  const membrane = drawnAt(WIDTH, draw);
  const below = colours === null ? BAR + 2 * LINE : LINE;
  const canvas = document.createElement("canvas");
  canvas.width = WIDTH + 2 * SPACE;
  canvas.height = membrane.height + lines.length * LINE + below + 3 * SPACE;
  const context = /** @type {CanvasRenderingContext2D} */ (canvas.getContext("2d"));
  const style = getComputedStyle(document.body);
  context.fillStyle = style.getPropertyValue("--paper");
  context.fillRect(0, 0, canvas.width, canvas.height);
  const ink = style.getPropertyValue("--ink");
  context.textBaseline = "middle";
  context.fillStyle = ink;
  lines.forEach((line, at) => {
    context.font = `${at ? "" : "600 "}28px system-ui, sans-serif`;
    context.fillText(line, SPACE, SPACE + (at + 0.5) * LINE);
  });
  context.font = "28px system-ui, sans-serif";
  let y = SPACE + lines.length * LINE + SPACE / 2;
  context.drawImage(membrane, SPACE, y);
  y += membrane.height + SPACE / 2;
  if (colours === null) {
    SEQUENTIAL.forEach((colour, step) => {
      context.fillStyle = colour;
      context.fillRect(SPACE + (step * WIDTH) / SEQUENTIAL.length, y, Math.ceil(WIDTH / SEQUENTIAL.length) + 1, BAR);
    });
    context.fillStyle = ink;
    y += BAR + LINE / 2;
    context.fillText(ends[0], SPACE, y);
    context.textAlign = "center";
    context.fillText(name, SPACE + WIDTH / 2, y);
    context.textAlign = "right";
    context.fillText(ends[1].trim(), SPACE + WIDTH, y);
  } else {
    let x = SPACE;
    context.fillText(colours.length ? `${name}:` : name, x, y + LINE / 2);
    x += context.measureText(`${name}: `).width + LINE / 2;
    for (const { text, colour } of colours) {
      context.fillStyle = colour;
      context.fillRect(x, y + LINE / 4, LINE / 2, LINE / 2);
      context.fillStyle = ink;
      context.fillText(text, x + 0.75 * LINE, y + LINE / 2);
      x += context.measureText(text).width + 1.5 * LINE;
    }
  }
  return new Promise((resolve) => canvas.toBlob(resolve, "image/png"));
}

/** Draws on a canvas of a width in pixels, which is on the page only for that: drawings take its width from there. @param {number} width @param {(canvas: HTMLCanvasElement) => void} draw */
function drawnAt(width, draw) {
  const canvas = document.createElement("canvas");
  canvas.className = "offscreen";
  canvas.style.width = `${width / (window.devicePixelRatio || 1)}px`;
  document.body.append(canvas);
  draw(canvas);
  canvas.remove();
  return canvas;
}
