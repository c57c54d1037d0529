"use strict";
// The page /annotate: the annotator's statements and submissions.

const STATES = { open: "to do", done: "done", skipped: "skipped" };

function workLine(line) {
  return element(
    "li",
    {},
    element("a", { class: "card", href: `/annotate/${line.id}` }, element("strong", {}, line.statement), element("span", {}, `${STATES[line.state]}, batch ${line.batch}`)),
  );
}

function historyRow(line) {
  const said = line.program ? element("code", {}, line.program) : line.reason;
  const review = line.review ? `${line.review}${line.note ? `: ${line.note}` : ""}` : "";
  return element(
    "tr",
    {},
    element("td", {}, element("a", { href: `/annotate/${line.assignment}` }, line.statement)),
    element("td", {}, said),
    element("td", {}, line.verdict),
    element("td", {}, review),
    element("td", {}, new Date(line.created).toLocaleString()),
  );
}

attempt(async () => {
  const [work, history] = await Promise.all([ask("GET", "/api/annotate/assignments"), ask("GET", "/api/annotate/history")]);
  const order = { open: 0, skipped: 1, done: 2 };
  work.sort((a, b) => order[a.state] - order[b.state] || a.id - b.id);
  byId("work").replaceChildren(
    work.length ? element("ul", { class: "cards" }, ...work.map(workLine)) : element("p", { class: "empty" }, "You were given no statements yet. Meanwhile, there is the tutorial."),
  );
  const heads = ["Statement", "Program or reason", "Result", "Review", "When"].map((name) => element("th", { scope: "col" }, name));
  byId("history").replaceChildren(
    history.length
      ? element("table", {}, element("thead", {}, element("tr", {}, ...heads)), element("tbody", {}, ...history.map(historyRow)))
      : element("p", { class: "empty" }, "Nothing yet."),
  );
  for (const name of ["work", "history"]) byId(name).removeAttribute("aria-busy");
});
