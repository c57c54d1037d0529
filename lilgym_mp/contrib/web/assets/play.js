"use strict";
// /play. Legality, transitions and rewards come from the server.

const setup = byId("setup");
const board = new Board(act, legal);
const expertView = new StepView(byId("expert-scene"), "A scene of the expert's solution");
const OUTCOMES = { wrong_stop: "Wrong STOP", invalid_action: "Illegal action", horizon: "Out of actions" };
let episode = null;
let shown = null; // id of the episode whose cells the board has

async function begin(taskId, focuses = true) {
  await attempt(async () => {
    const created = await request("POST", "/api/play/episodes", {
      configuration: setup.configuration.value,
      split: setup.split.value,
      rules: setup.rules.value,
      strict: setup.strict.checked,
      player: setup.player.value,
      task_id: taskId,
    });
    byId("expert").hidden = true;
    history.replaceState(null, "", `#${created.id}`);
    await show(created);
    if (focuses) board.focus();
  }, byId("episode"));
}

async function show(state) {
  episode = state;
  board.removable = state.removable;
  board.view.show(state.scene);
  board.showGhost(board.hovered);
  byId("statement").textContent = state.statement;
  byId("target").textContent = state.target ? "true" : "false";
  byId("left").textContent = state.over ? "" : `Actions left: ${state.actions_left}.`;
  byId("reward").textContent = state.reward.toFixed(1);
  byId("history").textContent = state.actions.length ? `So far: ${state.actions.join(", ")}` : "";
  byId("scatter-item-type").hidden = !state.grid;
  if (shown !== state.id) board.makeCells(state.grid);
  shown = state.id;
  board.enable(!state.over);
  for (const name of ["tools", "stop", "legal"]) byId(name).hidden = state.over;
  byId("messages").classList.toggle("reserved", !state.over);
  for (const name of ["end", "next", "why"]) byId(name).hidden = !state.over;
  await board.mark();
  byId("why").open &&= state.over;
  if (!state.over) return;
  await explain();
}

async function legal(query) {
  if (!episode || episode.over) return [];
  return (await request("GET", `/api/play/episodes/${episode.id}/legal?${query}`)).actions;
}

async function act(action) {
  if (!episode || episode.over) return;
  await attempt(async () => {
    const path = `/api/play/episodes/${episode.id}`;
    try {
      await show(await request("POST", `${path}/actions`, { action, steps: episode.steps }));
    } catch (fault) {
      if (fault.status === 409) await show(await request("GET", path));
      throw fault;
    }
  }, byId("board"));
}

async function explain() {
  const path = `/api/play/episodes/${episode.id}`;
  const explanation = await request("GET", `${path}/explanation`);
  const count = episode.actions.length === 1 ? "1 action" : `${episode.actions.length} actions`;
  byId("end-title").textContent = episode.outcome === "success" ? `Solved in ${count}` : OUTCOMES[episode.outcome];
  byId("end-title").className = episode.outcome === "success" ? "good" : "bad";
  byId("rule").textContent = explanation.invalid_reason ? `${explanation.rule} Reason: ${explanation.invalid_reason}.` : explanation.rule;
  byId("verdict").textContent = `In the last scene the statement is ${explanation.truth}; the target was ${explanation.target}. Reward: ${episode.reward.toFixed(1)}.`;
  byId("parts").replaceChildren(partsList(explanation.parts, board.view));
  byId("end-title").focus();
  if (episode.outcome !== "success") return;
  const ended = episode;
  const solution = await request("POST", `${path}/solution`).catch(() => ({ found: false })); // there may be no expert
  if (ended !== episode || !solution.found) return;
  const isShortest = episode.actions.length <= solution.steps.length;
  byId("end-title").textContent += isShortest ? ", the shortest possible" : `; the expert needs ${solution.steps.length}`;
}

async function showExpert() {
  await attempt(async () => {
    const expert = await request("POST", `/api/play/episodes/${episode.id}/solution`);
    byId("expert").hidden = false;
    const optimality = expert.proven_shortest ? "No shorter solution exists." : "A shorter one may exist.";
    byId("expert-line").textContent = expert.found ? `${expert.steps.length} actions. ${optimality}` : `No solution was found: ${expert.reason}`;
    expertView.show(expert.start, expert.steps);
    byId("expert").scrollIntoView({ block: "nearest" });
    expertView.forth.focus({ preventScroll: true });
  }, byId("expert"));
}

const press = (id) => () => !byId(id).hidden && byId(id).click();
onKeys(byId("episode"), { ...board.keys, t: press("stop"), n: press("next"), r: press("again"), e: press("solution"), p: () => board.focus() });

let searchCount = 0; // identifies the latest search
async function search() {
  searchCount += 1;
  const current = searchCount;
  await attempt(async () => {
    const query = new URLSearchParams({ configuration: setup.configuration.value, split: setup.split.value, text: byId("search").value });
    const found = await request("GET", `/api/play/tasks?${query}`);
    if (current !== searchCount) return;
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
setup.addEventListener("change", (event) => {
  if (event.target.name === "configuration") fillSplits(setup);
  if (["configuration", "split"].includes(event.target.name)) begin(null, false);
  if (["rules", "strict"].includes(event.target.name)) begin(episode.task_id, false);
  if (byId("chooser").open) search();
});
byId("chooser").addEventListener("toggle", () => byId("chooser").open && search());
byId("search").addEventListener("input", search);
byId("stop").addEventListener("click", () => act("STOP"));
byId("next").addEventListener("click", () => begin(null));
byId("again").addEventListener("click", () => begin(episode.task_id));
byId("solution").addEventListener("click", showExpert);

fillSplits(setup);
attempt(async () => {
  if (/^#[\w-]+$/.test(location.hash)) {
    const kept = await request("GET", `/api/play/episodes/${location.hash.slice(1)}`);
    setup.configuration.value = kept.configuration;
    fillSplits(setup);
    setup.split.value = kept.split;
    await show(kept);
    byId("episode").removeAttribute("aria-busy");
  } else {
    const query = new URLSearchParams(location.search);
    for (const name of ["configuration", "split"]) {
      if (query.has(name)) setup[name].value = query.get(name);
      fillSplits(setup);
    }
    await begin(query.get("task"), false);
  }
});
