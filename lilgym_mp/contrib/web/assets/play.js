// /play and the start page; /beat changes what is in `page`. Legality, transitions and rewards come from the server.

const setup = byId("setup");
const board = new Board(act, legal);
const expertView = new StepView(byId("expert-scene"), "A scene of the expert's solution");
const OUTCOMES = { wrong_stop: "Wrong STOP", horizon: "Out of actions" };
const asked = new URLSearchParams(location.search);
let episode = null;

/** What the page does when it opens, when a task is drawn, after an episode, when one has begun, and when one has ended. */
const page = {
  start: continueOrBegin,
  draw: (focuses) => begin(null, focuses),
  next: (focuses) => begin(null, focuses),
  began: (id) => history.replaceState(null, "", `#${id}`),
  ended: () => {},
};

/** Fills the form's split menu with those of the selected configuration. */
function fillSplits(form) {
  const sizes = JSON.parse(form.dataset.sizes)[form.configuration.value];
  const previous = form.split.value || "dev";
  form.split.replaceChildren(...Object.entries(sizes).map(([split, count]) => element("option", { value: split }, `${split} (${count})`)));
  form.split.value = previous in sizes ? previous : Object.keys(sizes)[0];
}

const begin = (taskId, focuses = true) => attempt(() => draw(taskId, focuses), byId("episode"));

async function draw(taskId, focuses) {
  const [configuration, split, player] = [setup.configuration.value, setup.split.value, asked.get("player") || ""];
  const created = await request("POST", "/api/play/episodes", { configuration, split, player, task_id: taskId });
  byId("expert").hidden = true;
  page.began(created.id);
  await show(created);
  if (focuses) board.focus();
}

async function show(state) {
  const isAnother = state.id !== episode?.id;
  episode = state;
  board.removable = state.removable;
  board.view.show(state.scene);
  board.showGhost(board.hovered);
  byId("statement").textContent = state.statement;
  byId("target").textContent = String(state.target);
  byId("left").textContent = state.over ? "" : `Actions left: ${state.actions_left}.`;
  byId("reward").textContent = signed(state.reward);
  byId("history").textContent = state.actions.length ? `So far: ${state.actions.join(", ")}` : "";
  byId("scatter-item-type").hidden = !state.grid;
  if (isAnother) board.makeCells(state.grid);
  board.enable(!state.over);
  for (const id of ["tools", "stop", "legal"]) byId(id).hidden = state.over;
  byId("messages").classList.toggle("reserved", !state.over);
  for (const id of ["end", "next", "why"]) byId(id).hidden = !state.over;
  await board.mark();
  byId("why").open &&= state.over;
  if (state.over) await showEnd();
}

async function legal() {
  if (!episode || episode.over) return [];
  return (await request("GET", `/api/play/episodes/${episode.id}/legal`)).actions;
}

function act(action) {
  const id = episode?.id;
  return actOn(`/api/play/episodes/${id}`, action, () => (episode?.id === id && !episode?.over ? { steps: episode.steps } : null), show);
}

async function showEnd() {
  const ended = episode;
  const { truth, parts } = ended.end;
  const solved = ended.outcome === "success";
  byId("end-title").textContent = solved ? `Solved in ${plural(ended.actions.length, "action")}` : OUTCOMES[ended.outcome];
  byId("end-title").className = solved ? "good" : "bad";
  byId("verdict").textContent = `The statement is ${truth}; the target was ${ended.target}. Reward: ${signed(ended.reward)}.`;
  byId("parts").replaceChildren(partsList(parts, board.view));
  byId("end-title").focus();
  await page.ended(ended);
  if (!solved) return;
  const solution = await request("POST", `/api/play/episodes/${ended.id}/solution`).catch(() => ({ found: false })); // there may be no expert
  if (ended !== episode || !solution.found) return;
  const isShortest = ended.actions.length <= solution.steps.length;
  byId("end-title").textContent += isShortest ? ", the shortest possible" : `; the expert needs ${solution.steps.length}`;
}

async function showExpert() {
  await attempt(async () => {
    const { id } = episode;
    const expert = await request("POST", `/api/play/episodes/${id}/solution`, undefined, () => id === episode.id);
    byId("expert").hidden = false;
    const optimality = expert.proven_shortest ? "No shorter solution exists." : "A shorter one may exist.";
    byId("expert-line").textContent = expert.found
      ? `${plural(expert.steps.length, "action")}. ${optimality}`
      : `No solution was found: ${expert.reason}`;
    expertView.show(expert.start, expert.steps);
    byId("expert").scrollIntoView({ block: "nearest" });
    expertView.forth.focus({ preventScroll: true });
  }, byId("expert"));
}

/** Continues the episode that the URL's fragment names, or begins one with what the query names. */
async function continueOrBegin() {
  if (/^#[\w-]+$/.test(location.hash)) {
    const kept = await request("GET", `/api/play/episodes/${location.hash.slice(1)}`);
    choose(kept);
    await show(kept);
    byId("episode").removeAttribute("aria-busy");
  } else {
    choose(Object.fromEntries(asked));
    await draw(asked.get("task"), false);
  }
}

/** Opens the page; if what its address names does not exist, says so beside a task that does. */
async function open() {
  fillSplits(setup);
  const fault = await page.start().catch((raised) => raised);
  if (fault?.status === undefined && fault) throw fault;
  if (!fault) return;
  await page.draw(false);
  showMessage(`${fault.message}. This is another task.`, "error");
}

function choose({ configuration, split }) {
  if (configuration) select(setup.configuration, configuration);
  if (configuration) fillSplits(setup);
  if (split) select(setup.split, split);
}

const press = (id) => () => byId(id)?.checkVisibility() && byId(id).click();
const keys = { t: press("stop"), n: press("next"), r: press("again"), e: press("solution") };
onKeys(byId("episode").parentElement, { ...board.keys, ...keys });
on("setup", "submit", (event) => {
  event.preventDefault();
  page.draw(true);
});
on("setup", "change", (event) => {
  if (event.target.name === "configuration") fillSplits(setup);
  page.draw(false);
});
on("stop", "click", () => act("STOP"));
on("next", "click", () => isBusy("episode") || page.next(true));
on("again", "click", () => isBusy("episode") || begin(episode.task_id));
on("solution", "click", showExpert);
document.addEventListener("DOMContentLoaded", () => attempt(open, byId("episode"))); // after all scripts
