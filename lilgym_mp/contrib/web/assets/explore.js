"use strict";
// /explore: filters and the list of statements.

const filters = byId("filters");
let first = 0;
let searchCount = 0; // identifies the latest search

function fill(select, counts) {
  const previous = select.value;
  select.replaceChildren(
    element("option", { value: "" }, "any"),
    ...Object.entries(counts).map(([name, count]) => element("option", { value: name }, `${name} (${count})`)),
  );
  select.value = previous in counts ? previous : "";
}

async function showChoices() {
  const query = new URLSearchParams({ appearance: filters.appearance.value, split: filters.split.value });
  const choices = await request("GET", `/api/explore/choices?${query}`);
  fill(filters.phenomenon, choices.phenomena);
  fill(filters.word, choices.words);
}

async function search() {
  searchCount += 1;
  const current = searchCount;
  const query = new URLSearchParams([...new FormData(filters)].filter(([, value]) => value !== ""));
  query.set("first", first);
  history.replaceState(null, "", `?${query}`);
  const found = await request("GET", `/api/explore/statements?${query}`);
  if (current !== searchCount) return;
  const last = Math.min(found.total, first + found.page);
  byId("count").textContent = found.total ? `Statements ${first + 1} to ${last} of ${found.total}` : "No statement matches these filters.";
  byId("results").replaceChildren(
    ...found.statements.map((line) =>
      element(
        "li",
        {},
        element("img", { class: "thumbnail", src: `/api/explore/picture?${new URLSearchParams({ appearance: filters.appearance.value, split: filters.split.value, statement_id: line.id })}`, alt: "", width: 190, height: 50, loading: "lazy" }),
        element("a", { href: `/explore/${filters.appearance.value}/${filters.split.value}/${encodeURIComponent(line.id)}` }, line.statement),
        element("p", { class: "soft small" }, `${line.length} words, ${line.scenes} scenes${line.phenomena.length ? `: ${line.phenomena.join(", ")}` : ""}`),
      ),
    ),
  );
  byId("before").hidden = first === 0;
  byId("after").hidden = last >= found.total;
}

function restart() {
  first = 0;
  attempt(search);
}

filters.addEventListener("submit", (event) => { event.preventDefault(); restart(); });
filters.addEventListener("input", (event) => {
  if (!["appearance", "split"].includes(event.target.name)) restart();
});
for (const name of ["appearance", "split"]) {
  filters.elements[name].addEventListener("change", () => attempt(async () => { first = 0; await showChoices(); await search(); }));
}
byId("before").addEventListener("click", () => { first = Math.max(0, first - 30); attempt(search); });
byId("after").addEventListener("click", () => { first += 30; attempt(search); });
attempt(async () => {
  const query = new URLSearchParams(location.search);
  for (const name of ["appearance", "split", "text", "least", "most"]) if (query.get(name)) filters.elements[name].value = query.get(name);
  first = Number(query.get("first")) || 0;
  await showChoices();
  for (const name of ["phenomenon", "word"]) if (query.get(name)) filters.elements[name].value = query.get(name);
  await search();
});
