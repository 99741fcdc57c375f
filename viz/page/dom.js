// Elements of the page: found, made, and the lines in which it says what it does.

/** @type {(id: string) => any} an element of the page's template, of whatever kind it is */
export const byId = id => document.getElementById(id);

/** @type {(tag: string, text?: string, more?: object) => any} */
export function element(tag, text = "", more = {}) { return Object.assign(document.createElement(tag), { textContent: text }, more); }

/** @type {(parent: HTMLElement, label: string, action: (b: any) => void, title?: string) => any} */
export function button(parent, label, action, title = "") {
  const b = element("button", label, { title, onclick: () => action(b) });
  parent.append(b);
  return b;
}

/** @type {(b: any, title: string, action: (event: any) => void) => any} */
export function titled(b, title, action) { Object.assign(b, { title, onclick: action }); b.setAttribute("aria-label", title); return b; }

/** @type {(parent: HTMLElement) => HTMLElement} */
export function rowIn(parent) {
  const row = element("div", "", { className: "row" });
  parent.append(row);
  return row;
}

/** @type {(texts: string[], tag?: string) => any} a line of a table: a heading, then cells; headings only for "th" */
export function lineOf(texts, tag = "td") {
  const tr = element("tr");
  tr.append(...texts.map((text, k) => element(k ? tag : "th", text, k && tag === "td" ? {} : { scope: k ? "col" : "row" })));
  return tr;
}

// What is read or made, and which share of it is done, where that is known; all of it leaves a note without a bar.
export function busyWith(text = "", share = NaN) {
  byId("data_state").textContent = text;
  byId("busy_bar").hidden = !text || share >= 1;
  if (share < 1) byId("busy_bar").value = share; else byId("busy_bar").removeAttribute("value");
}

export function say(text = "") {
  byId("error").textContent = text || "";
  byId("error").hidden = !text;
}

/**
 * A line for one sentence on one field, at the end of what holds it; the function that writes it, and takes it away.
 * @type {(box: HTMLElement, field: HTMLElement) => (text: string) => void}
 */
export function remarkIn(box, field) {
  const line = element("small", "", { className: "remark", hidden: true });
  line.setAttribute("role", "alert");
  box.append(line);
  return text => {
    line.textContent = text;
    line.hidden = !text;
    field.classList.toggle("refused", Boolean(text));
  };
}

/** @type {(parts: string[]) => void} the line under the title breaks between its parts, not within them */
export function tell(parts) {
  const line = byId("state"), text = parts.filter(Boolean);
  if (line.textContent === text.join(" · ")) return;
  line.title = text.join(" · ");
  line.replaceChildren(...text.flatMap((part, i) => [...(i ? [" · "] : []), element("span", part)]));
}

/** @type {(href: string, name: string) => void} */
export function save(href, name) { element("a", "", { href, download: name }).click(); }

/** @type {(name: string, content: Blob | string, kind?: string) => void} */
export function download(name, content, kind = "text/plain") {
  const address = URL.createObjectURL(content instanceof Blob ? content : new Blob([content], { type: kind }));
  save(address, name);
  setTimeout(() => URL.revokeObjectURL(address), 60000);
}

// A button clicked with the mouse would take the next space; one reached with the keyboard keeps the focus.
addEventListener("click", (/** @type {any} */ event) => { const b = event.target.closest("button"); if (b && event.detail > 0) b.blur(); });
