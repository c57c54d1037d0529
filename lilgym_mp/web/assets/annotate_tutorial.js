"use strict";
// /annotate/tutorial: like annotating an assignment, with advice.

const view = new SceneView("The shown scene");
let tasks = [];
let task = null;
const editor = new Editor(() => {
  byId("result").replaceChildren();
  showMessage("");
}, run);

byId("scene").append(view.root);

async function run() {
  await attempt(async () => {
    const result = await request("POST", `/api/annotate/tutorial/${task.name}/run`, { program: editor.value });
    const outcome = result.truth === null ? `cannot be evaluated: ${result.fault}` : `is ${result.truth}`;
    showMessage(`The program ${outcome}; the label is ${result.label}.`, result.agrees ? "success" : "error");
    byId("result").replaceChildren(partsList(result.parts, view));
  }, byId("result"));
}

function show(name) {
  task = tasks.find((each) => each.name === name);
  byId("title").textContent = task.title;
  byId("statement").textContent = task.statement;
  byId("task").textContent = `In this scene the statement is ${task.label}. Your program will also be checked on ${task.hidden_scenes} hidden scenes.`;
  byId("advice").textContent = task.advice;
  byId("result").replaceChildren();
  showMessage("");
  view.show(task.scene);
  editor.value = "";
  showTasks();
}

function showTasks() {
  byId("tasks").replaceChildren(
    ...tasks.map((each) =>
      element("li", {}, element("button", { type: "button", "aria-pressed": String(each === task), click: () => show(each.name) }, each.solved ? `${each.title} ✓` : each.title)),
    ),
  );
}

byId("run").addEventListener("click", run);
byId("submit").addEventListener("click", () =>
  attempt(async () => {
    const result = await request("POST", `/api/annotate/tutorial/${task.name}/submissions`, { program: editor.value });
    if (result.verdict === "accepted") task.solved = true;
    showTasks();
    const next = tasks.find((each) => !each.solved);
    const go = next ? element("button", { type: "button", click: () => show(next.name) }, `Next: ${next.title}`) : element("a", { href: "/annotate" }, "All solved; to your statements");
    showMessage([`${result.message} `, result.verdict === "failed" ? "" : go], result.verdict === "failed" ? "error" : "success");
  }),
);
attempt(async () => {
  await editor.start();
  tasks = await request("GET", "/api/annotate/tutorial");
  show((tasks.find((each) => !each.solved) || tasks[0]).name);
});
