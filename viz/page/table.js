// The table of the recordings: each cell is a field, and what is typed above it goes to several.
import { unfold } from "./channels.js";
import { correct, formOf, refuse } from "./corrections.js";
import { byId, element, titled } from "./dom.js";
import { EXPORTED } from "./exported.js";
import { number, typedNumber } from "./numbers.js";
import { effect } from "./reactive.js";
import { complain, tellServer } from "./server.js";
import { showRecording } from "./signals.js";
import { bench, isReadable, isSound, ticked } from "./store.js";

/** @type {Record<string, string>} */
const CELLS = { added_mass_kg: "load [kg]", body_mass_kg: "body mass [kg]", unit: "unit" };
function drawTable() {
  const { rows, chosen } = bench;
  const table = byId("recordings"), held = /** @type {any} */ (document.activeElement), place = held && held.dataset.key && table.contains(held) ? [held.dataset.id, held.dataset.key] : null;
  const forms = new Map([...table.querySelectorAll("form")].map(box => [+box.dataset.id, box])), head = element("tr");
  head.append(...["fit", "file", "Hz", "seconds", "load [kg]", "body [kg]", "unit", "status", "more"].map(text => element("th", text, { scope: "col" })));
  table.replaceChildren(head);
  for (const row of rows) {
    table.append(recordingRow(row));
    const box = forms.get(row.id);  // half filled in, it stays
    if (box) unfold(row.id, box);
  }
  if (place) focusCell(place[0], place[1]); else if (held && held.isConnected) held.focus();
  const scope = byId("scope"), was = scope.value, doubtful = rows.filter(row => row.doubt).length;
  const scopes = [{ name: "ticked", n: chosen.size }, { name: "in doubt", n: doubtful }, { name: "all", n: rows.length }].filter(({ n }) => n);
  scope.replaceChildren(...scopes.map(({ name, n }) => element("option", `${name} (${n})`, { value: name })));
  scope.value = scopes.some(({ name }) => name === was) ? was : scopes.length ? scopes[0].name : "";
  byId("tick_all").textContent = areAllTicked() ? "untick all" : "tick all";
  byId("tick_all").disabled = !chosen.size && !rows.some(isSound);
}
/** @type {(id: number | string, key: string) => void} */
function focusCell(id, key) { const cell = byId("recordings").querySelector(`input[data-id="${id}"][data-key="${key}"]`); if (cell) cell.focus(); }
const areAllTicked = () => bench.chosen.size > 0 && bench.rows.every(row => bench.chosen.has(row.id) || !isSound(row));
const inScope = () => bench.rows.filter(row => ({ ticked: bench.chosen.has(row.id), "in doubt": row.doubt, all: true })[/** @type {string} */ (byId("scope").value)]);

let lastTick = -1;
/** @param {Row} row */
function recordingRow(row) {
  const { id } = row, tr = element("tr", "", { className: row.unread || row.problem ? "wrong" : row.doubt || row.warnings.length ? "warned" : "" }), shown = id === bench.shown;
  tr.dataset.id = id;
  const pick = element("input", "", { type: "checkbox", checked: bench.chosen.has(id), disabled: !isReadable(row), title: "fit this one; with Shift all between" });
  pick.setAttribute("aria-label", `fit ${row.file}`);
  pick.onclick = (/** @type {MouseEvent} */ event) => {
    const order = bench.rows.map(r => r.id), from = event.shiftKey && order.includes(lastTick) ? order.indexOf(lastTick) : order.indexOf(id), to = order.indexOf(id);
    lastTick = id;
    setTicks(bench.rows.slice(Math.min(from, to), Math.max(from, to) + 1).filter(isReadable), pick.checked);
  };
  const name = element("button", row.file.split("/").pop(), { title: [row.file, row.subject ? `subject ${row.subject}` : "", row.samples ? `${row.samples} samples at ${number(row.rate_hz || 0)} Hz` : ""].filter(Boolean).join("; ") });
  name.setAttribute("aria-pressed", shown);
  name.onclick = () => showRecording(row);
  const cells = Object.entries(CELLS).map(([key, label]) => cellField(row, key, label));
  const status = element("td", "", { className: "status" });
  const text = row.unread || row.problem || row.doubt || (shown ? row.warnings.join(" ") : "");
  if (isReadable(row) && row.warnings.length) status.append(element("span", row.doubt ? "⚠ in doubt: " : `⚠ ${row.warnings.length} warning${row.warnings.length > 1 ? "s" : ""} `, { title: row.warnings[0], className: "mark" }));
  status.append(text || (row.warnings.length ? "" : "sound"));
  if (row.doubt && row.believed) status.append(" ", titled(element("button", "it is right"), `the numbers of ${row.file} are in ${row.unit}`, () => correct([[id, { unit: row.unit }]])));
  const more = titled(element("button", "…", { className: "more" }), `channels, units and masses of ${row.file}`, () => { const form = formOf(id); if (form) form.closest("tr").remove(); else tellServer("columns", { number: id }); });
  const away = titled(element("button", "×", { className: "more" }), `remove ${row.file}`, () => tellServer("remove", { numbers: [id] }));
  const at = row.frequency_hz ? number(row.frequency_hz) : isReadable(row) ? "broadband" : "";
  const used = row.start_s || row.end_s ? `${number(row.start_s || 0)} to ${row.end_s ? number(row.end_s) : "end"}` : row.seconds ? number(row.seconds) : "";
  for (const content of [pick, name, at, used, ...cells]) tr.insertCell().append(content);
  tr.append(status);
  tr.insertCell().append(more, " ", away);
  return tr;
}

/** @type {(row: Row, key: string, label: string) => any} Enter goes down; a pasted column of a spreadsheet fills what is below */
function cellField(row, key, label) {
  const { id } = row, value = /** @type {any} */ (row)[key], is = value === null || value === undefined ? "" : String(value), input = element("input", "", { type: "text", value: is, placeholder: key === "added_mass_kg" ? "0" : key === "unit" ? "" : "?" });
  Object.assign(input.dataset, { id, key });
  input.setAttribute("aria-label", `${label} of ${row.file}`);
  if (key === "unit") input.setAttribute("list", "units"); else input.inputMode = "decimal";
  input.onchange = () => { if (input.value.trim() !== is) fill([[id, input.value]], key, input); };
  input.onkeydown = (/** @type {KeyboardEvent} */ event) => {
    if (event.key === "Escape") { input.value = is; drawTable(); }
    if (event.key !== "Enter") return;
    const next = bench.rows[bench.rows.findIndex(r => r.id === id) + 1];
    if (next) focusCell(next.id, key); else input.blur();
  };
  input.onpaste = (/** @type {ClipboardEvent} */ event) => {
    const lines = /** @type {DataTransfer} */ (event.clipboardData).getData("text").trimEnd().split(/\r?\n/), at = bench.rows.findIndex(r => r.id === id);
    if (lines.length < 2) return;
    event.preventDefault();
    fill(bench.rows.slice(at, at + lines.length).map((r, k) => [r.id, lines[k]]), key, input);
  };
  return input;
}

/** @type {(texts: [number, string][], key: string, input: any) => void} texts for one column, each checked before any is sent */
function fill(texts, key, input) {
  /** @type {[number, object][]} */
  const changes = [];
  for (const [id, text] of texts) {
    const two = /\S\t/.test(text) && "These are two columns; paste one at a time.";
    const v = key === "unit" || !text.trim() ? text.trim() : typedNumber(text.replace(/(\d)\s*kg\s*$/i, "$1"));
    const wrong = two || (key !== "unit" && typeof v === "string" && v);
    if (wrong) { if (texts.length > 1 && input.closest("tr")) complain(wrong); else refuse(input, wrong); return; }
    changes.push([id, { [key]: v }]);
  }
  input.classList.remove("refused");
  input.removeAttribute("aria-invalid");
  if (changes.length) correct(changes, changes.length === 1 ? input.closest("td") && input : null);
}

/** @type {(rows: Row[], on: boolean) => void} */
export function setTicks(rows, on) {
  const chosen = new Set(bench.chosen);
  for (const row of rows) chosen[on ? "add" : "delete"](row.id);
  bench.chosen = chosen;
  if (chosen.size) byId("scope").value = "ticked";  // who ticks means these
}

if (!EXPORTED) {
  for (const input of byId("all").querySelectorAll("input")) input.onchange = () => {
    if (!input.value.trim()) return;
    fill(inScope().map(row => [row.id, input.value]), input.dataset.key, input);
    if (!input.classList.contains("refused")) input.value = "";
  };
  byId("tick_all").onclick = () => { const off = areAllTicked(); setTicks(bench.rows.filter(row => off || isSound(row)), !off); };
  byId("keep_study").onclick = () => tellServer("keep_study", { numbers: ticked() }, "writing the study");
}
effect(drawTable);
