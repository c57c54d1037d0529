"use strict";
// The tutorial: as the real work, with advice.

const view = new SceneView("The shown scene");
let tasks = [];
let task = null;
const editor = new Editor(() => {}, run);

byId("scene").append(view.root);

async function run() {
  await attempt(async () => {
    const told = await ask("POST", `/api/annotate/tutorial/${task.name}/run`, { program: editor.value });
    const value = told.truth === null ? `no value: ${told.fault}` : String(told.truth);
    byId("result").replaceChildren(
      element("p", { class: told.agrees ? "good" : "bad" }, `The program says ${value}; the label is ${told.label}.`),
      partsList(told.parts, view),
    );
  }, byId("result"));
}

function show(name) {
  task = tasks.find((each) => each.name === name);
  byId("title").textContent = task.title;
  byId("statement").textContent = task.statement;
  byId("task").textContent = `In this scene the statement is ${task.label}. ${task.hidden_scenes} other scenes will check your program.`;
  byId("advice").textContent = task.advice;
  byId("result").replaceChildren();
  view.show(task.scene);
  editor.value = "";
  list();
}

function list() {
  byId("tasks").replaceChildren(
    ...tasks.map((each) =>
      element("li", {}, element("button", { type: "button", "aria-pressed": String(each === task), click: () => show(each.name) }, each.solved ? `${each.title} ✓` : each.title)),
    ),
  );
}

byId("run").addEventListener("click", run);
byId("submit").addEventListener("click", () =>
  attempt(async () => {
    const told = await ask("POST", `/api/annotate/tutorial/${task.name}/submissions`, { program: editor.value });
    if (told.verdict === "accepted") task.solved = true;
    list();
    say(told.message, told.verdict === "failed" ? "error" : "");
  }),
);
attempt(async () => {
  await editor.start();
  tasks = await ask("GET", "/api/annotate/tutorial");
  show((tasks.find((each) => !each.solved) || tasks[0]).name);
});
