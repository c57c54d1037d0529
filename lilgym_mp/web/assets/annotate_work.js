"use strict";
// The page of one assignment. Drafts are saved while typing, here and on the server; a submission that was sent twice
// is kept once.

const assignment = byId("work").dataset.assignment;
const path = `/api/annotate/assignments/${assignment}`;
const localName = `draft-${assignment}`;
const view = new SceneView("The shown scene");
let version = 0;
let agreedWith = null;
let pending = null; // a submission without an answer: sent again with the same key
let saving = Promise.resolve();
let waiting = 0;

const editor = new Editor(
  (text) => {
    try { localStorage.setItem(localName, JSON.stringify({ text, version })); } catch { /* full or forbidden: the server keeps it */ }
    byId("saved").textContent = "";
    allowSubmission();
    clearTimeout(waiting);
    waiting = setTimeout(save, 800);
  },
  run,
);

byId("scene").append(view.root);

function allowSubmission() {
  byId("submit").disabled = agreedWith === null || agreedWith !== editor.value;
}

function newKey() {
  return [...crypto.getRandomValues(new Uint8Array(16))].map((byte) => byte.toString(16).padStart(2, "0")).join("");
}

function save() {
  saving = saving.then(async () => {
    const text = editor.value;
    try {
      version = (await ask("PUT", `${path}/draft`, { program: text, version })).version;
      byId("saved").textContent = "Saved.";
      localStorage.removeItem(localName);
    } catch (fault) {
      byId("saved").textContent = `Not saved on the server: ${fault.message}`;
    }
  });
  return saving;
}

async function run() {
  const text = editor.value;
  await attempt(async () => {
    const told = await ask("POST", `${path}/run`, { program: text });
    agreedWith = told.agrees ? text : null;
    allowSubmission();
    const value = told.truth === null ? `no value: ${told.fault}` : String(told.truth);
    const verdict = told.agrees ? "It agrees with the label: you can submit it." : `The label is ${told.label}: it does not agree yet.`;
    byId("result").replaceChildren(
      element("p", { class: told.agrees ? "good" : "bad" }, `The program says ${value} of this scene. ${verdict}`),
      partsList(told.parts, view),
    );
  }, byId("result"));
}

async function send(where, body) {
  if (!pending || pending.where !== where || pending.text !== JSON.stringify(body)) pending = { where, text: JSON.stringify(body), key: newKey() };
  const said = { ...body, key: pending.key, comment: byId("comment").value, question: byId("question").value };
  await attempt(async () => {
    const told = await ask("POST", `${path}/${where}`, said);
    pending = null;
    await show(false);
    say(told.message, told.verdict === "failed" ? "error" : "");
  }, byId("work"));
}

function historyLine(line) {
  const said = line.program ? element("code", {}, line.program) : `skipped: ${line.reason}`;
  const review = line.review ? ` Review: ${line.review}. ${line.note}` : "";
  return element("li", {}, said, element("br"), element("span", { class: "soft small" }, `${line.verdict}, ${new Date(line.created).toLocaleString()}.${review}`));
}

async function show(fills) {
  const told = await ask("GET", path);
  byId("statement").textContent = told.statement;
  const hidden = told.hidden_scenes === 1 ? "1 other scene" : `${told.hidden_scenes} other scenes`;
  byId("task").replaceChildren("In this scene the statement is ", element("strong", {}, String(told.label)), `. ${hidden} of it will check your program. State: ${told.state}.`);
  view.show(told.scene);
  byId("history").replaceChildren(told.submissions.length ? element("ul", {}, ...told.submissions.map(historyLine)) : element("p", { class: "empty" }, "Nothing yet."));
  byId("work").removeAttribute("aria-busy");
  if (!fills) return;
  version = told.draft_version;
  let kept = null;
  try { kept = JSON.parse(localStorage.getItem(localName)); } catch { /* not ours */ }
  editor.value = kept && kept.text ? kept.text : told.draft;
  if (kept && kept.text && kept.text !== told.draft) {
    say("Your text from before the connection was lost is back.");
    if (kept.version === version) save();
  }
}

byId("run").addEventListener("click", run);
byId("submit").addEventListener("click", async () => {
  await save();
  const confidence = byId("confidence").value;
  await send("submissions", { program: editor.value, confidence: confidence ? Number(confidence) : null });
});
byId("skip").addEventListener("submit", (event) => {
  event.preventDefault();
  send("skip", { reason: event.target.reason.value });
});
addEventListener("online", save);

attempt(async () => {
  await editor.start();
  await show(true);
});
