"use strict";
// The organisers' page.

const PAGE = 20;
const chosenPeople = new Set();
let nextReview = 0;

function rows(headings, lines) {
  const head = element("thead", {}, element("tr", {}, ...headings.map((name) => element("th", { scope: "col" }, name))));
  const body = lines.map((line) => element("tr", {}, ...line.map((value) => element("td", {}, value instanceof Node ? value : String(value ?? "")))));
  return element("table", {}, head, element("tbody", {}, ...body));
}

async function showStatistics() {
  const told = await ask("GET", "/api/annotate/statistics");
  const seconds = (value) => (value === null ? "–" : `${value} s`);
  const facts = [["Statements", told.statements], ["Scenes", told.scenes], ["Given to somebody", told.assigned], ["Collected", told.collected], ["Kept", told.kept], ["Skipped by all", told.skipped], ["Disputed", told.disputed], ["Time a statement, median", seconds(told.median_seconds)], ["Time a statement, mean", seconds(told.mean_seconds)]];
  byId("statistics").replaceChildren(
    element("dl", { class: "facts" }, ...facts.flatMap(([name, value]) => [element("dt", {}, name), element("dd", {}, String(value))])),
    told.annotators.length
      ? rows(["Annotator", "Accepted", "Failed", "Skipped", "Median time"], told.annotators.map((line) => [line.name, line.accepted, line.failed, line.skipped, seconds(line.median_seconds)]))
      : element("p", { class: "empty" }, "Nothing was submitted yet."),
  );
}

async function showPeople() {
  const found = await ask("GET", "/api/annotate/people");
  const line = (person) => {
    const choice = element("input", { type: "checkbox", "aria-label": `Choose ${person.name}`, change: (event) => (event.target.checked ? chosenPeople.add(person.id) : chosenPeople.delete(person.id)) });
    choice.checked = chosenPeople.has(person.id);
    const revoke = element("button", { type: "button", class: "quiet", click: () => attempt(async () => { await ask("DELETE", `/api/annotate/people/${person.id}/token`); await showPeople(); }) }, "End the link");
    return [choice, person.name, person.role, person.open, person.done, person.skipped, person.tutorial, person.has_token ? revoke : "no link"];
  };
  byId("people").replaceChildren(rows(["Choose", "Name", "Role", "To do", "Done", "Skipped", "Tutorial", "Link"], found.map(line)));
}

async function showBatches() {
  const found = await ask("GET", "/api/annotate/batches");
  byId("batches").replaceChildren(
    found.length ? rows(["Batch", "To do", "Done", "Skipped"], found.map((batch) => [batch.name, batch.open, batch.done, batch.skipped])) : element("p", { class: "empty" }, "No batches yet."),
  );
}

function submissionCard(submission) {
  const note = element("input", { maxlength: 2000, "aria-label": "Note to the annotator" });
  note.value = submission.note;
  const state = element("span", { class: "soft", role: "status" }, submission.review ? `Review: ${submission.review}` : "Not reviewed");
  const review = (verdict) =>
    attempt(async () => {
      await ask("POST", `/api/annotate/submissions/${submission.id}/reviews`, { verdict, note: note.value });
      state.textContent = `Review: ${verdict}`;
      await showStatistics();
    });
  const said = [submission.comment && `Comment: ${submission.comment}`, submission.question && `Question: ${submission.question}`].filter(Boolean);
  return element(
    "li",
    {},
    element("p", {}, `${submission.annotator}: ${submission.verdict}${submission.confidence ? `, confidence ${submission.confidence}` : ""}, ${Math.round(submission.seconds)} s. `, state),
    submission.program ? element("pre", { tabindex: 0 }, submission.program) : element("p", {}, `Reason: ${submission.reason}`),
    ...said.map((text) => element("p", { class: "small" }, text)),
    element("div", { class: "row" }, element("label", {}, "Note", note), ...["kept", "disputed", "rejected"].map((verdict) => element("button", { type: "button", click: () => review(verdict) }, { kept: "Keep", disputed: "Dispute", rejected: "Reject" }[verdict]))),
  );
}

async function showReviews(first) {
  const found = await ask("GET", `/api/annotate/reviews?first=${first}&most=${PAGE}`);
  const cards = found.map((statement) =>
    element(
      "article",
      { class: "panel" },
      element("h3", {}, statement.statement),
      element("p", { class: "soft small" }, `${statement.name}, ${statement.appearance}. `, statement.agreement === null ? "One annotator, or none accepted." : `Annotators agree on ${(100 * statement.agreement).toFixed(1)} % of ${statement.compared_scenes} scenes.`),
      element("ul", { class: "plain-list" }, ...statement.submissions.map(submissionCard)),
    ),
  );
  if (!first) byId("reviews").replaceChildren();
  byId("reviews").append(...(cards.length || first ? cards : [element("p", { class: "empty" }, "Nothing to review yet.")]));
  nextReview = found.length ? found[found.length - 1].id + 1 : nextReview;
  byId("more").hidden = found.length < PAGE;
}

const showAll = () => Promise.all([showStatistics(), showPeople(), showBatches(), showReviews(0)]);

byId("import").addEventListener("submit", (event) => {
  event.preventDefault();
  attempt(async () => {
    const told = await ask("POST", `/api/annotate/imports?split=${event.target.split.value}`, event.target.file.files[0]);
    await showAll();
    const faults = told.faults ? ` ${told.faults} faults, the first: ${told.first_faults[0]}` : "";
    say(`${told.read} statements read, ${told.added} of them new.${faults}`, told.faults ? "error" : "");
  }, event.target);
});
byId("person").addEventListener("submit", (event) => {
  event.preventDefault();
  attempt(async () => {
    const made = await ask("POST", "/api/annotate/people", { name: event.target.elements.name.value, role: event.target.role.value });
    byId("link").hidden = false;
    byId("link").textContent = `The link of ${made.name}, told this once: ${location.origin}${made.path}`;
    await showPeople();
  });
});
byId("batch").addEventListener("submit", (event) => {
  event.preventDefault();
  const form = event.target;
  const body = { name: form.elements.name.value, people: [...chosenPeople] };
  const again = event.submitter && event.submitter.name === "again";
  if (!again) Object.assign(body, { statements: Number(form.statements.value), annotators_each: Number(form.annotators_each.value) });
  attempt(async () => {
    const made = await ask("POST", again ? "/api/annotate/redistributions" : "/api/annotate/batches", body);
    await showAll();
    say(`Made: ${made.assignments} assignments.`);
  });
});
byId("more").addEventListener("click", () => attempt(() => showReviews(nextReview)));
attempt(showAll);
