// /watch: recorded episodes step by step; optionally two recordings side by side.

const STEP_MILLISECONDS = 900; // while playing
const MAX_LISTED = 200; // episodes
const filters = byId("filters");
const sides = [];
let listed = [];
let recording = null;
let step = 0;
let showsHeat = true;
let openCount = 0; // identifies the latest request for an episode, so that a late response is dropped

/** Options for recordings, with the file, as several may have the same agent and tasks. */
function recordingOptions(recordings) {
  const title = (line) => `${line.agent}: ${line.configuration}, ${line.split} · ${line.name}`;
  return recordings.map((line) => element("option", { value: line.id }, title(line)));
}

function svg(tag, attributes = {}, ...children) {
  const created = document.createElementNS("http://www.w3.org/2000/svg", tag);
  for (const [name, value] of Object.entries(attributes)) created.setAttribute(name, value);
  created.append(...children);
  return created;
}

/** The item's outline, a little larger than the item, in native pixels. */
function itemShape({ shape, x, y, side }) {
  const [left, top, right, bottom] = [x - 1, y - 1, x + side + 1, y + side + 1];
  if (shape === "circle") return svg("circle", { cx: x + side / 2, cy: y + side / 2, r: side / 2 + 1 });
  const corners = `${x + side / 2},${top - 2} ${right + 1},${bottom} ${left - 1},${bottom}`;
  if (shape === "triangle") return svg("polygon", { points: corners });
  return svg("rect", { x: left, y: top, width: right - left, height: bottom - top });
}

function barList(title, bars) {
  return element("div", {}, element("h3", {}, title), element("ul", { class: "bars" }, ...bars));
}

/** Panel with an episode of one recording. */
class Side {
  constructor(recording, episode) {
    this.episode = episode;
    this.view = new SceneView("The scene");
    this.heat = svg("svg", { class: "heat", viewBox: `0 0 ${IMAGE_WIDTH} ${IMAGE_HEIGHT}`, "aria-hidden": "true" });
    this.view.root.append(this.heat);
    this.maskId = `items-${sides.length}`;
    this.strip = element("ol", { class: "strip", "aria-label": "Steps" }, ...episode.steps.map(stripEntry));
    this.step = element("p", { role: "status" });
    this.predictions = element("div");
    const seen = episode.form_seen ? "its form was seen in training" : "not seen in training";
    const details = facts({
      Task: episode.task,
      Recording: recording.name,
      Statement: episode.statement_seen ? "seen in training" : seen,
      "Shortest solution": episode.optimal_actions === null ? null : plural(episode.optimal_actions, "action"),
    });
    const reason = episode.invalid_reason ? `: ${words(episode.invalid_reason)}` : "";
    const end = element("span", { class: judgement(episode) }, `${words(episode.outcome)}${reason}`);
    this.root = element("section", { class: "panel side" },
      element("h2", {}, recording.agent),
      element("p", { class: "statement" }, episode.statement),
      element("p", {}, `Make it ${episode.target}. `, end, `, reward ${signed(episode.total)}.`),
      this.view.root, this.step, this.predictions, this.strip,
      element("details", {}, element("summary", {}, "Program and task"), element("pre", {}, episode.program), details));
  }

  show(wanted) {
    const index = Math.min(wanted, this.episode.steps.length - 1);
    const shown = this.episode.steps[index];
    this.view.show(shown.scene);
    this.step.textContent = shown.action
      ? `Step ${index + 1}: ${shown.action}, reward ${signed(shown.reward)}`
      : `End: ${words(this.episode.outcome)}`;
    [...this.strip.querySelectorAll("button")].forEach((button, place) => {
      button.removeAttribute("aria-current");
      if (place !== index) return;
      button.setAttribute("aria-current", "step");
      this.strip.scrollLeft = button.offsetLeft - this.strip.offsetLeft - 60;
    });
    const cells = shown.decision && showsHeat ? [...shown.decision.add_cells, ...shown.decision.remove_cells] : [];
    const shares = new Map();
    for (const [cell, share] of cells) shares.set(cell, (shares.get(cell) || 0) + share);
    const overlays = [...shares].map(([cell, share]) => this.overlay(cell, share));
    this.heat.replaceChildren(this.mask(), svg("g", { mask: `url(#${this.maskId})` }, ...overlays));
    this.predictions.replaceChildren(...(shown.action ? this.decision(shown) : []));
  }

  /** The more probable an action in the cell, the more opaque. */
  overlay(cell, share) {
    const [columns, rows] = this.episode.grid;
    const [column, row] = [Math.floor(cell / rows), cell % rows];
    const opacity = 0.6 * Math.sqrt(Math.min(1, share));
    const looks = { opacity, fill: "#d6006c" };
    if (columns === 3) return svg("rect", { x: column * 140, y: 0, width: 100, height: 100, ...looks });
    const [width, height] = [IMAGE_WIDTH / columns, IMAGE_HEIGHT / rows];
    return svg("rect", { x: column * width, y: row * height, width, height, ...looks });
  }

  /** Hides the heat map where items are, so that it changes no item's colour. */
  mask() {
    const size = { x: 0, y: 0, width: IMAGE_WIDTH, height: IMAGE_HEIGHT };
    const items = this.view.scene.items.map(itemShape);
    return svg("mask", { id: this.maskId, maskUnits: "userSpaceOnUse", ...size }, svg("rect", { ...size, fill: "white" }), ...items);
  }

  /** The agent's predictions before the action. */
  decision({ action, decision }) {
    const command = element("code", {}, "lilgym-mp evaluate AGENT --record DIR --record-decisions");
    if (!decision) return [element("p", { class: "notice" }, "The agent's predictions were not recorded. Record them with ", command)];
    const kinds = ["STOP", "ADD", "REMOVE"].map((kind, index) => bar(kind, decision.types[index], action.startsWith(kind)));
    const likeliest = decision.likeliest.map(([name, share]) => bar(name, share, name === action));
    const parts = [barList("Type of action", kinds), barList("Likeliest actions", likeliest)];
    const readings = Object.entries(decision.programs);
    const holds = (program) => decision.satisfied.includes(program);
    const satisfied = readings.filter(([program]) => holds(program)).reduce((sum, [, share]) => sum + share, 0);
    if (readings.length) {
      const bars = readings.map(([program, share]) => bar(programCode(program), share, holds(program), true));
      parts.push(barList(`Readings, ✓ if ${this.episode.target} in this scene`, bars));
    }
    if (decision.notes.length) {
      const notes = decision.notes.map((note) => element("p", { class: "notice" }, note));
      parts.push(element("div", {}, element("h3", {}, "About the statement"), ...notes));
    }
    const [stops, adds, removes] = decision.legal;
    const legal = `${stops} STOP, ${adds} ADD, ${removes} REMOVE`;
    const optimal = decision.optimal ? "yes" : "no";
    const known = facts({
      "Satisfied readings": readings.length ? `${percent(satisfied)} of the probability` : null,
      "It stops": readings.length ? "when its plan has no action left" : "when it chooses STOP",
      Value: decision.value === null ? null : decision.value.toFixed(2),
      "Predicted success of the plan": decision.success_probability === null ? null : percent(decision.success_probability),
      "Legal actions": `${legal}; total probability ${percent(decision.legal_probability)}`,
      "Optimal according to the expert": decision.steps_to_go === null ? null : decision.optimal === null ? "unknown" : optimal,
      "Shortest solution from here": decision.steps_to_go === null ? null : plural(decision.steps_to_go, "action"),
    });
    return [element("div", { class: "beliefs" }, ...parts), known];
  }
}

const judgement = (episode) => (episode.outcome === "success" ? "good" : "bad");

function stripEntry({ action, scene }, index) {
  const image = element("img", { src: scene.picture, alt: "", width: 190, height: 50 });
  const title = element("span", {}, action ? `${index + 1}. ${action}` : "End");
  return element("li", {}, element("button", { type: "button", click: () => showStep(index) }, image, title));
}

let playing = 0; // timer

function pause() {
  clearInterval(playing);
  playing = 0;
  labelPlay("▶", "Play");
}

function labelPlay(sign, title) {
  byId("play").textContent = sign;
  byId("play").setAttribute("aria-label", title);
}

function togglePlay() {
  if (playing) return pause();
  if (byId("forth").disabled) showStep(0);
  playing = setInterval(() => (byId("forth").disabled ? pause() : showStep(step + 1)), STEP_MILLISECONDS);
  labelPlay("❚❚", "Pause");
}

function showStep(wanted) {
  const longest = Math.max(...sides.map((side) => side.episode.steps.length)) - 1;
  step = Math.max(0, Math.min(longest, wanted));
  for (const side of sides) side.show(step);
  byId("step-line").textContent = step === longest ? `End, after ${plural(longest, "step")}` : `Step ${step + 1} of ${longest}`;
  byId("back").disabled = step === 0;
  byId("forth").disabled = step === longest;
}

/** Stores the values in the URL's query, so that the view can be reloaded and shared; "" removes a value. */
function remember(values) {
  const query = { ...Object.fromEntries(new URLSearchParams(location.search)), ...values };
  history.replaceState(null, "", `?${queryOf(Object.entries(query).filter(([, value]) => value !== ""))}`);
}

async function openRecording(id) {
  byId("recording").value = id;
  recording = await request("GET", `/api/watch/recordings/${id}`, undefined, () => byId("recording").value === id);
  const { agent, configuration, outcomes, successes, episodes, split, rules, mask } = recording;
  byId("about").hidden = byId("finder").hidden = false;
  byId("about-title").textContent = `${agent}, ${configuration}`;
  const ends = Object.entries(outcomes).map(([name, count]) => `${words(name)} ${count}`).join(", ");
  const share = percent(successes / Math.max(1, episodes));
  byId("about-line").textContent =
    `${successes} of ${episodes} episodes succeeded (${share}): ${ends}. Corpus ${recording.corpus}, split ${split}, rules ${rules}, ` +
    `actions ${recording.actions}, ${mask ? "with" : "without"} action mask. Learned from: ${recording.supervision}.`;
  byId("beside").replaceChildren(element("option", { value: "" }, "nothing"), ...recordingOptions(recording.comparable));
  remember({ recording: id });
}

/** Lists the recording's episodes that match the filters. */
function listEpisodes() {
  const text = filters.text.value.toLowerCase();
  const wants = { outcome: filters.outcome.value, statement_seen: filters.seen.value };
  const hasText = (line) => `${line.statement} ${line.task}`.toLowerCase().includes(text);
  const matches = (line) => Object.entries(wants).every(([name, value]) => !value || String(line[name]) === value);
  const found = recording.played.filter((line) => matches(line) && hasText(line));
  listed = found.slice(0, MAX_LISTED);
  const shown = listed.length < found.length ? `; the first ${listed.length} are listed` : "";
  byId("total").textContent = found.length ? `${plural(found.length, "episode")}${shown}` : "No episode matches these filters.";
  byId("episodes").hidden = !found.length;
  byId("episodes").replaceChildren(...listed.map(episodeEntry));
}

function episodeEntry(line) {
  const picture = url(`/api/watch/recordings/${recording.id}/episodes/${line.index}/picture`);
  const open = () => attempt(() => openEpisode(line.index, 0, true), byId("viewer"));
  const image = element("img", { src: picture, alt: "", width: 114, height: 30, loading: "lazy" });
  const end = element("span", { class: judgement(line) }, `${words(line.outcome)}, ${line.actions}`);
  const title = element("span", {}, `${line.statement} (${line.target})`);
  return element("li", {}, element("button", { type: "button", "data-index": line.index, click: open }, image, title, end));
}

/** Shows the first of the episodes found, or none. */
async function openFirst() {
  listEpisodes();
  if (listed.length) return openEpisode(listed[0].index);
  openCount += 1;
  pause();
  sides.length = 0;
  byId("viewer").hidden = true;
  remember({ episode: "" });
}

async function openEpisode(index, initialStep = 0, focuses = false) {
  const current = (openCount += 1);
  const isWanted = () => current === openCount;
  pause();
  const opened = [[recording, index]];
  if (byId("beside").value) {
    const other = await request("GET", `/api/watch/recordings/${byId("beside").value}`, undefined, isWanted);
    const same = other.played.find((line) => line.task === recording.played[index].task);
    if (same) opened.push([other, same.index]);
    else showMessage("The other recording has no episode of this task.");
  }
  const episodes = await Promise.all(opened.map(([{ id }, at]) => request("GET", `/api/watch/recordings/${id}/episodes/${at}`, undefined, isWanted)));
  sides.length = 0;
  opened.forEach(([source], at) => sides.push(new Side(source, episodes[at])));
  byId("sides").replaceChildren(...sides.map((side) => side.root));
  byId("sides").classList.toggle("two", sides.length > 1);
  byId("viewer").hidden = false;
  byId("film").href = url(`/api/watch/recordings/${recording.id}/episodes/${index}/film`);
  for (const button of byId("episodes").querySelectorAll("button")) {
    button.setAttribute("aria-pressed", String(Number(button.dataset.index) === index));
  }
  remember({ episode: index, beside: byId("beside").value });
  showStep(initialStep);
  if (focuses) byId("viewer").focus();
}

async function nextEpisode(by) {
  const next = listed[listed.findIndex((line) => line.index === sides[0].episode.index) + by];
  if (next) await openEpisode(next.index, 0, true);
}

/** Lists the recordings and opens the one with the id, or the one that the URL names, or the first. */
async function start(id = null) {
  const query = new URLSearchParams(id ? "" : location.search);
  const text = query.get("text") || "";
  const { recordings: readable, first } = await request("GET", `/api/watch/recordings?${queryOf({ text })}`);
  byId("nothing").hidden = readable.length > 0;
  byId("choose").hidden = !readable.length;
  if (!readable.length) return;
  byId("recording").replaceChildren(...recordingOptions(readable));
  filters.text.value = text;
  const asked = id || query.get("recording") || first;
  if (text && !first) showMessage(`No recording has an episode with “${text}”.`);
  await openRecording(readable.some((line) => line.id === asked) ? asked : readable[0].id);
  if (recording.comparable.some((line) => line.id === query.get("beside"))) byId("beside").value = query.get("beside");
  if (!(query.get("episode") in recording.played)) return openFirst();
  listEpisodes();
  await openEpisode(Number(query.get("episode")), Number(query.get("step")) || 0);
}

on("request", "submit", (event) => {
  event.preventDefault();
  if (isBusy("request")) return;
  attempt(async () => {
    showMessage("The agent is playing twelve tasks; this may take half a minute.");
    const [agent, configuration] = event.target.play.value.split(" ");
    const { id } = await request("POST", "/api/watch/recordings", { agent, configuration });
    showMessage("");
    await start(id);
    byId("viewer").focus();
  }, byId("request"));
});
on("recording", "change", () =>
  attempt(async () => {
    remember({ episode: "", beside: "", step: "" });
    await openRecording(byId("recording").value);
    await openFirst();
  }, byId("finder")),
);
on("beside", "change", () => attempt(() => sides.length && openEpisode(sides[0].episode.index, step), byId("viewer")));
on("filters", "input", () => attempt(openFirst, byId("episodes")));
on("filters", "submit", (event) => event.preventDefault());
const controls = {
  play: togglePlay,
  back: () => showStep(step - 1),
  forth: () => showStep(step + 1),
  heat: () => {
    showsHeat = !showsHeat;
    byId("heat").setAttribute("aria-pressed", String(showsHeat));
    showStep(step);
  },
};
for (const [id, action] of Object.entries(controls)) on(id, "click", action);
onKeys(byId("viewer"), {
  " ": controls.play,
  Home: () => showStep(0),
  ArrowLeft: controls.back,
  ArrowRight: controls.forth,
  End: () => showStep(Infinity),
  h: controls.heat,
  j: () => attempt(() => nextEpisode(1), byId("viewer")),
  k: () => attempt(() => nextEpisode(-1), byId("viewer")),
});

attempt(() => start());
