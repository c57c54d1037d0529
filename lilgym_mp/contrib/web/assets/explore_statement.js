"use strict";
// /explore/APPEARANCE/SPLIT/ID: one statement.

const root = byId("statement");

function facts(pairs) {
  return element("dl", { class: "facts" }, ...pairs.flatMap(([name, value]) => [element("dt", {}, name), element("dd", {}, value)]));
}

function solutions(scene) {
  if (!scene.steps) return "The expert found no solution.";
  const amount = scene.complete ? `${scene.optimal_first}` : `at least ${scene.optimal_first}`;
  return `Shortest solution: ${scene.steps} actions; number of optimal first actions: ${amount}.`;
}

function sceneCard(scene) {
  const view = new SceneView(`Start ${scene.task_id}`).show(scene.scene);
  const parts = element("details", {}, element("summary", {}, "The program's value here, part by part"), partsList(scene.parts, view));
  return element(
    "article",
    { class: "panel" },
    element("h2", {}, `${scene.configuration}, ${scene.task_id}`),
    view.root,
    element("p", {}, element("a", { class: "button", href: `/play?${new URLSearchParams({ configuration: scene.configuration, split: root.dataset.split, task: scene.task_id })}` }, "Play this task")),
    element("p", {}, `The statement is ${scene.truth} here; the target is ${scene.target}. ${solutions(scene)}`),
    parts,
  );
}

function runsTable(runs) {
  const headings = ["Agent", "Episode", "Configuration", "Task", "Outcome", "Actions", "Reward"];
  const rows = runs.map((run) => [run.agent, element("a", { href: `/watch?${new URLSearchParams({ recording: run.recording_id, episode: run.episode })}` }, "watch"), run.configuration, run.task_id, run.outcome.replaceAll("_", " "), run.actions, run.reward.toFixed(1)]);
  return element(
    "div",
    { class: "scroll", tabindex: 0, role: "region", "aria-label": "Recorded runs" },
    element(
      "table",
      {},
      element("thead", {}, element("tr", {}, ...headings.map((name) => element("th", { scope: "col" }, name)))),
      element("tbody", {}, ...rows.map((row) => element("tr", {}, ...row.map((value) => element("td", {}, value instanceof Node ? value : String(value)))))),
    ),
  );
}

attempt(async () => {
  const query = new URLSearchParams({ appearance: root.dataset.appearance, split: root.dataset.split, statement_id: root.dataset.id });
  const details = await request("GET", `/api/explore/statement?${query}`);
  const runs = details.runs.length ? runsTable(details.runs) : element("p", { class: "empty" }, "No recorded run contains this statement. Record runs with: lilgym-mp evaluate --record.");
  root.replaceChildren(
    element("div", { class: "scenes" }, ...details.scenes.map(sceneCard)),
    element("h2", {}, "Program"),
    facts([
      ["Program", element("code", {}, details.program)],
      ["Canonical", element("code", {}, details.canonical)],
      ["Form", details.form],
      ["Program words", details.words.join(", ") || "none"],
      ["Phenomena", details.phenomena.join(", ") || "none found"],
      ["Syntax", details.syntax.join(", ") || "none found"],
    ]),
    element("h2", {}, "Recorded runs"),
    runs,
    ...details.unreadable.map((fault) => element("p", { class: "notice error" }, fault)),
  );
}, root);
