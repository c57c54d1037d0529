// A scene: the rendered image, with marks on items.

const IMAGE_WIDTH = 380;
const IMAGE_HEIGHT = 100;

/** Positions an element over a rectangle of the image, in native pixels. */
function place(target, x, y, width, height) {
  const [across, down] = [(pixels) => `${(100 * pixels) / IMAGE_WIDTH}%`, (pixels) => `${(100 * pixels) / IMAGE_HEIGHT}%`];
  Object.assign(target.style, { left: across(x), top: down(y), width: across(width), height: down(height) });
  return target;
}

/** Displays a scene: `show` replaces it, `mark` outlines items given as [box, index]. */
class SceneView {
  constructor(label = "Scene") {
    this.label = label;
    this.image = element("img", { class: "picture", alt: "", width: 760, height: 200 });
    this.marks = element("div", { class: "marks", "aria-hidden": "true" });
    this.root = element("div", { class: "scene" }, this.image, this.marks);
  }

  show(scene) {
    this.scene = scene;
    this.image.src = scene.picture;
    this.image.alt = `${this.label}. ${scene.description}`;
    this.mark([]);
    return this;
  }

  mark(items) {
    const wanted = new Set(items.map(([box, index]) => `${box},${index}`));
    const found = this.scene.items.filter((item) => wanted.has(`${item.box},${item.index}`));
    this.marks.replaceChildren(...found.map((item) => place(element("div", { class: "mark" }), item.x, item.y, item.side, item.side)));
  }
}

/** Steps through scenes: `show` takes the first, and the steps as {action, scene}. */
class StepView {
  constructor(root, label) {
    this.view = new SceneView(label);
    this.back = element("button", { type: "button", class: "back", click: () => this.go(-1) }, "Back");
    this.forth = element("button", { type: "button", class: "forth", click: () => this.go(1) }, "Next");
    this.line = element("p", { class: "step", role: "status" });
    root.replaceChildren(this.view.root, element("div", { class: "row" }, this.back, this.forth, this.line));
  }

  show(start, steps) {
    Object.assign(this, { start, steps, at: 0 });
    this.go(0);
  }

  go(by) {
    clearTimeout(this.timer);
    this.at += by;
    const step = this.at ? this.steps[this.at - 1] : null;
    this.view.show(step ? step.scene : this.start);
    this.line.textContent = step ? `${this.at} of ${this.steps.length}: ${step.action}` : "Start";
    this.back.disabled = this.at === 0;
    this.forth.disabled = this.at >= this.steps.length;
  }

  /** Goes on by itself until the end, or until a button is pressed. */
  play() {
    this.timer = setTimeout(() => {
      this.go(1);
      if (!this.forth.disabled) this.play();
    }, 900);
  }
}

const percent = (share) => (share > 0 && share < 0.0005 ? "< 0.1 %" : `${(100 * share).toFixed(share > 0 && share < 0.1 ? 1 : 0)} %`);

/** A bar with a probability; `taken` marks the action taken. */
function bar(label, share, taken = false, mono = false) {
  const fill = element("span", { class: "fill" });
  fill.style.width = `${100 * share}%`;
  return element("li", { class: taken ? "done" : null }, fill, element("span", { class: mono ? "mono" : null }, label, taken ? " ✓" : ""), element("span", { class: "share" }, percent(share)));
}

/** A program, which wraps at spaces and before calls. */
function programCode(source) {
  return element("code", { class: "program" }, ...source.split(/(?<=[(,.])(?=\w+\()/).flatMap((piece) => [element("wbr"), piece]));
}

/** Draws an item that an action would add, or crosses it out if the action would remove it. */
function drawGhost(ghost, item, removes) {
  ghost.className = removes ? "ghost removed" : `ghost colour-${item.colour} shape-${item.shape}`;
  place(ghost, item.x, item.y, item.side, item.side);
}

/** A list of the parts of a program with their values; hovering over or focusing a part marks its items in the view. */
function partsList(parts, view) {
  const list = element("ul", { class: "parts" });
  for (const part of parts) {
    const marks = () => view.mark(part.items);
    const value = part.value.replace(/^(True|False)$/, (truth) => truth.toLowerCase());
    const content = [programCode(part.source), element("span", { class: "value" }, value)];
    const line = element("li");
    line.style.setProperty("--depth", Math.min(part.depth, 4));
    const marking = { type: "button", class: "part", mouseenter: marks, focus: marks, click: marks };
    line.append(part.items.length ? element("button", marking, ...content) : element("span", { class: "part" }, ...content));
    list.append(line);
  }
  return list;
}

const MOVES = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] };

/** Lets the arrow keys move the focus among `cells`, buttons in row-major order; `grid()` returns [columns, rows]. */
function moveWithArrows(cells, grid) {
  cells.addEventListener("keydown", (event) => {
    const move = MOVES[event.key];
    const from = event.target.closest("button");
    if (!move || !from) return;
    event.preventDefault();
    const [columns, rows] = grid();
    const column = Math.max(0, Math.min(columns - 1, Number(from.dataset.column) + move[0]));
    const row = Math.max(0, Math.min(rows - 1, Number(from.dataset.row) + move[1]));
    const to = cells.children[row * columns + column];
    from.tabIndex = -1;
    to.tabIndex = 0;
    to.focus();
  });
}
