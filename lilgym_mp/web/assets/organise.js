"use strict";
// /annotate/organise: the organisers' page.

const PAGE_SIZE = 20;
const selectedPeople = new Set(); // ids
let nextReview = 0;

function table(headings, rows) {
  const head = element("thead", {}, element("tr", {}, ...headings.map((name) => element("th", { scope: "col" }, name))));
  const body = rows.map((row) => element("tr", {}, ...row.map((value) => element("td", {}, value instanceof Node ? value : String(value ?? "")))));
  return element("table", {}, head, element("tbody", {}, ...body));
}

async function showStatistics() {
  const statistics = await request("GET", "/api/annotate/statistics");
  const seconds = (value) => (value === null ? "–" : `${value} s`);
  const facts = [["Statements", statistics.statements], ["Scenes", statistics.scenes], ["Assigned", statistics.assigned], ["With an accepted program", statistics.collected], ["To export", statistics.kept], ["Skipped by all annotators", statistics.skipped], ["Disputed", statistics.disputed], ["Time per statement, median", seconds(statistics.median_seconds)], ["Time per statement, mean", seconds(statistics.mean_seconds)]];
  byId("statistics").replaceChildren(
    element("dl", { class: "facts" }, ...facts.flatMap(([name, value]) => [element("dt", {}, name), element("dd", {}, String(value))])),
    statistics.annotators.length
      ? table(["Annotator", "Accepted", "Failed", "Skipped", "Median time"], statistics.annotators.map((line) => [line.name, line.accepted, line.failed, line.skipped, seconds(line.median_seconds)]))
      : element("p", { class: "empty" }, "Nothing has been submitted yet."),
  );
}

async function showPeople() {
  const found = await request("GET", "/api/annotate/people");
  const line = (person) => {
    const choice = element("input", { type: "checkbox", "aria-label": `Select ${person.name}`, change: (event) => (event.target.checked ? selectedPeople.add(person.id) : selectedPeople.delete(person.id)) });
    choice.checked = selectedPeople.has(person.id);
    if (person.is_fixed) return [choice, person.name, person.role, person.open, person.done, person.skipped, person.tutorial, ""];
    const change = (name, work) => element("button", { type: "button", class: "quiet", click: () => attempt(async () => { await work(); await showPeople(); }) }, name);
    const path = `/api/annotate/people/${person.id}`;
    const role = element("select", { "aria-label": `Role of ${person.name}`, change: (event) => attempt(async () => { await request("PUT", `${path}/role`, { role: event.target.value }); }) }, ...["annotator", "organiser"].map((name) => element("option", {}, name)));
    role.value = person.role;
    const links = element("div", { class: "row" }, change("New link", async () => showLink(await request("POST", `${path}/token`))), person.has_token ? change("Revoke link", () => request("DELETE", `${path}/token`)) : "no link");
    return [choice, person.name, role, person.open, person.done, person.skipped, person.tutorial, links];
  };
  byId("people").replaceChildren(table(["Select", "Name", "Role", "To do", "Done", "Skipped", "Tutorial", "Link"], found.map(line)));
}

function showLink(issued) {
  byId("link").hidden = false;
  byId("link").textContent = `Link for ${issued.name}, shown only once: ${location.origin}${issued.path}`;
}

async function showBatches() {
  const found = await request("GET", "/api/annotate/batches");
  byId("batches").replaceChildren(
    found.length ? table(["Batch", "To do", "Done", "Skipped"], found.map((batch) => [batch.name, batch.open, batch.done, batch.skipped])) : element("p", { class: "empty" }, "No batches yet."),
  );
}

function submissionCard(submission) {
  const note = element("input", { maxlength: 2000, "aria-label": "Note to the annotator" });
  note.value = submission.note;
  const state = element("span", { class: "soft", role: "status" }, submission.review ? `Review: ${submission.review}` : "Not reviewed");
  const review = (verdict) =>
    attempt(async () => {
      await request("POST", `/api/annotate/submissions/${submission.id}/reviews`, { verdict, note: note.value });
      state.textContent = `Review: ${verdict}`;
      await showStatistics();
    });
  const remarks = [submission.comment && `Comment: ${submission.comment}`, submission.question && `Question: ${submission.question}`].filter(Boolean);
  return element(
    "li",
    {},
    element("p", {}, `${submission.annotator}: ${submission.verdict}${submission.confidence ? `, confidence ${submission.confidence}` : ""}, ${Math.round(submission.seconds)} s. `, state),
    submission.program ? element("pre", { tabindex: 0 }, submission.program) : element("p", {}, `Reason: ${submission.reason}`),
    ...remarks.map((text) => element("p", { class: "small" }, text)),
    element("div", { class: "row" }, element("label", {}, "Note", note), ...["kept", "disputed", "rejected"].map((verdict) => element("button", { type: "button", click: () => review(verdict) }, { kept: "Keep", disputed: "Dispute", rejected: "Reject" }[verdict]))),
  );
}

async function showReviews(first) {
  const found = await request("GET", `/api/annotate/reviews?first=${first}&most=${PAGE_SIZE}`);
  const cards = found.map((statement) =>
    element(
      "article",
      { class: "panel" },
      element("h3", {}, statement.statement),
      element("p", { class: "soft small" }, `${statement.name}, ${statement.appearance}. `, statement.agreement === null ? "Agreement needs programs by two annotators." : `The annotators' programs agree on ${(100 * statement.agreement).toFixed(1)} % of ${statement.compared_scenes} scenes.`),
      element("ul", { class: "plain-list" }, ...statement.submissions.map(submissionCard)),
    ),
  );
  if (!first) byId("reviews").replaceChildren();
  byId("reviews").append(...(cards.length || first ? cards : [element("p", { class: "empty" }, "Nothing to review yet.")]));
  nextReview = found.length ? found[found.length - 1].id + 1 : nextReview;
  byId("more").hidden = found.length < PAGE_SIZE;
}

const showAll = () => Promise.all([showStatistics(), showPeople(), showBatches(), showReviews(0)]);

byId("import").addEventListener("submit", (event) => {
  event.preventDefault();
  attempt(async () => {
    const result = await request("POST", `/api/annotate/imports?split=${event.target.split.value}`, event.target.file.files[0]);
    await showAll();
    const errors = result.faults ? ` ${result.faults} errors, the first: ${result.first_faults[0]}` : "";
    showMessage(`${result.read} statements read, ${result.added} of them new.${errors}`, result.faults ? "error" : "");
  }, event.target);
});
byId("person").addEventListener("submit", (event) => {
  event.preventDefault();
  attempt(async () => {
    showLink(await request("POST", "/api/annotate/people", { name: event.target.elements.name.value, role: event.target.role.value }));
    await showPeople();
  });
});
byId("batch").addEventListener("submit", (event) => {
  event.preventDefault();
  const form = event.target;
  const body = { name: form.elements.name.value, people: [...selectedPeople] };
  const again = event.submitter && event.submitter.name === "again";
  if (!again) Object.assign(body, { statements: Number(form.statements.value), annotators_each: Number(form.annotators_each.value) });
  attempt(async () => {
    const created = await request("POST", again ? "/api/annotate/redistributions" : "/api/annotate/batches", body);
    await showAll();
    showMessage(`${created.assignments} assignments created.`);
  });
});
byId("more").addEventListener("click", () => attempt(() => showReviews(nextReview)));
attempt(showAll);
