// /game. The URL fragment is the seat's key; everything shown comes from the server's responses.

const setup = byId("setup");
const board = new Board(act, legal);
const POLL_MILLISECONDS = 1500;
let key = null;
let otherKey = null;
let seat = null;
let shownText = ""; // JSON of the seat as last shown

function showProtocol() {
  for (const line of document.querySelectorAll("[data-protocol]")) line.hidden = line.dataset.protocol !== setup.protocol.value;
}

// Field values by the name of a preset.
const PRESETS = {
  propose: { protocol: "veto", rewards: "common", proposer: "person", verifier: "oracle" },
  judge: { protocol: "veto", rewards: "common", proposer: "expert", verifier: "person" },
  catch: { protocol: "audit", rewards: "hidden", proposer: "expert", verifier: "person" },
  together: { protocol: "veto", rewards: "common", proposer: "person", verifier: "person" },
};

function applyPreset() {
  for (const [name, value] of Object.entries(PRESETS[byId("preset").value] || {})) setup.elements[name].value = value;
  showProtocol();
}

const begin = () => isBusy("seat") || attempt(async () => {
  const created = await request("POST", "/api/game/games", Object.fromEntries(new FormData(setup)));
  otherKey = created.proposer && created.verifier ? created.verifier : null;
  await takeSeat(created.proposer || created.verifier);
}, byId("seat"));

async function takeSeat(newKey) {
  key = newKey;
  seat = null;
  shownText = "";
  board.cells.replaceChildren();
  history.replaceState(null, "", `#${key}`);
  await refresh();
  byId("seat-title").focus();
}

/** Requests the seat's view; redraws only if it has changed. */
async function refresh() {
  const requested = key;
  const view = await request("GET", `/api/game/seats/${requested}`);
  if (requested === key) await show(view);
}

async function show(view) {
  const text = JSON.stringify(view);
  if (text === shownText) return;
  shownText = text;
  seat = view;
  byId("nothing").hidden = true;
  byId("seat").hidden = false;
  byId("seat-title").textContent = `You are the ${seat.role}, playing with ${seat.opposite === "person" ? "a person" : seat.opposite.replace(/^(agent|run):/, "").replaceAll("_", " ")}`;
  byId("other-seat").hidden = !otherKey;
  byId("link").textContent = byId("link").href = `${location.href.split("#")[0]}#${otherKey}`;
  byId("statement").textContent = seat.statement;
  byId("task-line").textContent = taskLine();
  byId("turn").className = "notice";
  byId("turn").textContent = turnLine();
  byId("proposal").textContent = seat.proposal ? `Proposed: ${seat.proposal}` : "";
  const agrees = (answer) => ["accept", "holds"].includes(answer);
  seat.answers.sort((one, other) => agrees(other) - agrees(one)); // key 1 agrees
  showEnd();
  byId("proposing").hidden = seat.role !== "proposer" || !seat.your_turn;
  byId("scatter-item-type").hidden = !seat.grid;
  byId("stop").disabled = !seat.may_stop;
  showScene();
  showAnswers();
  showPast();
  await board.mark();
  document.title = `${seat.your_turn ? "Your turn · " : ""}Game · lilgym-mp`;
}

function taskLine() {
  const parts = [`Make it ${seat.target}.`];
  if (seat.intent) parts.push(seat.intent === "deceptive" ? "You are deceptive: get a false claim accepted." : "You are helpful: get a true claim accepted.");
  if (seat.message) parts.push(`The other player's last message: ${seat.message} (players agree on what numbers mean).`);
  parts.push(...(seat.over ? [] : [`Round ${seat.round} of ${seat.horizon}.`]), `Protocol ${seat.protocol}, ${seat.configuration}.`);
  return parts.join(" ");
}

function turnLine() {
  if (seat.over) return `The game is over: ${seat.end.reached ? "the goal was reached" : "the goal was missed"}. Your reward: ${signed(seat.reward, 2)}.`;
  if (seat.waiting_for_other) return "You have chosen; waiting for the other player.";
  return seat.your_turn ? "It is your turn." : "The other player is choosing.";
}

function showEnd() {
  byId("end").hidden = !seat.over;
  if (!seat.over) return;
  byId("turn").className = `notice ${seat.end.reached ? "success" : "error"}`;
  const { statement, value, target, intent } = seat.end;
  byId("end-line").textContent = `“${statement}” is ${value} in the last scene; the target was ${target}. The proposer was ${intent}.`;
}

function showScene() {
  board.removable = seat.removable;
  board.view.show(seat.scene);
  board.proposed.className = "";
  if (seat.proposed_item) {
    drawGhost(board.proposed, seat.proposed_item, seat.proposal.startsWith("REMOVE"));
    board.proposed.classList.add("proposed");
  }
  if (seat.role === "proposer" && !board.cells.firstChild) board.makeCells(seat.grid);
  board.enable(seat.your_turn);
}

function showAnswers() {
  const key = (index) => (index < 9 ? element("kbd", {}, String(index + 1)) : "");
  const button = (answer, index) => element("button", { type: "button", click: () => act(answer) }, answer, " ", key(index));
  byId("answers").replaceChildren(...seat.answers.map(button));
}

function showPast() {
  const title = "One of the numbers that players may send. It has no fixed meaning: trained pairs agree on one.";
  const sent = (number) => (number ? [" with ", element("abbr", { title }, `message ${number}`)] : []);
  const turns = seat.history.map((turn) => [
    ...(turn.proposal ? [`proposed ${turn.proposal}`, ...sent(turn.proposer_message)] : []),
    ...(turn.answer ? [turn.proposal ? ", " : "", `answered “${turn.answer}”`, ...sent(turn.verifier_message)] : []),
  ]);
  const seen = turns.filter((parts) => parts.length).map((parts) => element("li", {}, ...parts));
  byId("past").replaceChildren(...(seen.length ? seen : [element("li", { class: "soft" }, "Nothing yet.")]));
}

async function legal() {
  if (!seat || !seat.your_turn || seat.role !== "proposer") return [];
  return (await request("GET", `/api/game/seats/${key}/legal`)).actions;
}

function act(action) {
  const count = seat?.own_actions.length; // if it differs later, the partner may have moved
  return actOn(`/api/game/seats/${key}`, action, () => (seat?.your_turn && seat.own_actions.length === count ? { own_actions: count } : null), show);
}

const proposing = (key) => () => seat.role === "proposer" && board.keys[key]();
const answering = (key) => () => key <= seat.answers.length && act(seat.answers[key - 1]);
onKeys(byId("seat"), {
  ...Object.fromEntries(Object.keys(board.keys).map((key) => [key, proposing(key)])),
  ...Object.fromEntries([1, 2, 3, 4, 5, 6, 7, 8, 9].map((key) => [key, answering(key)])),
  n: () => seat.over && begin(),
  t: () => seat.may_stop && act("STOP"),
});

setup.addEventListener("submit", (event) => {
  event.preventDefault();
  begin();
});
on("preset", "change", applyPreset);
on("more", "change", () => { byId("preset").value = "own"; });
on("again", "click", begin);
setup.protocol.addEventListener("change", showProtocol);
on("stop", "click", () => act("STOP"));
// Polls for the other player's actions, except while the window is hidden.
setInterval(() => {
  if (seat && !seat.over && !seat.your_turn && !document.hidden) refresh().catch(() => {});
}, POLL_MILLISECONDS);

const takeSeatFromUrl = () => /^#[\w-]+$/.test(location.hash) && attempt(() => takeSeat(location.hash.slice(1)));
window.addEventListener("hashchange", () => location.hash.slice(1) !== key && takeSeatFromUrl());
showProtocol();
takeSeatFromUrl();
