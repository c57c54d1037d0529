"use strict";
// What /play and /game share: the choice of a task set, and the picture whose places are buttons.

/** Offers the splits of the configuration that is chosen in the form. */
function fillSplits(form) {
  const sizes = JSON.parse(form.configuration.selectedOptions[0].dataset.splits);
  const before = form.split.value || "dev";
  form.split.replaceChildren(
    ...Object.entries(sizes).map(([split, count]) => element("option", { value: split }, `${split} (${count})`)),
  );
  form.split.value = before in sizes ? before : Object.keys(sizes)[0];
}

const BOXES = ["LEFT", "MIDDLE", "RIGHT"];

/** The scene with a button at each place, and the look of the item that is added there.
 *
 * `act` gets the name of an action; `legal` gets a look as a query and promises the names of legal actions.
 */
class Board {
  constructor(act, legal) {
    this.act = act;
    this.legal = legal;
    this.look = { kind: "ADD", shape: "CIRCLE", size: "SMALL", colour: "YELLOW" };
    this.grid = null; // Scatter's columns and rows
    this.showsLegal = false;
    this.view = new SceneView("The scene");
    this.cells = element("div", { class: "cells", role: "group", "aria-label": "Places in the picture" });
    this.view.root.append(this.cells);
    byId("board").append(this.view.root);
    moveWithArrows(this.cells, () => this.size());
    byId("legal").addEventListener("click", () => this.toggleLegal());
    for (const group of document.querySelectorAll("[data-choice]")) {
      group.addEventListener("click", (event) => {
        const button = event.target.closest("button");
        if (button) this.choose(group.dataset.choice, button.dataset.value);
      });
    }
    const next = (name) => () => this.chooseNext(name);
    this.keys = { a: next("kind"), s: next("shape"), z: next("size"), c: next("colour"), l: () => this.toggleLegal() };
  }

  size() {
    return this.grid || [3, 1];
  }

  /** New places: Scatter's cells, or Tower's boxes where there is no grid. */
  makeCells(grid) {
    this.grid = grid;
    this.cells.replaceChildren();
    byId("board").classList.toggle("fine", Boolean(grid));
    const [columns, rows] = this.size();
    for (let row = 0; row < rows; row += 1) {
      for (let column = 0; column < columns; column += 1) {
        const cell = element("button", { type: "button", tabindex: -1, click: () => this.act(this.actionAt(cell)) });
        Object.assign(cell.dataset, { column, row });
        if (grid) place(cell, (column * IMAGE_WIDTH) / columns, (row * IMAGE_HEIGHT) / rows, IMAGE_WIDTH / columns, IMAGE_HEIGHT / rows);
        else place(cell, column * 140, 0, 100, 100);
        this.cells.append(cell);
      }
    }
    this.cells.firstChild.tabIndex = 0;
  }

  actionAt(cell) {
    const { column, row } = cell.dataset;
    const { kind, shape, size, colour } = this.look;
    if (!this.grid) return kind === "ADD" ? `ADD(${BOXES[column]}, ${colour})` : `REMOVE(${BOXES[column]})`;
    return kind === "ADD" ? `ADD(${column}, ${row}, ${shape}, ${colour}, ${size})` : `REMOVE(${column}, ${row})`;
  }

  enable(enabled) {
    for (const cell of this.cells.children) cell.disabled = !enabled;
  }

  /** Marks and names the places; asks which are legal only where they are shown. */
  async mark() {
    const { shape, colour, size } = this.look;
    const names = new Set(this.showsLegal ? await this.legal(new URLSearchParams({ shape, colour, size })) : []);
    for (const cell of this.cells.children) {
      const isLegal = names.has(this.actionAt(cell));
      const told = this.grid ? `column ${cell.dataset.column}, row ${cell.dataset.row}` : `${BOXES[cell.dataset.column].toLowerCase()} box`;
      cell.classList.toggle("legal", isLegal);
      cell.setAttribute("aria-label", isLegal ? `${told}, legal` : told);
    }
  }

  choose(name, value) {
    this.look[name] = value;
    for (const button of document.querySelectorAll(`[data-choice="${name}"] button`)) {
      button.setAttribute("aria-pressed", String(button.dataset.value === value));
    }
    attempt(() => this.mark());
  }

  chooseNext(name) {
    const values = [...document.querySelectorAll(`[data-choice="${name}"] button`)].map((button) => button.dataset.value);
    this.choose(name, values[(values.indexOf(this.look[name]) + 1) % values.length]);
  }

  toggleLegal() {
    this.showsLegal = !this.showsLegal;
    byId("legal").setAttribute("aria-pressed", String(this.showsLegal));
    attempt(() => this.mark());
  }

  focus() {
    const cell = [...this.cells.children].find((each) => each.tabIndex === 0);
    if (cell) cell.focus({ preventScroll: true });
  }
}
