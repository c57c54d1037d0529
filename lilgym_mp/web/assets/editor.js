"use strict";
// The editor of programs: completion, signatures and documentation from the server's language tables, errors where they are.

const CHECK_DELAY = 200; // milliseconds after the last key

class Editor {
  constructor(onChange, onRun) {
    this.text = byId("program");
    this.marks = byId("program-marks");
    this.list = byId("completions");
    this.onChange = onChange;
    this.onRun = onRun;
    this.words = [];
    this.offered = [];
    this.chosen = 0;
    this.asked = 0;
    this.isProgram = false;
    this.text.addEventListener("input", () => this.changed());
    this.text.addEventListener("keydown", (event) => this.key(event));
    this.text.addEventListener("keyup", () => this.showSignature());
    this.text.addEventListener("click", () => { this.close(); this.showSignature(); });
    this.text.addEventListener("blur", () => setTimeout(() => this.close(), 150));
    this.text.addEventListener("scroll", () => { this.marks.scrollTop = this.text.scrollTop; });
    byId("word-search").addEventListener("input", () => this.showWords());
  }

  async start() {
    const language = await ask("GET", "/api/annotate/language");
    this.groups = language.groups;
    this.words = language.words;
    this.showWords();
  }

  get value() { return this.text.value; }

  set value(text) {
    this.text.value = text;
    this.check();
  }

  changed() {
    this.offer();
    this.showSignature();
    this.mark(0, 0);
    this.isProgram = false;
    clearTimeout(this.waiting);
    this.waiting = setTimeout(() => this.check(), CHECK_DELAY);
    this.onChange(this.value);
  }

  /** Asks the language what is wrong with the text, and shows it where it is. */
  async check() {
    const text = this.value;
    this.asked += 1;
    const mine = this.asked;
    if (!text.trim()) {
      this.told({ ok: false, offset: 0, length: 0, message: "" });
      return;
    }
    try {
      const told = await ask("POST", "/api/annotate/check", { program: text });
      if (mine === this.asked) this.told(told);
    } catch (fault) {
      if (mine === this.asked) byId("program-fault").textContent = fault.message;
    }
  }

  told(found) {
    this.isProgram = found.ok;
    byId("program-fault").textContent = found.ok || !found.message ? "" : `At character ${found.offset + 1}: ${found.message}`;
    this.text.setAttribute("aria-invalid", String(!found.ok && Boolean(found.message)));
    this.mark(found.offset, found.ok ? 0 : found.length);
    document.dispatchEvent(new CustomEvent("program-checked", { detail: found }));
  }

  mark(offset, length) {
    const text = this.value;
    if (!length) {
      this.marks.replaceChildren();
      return;
    }
    const start = Math.min(offset, Math.max(0, text.length - 1));
    this.marks.replaceChildren(text.slice(0, start), element("mark", {}, text.slice(start, start + length) || " "), `${text.slice(start + length)}\n`);
    this.marks.scrollTop = this.text.scrollTop;
  }

  /** The name, with what leads to it, that ends at the cursor. */
  get typed() {
    return /[A-Za-z_.][\w.]*$/.exec(this.value.slice(0, this.text.selectionStart))?.[0] ?? "";
  }

  offer() {
    const typed = this.typed;
    const dot = typed.lastIndexOf(".");
    const member = dot > 0 && !/^(Color|Shape|Size|Side)\./.test(typed);
    const wanted = (member ? typed.slice(dot) : typed).toLowerCase();
    this.length = wanted.length;
    const starts = (word) => word.name.toLowerCase().startsWith(wanted);
    const holds = (word) => !member && wanted.length > 2 && word.name.toLowerCase().includes(wanted) && !starts(word);
    const found = wanted.length ? [...this.words.filter(starts), ...this.words.filter(holds)] : [];
    this.offered = found.filter((word) => word.name.toLowerCase() !== wanted).slice(0, 12);
    this.chosen = 0;
    this.showOffered();
  }

  showOffered() {
    this.list.replaceChildren(
      ...this.offered.map((word, index) =>
        element(
          "li",
          { id: `completion-${index}`, role: "option", "aria-selected": String(index === this.chosen), mousedown: (event) => { event.preventDefault(); this.chosen = index; this.take(); } },
          element("code", {}, word.signature),
          element("span", { class: "meaning" }, word.meaning),
        ),
      ),
    );
    const open = this.offered.length > 0;
    this.list.hidden = !open;
    if (open) {
      this.text.setAttribute("aria-activedescendant", `completion-${this.chosen}`);
      this.list.children[this.chosen].scrollIntoView({ block: "nearest" });
    } else this.text.removeAttribute("aria-activedescendant");
  }

  close() {
    this.offered = [];
    this.showOffered();
  }

  take() {
    const word = this.offered[this.chosen];
    const at = this.text.selectionStart;
    const added = word.is_function && this.value[at] !== "(" ? `${word.name}(` : word.name;
    this.text.setRangeText(added, at - this.length, at, "end");
    this.text.focus();
    this.changed();
    this.close();
  }

  key(event) {
    if (event.key === "Enter" && (event.ctrlKey || event.metaKey)) {
      event.preventDefault();
      this.onRun();
    } else if (event.key === "Enter" && !this.offered.length) {
      event.preventDefault(); // a program is one line
    } else if (this.offered.length && ["ArrowDown", "ArrowUp"].includes(event.key)) {
      event.preventDefault();
      const step = event.key === "ArrowDown" ? 1 : -1;
      this.chosen = (this.chosen + step + this.offered.length) % this.offered.length;
      this.showOffered();
    } else if (this.offered.length && ["Tab", "Enter"].includes(event.key)) {
      event.preventDefault();
      this.take();
    } else if (this.offered.length && event.key === "Escape") {
      event.preventDefault();
      this.close();
    }
  }

  /** The signature of the call that the cursor is in. */
  showSignature() {
    const before = this.value.slice(0, this.text.selectionStart);
    let depth = 0;
    let name = null;
    for (let at = before.length - 1; at >= 0 && name === null; at -= 1) {
      if (before[at] === ")") depth += 1;
      else if (before[at] === "(" && depth) depth -= 1;
      else if (before[at] === "(") {
        const called = /(\w+)$/.exec(before.slice(0, at))?.[1];
        if (this.words.some((word) => word.is_function && word.name === called)) name = called;
      }
    }
    const word = this.words.find((each) => each.is_function && each.name === name);
    byId("signature").hidden = !word;
    if (word) byId("signature").replaceChildren(element("code", {}, word.signature), element("br"), word.meaning);
  }

  showWords() {
    const wanted = byId("word-search").value.toLowerCase();
    const parts = [];
    for (const group of this.groups) {
      const found = this.words.filter((word) => word.group === group && `${word.name} ${word.meaning}`.toLowerCase().includes(wanted));
      if (!found.length) continue;
      parts.push(element("h3", {}, group));
      parts.push(element("dl", {}, ...found.flatMap((word) => [element("dt", {}, element("code", {}, word.signature)), element("dd", { class: "meaning" }, word.meaning)])));
    }
    byId("words").replaceChildren(...(parts.length ? parts : [element("p", { class: "empty" }, "No such word.")]));
  }
}
