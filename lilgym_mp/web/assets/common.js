"use strict";
// What every page uses: requests to the server, messages, elements.

const csrfToken = document.querySelector('meta[name="csrf-token"]').content;

class RequestError extends Error {
  constructor(status, message, fields) {
    super(message);
    this.status = status;
    this.fields = fields || [];
  }
}

/** The JSON that the server answers; throws RequestError, whose message is for people. */
async function ask(method, path, body) {
  const headers = { Accept: "application/json" };
  if (method !== "GET") headers["X-CSRF-Token"] = csrfToken;
  const isRaw = body instanceof Blob;
  if (body !== undefined && !isRaw) headers["Content-Type"] = "application/json";
  let response;
  try {
    response = await fetch(path, { method, headers, body: body === undefined || isRaw ? body : JSON.stringify(body) });
  } catch {
    throw new RequestError(0, "the server cannot be reached; what you did is kept here: try again");
  }
  const text = await response.text();
  let data = null;
  try {
    data = text ? JSON.parse(text) : null;
  } catch {
    throw new RequestError(response.status, "the server's answer cannot be read");
  }
  if (!response.ok) throw new RequestError(response.status, (data && data.message) || response.statusText, data && data.fields);
  return data;
}

/** A new element: tag, attributes (functions become listeners), children (texts or elements). */
function element(tag, attributes = {}, ...children) {
  const made = document.createElement(tag);
  for (const [name, value] of Object.entries(attributes)) {
    if (typeof value === "function") made.addEventListener(name, value);
    else if (value === true) made.setAttribute(name, "");
    else if (value !== false && value !== null && value !== undefined) made.setAttribute(name, value);
  }
  made.append(...children.filter((child) => child !== null && child !== undefined));
  return made;
}

/** Shows a message above the page's content, where screen readers announce it. */
function say(message, kind = "") {
  const place = document.getElementById("messages");
  place.replaceChildren(...(message ? [element("p", { class: `notice ${kind}` }, message)] : []));
}

/** Runs what a person asked for; an error is told, and the page stays as it is. */
async function attempt(action, busy = null) {
  if (busy) busy.setAttribute("aria-busy", "true");
  try {
    say("");
    return await action();
  } catch (fault) {
    if (!(fault instanceof RequestError)) throw fault;
    say(fault.message, "error");
    return undefined;
  } finally {
    if (busy) busy.removeAttribute("aria-busy");
  }
}

const byId = (id) => document.getElementById(id);

if (byId("logout")) {
  byId("logout").addEventListener("click", () =>
    attempt(async () => {
      await ask("POST", "/api/session/logout");
      location.assign("/");
    }),
  );
}
