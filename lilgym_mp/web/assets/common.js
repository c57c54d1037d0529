"use strict";
// Used by every page: requests to the server, messages, DOM elements.

const csrfToken = document.querySelector('meta[name="csrf-token"]').content;

class RequestError extends Error {
  constructor(status, message, fields) {
    super(message);
    this.status = status;
    this.fields = fields || [];
  }
}

/** Sends a request and returns the JSON response; throws RequestError with a message to display. */
async function request(method, path, body) {
  const headers = { Accept: "application/json" };
  if (method !== "GET") headers["X-CSRF-Token"] = csrfToken;
  const isRaw = body instanceof Blob;
  if (body !== undefined && !isRaw) headers["Content-Type"] = "application/json";
  let response;
  try {
    response = await fetch(path, { method, headers, body: body === undefined || isRaw ? body : JSON.stringify(body) });
  } catch {
    throw new RequestError(0, "the server cannot be reached; your input is kept here: try again");
  }
  const text = await response.text();
  let data = null;
  try {
    data = text ? JSON.parse(text) : null;
  } catch {
    throw new RequestError(response.status, "the server's response cannot be read");
  }
  if (!response.ok) throw new RequestError(response.status, (data && data.message) || response.statusText, data && data.fields);
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

/** Shows a message in the page's live region. */
function showMessage(message, kind = "") {
  document.getElementById("messages").replaceChildren(...(message ? [element("p", { class: `notice ${kind}` }, message)] : []));
}

/** Runs a user's action, marking the element `busy` meanwhile; shows a RequestError as a message. */
async function attempt(action, busy = null) {
  if (busy) busy.setAttribute("aria-busy", "true");
  try {
    showMessage("");
    return await action();
  } catch (fault) {
    if (!(fault instanceof RequestError)) throw fault;
    showMessage(fault.message, "error");
    return undefined;
  } finally {
    if (busy) busy.removeAttribute("aria-busy");
  }
}

const byId = (id) => document.getElementById(id);

if (byId("logout")) {
  byId("logout").addEventListener("click", () =>
    attempt(async () => {
      await request("POST", "/api/session/logout");
      location.assign("/");
    }),
  );
}
