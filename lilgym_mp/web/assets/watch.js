"use strict";
// The page /watch: recorded episodes, step by step, one recording or two beside each other.

const PAGE = 100;
const filters = byId("filters");
const sides = [];
let listed = [];
let recording = null;
let offset = 0;
let total = 0;
let step = 0;
let showsLegal = false;
let opening = 0; // counts what was asked for, so that a late answer does not replace a newer one

const percent = (share) => `${(100 * share).toFixed(share > 0 && share < 0.1 ? 1 : 0)} %`;
const signed = (number) => `${number < 0 ? "−" : "+"}${Math.abs(number).toFixed(2)}`;
const plural = (count, name) => `${count} ${name}${count === 1 ? "" : "s"}`;
const words = (name) => name.replaceAll("_", " ");

function titleOf(line) {
  const seeds = line.training_seed === null ? "" : `, training seed ${line.training_seed}`;
  return `${line.agent}, ${line.configuration}, ${line.split}, ${line.actions}${seeds}: ${line.name}`;
}

/** A bar with its share; `done` marks what was done. */
function bar(label, share, done = false, mono = false) {
  const fill = element("span", { class: "fill" });
  fill.style.width = `${100 * share}%`;
  return element("li", { class: done ? "done" : null }, fill, element("span", { class: mono ? "mono" : null }, label, done ? " ✓" : ""), element("span", { class: "share" }, percent(share)));
}

function facts(pairs) {
  const list = element("dl", { class: "facts" });
  for (const [name, value] of pairs) if (value !== null) list.append(element("dt", {}, name), element("dd", {}, value));
  return list;
}

/** One recording's episode. */
class Side {
  constructor() {
    this.view = new SceneView("The scene");
    this.heat = element("div", { class: "heat", "aria-hidden": "true" });
    this.view.root.append(this.heat);
    this.strip = element("ol", { class: "strip", "aria-label": "Steps" });
    this.title = element("h2");
    this.head = element("div");
    this.done = element("p", { role: "status" });
    this.beliefs = element("div");
    this.root = element("section", { class: "panel side" }, this.title, this.head, this.view.root, this.done, this.strip, this.beliefs);
  }

  open(of, episode) {
    this.episode = episode;
    this.command = of.command;
    this.title.textContent = of.agent;
    const end = episode.invalid_reason ? `${words(episode.outcome)}: ${words(episode.invalid_reason)}` : words(episode.outcome);
    this.head.replaceChildren(
      element("p", { class: "soft small name" }, of.name),
      element("p", { class: "statement" }, episode.statement),
      element("p", {}, `Make it ${episode.target}. `, element("span", { class: episode.outcome === "success" ? "good" : "bad" }, end), `, reward ${episode.total.toFixed(1)}.`),
      element("details", {}, element("summary", {}, "Program and task"), element("pre", {}, episode.program), facts([
        ["Task", episode.task],
        ["Statement", episode.statement_seen ? "seen in training" : episode.form_seen ? "its form seen in training" : "not seen in training"],
        ["Phenomena", episode.phenomena.join(", ") || "none"],
        ["Shortest", episode.optimal_actions === null ? null : plural(episode.optimal_actions, "action")],
      ])),
    );
    this.strip.replaceChildren(
      ...episode.steps.map((each, index) =>
        element("li", {}, element("button", { type: "button", click: () => showStep(index) }, element("img", { src: each.scene.picture, alt: "", width: 190, height: 50 }), element("span", {}, each.action ? `${index + 1}. ${each.action}` : "The end"))),
      ),
    );
  }

  show(wanted) {
    const index = Math.min(wanted, this.episode.steps.length - 1);
    const shown = this.episode.steps[index];
    this.view.show(shown.scene);
    this.done.textContent = shown.action ? `Step ${index + 1}: ${shown.action}, reward ${signed(shown.reward)}` : `The end: ${words(this.episode.outcome)}`;
    [...this.strip.querySelectorAll("button")].forEach((button, place) => {
      if (place === index) {
        button.setAttribute("aria-current", "step");
        this.strip.scrollLeft = button.offsetLeft - this.strip.offsetLeft - 60;
      } else button.removeAttribute("aria-current");
    });
    this.showHeat(shown);
    this.beliefs.replaceChildren(...(shown.action ? this.decision(shown) : []));
  }

  showHeat(shown) {
    const kind = byId("heat").value;
    const made = [];
    if (shown.decision && kind !== "none") {
      const shareOf = (cell) => (kind === "both" ? cell.add + cell.remove : cell[kind]);
      for (const cell of shown.decision.cells) {
        const cover = this.cover(cell);
        cover.style.opacity = String(0.55 * Math.sqrt(Math.min(1, shareOf(cell))));
        made.push(cover);
      }
    }
    if (showsLegal) {
      for (const cell of shown.legal) {
        if (kind === "remove" ? !cell.remove : kind === "add" && !cell.add) continue;
        const cover = this.cover(cell);
        cover.className = "may";
        made.push(cover);
      }
    }
    this.heat.replaceChildren(...made);
  }

  cover(cell) {
    const [columns, rows] = this.episode.grid;
    const made = element("div");
    if (columns === 3) return place(made, cell.column * 140, 0, 100, 100);
    return place(made, (cell.column * IMAGE_WIDTH) / columns, (cell.row * IMAGE_HEIGHT) / rows, IMAGE_WIDTH / columns, IMAGE_HEIGHT / rows);
  }

  decision(shown) {
    const told = shown.decision;
    if (!told) return [element("p", { class: "notice" }, "What the agent went by was not recorded. Record it with: ", element("code", {}, this.command))];
    const kind = shown.action.split("(")[0];
    const expert = told.optimal === null ? (told.steps_to_go === null ? null : "not known") : told.optimal ? "yes" : "no";
    const parts = [
      element("div", {}, element("h3", {}, "Type of action"), element("ul", { class: "bars" }, bar("STOP", told.stop, kind === "STOP"), bar("ADD", told.add, kind === "ADD"), bar("REMOVE", told.remove, kind === "REMOVE"))),
      element("div", {}, element("h3", {}, "Likeliest actions"), element("ul", { class: "bars" }, ...told.likeliest.map((each) => bar(each.action, each.probability, each.action === shown.action)))),
    ];
    if (told.programs.length) parts.push(element("div", {}, element("h3", {}, "Programs planned for"), element("ul", { class: "bars" }, ...told.programs.map((each) => bar(each.program, each.probability, false, true)))));
    const answers = told.answers.map((each) =>
      element("div", {}, element("h3", {}, each.understood ? "Its answer" : "Its answer, which decided for no action"), element("pre", { class: "answer", tabindex: 0 }, each.text || "(nothing)")),
    );
    return [
      ...answers,
      element("div", { class: "beliefs" }, ...parts),
      facts([
        ["Value", told.value === null ? null : signed(told.value)],
        ["Plan succeeds", told.success_probability === null ? null : `with probability ${percent(told.success_probability)}, as it says`],
        ["Legal actions", `${told.legal_stop} STOP, ${told.legal_add} ADD, ${told.legal_remove} REMOVE; they have ${percent(told.legal_probability)} of the probability`],
        ["Expert would do this", expert],
        ["Shortest from here", told.steps_to_go === null ? null : plural(told.steps_to_go, "action")],
      ]),
    ];
  }
}

function showStep(wanted) {
  const longest = Math.max(...sides.map((side) => side.episode.steps.length)) - 1;
  step = Math.max(0, Math.min(longest, wanted));
  for (const side of sides) side.show(step);
  byId("step-line").textContent = step === longest ? `The end, after ${longest}` : `Step ${step + 1} of ${longest}`;
  byId("first").disabled = byId("back").disabled = step === 0;
  byId("last").disabled = byId("forth").disabled = step === longest;
}

/** Keeps in the address what is shown, so that it can be reloaded and sent. */
function remember(values) {
  const query = new URLSearchParams(location.search);
  for (const [name, value] of Object.entries(values)) value === "" || value === null ? query.delete(name) : query.set(name, value);
  history.replaceState(null, "", `?${query}`);
}

async function openRecording(id) {
  recording = await ask("GET", `/api/watch/recordings/${id}`);
  byId("about").hidden = byId("finder").hidden = false;
  byId("about-title").textContent = `${recording.agent}, ${recording.configuration}`;
  const ends = recording.outcomes.map((end) => `${words(end.name)} ${end.episodes}`).join(", ");
  byId("about-line").textContent = `${recording.successes} of ${recording.episodes} episodes succeed (${percent(recording.successes / Math.max(1, recording.episodes))}): ${ends}. Corpus ${recording.corpus}, split ${recording.split}, rules ${recording.rules}, actions ${recording.actions}, mask ${recording.mask ? "shown" : "not shown"}. Learnt from: ${recording.supervision}.`;
  byId("no-decisions").hidden = recording.has_decisions;
  byId("record-command").textContent = recording.command;
  byId("beside").replaceChildren(element("option", { value: "" }, "nothing"), ...recording.comparable.map((line) => element("option", { value: line.id }, titleOf(line))));
  markCounts(filters.phenomenon, recording.phenomena);
  markCounts(filters.outcome, recording.outcomes);
  markCounts(filters.invalid_reason, recording.invalid_reasons);
  remember({ recording: id });
}

function markCounts(select, counts) {
  const known = new Map(counts.map((each) => [each.name, each.episodes]));
  for (const option of select.options) if (option.value) option.textContent = `${words(option.value)} (${known.get(option.value) || 0})`;
}

async function findEpisodes() {
  const query = new URLSearchParams({ offset });
  for (const [name, value] of new FormData(filters)) if (value) query.set(name, value);
  const found = await ask("GET", `/api/watch/recordings/${recording.id}/episodes?${query}`);
  total = found.total;
  byId("total").textContent = total ? `${offset + 1} to ${offset + found.episodes.length} of ${total}` : "No episode is like this; choose fewer conditions.";
  byId("earlier").hidden = offset === 0;
  byId("later").hidden = offset + found.episodes.length >= total;
  listed = found.episodes;
  byId("episodes").hidden = total === 0;
  byId("episodes").replaceChildren(
    ...listed.map((line) =>
      element("li", {}, element("button", { type: "button", "data-index": line.index, click: () => attempt(() => openEpisode(line.index, 0, true), byId("viewer")) },
        element("span", {}, `${line.statement} (${line.target})`),
        element("span", { class: line.outcome === "success" ? "good" : "bad" }, `${words(line.outcome)}, ${line.actions}`))),
    ),
  );
}

async function openEpisode(index, at, focuses) {
  const mine = (opening += 1);
  const of = recording;
  const beside = byId("beside").value;
  const found = await ask("GET", `/api/watch/recordings/${of.id}/episodes/${index}`);
  const other = beside ? await besideOf(beside, found.task) : null;
  if (mine !== opening) return;
  sides.length = 0;
  sides.push(new Side());
  sides[0].open(of, found);
  if (other) sides.push(other);
  byId("sides").replaceChildren(...sides.map((side) => side.root));
  byId("sides").classList.toggle("two", sides.length > 1);
  byId("viewer").hidden = false;
  for (const button of byId("episodes").querySelectorAll("button")) button.setAttribute("aria-pressed", String(Number(button.dataset.index) === index));
  remember({ episode: index, beside });
  showStep(at);
  if (focuses) byId("viewer").focus();
}

async function besideOf(id, task) {
  const other = await ask("GET", `/api/watch/recordings/${id}`);
  const same = await ask("GET", `/api/watch/recordings/${id}/episodes?${new URLSearchParams({ task })}`);
  if (!same.episodes.length) {
    say("The other recording has no episode of this task.");
    return null;
  }
  const side = new Side();
  side.open(other, await ask("GET", `/api/watch/recordings/${id}/episodes/${same.episodes[0].index}`));
  return side;
}

async function nextEpisode(by) {
  const place = listed.findIndex((line) => line.index === sides[0].episode.index) + by;
  if (place >= 0 && place < listed.length) await openEpisode(listed[place].index, 0, true);
}

function showNothing(found) {
  const command = "lilgym-mp evaluate RUN --record runs/recordings --record-decisions";
  const where = found.directory === null ? "The server was started without a directory of runs: give it one with --runs DIR. " : `There are no recorded episodes in ${found.directory}. `;
  byId("nothing").hidden = false;
  byId("nothing").replaceChildren(
    element("p", {}, where, "Record what an agent does, and what it goes by, with:"),
    element("pre", {}, found.runs.length ? found.runs[0].command : command),
    element("p", { class: "soft" }, "An agent that comes with the package is played by "),
    element("pre", {}, "lilgym-mp evaluate --policy expert random-legal --configuration TowerFlipIt --record runs/simple --record-decisions"),
  );
}

async function start() {
  const found = await ask("GET", "/api/watch/recordings");
  const whole = found.recordings.filter((line) => !line.fault);
  const faulty = found.recordings.filter((line) => line.fault);
  byId("loading").hidden = true;
  byId("faulty").hidden = !faulty.length;
  byId("fault-list").replaceChildren(...faulty.map((line) => element("li", {}, `${line.name}: ${line.fault}`)));
  byId("runs").hidden = !found.runs.length;
  byId("run-list").replaceChildren(...found.runs.map((run) => element("li", {}, `${run.name}: `, element("code", {}, run.command))));
  if (!whole.length) {
    showNothing(found);
    return;
  }
  byId("recording").replaceChildren(...whole.map((line) => element("option", { value: line.id }, titleOf(line))));
  byId("choose").hidden = false;
  const query = new URLSearchParams(location.search);
  const wanted = whole.some((line) => line.id === query.get("recording")) ? query.get("recording") : whole[0].id;
  byId("recording").value = wanted;
  await openRecording(wanted);
  if (recording.comparable.some((line) => line.id === query.get("beside"))) byId("beside").value = query.get("beside");
  await findEpisodes();
  const index = Number(query.get("episode"));
  if (query.has("episode") && Number.isInteger(index)) await openEpisode(index, Number(query.get("step")) || 0, false);
}

byId("recording").addEventListener("change", () =>
  attempt(async () => {
    byId("viewer").hidden = true;
    opening += 1;
    remember({ episode: "", beside: "", step: "" });
    offset = 0;
    await openRecording(byId("recording").value);
    await findEpisodes();
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
  attempt(findEpisodes, byId("episodes"));
}
filters.addEventListener("input", filter);
filters.addEventListener("submit", (event) => {
  event.preventDefault();
  filter();
});
byId("earlier").addEventListener("click", () => { offset = Math.max(0, offset - PAGE); attempt(findEpisodes, byId("episodes")); });
byId("later").addEventListener("click", () => { offset += PAGE; attempt(findEpisodes, byId("episodes")); });
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
const KEYS = {
  ArrowLeft: () => showStep(step - 1),
  ArrowRight: () => showStep(step + 1),
  Home: () => showStep(0),
  End: () => showStep(Infinity),
  j: () => attempt(() => nextEpisode(1), byId("viewer")),
  k: () => attempt(() => nextEpisode(-1), byId("viewer")),
  l: toggleLegal,
};
byId("viewer").addEventListener("keydown", (event) => {
  if (event.ctrlKey || event.metaKey || event.altKey || event.target.closest("select, input") || !(event.key in KEYS)) return;
  event.preventDefault();
  KEYS[event.key]();
});

attempt(start);
