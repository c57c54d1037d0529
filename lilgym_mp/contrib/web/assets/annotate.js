// /annotate: a statement, its shown scenes, and an editor for its program. The text is kept in this browser while typing.

const choice = byId("choice");
const views = [];
let lines = []; // statements of the chosen appearance and split
let agreeing = null; // program text that had the statement's value in all shown scenes when last run

const editor = new Editor((text) => {
  keep(draftKey(), text);
  byId("result").replaceChildren();
  showMessage("");
  updateSubmit();
}, run);

/** Reads a text that this browser keeps, or stores it; browsers may refuse both. */
function keep(name, text) {
  try {
    if (text === undefined) return localStorage.getItem(name) || "";
    localStorage.setItem(name, text);
  } catch { /* the page works without */ }
  return "";
}

const query = () => new URLSearchParams({ appearance: choice.appearance.value, split: choice.split.value, statement_id: choice.statement.value });
/** A function that says whether the statement chosen now is still the one chosen. */
const unlessChanged = (asked = String(query())) => () => asked === String(query());
const draftKey = () => `draft ${query()}`;

function updateSubmit() {
  byId("submit").disabled = agreeing === null || agreeing !== editor.value;
}

async function list(wanted) {
  const { appearance, split, name } = choice;
  lines = await request("GET", `/api/annotate/statements?${new URLSearchParams({ appearance: appearance.value, split: split.value, name: name.value })}`);
  const chosen = wanted || choice.statement.value;
  choice.statement.replaceChildren(...lines.map((line) => element("option", { value: line.id }, `${line.done ? "✓ " : ""}${line.statement}`)));
  if (lines.some((line) => line.id === chosen)) choice.statement.value = chosen;
  byId("progress").textContent = `${lines.filter((line) => line.done).length} of ${lines.length} statements have an accepted program of yours.`;
}

async function open() {
  const found = await request("GET", `/api/annotate/statement?${query()}`, undefined, unlessChanged());
  byId("statement").textContent = found.statement;
  byId("hidden").textContent = found.hidden === 1 ? "1 hidden scene" : `${found.hidden} hidden scenes`;
  views.splice(0, Infinity, ...found.shown.map(({ scene }, index) => new SceneView(`Shown scene ${index + 1}`).show(scene)));
  byId("scenes").replaceChildren(...found.shown.map(({ label }, index) =>
    element("figure", {}, views[index].root, element("figcaption", {}, "Here the statement is ", element("strong", {}, String(label)), ".")),
  ));
  agreeing = null;
  byId("result").replaceChildren();
  editor.value = keep(draftKey());
  updateSubmit();
  history.replaceState(null, "", `?${query()}`);
}

async function run() {
  const text = editor.value;
  await attempt(async () => {
    const values = await request("POST", `/api/annotate/run?${query()}`, { program: text }, unlessChanged());
    const wrong = values.filter((value) => value.truth !== value.label).length;
    agreeing = wrong ? null : text;
    updateSubmit();
    showMessage(wrong ? `The program does not have the statement's value in ${wrong} of ${values.length} shown scenes.` : "The program has the statement's value in the shown scenes: you can submit it.", wrong ? "error" : "success");
    byId("result").replaceChildren(...values.map((value, index) =>
      element("details", { open: index === 0 },
        element("summary", { class: value.truth === value.label ? "good" : "bad" }, `${value.truth === value.label ? "✓" : "✗"} Scene ${index + 1}: ${value.truth === null ? `no value (${value.fault})` : value.truth}`),
        partsList(value.parts, views[index])),
    ));
  }, byId("result"));
}

async function submit() {
  if (isBusy("submit") || !choice.name.reportValidity()) return;
  await attempt(async () => {
    const body = { program: editor.value, name: choice.name.value };
    const { accepted, message } = await request("POST", `/api/annotate/annotations?${query()}`, body);
    if (accepted) await list();
    const next = lines.find((line) => !line.done);
    const go = accepted && next ? element("button", { type: "button", click: () => openStatement(next.id) }, "Next statement") : "";
    showMessage([`${message} `, go], accepted ? "success" : "error");
  }, byId("submit"));
}

function openStatement(id) {
  choice.statement.value = id;
  attempt(open, byId("work"));
}

choice.addEventListener("submit", (event) => event.preventDefault());
for (const name of ["appearance", "split", "name"]) {
  choice[name].addEventListener("change", () => attempt(async () => {
    keep("annotator", choice.name.value);
    await list();
    if (name !== "name") await open();
  }, byId("work")));
}
choice.statement.addEventListener("change", () => openStatement(choice.statement.value));
on("run", "click", run);
on("submit", "click", submit);

attempt(async () => {
  const wanted = new URLSearchParams(location.search);
  for (const name of ["appearance", "split"]) if (wanted.has(name)) choice[name].value = wanted.get(name);
  choice.name.value = keep("annotator");
  await list(wanted.get("statement_id"));
  await open();
}, byId("work"));
