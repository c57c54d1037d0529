"use strict";
// The page of one statement.

const root = byId("statement");

function facts(pairs) {
  return element("dl", { class: "facts" }, ...pairs.flatMap(([name, value]) => [element("dt", {}, name), element("dd", {}, value)]));
}

function solutions(scene) {
  if (!scene.steps) return "The expert knows no solution.";
  const amount = scene.complete ? `${scene.optimal_first}` : `at least ${scene.optimal_first}`;
  return `Shortest solution: ${scene.steps} actions; ${amount} first actions begin one.`;
}

function sceneCard(scene) {
  const view = new SceneView(`Start ${scene.task_id}`).show(scene.scene);
  const parts = element("details", {}, element("summary", {}, "The program here, part by part"), partsList(scene.parts, view));
  return element(
    "article",
    { class: "panel" },
    element("h3", {}, `${scene.configuration}, ${scene.task_id}`),
    view.root,
    element("p", {}, `The statement is ${scene.truth} here; to be made ${scene.target}. ${solutions(scene)}`),
    parts,
  );
}

function runsTable(told) {
  const heads = ["Agent", "Recording", "Configuration", "Task", "Outcome", "Actions", "Reward"];
  const rows = told.runs.map((run) => [run.agent, run.recording, run.configuration, run.task_id, run.outcome.replaceAll("_", " "), run.actions, run.reward.toFixed(1)]);
  return element(
    "div",
    { class: "scroll", tabindex: 0, role: "region", "aria-label": "Recorded runs" },
    element(
      "table",
      {},
      element("thead", {}, element("tr", {}, ...heads.map((name) => element("th", { scope: "col" }, name)))),
      element("tbody", {}, ...rows.map((row) => element("tr", {}, ...row.map((value) => element("td", {}, String(value)))))),
    ),
  );
}

attempt(async () => {
  const query = new URLSearchParams({ appearance: root.dataset.appearance, split: root.dataset.split, statement_id: root.dataset.id });
  const told = await ask("GET", `/api/explore/statement?${query}`);
  const runs = told.runs.length ? runsTable(told) : element("p", { class: "empty" }, "No recorded run met this statement: lilgym-mp evaluate --record makes recordings.");
  root.replaceChildren(
    facts([
      ["Program", element("code", {}, told.program)],
      ["Canonical", element("code", {}, told.canonical)],
      ["Form", told.form],
      ["Words of the program", told.words.join(", ") || "none"],
      ["Phenomena", told.phenomena.join(", ") || "none found"],
      ["Syntax", told.syntax.join(", ") || "none found"],
    ]),
    element("h2", {}, "Recorded runs"),
    runs,
    ...told.unreadable.map((fault) => element("p", { class: "notice error" }, fault)),
    element("h2", {}, "Scenes"),
    ...told.scenes.map(sceneCard),
  );
}, root);
