"use strict";
// /watch: recorded episodes step by step; optionally two recordings side by side.

const PAGE_SIZE = 100;
const STEP_MILLISECONDS = 900; // while playing
const filters = byId("filters");
const sides = [];
let listed = [];
let recording = null;
let offset = 0;
let total = 0;
let step = 0;
let showsLegal = false;
let openCount = 0; // identifies the latest episode request, so that a late response is dropped
let findCount = 0; // likewise for the list of episodes

const signed = (number) => `${number < 0 ? "−" : "+"}${Math.abs(number).toFixed(2)}`;
const plural = (count, name) => `${count} ${name}${count === 1 ? "" : "s"}`;
const words = (name) => name.replaceAll("_", " ");

/** A short name, such as "imitation, seed 0". */
function shortName(recording) {
  return `${recording.agent}${recording.training_seed === null ? "" : `, seed ${recording.training_seed}`}`;
}

/** Options for recordings: short names with what distinguishes them, and the file where that is not enough. */
function recordingOptions(recordings) {
  const titles = recordings.map((line) => `${shortName(line)} · ${line.configuration}, ${line.split}${line.actions === "sampled" ? ", sampled" : ""}`);
  const isUnique = (title) => titles.indexOf(title) === titles.lastIndexOf(title);
  return recordings.map((line, index) => element("option", { value: line.id }, isUnique(titles[index]) ? titles[index] : `${titles[index]} · ${line.name}`));
}

function facts(pairs) {
  const list = element("dl", { class: "facts" });
  for (const [name, value] of pairs) if (value !== null) list.append(element("dt", {}, name), element("dd", {}, value));
  return list;
}

let maskCount = 0; // makes ids of masks unique

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
  if (shape === "triangle") return svg("polygon", { points: `${x + side / 2},${top - 2} ${right + 1},${bottom} ${left - 1},${bottom}` });
  return svg("rect", { x: left, y: top, width: right - left, height: bottom - top });
}

/** Panel with an episode of one recording. */
class Side {
  constructor() {
    this.view = new SceneView("The scene");
    this.heat = svg("svg", { class: "heat", viewBox: `0 0 ${IMAGE_WIDTH} ${IMAGE_HEIGHT}`, "aria-hidden": "true" });
    this.view.root.append(this.heat);
    this.maskId = `items-${(maskCount += 1)}`;
    this.strip = element("ol", { class: "strip", "aria-label": "Steps" });
    this.title = element("h2");
    this.head = element("div");
    this.step = element("p", { role: "status" });
    this.predictions = element("div");
    this.root = element("section", { class: "panel side" }, this.title, this.head, this.view.root, this.step, this.strip, this.predictions);
  }

  open(recording, episode) {
    this.episode = episode;
    this.command = recording.command;
    this.title.textContent = shortName(recording);
    const end = episode.invalid_reason ? `${words(episode.outcome)}: ${words(episode.invalid_reason)}` : words(episode.outcome);
    this.head.replaceChildren(
      element("p", { class: "statement" }, episode.statement),
      element("p", {}, `Make it ${episode.target}. `, element("span", { class: episode.outcome === "success" ? "good" : "bad" }, end), `, reward ${episode.total.toFixed(1)}.`),
      element("details", {}, element("summary", {}, "Program and task"), element("pre", {}, episode.program), facts([
        ["Task", episode.task],
        ["Recording", recording.name],
        ["Statement", episode.statement_seen ? "seen in training" : episode.form_seen ? "its form was seen in training" : "not seen in training"],
        ["Shortest solution", episode.optimal_actions === null ? null : plural(episode.optimal_actions, "action")],
      ])),
    );
    this.strip.replaceChildren(
      ...episode.steps.map((each, index) =>
        element("li", {}, element("button", { type: "button", click: () => showStep(index) }, element("img", { src: each.scene.picture, alt: "", width: 190, height: 50 }), element("span", {}, each.action ? `${index + 1}. ${each.action}` : "End"))),
      ),
    );
  }

  show(wanted) {
    const index = Math.min(wanted, this.episode.steps.length - 1);
    const shown = this.episode.steps[index];
    this.view.show(shown.scene);
    this.step.textContent = shown.action ? `Step ${index + 1}: ${shown.action}, reward ${shown.reward.toFixed(1)}` : `End: ${words(this.episode.outcome)}`;
    [...this.strip.querySelectorAll("button")].forEach((button, place) => {
      if (place === index) {
        button.setAttribute("aria-current", "step");
        this.strip.scrollLeft = button.offsetLeft - this.strip.offsetLeft - 60;
      } else button.removeAttribute("aria-current");
    });
    this.showHeat(shown);
    this.predictions.replaceChildren(...(shown.action ? this.decision(shown) : []));
  }

  showHeat(shown) {
    const kind = byId("heat").value;
    const overlays = [];
    if (shown.decision && kind !== "none") {
      const shareOf = (cell) => (kind === "both" ? cell.add + cell.remove : cell[kind]);
      for (const cell of shown.decision.cells) {
        overlays.push(this.overlay(cell, { opacity: 0.6 * Math.sqrt(Math.min(1, shareOf(cell))), fill: "#d6006c" }));
      }
    }
    if (showsLegal) {
      for (const cell of shown.legal) {
        if (kind === "remove" ? !cell.remove : kind === "add" && !cell.add) continue;
        overlays.push(this.overlay(cell, { class: "may" }));
      }
    }
    this.heat.replaceChildren(this.mask(), svg("g", { mask: `url(#${this.maskId})` }, ...overlays));
  }

  overlay(cell, attributes) {
    const [columns, rows] = this.episode.grid;
    if (columns === 3) return svg("rect", { x: cell.column * 140, y: 0, width: 100, height: 100, ...attributes });
    const [width, height] = [IMAGE_WIDTH / columns, IMAGE_HEIGHT / rows];
    return svg("rect", { x: cell.column * width, y: cell.row * height, width, height, ...attributes });
  }

  /** Hides the heat map where items are, so that it changes no item's colour. */
  mask() {
    const all = svg("rect", { width: IMAGE_WIDTH, height: IMAGE_HEIGHT, fill: "white" });
    return svg("mask", { id: this.maskId, maskUnits: "userSpaceOnUse", x: 0, y: 0, width: IMAGE_WIDTH, height: IMAGE_HEIGHT }, all, ...this.view.scene.items.map(itemShape));
  }

  decision(shown) {
    const decision = shown.decision;
    if (!decision) return [element("p", { class: "notice" }, "The agent's predictions were not recorded. Record them with: ", element("code", {}, this.command))];
    const kind = shown.action.split("(")[0];
    const expert = decision.optimal === null ? (decision.steps_to_go === null ? null : "unknown") : decision.optimal ? "yes" : "no";
    const parts = [
      element("div", {}, element("h3", {}, "Type of action"), element("ul", { class: "bars" }, bar("STOP", decision.stop, kind === "STOP"), bar("ADD", decision.add, kind === "ADD"), bar("REMOVE", decision.remove, kind === "REMOVE"))),
      element("div", {}, element("h3", {}, "Likeliest actions"), element("ul", { class: "bars" }, ...Object.entries(decision.likeliest).map(([action, probability]) => bar(action, probability, action === shown.action)))),
    ];
    const programs = Object.entries(decision.programs);
    const holds = (program) => decision.satisfied.includes(program);
    if (programs.length) parts.push(element("div", {}, element("h3", {}, `Readings, ✓ if ${this.episode.target} in this scene`), element("ul", { class: "bars" }, ...programs.map(([program, probability]) => bar(programCode(program), probability, holds(program), true)))));
    const satisfied = programs.filter(([program]) => holds(program)).reduce((sum, [, probability]) => sum + probability, 0);
    const stopRule = programs.length ? "when no edit of its plan is left: the plan makes the readings that are together the most probable have the target value" : "when STOP is the action it chooses, as any other";
    if (decision.notes.length) parts.push(element("div", {}, element("h3", {}, "About the statement"), ...decision.notes.map((note) => element("p", { class: "notice" }, note))));
    const answers = decision.answers.map((each) =>
      element("div", {}, element("h3", {}, each.understood ? "Answer" : "Answer, not understood as an action"), element("pre", { class: "answer", tabindex: 0 }, each.text || "(nothing)")),
    );
    return [
      ...answers,
      element("div", { class: "beliefs" }, ...parts),
      facts([
        ["Satisfied readings", programs.length ? `${percent(satisfied)} of the probability` : null],
        ["It stops", stopRule],
        ["Value", decision.value === null ? null : signed(decision.value)],
        ["Predicted success of the plan", decision.success_probability === null ? null : percent(decision.success_probability)],
        ["Legal actions", `${decision.legal_stop} STOP, ${decision.legal_add} ADD, ${decision.legal_remove} REMOVE; total probability ${percent(decision.legal_probability)}`],
        ["Optimal according to the expert", expert],
        ["Shortest solution from here", decision.steps_to_go === null ? null : plural(decision.steps_to_go, "action")],
      ]),
    ];
  }
}

let playing = 0; // timer

function pause() {
  clearInterval(playing);
  playing = 0;
  byId("play").textContent = "▶";
  byId("play").setAttribute("aria-label", "Play");
}

function togglePlay() {
  if (playing) return pause();
  if (byId("forth").disabled) showStep(0);
  playing = setInterval(() => (byId("forth").disabled ? pause() : showStep(step + 1)), STEP_MILLISECONDS);
  byId("play").textContent = "❚❚";
  byId("play").setAttribute("aria-label", "Pause");
}

function showStep(wanted) {
  const longest = Math.max(...sides.map((side) => side.episode.steps.length)) - 1;
  step = Math.max(0, Math.min(longest, wanted));
  for (const side of sides) side.show(step);
  byId("step-line").textContent = step === longest ? `End, after ${plural(longest, "step")}` : `Step ${step + 1} of ${longest}`;
  byId("first").disabled = byId("back").disabled = step === 0;
  byId("last").disabled = byId("forth").disabled = step === longest;
}

/** Stores the values in the URL's query, so that the view can be reloaded and shared; null and "" remove a value. */
function remember(values) {
  const query = new URLSearchParams(location.search);
  for (const [name, value] of Object.entries(values)) value === "" || value === null ? query.delete(name) : query.set(name, value);
  history.replaceState(null, "", `?${query}`);
}

async function openRecording(id) {
  recording = await request("GET", `/api/watch/recordings/${id}`);
  byId("about").hidden = byId("finder").hidden = false;
  byId("about-title").textContent = `${recording.agent}, ${recording.configuration}`;
  const ends = Object.entries(recording.outcomes).map(([name, episodes]) => `${words(name)} ${episodes}`).join(", ");
  byId("about-line").textContent = `${recording.successes} of ${recording.episodes} episodes succeeded (${percent(recording.successes / Math.max(1, recording.episodes))}): ${ends}. Corpus ${recording.corpus}, split ${recording.split}, rules ${recording.rules}, actions ${recording.actions}, ${recording.mask ? "with" : "without"} action mask. Trained from: ${recording.supervision}.`;
  byId("no-decisions").hidden = recording.has_decisions;
  byId("record-command").textContent = recording.command;
  byId("beside").replaceChildren(element("option", { value: "" }, "nothing"), ...recordingOptions(recording.comparable));
  markCounts(filters.outcome, recording.outcomes);
  markCounts(filters.invalid_reason, recording.invalid_reasons);
  remember({ recording: id });
}

function markCounts(select, counts) {
  for (const option of select.options) if (option.value) option.textContent = `${words(option.value)} (${counts[option.value] || 0})`;
}

/** Lists the episodes that match the filters; false if the filters have changed meanwhile. */
async function findEpisodes() {
  const current = (findCount += 1);
  const query = new URLSearchParams({ offset });
  for (const [name, value] of new FormData(filters)) if (value) query.set(name, value);
  const found = await request("GET", `/api/watch/recordings/${recording.id}/episodes?${query}`);
  if (current !== findCount) return false;
  total = found.total;
  byId("total").textContent = total ? `${offset + 1} to ${offset + found.episodes.length} of ${total}` : "No episode matches these filters.";
  byId("earlier").hidden = offset === 0;
  byId("later").hidden = offset + found.episodes.length >= total;
  listed = found.episodes;
  byId("episodes").hidden = total === 0;
  byId("episodes").replaceChildren(
    ...listed.map((line) =>
      element("li", {}, element("button", { type: "button", "data-index": line.index, click: () => attempt(() => openEpisode(line.index, 0, true), byId("viewer")) },
        element("img", { src: `/api/watch/recordings/${recording.id}/episodes/${line.index}/picture`, alt: "", width: 114, height: 30, loading: "lazy" }),
        element("span", {}, `${line.statement} (${line.target})`),
        element("span", { class: line.outcome === "success" ? "good" : "bad" }, `${words(line.outcome)}, ${line.actions}`))),
    ),
  );
  return true;
}

/** Shows the first of the episodes found, or none. */
async function openFirst() {
  if (!(await findEpisodes())) return;
  if (listed.length) await openEpisode(listed[0].index, 0, false);
  else {
    openCount += 1;
    pause();
    sides.length = 0;
    byId("viewer").hidden = true;
    remember({ episode: "" });
  }
}

async function openEpisode(index, initialStep, focuses) {
  const current = (openCount += 1);
  pause();
  const opened = recording;
  const beside = byId("beside").value;
  const episode = await request("GET", `/api/watch/recordings/${opened.id}/episodes/${index}`);
  const other = beside ? await sideWithTask(beside, episode.task) : null;
  if (current !== openCount) return;
  sides.length = 0;
  sides.push(new Side());
  sides[0].open(opened, episode);
  if (other) sides.push(other);
  byId("sides").replaceChildren(...sides.map((side) => side.root));
  byId("sides").classList.toggle("two", sides.length > 1);
  byId("viewer").hidden = false;
  for (const button of byId("episodes").querySelectorAll("button")) button.setAttribute("aria-pressed", String(Number(button.dataset.index) === index));
  remember({ episode: index, beside });
  showStep(initialStep);
  if (focuses) byId("viewer").focus();
}

/** A panel with another recording's episode of the task, or null if it has none. */
async function sideWithTask(id, task) {
  const other = await request("GET", `/api/watch/recordings/${id}`);
  const found = await request("GET", `/api/watch/recordings/${id}/episodes?${new URLSearchParams({ task })}`);
  if (!found.episodes.length) {
    showMessage("The other recording has no episode of this task.");
    return null;
  }
  const side = new Side();
  side.open(other, await request("GET", `/api/watch/recordings/${id}/episodes/${found.episodes[0].index}`));
  return side;
}

async function nextEpisode(by) {
  const next = listed.findIndex((line) => line.index === sides[0].episode.index) + by;
  if (next >= 0 && next < listed.length) await openEpisode(listed[next].index, 0, true);
}

/** Lists the recordings and opens the one with the id, or the one that the URL names, or the first. */
async function start(id = null) {
  const found = await request("GET", "/api/watch/recordings");
  const readable = found.recordings.filter((line) => !line.fault);
  const faulty = found.recordings.filter((line) => line.fault);
  byId("faulty").hidden = !faulty.length;
  byId("fault-list").replaceChildren(...faulty.map((line) => element("li", {}, `${line.name}: ${line.fault}`)));
  byId("nothing").hidden = readable.length > 0;
  byId("choose").hidden = !readable.length;
  if (!readable.length) return;
  byId("recording").replaceChildren(...recordingOptions(readable));
  const query = new URLSearchParams(id ? "" : location.search);
  const wanted = id || (readable.some((line) => line.id === query.get("recording")) ? query.get("recording") : readable[0].id);
  byId("recording").value = wanted;
  await openRecording(wanted);
  if (recording.comparable.some((line) => line.id === query.get("beside"))) byId("beside").value = query.get("beside");
  const index = Number(query.get("episode"));
  if (!query.has("episode") || !Number.isInteger(index)) return openFirst();
  await findEpisodes();
  await openEpisode(index, Number(query.get("step")) || 0, false);
}

if (byId("request")) {
  byId("request").addEventListener("submit", (event) => {
    event.preventDefault();
    attempt(async () => {
      const asked = Object.fromEntries(new FormData(event.target));
      const { id } = await request("POST", "/api/watch/recordings", asked);
      offset = 0;
      await start(id);
      byId("viewer").focus();
    }, byId("request"));
  });
}
byId("recording").addEventListener("change", () =>
  attempt(async () => {
    remember({ episode: "", beside: "", step: "" });
    offset = 0;
    await openRecording(byId("recording").value);
    await openFirst();
  }, byId("finder")),
);
byId("beside").addEventListener("change", () =>
  attempt(async () => {
    remember({ beside: byId("beside").value });
    if (sides.length) await openEpisode(sides[0].episode.index, step, false);
  }, byId("viewer")),
);
function filter() {
  offset = 0;
  attempt(openFirst, byId("episodes"));
}
filters.addEventListener("input", filter);
filters.addEventListener("submit", (event) => {
  event.preventDefault();
  filter();
});
byId("earlier").addEventListener("click", () => { offset = Math.max(0, offset - PAGE_SIZE); attempt(findEpisodes, byId("episodes")); });
byId("later").addEventListener("click", () => { offset += PAGE_SIZE; attempt(findEpisodes, byId("episodes")); });
byId("play").addEventListener("click", togglePlay);
byId("first").addEventListener("click", () => showStep(0));
byId("back").addEventListener("click", () => showStep(step - 1));
byId("forth").addEventListener("click", () => showStep(step + 1));
byId("last").addEventListener("click", () => showStep(Infinity));
byId("heat").addEventListener("change", () => showStep(step));
function toggleLegal() {
  showsLegal = !showsLegal;
  byId("legal").setAttribute("aria-pressed", String(showsLegal));
  showStep(step);
}
byId("legal").addEventListener("click", toggleLegal);
onKeys(byId("viewer"), {
  " ": togglePlay,
  ArrowLeft: () => showStep(step - 1),
  ArrowRight: () => showStep(step + 1),
  Home: () => showStep(0),
  End: () => showStep(Infinity),
  j: () => attempt(() => nextEpisode(1), byId("viewer")),
  k: () => attempt(() => nextEpisode(-1), byId("viewer")),
  l: toggleLegal,
});

attempt(() => start());
