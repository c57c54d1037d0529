// Shared by /play, /beat and /game: a scene whose grid cells are buttons.

let taken = Promise.resolve(); // the last action, which the next one waits for
let sending = null; // its name, until it is taken: the same one again is ignored

/** Takes an action in an episode or seat and shows the new state; after a conflict, the current one. `rest()`: what to send with it; null: nothing. */
function actOn(path, action, rest, show) {
  const act = async () => {
    const others = rest();
    try {
      if (others) await show(await request("POST", `${path}/actions`, { action, ...others }));
    } catch (fault) {
      if (fault.status === 409) await show(await request("GET", path));
      throw fault;
    }
  };
  if (action === sending) return taken;
  sending = action;
  taken = taken.catch(() => {}).then(() => attempt(act, byId("board"))).finally(() => sending === action && (sending = null));
  return taken;
}

const DOUBLE_CLICK_MILLISECONDS = 300;
const BOXES = ["LEFT", "MIDDLE", "RIGHT"];

/** A scene with a button on each cell, and the selected action kind and item type.
 *
 * `act(name)` takes the action with that name; `legal()` resolves to the names of the legal actions.
 */
class Board {
  constructor(act, legal) {
    this.act = act;
    this.legal = legal;
    this.selection = { kind: "ADD", shape: "CIRCLE", size: "SMALL", colour: "YELLOW" };
    this.grid = null; // [columns, rows] in Scatter, null in Tower
    this.showsLegal = false;
    this.view = new SceneView("The scene");
    this.cells = element("div", { class: "cells", role: "group", "aria-label": "Cells of the scene" });
    this.ghost = element("div", { "aria-hidden": "true" }); // what a click on the cell under the pointer would do
    this.proposed = element("div", { "aria-hidden": "true" }); // what another player proposes
    this.removable = {}; // the item that each legal REMOVE removes, by its name
    this.view.root.append(this.ghost, this.proposed, this.cells);
    for (const name of ["pointerover", "focusin"]) this.cells.addEventListener(name, (event) => this.showGhost(event.target));
    for (const name of ["pointerleave", "focusout"]) this.cells.addEventListener(name, () => this.showGhost(null));
    byId("board").append(this.view.root);
    moveWithArrows(this.cells, () => this.size());
    byId("legal").addEventListener("click", () => this.toggleLegal());
    for (const button of document.querySelectorAll("[data-choice] button")) {
      button.addEventListener("click", () => this.choose(button.closest("[data-choice]").dataset.choice, button.dataset.value));
    }
    const next = (name) => () => this.chooseNext(name);
    const arrows = Object.keys(MOVES).map((key) => [key, () => this.enter()]);
    this.keys = { ...Object.fromEntries(arrows), a: next("kind"), s: next("shape"), z: next("size"), c: next("colour"), l: () => this.toggleLegal() };
  }

  size() {
    return this.grid || [3, 1];
  }

  /** Creates the buttons: Scatter's grid cells, or Tower's boxes if `grid` is null. */
  makeCells(grid) {
    this.grid = grid;
    this.cells.replaceChildren();
    for (const part of document.querySelectorAll(".board, .cue")) part.classList.toggle("fine", Boolean(grid));
    const [columns, rows] = this.size();
    for (let row = 0; row < rows; row += 1) {
      for (let column = 0; column < columns; column += 1) {
        const cell = element("button", { type: "button", tabindex: -1, click: (event) => this.press(event, cell) });
        cell.addEventListener("contextmenu", (event) => {
          event.preventDefault();
          if (!cell.disabled) this.press(event, cell, "REMOVE");
        });
        Object.assign(cell.dataset, { column, row });
        if (grid) place(cell, (column * IMAGE_WIDTH) / columns, (row * IMAGE_HEIGHT) / rows, IMAGE_WIDTH / columns, IMAGE_HEIGHT / rows);
        else place(cell, column * 140, 0, 100, 100);
        this.cells.append(cell);
      }
    }
    this.cells.firstChild.tabIndex = 0;
  }

  /** Takes the action at the cell, once for a double click or a key that repeats. */
  press(event, cell, kind) {
    const isRepeated = cell === this.pressed?.cell && event.timeStamp - this.pressed.time < DOUBLE_CLICK_MILLISECONDS;
    this.pressed = { cell, time: event.timeStamp };
    if (!isRepeated) this.act(this.actionAt(cell, kind));
  }

  actionAt(cell, kind = this.selection.kind) {
    const { column, row } = cell.dataset;
    const { shape, size, colour } = this.selection;
    if (!this.grid) return kind === "ADD" ? `ADD(${BOXES[column]}, ${colour})` : `REMOVE(${BOXES[column]})`;
    return kind === "ADD" ? `ADD(${column}, ${row}, ${shape}, ${colour}, ${size})` : `REMOVE(${column}, ${row})`;
  }

  /** Shows the item that a click on the cell would add or remove. */
  showGhost(cell) {
    const { kind, shape, size, colour } = this.selection;
    this.hovered = cell;
    this.ghost.className = "";
    const isCell = cell && cell !== this.cells && !cell.disabled;
    byId("messages").dataset.hint = isCell ? `Click or Enter: ${this.actionAt(cell)}` : "Point at the scene to see what a click does.";
    if (!isCell) return;
    const [column, row] = [Number(cell.dataset.column), Number(cell.dataset.row)];
    if (kind === "REMOVE") {
      const item = this.removable[this.actionAt(cell)];
      if (item) drawGhost(this.ghost, item, true);
    } else if (this.grid) {
      const side = { SMALL: 10, MEDIUM: 20, LARGE: 30 }[size];
      const item = { x: (column * IMAGE_WIDTH) / this.grid[0], y: (row * IMAGE_HEIGHT) / this.grid[1], side };
      drawGhost(this.ghost, { ...item, shape: shape.toLowerCase(), colour: colour.toLowerCase() }, false);
    } else {
      const y = 80 - 21 * this.view.scene.items.filter((item) => item.box === column).length;
      if (y >= 0) drawGhost(this.ghost, { x: column * 140 + 40, y, side: 20, shape: "square", colour: colour.toLowerCase() }, false);
    }
  }

  enable(enabled) {
    for (const cell of this.cells.children) cell.disabled = !enabled;
  }

  /** Labels the cells and marks legal ones; requests the legal actions only if they are to be shown. */
  async mark() {
    const names = new Set(this.showsLegal ? await this.legal() : []);
    for (const cell of this.cells.children) {
      const isLegal = names.has(this.actionAt(cell));
      const label = this.grid ? `column ${cell.dataset.column}, row ${cell.dataset.row}` : `${BOXES[cell.dataset.column].toLowerCase()} box`;
      cell.classList.toggle("legal", isLegal);
      cell.setAttribute("aria-label", isLegal ? `${label}, legal` : label);
    }
  }

  choose(name, value) {
    this.selection[name] = value;
    for (const button of document.querySelectorAll(`[data-choice="${name}"] button`)) {
      button.setAttribute("aria-pressed", String(button.dataset.value === value));
    }
    this.showGhost(this.hovered);
    attempt(() => this.mark());
  }

  chooseNext(name) {
    const values = [...document.querySelectorAll(`[data-choice="${name}"] button`)].map((button) => button.dataset.value);
    this.choose(name, values[(values.indexOf(this.selection[name]) + 1) % values.length]);
  }

  toggleLegal() {
    this.showsLegal = !this.showsLegal;
    byId("legal").setAttribute("aria-pressed", String(this.showsLegal));
    attempt(() => this.mark());
  }

  /** Moves the focus into the scene unless a control has it or no cell can be pressed. Returns whether it did. */
  enter() {
    if (this.cells.firstChild?.disabled !== false || document.activeElement.closest("a, button, summary")) return false;
    this.focus();
    return true;
  }

  focus() {
    [...this.cells.children].find((each) => each.tabIndex === 0)?.focus({ preventScroll: true });
  }
}
