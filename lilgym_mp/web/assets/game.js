"use strict";
// The page /game. A seat is known by its key, which stands after the # of the address; all that is shown is the server's answer.

const setup = byId("setup");
const look = { kind: "ADD", shape: "CIRCLE", size: "SMALL", colour: "YELLOW" };
const board = new SceneView("The scene");
const cells = element("div", { class: "cells", role: "group", "aria-label": "Places in the picture" });
const BOXES = ["LEFT", "MIDDLE", "RIGHT"];
const POLL_MILLISECONDS = 1500;
const PROTOCOLS = {
  veto: "Veto: the verifier accepts or rejects each proposal; a rejection spends the round.",
  joint: "Joint: both choose at once; the verifier says whether to stop.",
  audit: "Audit: the proposer edits alone; its STOP is a claim that the verifier judges, which ends the game.",
  critique: "Critique: as veto, but a rejection is free for some times, and the verifier may say a word with it.",
};
let key = null;
let otherKey = null;
let seat = null;
let told = "";
let showsLegal = false;

board.root.append(cells);
byId("board").append(board.root);

function fillSplits() {
  const splits = JSON.parse(setup.configuration.selectedOptions[0].dataset.splits);
  const before = setup.split.value || "dev";
  setup.split.replaceChildren(...splits.map((split) => element("option", { value: split }, split)));
  setup.split.value = splits.includes(before) ? before : splits[0];
}

const sayProtocol = () => { byId("protocol-line").textContent = PROTOCOLS[setup.protocol.value]; };
const linkOf = (other) => `${location.origin}/game#${other}`;

async function begin() {
  await attempt(async () => {
    const chosen = Object.fromEntries(new FormData(setup));
    const made = await ask("POST", "/api/game/games", chosen);
    const mine = made.proposer || made.verifier;
    otherKey = made.proposer && made.verifier ? made.verifier : null;
    await sit(mine);
  }, byId("seat"));
}

async function sit(wanted) {
  key = wanted;
  seat = null;
  told = "";
  cells.replaceChildren();
  history.replaceState(null, "", `#${key}`);
  await lookAgain();
  byId("seat-title").focus();
}

/** Asks what the seat sees; the page changes only where the answer has. */
async function lookAgain() {
  const mine = key;
  const found = await ask("GET", `/api/game/seats/${mine}`);
  if (mine === key) await show(found);
}

async function show(found) {
  const text = JSON.stringify(found);
  if (text === told) return;
  told = text;
  seat = found;
  byId("nothing").hidden = true;
  byId("seat").hidden = false;
  byId("seat-title").textContent = `You are the ${seat.role}; opposite: ${seat.opposite === "person" ? "a person" : seat.opposite.replace(/^\w+:/, "").replaceAll("_", " ")}`;
  byId("other-seat").hidden = !otherKey;
  if (otherKey) byId("link").value = linkOf(otherKey);
  byId("statement").textContent = seat.statement === null ? "You do not see the statement." : seat.statement;
  byId("task-line").textContent = taskLine();
  byId("turn").textContent = turnLine();
  byId("proposal").textContent = seat.proposal ? `Proposed: ${seat.proposal}` : "";
  byId("proposing").hidden = seat.role !== "proposer" || !seat.your_turn;
  byId("scatter-look").hidden = !seat.grid;
  byId("stop").disabled = !seat.may_stop;
  showScene();
  showAnswers();
  showPast();
  await showLegal();
  document.title = `${seat.your_turn ? "Your turn · " : ""}Game · lilgym-mp`;
}

function taskLine() {
  const parts = [seat.target === null ? "You do not see the target." : `Make it ${seat.target}.`];
  if (seat.intent) parts.push(seat.intent === "sneaky" ? "You are sneaky: get a false claim accepted." : "You are helpful: get a true claim accepted.");
  if (seat.message) parts.push(`The other's last word: ${seat.message}.`);
  parts.push(`${seat.protocol}, ${seat.configuration}, at most ${seat.horizon} rounds.`);
  return parts.join(" ");
}

function turnLine() {
  if (seat.over) return `The game is over. Your reward: ${seat.reward.toFixed(2)}.`;
  if (seat.waiting_for_other) return "You have chosen; the other has not yet.";
  return seat.your_turn ? "It is your turn." : "The other is choosing.";
}

function showScene() {
  board.root.classList.toggle("unseen", seat.scene === null);
  if (seat.scene) board.show(seat.scene);
  else {
    board.image.removeAttribute("src");
    board.image.alt = "You do not see the scene.";
  }
  if (seat.role === "proposer" && !cells.firstChild) makeCells();
  for (const button of cells.children) button.disabled = !seat.your_turn;
}

function makeCells() {
  const [columns, rows] = seat.grid || [3, 1];
  byId("board").classList.toggle("fine", Boolean(seat.grid));
  for (let row = 0; row < rows; row += 1) {
    for (let column = 0; column < columns; column += 1) {
      const name = seat.grid ? `column ${column}, row ${row}` : `${BOXES[column].toLowerCase()} box`;
      const cell = element("button", { type: "button", tabindex: -1, "aria-label": name, click: () => act(actionAt(cell)) });
      Object.assign(cell.dataset, { column, row });
      if (seat.grid) place(cell, (column * IMAGE_WIDTH) / columns, (row * IMAGE_HEIGHT) / rows, IMAGE_WIDTH / columns, IMAGE_HEIGHT / rows);
      else place(cell, column * 140, 0, 100, 100);
      cells.append(cell);
    }
  }
  cells.firstChild.tabIndex = 0;
}

function actionAt(cell) {
  const { column, row } = cell.dataset;
  if (!seat.grid) return look.kind === "ADD" ? `ADD(${BOXES[column]}, ${look.colour})` : `REMOVE(${BOXES[column]})`;
  return look.kind === "ADD" ? `ADD(${column}, ${row}, ${look.shape}, ${look.colour}, ${look.size})` : `REMOVE(${column}, ${row})`;
}

function showAnswers() {
  byId("answers").replaceChildren(
    ...seat.answers.map((answer, index) =>
      element("button", { type: "button", click: () => act(answer) }, answer, " ", index < 9 ? element("kbd", {}, String(index + 1)) : ""),
    ),
  );
}

function showPast() {
  const turns = seat.history.map((turn) => {
    const parts = [];
    if (turn.proposal) parts.push(`proposed ${turn.proposal}`);
    if (turn.answer) parts.push(`answered “${turn.answer}”`);
    if (turn.verifier_word) parts.push(`word ${turn.verifier_word}`);
    return parts.join(", ");
  });
  const seen = turns.filter(Boolean);
  byId("past").replaceChildren(...(seen.length ? seen.map((turn) => element("li", {}, turn)) : [element("li", { class: "soft" }, "Nothing yet.")]));
}

async function showLegal() {
  const names = new Set();
  if (showsLegal && seat && seat.your_turn && seat.role === "proposer") {
    const query = new URLSearchParams({ shape: look.shape, colour: look.colour, size: look.size });
    (await ask("GET", `/api/game/seats/${key}/legal?${query}`)).actions.forEach((name) => names.add(name));
  }
  for (const cell of cells.children) cell.classList.toggle("legal", names.has(actionAt(cell)));
}

async function act(action) {
  if (!seat || !seat.your_turn) return;
  await attempt(async () => {
    try {
      await show(await ask("POST", `/api/game/seats/${key}/actions`, { action, own_actions: seat.own_actions.length }));
    } catch (fault) {
      if (fault.status === 409) await lookAgain();
      throw fault;
    }
  }, byId("board"));
}

function choose(name, value) {
  look[name] = value;
  for (const button of document.querySelectorAll(`[data-choice="${name}"] button`)) button.setAttribute("aria-pressed", String(button.dataset.value === value));
  attempt(showLegal);
}

function chooseNext(name) {
  const values = [...document.querySelectorAll(`[data-choice="${name}"] button`)].map((button) => button.dataset.value);
  choose(name, values[(values.indexOf(look[name]) + 1) % values.length]);
}

function toggleLegal() {
  showsLegal = !showsLegal;
  byId("legal").setAttribute("aria-pressed", String(showsLegal));
  attempt(showLegal);
}

moveWithArrows(cells, () => seat.grid || [3, 1]);

const KEYS = { a: () => chooseNext("kind"), s: () => chooseNext("shape"), z: () => chooseNext("size"), c: () => chooseNext("colour"), l: toggleLegal };
byId("seat").addEventListener("keydown", (event) => {
  if (event.ctrlKey || event.metaKey || event.altKey || event.target.closest("input, select") || !seat) return;
  const pressed = event.key.toLowerCase();
  const answer = /^[1-9]$/.test(pressed) ? seat.answers[Number(pressed) - 1] : null;
  if (!answer && !(pressed in KEYS && seat.role === "proposer")) return;
  event.preventDefault();
  if (answer) act(answer);
  else KEYS[pressed]();
});

setup.addEventListener("submit", (event) => {
  event.preventDefault();
  begin();
});
setup.configuration.addEventListener("change", fillSplits);
setup.protocol.addEventListener("change", sayProtocol);
byId("stop").addEventListener("click", () => act("STOP"));
byId("legal").addEventListener("click", toggleLegal);
byId("swap").addEventListener("click", () => {
  const next = otherKey;
  otherKey = key;
  attempt(() => sit(next));
});
byId("copy").addEventListener("click", async () => {
  byId("link").select();
  try {
    await navigator.clipboard.writeText(byId("link").value);
    say("The link is copied.");
  } catch {
    say("Copy the marked link.");
  }
});
for (const group of document.querySelectorAll("[data-choice]")) {
  group.addEventListener("click", (event) => {
    const button = event.target.closest("button");
    if (button) choose(group.dataset.choice, button.dataset.value);
  });
}

// What another person does is seen by asking; a window that nobody looks at does not ask.
setInterval(() => {
  if (seat && !seat.over && !seat.your_turn && !document.hidden) lookAgain().catch(() => {});
}, POLL_MILLISECONDS);

const fromAddress = () => /^#[\w-]+$/.test(location.hash) && attempt(() => sit(location.hash.slice(1)));
window.addEventListener("hashchange", () => location.hash.slice(1) !== key && fromAddress());
fillSplits();
sayProtocol();
fromAddress();
