// /explore/APPEARANCE/SPLIT/ID: one statement.

const root = byId("statement");

function sceneCard(scene) {
  const view = new SceneView(`Start ${scene.task_id}`).show(scene.scene);
  if (!scene.parts) return element("article", { class: "panel" }, element("h2", {}, scene.task_id), view.root, scene.truth === null ? "" : element("p", {}, `The statement is ${scene.truth} here.`));
  return element("article", { class: "panel" },
    element("h2", {}, `${scene.configuration}, ${scene.task_id}`),
    view.root,
    element("p", {}, element("a", { class: "button", href: url(`/play?${new URLSearchParams({ configuration: scene.configuration, split: root.dataset.split, task: scene.task_id })}`) }, "Play this task")),
    element("p", {}, `The statement is ${scene.truth} here; the target is ${scene.target}. ${scene.steps ? `Shortest solution: ${plural(scene.steps, "action")}.` : "The expert found no solution."}`),
    element("details", {}, element("summary", {}, "The program's value here, part by part"), partsList(scene.parts, view)),
  );
}

attempt(async () => {
  const query = new URLSearchParams({ appearance: root.dataset.appearance, split: root.dataset.split, statement_id: root.dataset.id });
  const details = await request("GET", `/api/explore/statement?${query}`);
  root.replaceChildren(
    element("div", { class: "scenes" }, ...details.scenes.map(sceneCard)),
    element("h2", {}, "Program"),
    element("p", {}, details.program ? element("code", {}, details.program) : element("a", { href: url(`/annotate?${query}`) }, "None yet, so it is not played: write one")),
    element("p", {}, element("a", { href: url(`/watch?${queryOf({ text: details.statement })}`) }, "Watch recorded episodes with this statement")),
  );
}, root);
