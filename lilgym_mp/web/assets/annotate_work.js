"use strict";
// /annotate/ID: one assignment. Drafts are saved while typing, in localStorage and on the server; submissions carry an
// idempotency key, so that a retry is stored once.

const assignment = byId("work").dataset.assignment;
const path = `/api/annotate/assignments/${assignment}`;
const draftKey = `draft-${assignment}`; // in localStorage
const view = new SceneView("The shown scene");
let version = 0;
let agreeingProgram = null; // program text that agreed with the label when last run
let pending = null; // a submission without a response; a retry reuses its key
let saving = Promise.resolve();
let saveTimer = 0;

const editor = new Editor(
  (text) => {
    try { localStorage.setItem(draftKey, JSON.stringify({ text, version })); } catch { /* full or disabled: the server stores the draft too */ }
    byId("saved").textContent = "";
    byId("result").replaceChildren();
    showMessage("");
    updateSubmitButton();
    clearTimeout(saveTimer);
    saveTimer = setTimeout(save, 800);
  },
  run,
);

byId("scene").append(view.root);

function updateSubmitButton() {
  byId("submit").disabled = agreeingProgram === null || agreeingProgram !== editor.value;
}

function newKey() {
  return [...crypto.getRandomValues(new Uint8Array(16))].map((byte) => byte.toString(16).padStart(2, "0")).join("");
}

function save() {
  saving = saving.then(async () => {
    const text = editor.value;
    try {
      version = (await request("PUT", `${path}/draft`, { program: text, version })).version;
      byId("saved").textContent = "Saved.";
      localStorage.removeItem(draftKey);
    } catch (fault) {
      byId("saved").textContent = `Not saved on the server: ${fault.message}`;
    }
  });
  return saving;
}

async function run() {
  const text = editor.value;
  await attempt(async () => {
    const result = await request("POST", `${path}/run`, { program: text });
    agreeingProgram = result.agrees ? text : null;
    updateSubmitButton();
    const outcome = result.truth === null ? `cannot be evaluated in this scene: ${result.fault}` : `is ${result.truth} in this scene`;
    const verdict = result.agrees ? "It agrees with the label: you can submit it." : `It does not agree with the label, which is ${result.label}.`;
    showMessage(`The program ${outcome}. ${verdict}`, result.agrees ? "success" : "error");
    byId("result").replaceChildren(partsList(result.parts, view));
  }, byId("result"));
}

async function send(endpoint, body) {
  if (!pending || pending.endpoint !== endpoint || pending.text !== JSON.stringify(body)) pending = { endpoint, text: JSON.stringify(body), key: newKey() };
  const payload = { ...body, key: pending.key, comment: byId("comment").value, question: byId("question").value };
  await attempt(async () => {
    const result = await request("POST", `${path}/${endpoint}`, payload);
    pending = null;
    await show(false);
    const open = (await request("GET", "/api/annotate/assignments")).filter((line) => line.state === "open" && String(line.id) !== assignment);
    const next = open.length ? element("a", { href: `/annotate/${open[0].id}` }, "Next statement") : element("a", { href: "/annotate" }, "That was the last; back to your statements");
    showMessage([`${result.message} `, result.verdict === "failed" ? "" : next], result.verdict === "failed" ? "error" : "success");
  }, byId("work"));
}

function submissionItem(submission) {
  const content = submission.program ? element("code", {}, submission.program) : `skipped: ${submission.reason}`;
  const review = submission.review ? ` Review: ${submission.review}. ${submission.note}` : "";
  return element("li", {}, content, element("br"), element("span", { class: "soft small" }, `${submission.verdict}, ${new Date(submission.created).toLocaleString()}.${review}`));
}

async function show(fillsEditor) {
  const state = await request("GET", path);
  byId("statement").textContent = state.statement;
  const hidden = state.hidden_scenes === 1 ? "1 hidden scene" : `${state.hidden_scenes} hidden scenes`;
  byId("task").replaceChildren("In this scene the statement is ", element("strong", {}, String(state.label)), `. Your program will also be checked on ${hidden}. State: ${state.state}.`);
  view.show(state.scene);
  byId("history").replaceChildren(state.submissions.length ? element("ul", {}, ...state.submissions.map(submissionItem)) : element("p", { class: "empty" }, "Nothing yet."));
  byId("work").removeAttribute("aria-busy");
  if (!fillsEditor) return;
  version = state.draft_version;
  let local = null;
  try { local = JSON.parse(localStorage.getItem(draftKey)); } catch { /* not written by this page */ }
  editor.value = local && local.text ? local.text : state.draft;
  if (local && local.text && local.text !== state.draft) {
    showMessage("Your unsaved text has been restored.");
    if (local.version === version) save();
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
