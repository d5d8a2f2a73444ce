// Files of the sketchpad: opens and saves patterns, and shows how to use them in a pipeline.

import { copyable, h, labelled, replace } from "./elements.js";
import { fromFile, READ, saveAs } from "./files.js";

/** Placeholder for the name of the pattern in responses, which are used for all names. */
export const PLACEHOLDER = "name-of-the-pattern";

export class Files {
  /** @param {any} pad */
  constructor(pad) {
    this.pad = pad;
    /** @type {any} */ this.reproduced = null;
  }

  panel() {
    const { pad } = this;
    const opened = h("div", { role: "alert", id: "opened" });
    const file = h("input", { type: "file", accept: READ.map((format) => `.${format}`).join(","), "aria-label": "Open a pattern", onchange: async () => {
      const chosen = file.files?.[0];
      file.value = "";
      if (chosen) await pad.attempt(opened, async () => {
        const { pattern, notes } = await fromFile(chosen, pad.scene);
        pad.pen.become(pattern);
        replace(opened, notes.map((note) => h("p", { class: "box" }, `${chosen.name}: ${note}`)));
      });
    } });
    this.saved = h("div", { "aria-live": "polite" });
    this.name = h("input", { type: "text", value: "mine", pattern: "[A-Za-z0-9_\\-]+", maxlength: "60", "aria-label": "Name of the file", title: "letters, digits, - and _", name: "name" });
    const formats = ["csv", "npy", "png", "svg", "dxf", "gbr"].map((format) => h("button", { type: "button", "data-format": format, onclick: () => this.keep(format) }, format));
    this.stages = h("div", { id: "stages" });
    this.into = h("button", { type: "button", class: "main", id: "into-pipeline", onclick: () => this.keep("csv") }, "Save mine.csv");
    this.name.addEventListener("input", () => this.show());
    return h(
      "section",
      { class: "panel" },
      h("h2", {}, "Files"),
      labelled("Open png, csv, npy, svg or dxf", file),
      opened,
      h("div", { class: "tools" }, labelled("Name", this.name)),
      h("div", { class: "tools", role: "group", "aria-label": "Save the mask as a file" }, h("span", { class: "soft" }, "Save the mask as"), formats),
      h("h3", {}, "Use in a pipeline"),
      h("div", { class: "tools" }, this.into),
      this.stages,
      this.saved,
    );
  }

  /** @param {string} format */
  async keep(format) {
    const { pad } = this;
    const name = this.fileName();
    await pad.attempt(this.saved, async () => {
      await saveAs(format, { scene: pad.scene.name, pattern: pad.pattern.asRows() }, name);
      replace(this.saved, h("p", { class: "small" }, `Saved ${name}.${format}.`));
    });
  }

  fileName() {
    return this.name.value.replace(/[^A-Za-z0-9_-]/g, "_") || "mine";
  }

  /** Inserts the name of the pattern. @param {string} text */
  named(text) {
    return text.replaceAll(PLACEHOLDER, this.fileName());
  }

  /** @param {any} reproduced response of `sketch/reproduce` */
  take(reproduced) {
    this.reproduced = reproduced;
    this.show();
  }

  /** Shows the stages with the pattern. */
  show() {
    const name = this.fileName();
    this.into.textContent = `Save ${name}.csv`;
    const found = this.reproduced;
    if (!found) return;
    this.pad.numbers.reproduce(found, (text) => this.named(text));
    const others = found.set.length
      ? [
          h("p", { class: "small", "data-changed": "true" }, "The values shown here differ from the scene of the pipeline. Run it with these values, which apply to all of its stages:"),
          copyable(found.run ? this.named(found.run) : found.set.map((/** @type {string} */ set) => `--set '${set}'`).join(" ")),
        ]
      : null;
    replace(
      this.stages,
      h("p", { class: "small" }, `Save ${name}.csv beside a pipeline with the scene ${this.pad.scene.name}${found.saved ? ", as the one below," : ""} and add these stages, which have the state, method and mesh shown here. The run prints the largest displacement; the command below the numbers prints that of the point.`),
      copyable(this.named(found.stages)),
      others,
      h("details", {}, h("summary", {}, "A complete pipeline with this scene"), copyable(this.named(found.pipeline))),
    );
  }
}
