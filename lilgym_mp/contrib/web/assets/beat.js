// /beat: ten tasks on the board of /play, which an agent plays too. The URL's query names them, for somebody else.

let tasks = []; // ids
let begun = []; // ids of episodes, also in the state of the tab's history

const opponent = () => (setup.agent ? { agent: setup.agent.value } : {});

/** Draws the tasks that the seed determines. */
async function drawTasks(seed) {
  const query = queryOf({ configuration: setup.configuration.value, split: setup.split.value, seed, ...opponent() });
  tasks = (await request("GET", `/api/beat/tasks?${query}`)).tasks;
  begun = [];
  history.replaceState(null, "", `?${query}`);
  byId("score").textContent = "Nothing played yet.";
  byId("share").hidden = true;
  byId("rows").replaceChildren();
}

async function showScore() {
  const query = queryOf([...begun.map((id) => ["episode", id]), ...Object.entries(opponent())]);
  const { rows, verdict, summary } = await request("GET", `/api/beat/round?${query}`);
  const cell = (actions) => element("td", { class: "number" }, actions === null ? "–" : String(actions));
  const line = (row) => element("tr", {}, element("td", {}, row.statement), cell(row.you), cell(row.agent), cell(row.shortest));
  const isOver = rows.length === tasks.length;
  byId("rows").replaceChildren(...rows.map(line));
  byId("score").textContent = isOver ? `${verdict} ${summary}` : summary;
  byId("next").hidden ||= isOver;
  byId("share").hidden = !isOver;
  if (!isOver) return;
  byId("picture").src = byId("download").href = url(`/api/beat/picture?${query}`);
  byId("picture").alt = `${verdict} ${summary}`;
}

const randomSeed = () => Math.floor(1e6 * Math.random());

page.draw = (focuses) => attempt(async () => {
  await drawTasks(randomSeed());
  await page.next(focuses);
});
page.next = (focuses) => begin(tasks[begun.length], focuses);
page.began = (id) => {
  begun.push(id);
  history.replaceState(begun, "");
  byId("progress").textContent = `Task ${begun.length} of ${tasks.length}`;
};
page.ended = showScore;
page.start = async () => {
  const kept = history.state || [];
  choose(Object.fromEntries(asked));
  if (setup.agent && asked.has("agent")) select(setup.agent, asked.get("agent"));
  await drawTasks(asked.get("seed") || randomSeed());
  const last = kept.length && (await request("GET", `/api/play/episodes/${kept.at(-1)}`).catch(() => null));
  if (!last) return page.next(false);
  for (const id of kept) page.began(id);
  byId("episode").removeAttribute("aria-busy");
  await show(last);
  if (!last.over) await showScore();
};
