// Used by every page: requests to the server, messages, DOM elements.

const OUTDATED = -1; // status of a response that came after the user chose something else; it is dropped

/** An error with a message to display. */
const requestError = (status, message) => Object.assign(new Error(message), { status });

/** The URL of a path of the server, relative to the page, as a proxy may add a prefix. */
const url = (path) => document.documentElement.dataset.root + path.slice(1);

/** Sends a request and returns the JSON response; throws a requestError, also if the response is not wanted any more when it comes. */
async function request(method, path, body, isWanted = () => true) {
  const headers = { Accept: "application/json" };
  if (body !== undefined) headers["Content-Type"] = "application/json";
  let response;
  try {
    response = await fetch(url(path), { method, headers, body: body === undefined ? body : JSON.stringify(body) });
  } catch {
    throw requestError(isWanted() ? 0 : OUTDATED, "the server cannot be reached; your input is kept here: try again");
  }
  const data = await response.json().catch(() => null);
  if (!isWanted()) throw requestError(OUTDATED, "outdated");
  if (data === null) throw requestError(response.status, "the server's response cannot be read");
  if (!response.ok) throw requestError(response.status, data.message || response.statusText);
  return data;
}

/** Creates a DOM element; attributes that are functions become event listeners, children are strings or elements. */
function element(tag, attributes = {}, ...children) {
  const created = document.createElement(tag);
  for (const [name, value] of Object.entries(attributes)) {
    if (typeof value === "function") created.addEventListener(name, value);
    else if (value === true) created.setAttribute(name, "");
    else if (value !== false && value !== null && value !== undefined) created.setAttribute(name, value);
  }
  created.append(...children.filter((child) => child !== null && child !== undefined));
  return created;
}

/** Shows a message, made of strings and elements, in the page's live region, which pages put where the user looks. */
function showMessage(message, kind = "") {
  const region = byId("messages");
  region.replaceChildren(...(message ? [element("p", { class: `notice ${kind}` }, ...[message].flat())] : []));
  if (message) region.scrollIntoView({ block: "nearest" });
}

/** Runs a user's action, marking the element `busy` meanwhile; shows a requestError as a message. */
async function attempt(action, busy = null) {
  if (busy) busy.setAttribute("aria-busy", "true");
  try {
    showMessage("");
    return await action();
  } catch (fault) {
    if (fault.status === undefined) throw fault;
    if (fault.status !== OUTDATED) showMessage(fault.message, "error");
  } finally {
    if (busy) busy.removeAttribute("aria-busy");
  }
}

const byId = (id) => document.getElementById(id);
const isBusy = (id) => byId(id).getAttribute("aria-busy"); // then a second click is ignored
const on = (id, name, action) => byId(id)?.addEventListener(name, action);
const plural = (count, name) => `${count} ${name}${count === 1 ? "" : "s"}`;
const words = (name) => name.replaceAll("_", " ");
const signed = (number, digits = 1) => number.toFixed(digits).replace("-", "−");
/** Selects the option with that value; throws a requestError that names the choices. */
function select(menu, value) {
  const values = [...menu.options].map((option) => option.value);
  if (!values.includes(value)) throw requestError(404, `there is no ${menu.name} “${value}”; choose from ${values.join(", ")}`);
  menu.value = value;
}

const queryOf = (values) => new URLSearchParams(values).toString();

/** A list of names with values; those whose value is null are left out. */
function facts(pairs) {
  const shown = Object.entries(pairs).filter(([, value]) => value !== null);
  return element("dl", { class: "facts" }, ...shown.flatMap(([name, value]) => [element("dt", {}, name), element("dd", {}, value)]));
}

/** Lets keys act unless the focus is in a field, or on a control outside the section. `keys`: functions by lower-case key; one that returns false leaves the key to the browser. */
function onKeys(section, keys) {
  document.addEventListener("keydown", (event) => {
    const elsewhere = !section.contains(event.target) && event.target.closest("a, button, summary, [tabindex='0']");
    const key = event.key.length === 1 ? event.key.toLowerCase() : event.key;
    if (event.defaultPrevented || elsewhere || section.hidden || event.ctrlKey || event.metaKey || event.altKey || event.target.closest("input, select, textarea") || !(key in keys)) return;
    if (key === " " && event.target.closest("button")) return; // presses the button
    if (keys[key](event) !== false) event.preventDefault();
  });
}
