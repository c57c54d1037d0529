// Program editor: completions with their documentation, and syntax errors, all from the server's language tables.

const CHECK_DELAY = 200; // milliseconds after the last keystroke

class Editor {
  constructor(onChange, onRun) {
    this.text = byId("program");
    this.marks = byId("program-marks");
    this.list = byId("completions");
    this.onChange = onChange;
    this.onRun = onRun;
    this.words = JSON.parse(byId("editor").dataset.words);
    this.completions = [];
    this.chosen = 0;
    this.text.addEventListener("input", () => this.changed());
    this.text.addEventListener("keydown", (event) => this.key(event));
    this.text.addEventListener("click", () => this.close());
    this.text.addEventListener("blur", () => setTimeout(() => this.close(), 150));
    this.text.addEventListener("scroll", () => { this.marks.scrollTop = this.text.scrollTop; });
  }

  get value() { return this.text.value; }
  set value(text) {
    this.text.value = text;
    this.check();
  }

  changed() {
    this.offer();
    this.mark(0, 0);
    clearTimeout(this.checkTimer);
    this.checkTimer = setTimeout(() => this.check(), CHECK_DELAY);
    this.onChange(this.value);
  }

  /** Checks the syntax on the server and marks the error in the text. */
  async check() {
    const text = this.value;
    if (!text.trim()) return this.showCheck({ ok: true });
    try {
      this.showCheck(await request("POST", "/api/annotate/check", { program: text }, () => text === this.value));
    } catch (fault) {
      if (text === this.value) byId("program-fault").textContent = fault.message;
    }
  }

  showCheck(result) {
    byId("program-fault").textContent = result.ok || !result.message ? "" : `At character ${result.offset + 1}: ${result.message}`;
    this.text.setAttribute("aria-invalid", String(!result.ok && Boolean(result.message)));
    this.mark(result.offset, result.ok ? 0 : result.length);
  }

  mark(offset, length) {
    const text = this.value;
    if (!length) return this.marks.replaceChildren();
    const start = Math.min(offset, Math.max(0, text.length - 1));
    this.marks.replaceChildren(text.slice(0, start), element("mark", {}, text.slice(start, start + length) || " "), `${text.slice(start + length)}\n`);
    this.marks.scrollTop = this.text.scrollTop;
  }

  /** The dotted name that ends at the cursor. */
  get typed() {
    return /[A-Za-z_.][\w.]*$/.exec(this.value.slice(0, this.text.selectionStart))?.[0] ?? "";
  }

  offer() {
    const typed = this.typed;
    const dot = typed.lastIndexOf(".");
    const member = dot > 0 && !/^(Color|Shape|Size|Side)\./.test(typed);
    const prefix = (member ? typed.slice(dot) : typed).toLowerCase();
    this.prefixLength = prefix.length;
    const starts = (word) => word.name.toLowerCase().startsWith(prefix);
    const found = prefix.length ? this.words.filter(starts) : [];
    this.completions = found.filter((word) => word.name.toLowerCase() !== prefix).slice(0, 12);
    this.chosen = 0;
    this.showCompletions();
  }

  showCompletions() {
    const option = (word, index) =>
      element("li", { id: `completion-${index}`, role: "option", "aria-selected": String(index === this.chosen), mousedown: (event) => { event.preventDefault(); this.chosen = index; this.accept(); } },
        element("code", {}, word.signature), element("span", { class: "meaning" }, word.meaning));
    this.list.replaceChildren(...this.completions.map(option));
    const open = this.completions.length > 0;
    this.list.hidden = !open;
    if (!open) return this.text.removeAttribute("aria-activedescendant");
    this.text.setAttribute("aria-activedescendant", `completion-${this.chosen}`);
    this.list.children[this.chosen].scrollIntoView({ block: "nearest" });
  }

  close() {
    this.completions = [];
    this.showCompletions();
  }

  /** Whether the argument that begins at this place is a function, as the second one of filter_obj(all_items, is_blue). */
  takesFunction(place) {
    let before = this.value.slice(0, place);
    while (/\([^()]*\)/.test(before)) before = before.replace(/\([^()]*\)/g, "");
    const [, name, inside = ""] = /(\w+)\(([^()]*)$/.exec(before) || [];
    const given = inside.split(",");
    const parameters = this.words.find((word) => word.name === name)?.signature.split("(")[1].split(",") || [];
    return /^\s*key\s*=\s*$/.test(given.at(-1)) || (!given.at(-1).trim() && /: function/.test(parameters[given.length - 1]));
  }

  accept() {
    const word = this.completions[this.chosen];
    const at = this.text.selectionStart;
    const isCalled = word.is_function && this.value[at] !== "(" && !this.takesFunction(at - this.prefixLength);
    const added = isCalled ? `${word.name}(` : word.name;
    this.text.setRangeText(added, at - this.prefixLength, at, "end");
    this.text.focus();
    this.changed();
    this.close();
  }

  key(event) {
    const isOpen = this.completions.length > 0;
    const move = { ArrowDown: 1, ArrowUp: -1 }[event.key];
    if (event.key === "Enter" && (event.ctrlKey || event.metaKey)) this.onRun();
    else if (isOpen && move) this.chooseNext(move);
    else if (isOpen && ["Tab", "Enter"].includes(event.key)) this.accept();
    else if (isOpen && event.key === "Escape") this.close();
    else if (event.key !== "Enter") return; // programs have one line
    event.preventDefault();
  }

  chooseNext(step) {
    this.chosen = (this.chosen + step + this.completions.length) % this.completions.length;
    this.showCompletions();
  }
}
