"use strict";
// /annotate: the annotator's assignments and submissions.

const STATES = { open: "to do", done: "done", skipped: "skipped" };

function assignmentCard(assignment) {
  return element(
    "li",
    {},
    element("a", { class: "card", href: `/annotate/${assignment.id}` }, element("strong", {}, assignment.statement), element("span", {}, `${STATES[assignment.state]}, batch ${assignment.batch}`)),
  );
}

function submissionRow(submission) {
  const content = submission.program ? element("code", {}, submission.program) : submission.reason;
  const review = submission.review ? `${submission.review}${submission.note ? `: ${submission.note}` : ""}` : "";
  return element(
    "tr",
    {},
    element("td", {}, element("a", { href: `/annotate/${submission.assignment}` }, submission.statement)),
    element("td", {}, content),
    element("td", {}, submission.verdict),
    element("td", {}, review),
    element("td", {}, new Date(submission.created).toLocaleString()),
  );
}

attempt(async () => {
  const [work, history] = await Promise.all([request("GET", "/api/annotate/assignments"), request("GET", "/api/annotate/history")]);
  const order = { open: 0, skipped: 1, done: 2 };
  work.sort((a, b) => order[a.state] - order[b.state] || a.id - b.id);
  byId("work").replaceChildren(
    work.length ? element("ul", { class: "cards" }, ...work.map(assignmentCard)) : element("p", { class: "empty" }, "No statements have been assigned to you yet. In the meantime, try the tutorial."),
  );
  const headings = ["Statement", "Program or reason", "Result", "Review", "Submitted"].map((name) => element("th", { scope: "col" }, name));
  byId("history").replaceChildren(
    history.length
      ? element("table", {}, element("thead", {}, element("tr", {}, ...headings)), element("tbody", {}, ...history.map(submissionRow)))
      : element("p", { class: "empty" }, "Nothing yet."),
  );
  for (const name of ["work", "history"]) byId(name).removeAttribute("aria-busy");
});
