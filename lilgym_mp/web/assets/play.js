"use strict";
// The page /play. What is legal, what comes of an action and what it gives are the server's answers.

const setup = byId("setup");
const look = { kind: "ADD", shape: "CIRCLE", size: "SMALL", colour: "YELLOW" };
const board = new SceneView("The scene");
const cells = element("div", { class: "cells", role: "group", "aria-label": "Places in the picture" });
const endView = new SceneView("The last scene");
const expertView = new SceneView("The expert's scene");
const BOXES = ["LEFT", "MIDDLE", "RIGHT"];
const OUTCOMES = { success: "Solved", wrong_stop: "Stopped in the wrong scene", invalid_action: "Not a legal action", horizon: "Out of actions" };
let episode = null;
let showsLegal = false;
let expert = null;
let expertStep = 0;

board.root.append(cells);
byId("board").append(board.root);
byId("end-scene").append(endView.root);
byId("expert-scene").append(expertView.root);

function fillSplits() {
  const sizes = JSON.parse(setup.configuration.selectedOptions[0].dataset.splits);
  const before = setup.split.value || "dev";
  setup.split.replaceChildren(
    ...Object.entries(sizes).map(([split, count]) => element("option", { value: split }, `${split} (${count})`)),
  );
  setup.split.value = before in sizes ? before : Object.keys(sizes)[0];
}

async function begin(taskId) {
  await attempt(async () => {
    const made = await ask("POST", "/api/play/episodes", {
      configuration: setup.configuration.value,
      split: setup.split.value,
      rules: setup.rules.value,
      strict: setup.strict.checked,
      task_id: taskId,
    });
    expert = null;
    byId("expert").hidden = true;
    history.replaceState(null, "", `#${made.id}`);
    await show(made);
    focusBoard();
  }, byId("episode"));
}

/** The places of the picture: Scatter's cells, or Tower's boxes. */
function makeCells() {
  cells.replaceChildren();
  const [columns, rows] = episode.grid || [3, 1];
  byId("board").classList.toggle("fine", Boolean(episode.grid));
  for (let row = 0; row < rows; row += 1) {
    for (let column = 0; column < columns; column += 1) {
      const cell = element("button", { type: "button", tabindex: -1, click: () => act(actionAt(cell)) });
      Object.assign(cell.dataset, { column, row });
      if (episode.grid) place(cell, (column * IMAGE_WIDTH) / columns, (row * IMAGE_HEIGHT) / rows, IMAGE_WIDTH / columns, IMAGE_HEIGHT / rows);
      else place(cell, column * 140, 0, 100, 100);
      cells.append(cell);
    }
  }
  cells.dataset.for = episode.id;
  cells.firstChild.tabIndex = 0;
}

function actionAt(cell) {
  const { column, row } = cell.dataset;
  if (!episode.grid) return look.kind === "ADD" ? `ADD(${BOXES[column]}, ${look.colour})` : `REMOVE(${BOXES[column]})`;
  return look.kind === "ADD" ? `ADD(${column}, ${row}, ${look.shape}, ${look.colour}, ${look.size})` : `REMOVE(${column}, ${row})`;
}

async function show(state) {
  episode = state;
  board.show(state.scene);
  byId("nothing").hidden = true;
  byId("episode").hidden = false;
  byId("statement").textContent = state.statement;
  byId("target").textContent = state.target ? "true" : "false";
  byId("left").textContent = state.over ? "" : `Actions left: ${state.actions_left}.`;
  byId("reward").textContent = state.reward.toFixed(1);
  byId("history").textContent = state.actions.length ? `So far: ${state.actions.join(", ")}` : "";
  byId("scatter-look").hidden = !state.grid;
  if (cells.dataset.for !== state.id) makeCells();
  for (const button of [...cells.children, byId("stop"), byId("legal")]) button.disabled = state.over;
  byId("end").hidden = !state.over;
  await showLegal();
  nameCells();
  if (state.over) await explain();
  await showTables();
}

function nameCells() {
  for (const cell of cells.children) {
    const told = episode.grid ? `column ${cell.dataset.column}, row ${cell.dataset.row}` : `${BOXES[cell.dataset.column].toLowerCase()} box`;
    cell.setAttribute("aria-label", cell.classList.contains("legal") ? `${told}, legal` : told);
  }
}

async function showLegal() {
  const names = new Set();
  if (showsLegal && episode && !episode.over) {
    const query = new URLSearchParams({ shape: look.shape, colour: look.colour, size: look.size });
    const found = await ask("GET", `/api/play/episodes/${episode.id}/legal?${query}`);
    found.actions.forEach((name) => names.add(name));
  }
  for (const cell of cells.children) cell.classList.toggle("legal", names.has(actionAt(cell)));
}

async function act(action) {
  if (!episode || episode.over) return;
  await attempt(async () => {
    const path = `/api/play/episodes/${episode.id}`;
    try {
      await show(await ask("POST", `${path}/actions`, { action, steps: episode.steps }));
    } catch (fault) {
      if (fault.status === 409) await show(await ask("GET", path));
      throw fault;
    }
  }, byId("board"));
}

async function explain() {
  const told = await ask("GET", `/api/play/episodes/${episode.id}/explanation`);
  byId("end-title").textContent = OUTCOMES[episode.outcome];
  byId("end-title").className = episode.outcome === "success" ? "good" : "bad";
  byId("rule").textContent = told.invalid_reason ? `${told.rule} Reason: ${told.invalid_reason}.` : told.rule;
  byId("verdict").textContent = `The statement is ${told.truth} of the last scene; it was to be ${told.target}. Reward: ${episode.reward.toFixed(1)}.`;
  endView.show(episode.scene);
  byId("parts").replaceChildren(partsList(told.parts, endView));
  byId("end-title").focus();
}

async function showExpert() {
  await attempt(async () => {
    expert = await ask("POST", `/api/play/episodes/${episode.id}/solution`);
    expertStep = 0;
    byId("expert").hidden = false;
    const told = expert.proven_shortest ? "No shorter one exists." : "A shorter one was not found.";
    byId("expert-line").textContent = expert.found ? `${expert.steps.length} actions. ${told}` : `None was found: ${expert.reason}`;
    showExpertStep();
    byId("expert").scrollIntoView({ block: "nearest" });
  }, byId("expert"));
}

function showExpertStep() {
  const step = expertStep ? expert.steps[expertStep - 1] : null;
  expertView.show(step ? step.scene : expert.start);
  byId("expert-step").textContent = step ? `${expertStep} of ${expert.steps.length}: ${step.action}` : "The start.";
  byId("back").disabled = expertStep === 0;
  byId("forth").disabled = expertStep >= expert.steps.length;
}

function table(headings, rows, caption) {
  const cellsOf = (values, tag) => values.map((value) => element(tag, { class: typeof value === "number" ? "number" : null }, String(value)));
  return element(
    "table",
    { "aria-label": caption },
    element("thead", {}, element("tr", {}, ...cellsOf(headings, "th"))),
    element("tbody", {}, ...rows.map((row) => element("tr", {}, ...cellsOf(row, "td")))),
  );
}

async function showTables() {
  const [own, best] = await Promise.all([ask("GET", "/api/play/progress"), ask("GET", "/api/play/best")]);
  byId("no-progress").hidden = own.configurations.length > 0;
  if (own.nickname && !byId("nickname").nickname.value) byId("nickname").nickname.value = own.nickname;
  const ownRows = own.configurations.map((line) => [line.configuration, line.successes, line.episodes, line.mean_reward]);
  byId("progress").replaceChildren(...(ownRows.length ? [table(["Configuration", "Solved", "Played", "Mean reward"], ownRows, "Your play")] : []));
  const bestRows = best.map((line) => [line.you ? `${line.player} (you)` : line.player, line.configuration, line.successes, line.mean_reward]);
  byId("best").replaceChildren(bestRows.length ? table(["Player", "Configuration", "Tasks", "Mean reward"], bestRows, "Best play") : element("p", { class: "empty" }, "Nobody has finished a task yet."));
}

function choose(name, value) {
  look[name] = value;
  for (const button of document.querySelectorAll(`[data-choice="${name}"] button`)) {
    button.setAttribute("aria-pressed", String(button.dataset.value === value));
  }
  attempt(async () => {
    await showLegal();
    if (episode) nameCells();
  });
}

function chooseNext(name) {
  const values = [...document.querySelectorAll(`[data-choice="${name}"] button`)].map((button) => button.dataset.value);
  choose(name, values[(values.indexOf(look[name]) + 1) % values.length]);
}

function toggleLegal() {
  showsLegal = !showsLegal;
  byId("legal").setAttribute("aria-pressed", String(showsLegal));
  attempt(async () => {
    await showLegal();
    nameCells();
  });
}

function focusBoard() {
  const cell = [...cells.children].find((each) => each.tabIndex === 0);
  if (cell) cell.focus({ preventScroll: true });
}

moveWithArrows(cells, () => episode.grid || [3, 1]);

const KEYS = { a: () => chooseNext("kind"), s: () => chooseNext("shape"), z: () => chooseNext("size"), c: () => chooseNext("colour"), l: toggleLegal, p: focusBoard };
byId("episode").addEventListener("keydown", (event) => {
  if (event.ctrlKey || event.metaKey || event.altKey || !(event.key.toLowerCase() in KEYS)) return;
  event.preventDefault();
  KEYS[event.key.toLowerCase()]();
});

let searching = 0;
async function search() {
  searching += 1;
  const mine = searching;
  await attempt(async () => {
    const query = new URLSearchParams({ configuration: setup.configuration.value, split: setup.split.value, text: byId("search").value });
    const found = await ask("GET", `/api/play/tasks?${query}`);
    if (mine !== searching) return;
    byId("found").textContent = found.total > found.tasks.length ? `${found.total} tasks, the first ${found.tasks.length}:` : `${found.total} tasks`;
    byId("tasks").replaceChildren(
      ...found.tasks.map((task) =>
        element("li", {}, element("button", { type: "button", click: () => begin(task.id) }, `${task.statement} (${task.target}) `, element("span", { class: "soft small" }, task.id))),
      ),
    );
  });
}

setup.addEventListener("submit", (event) => {
  event.preventDefault();
  begin(null);
});
setup.configuration.addEventListener("change", fillSplits);
setup.addEventListener("change", () => byId("chooser").open && search());
byId("chooser").addEventListener("toggle", () => byId("chooser").open && search());
byId("search").addEventListener("input", search);
byId("stop").addEventListener("click", () => act("STOP"));
byId("legal").addEventListener("click", toggleLegal);
byId("again").addEventListener("click", () => begin(episode.task_id));
byId("solution").addEventListener("click", showExpert);
byId("back").addEventListener("click", () => { expertStep -= 1; showExpertStep(); });
byId("forth").addEventListener("click", () => { expertStep += 1; showExpertStep(); });
for (const group of document.querySelectorAll("[data-choice]")) {
  group.addEventListener("click", (event) => {
    const button = event.target.closest("button");
    if (button) choose(group.dataset.choice, button.dataset.value);
  });
}
byId("nickname").addEventListener("submit", (event) => {
  event.preventDefault();
  attempt(async () => {
    await ask("PUT", "/api/play/nickname", { nickname: byId("nickname").nickname.value });
    await showTables();
  });
});

fillSplits();
attempt(async () => {
  await showTables();
  if (/^#[\w-]+$/.test(location.hash)) {
    const kept = await ask("GET", `/api/play/episodes/${location.hash.slice(1)}`);
    setup.configuration.value = kept.configuration;
    fillSplits();
    setup.split.value = kept.split;
    await show(kept);
  }
});
