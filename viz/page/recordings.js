// The recordings: a table whose cells are fields, a matrix of loads against frequencies, and a form for channels.
"use strict";
/** @param {Recordings} document_ */
function showRecordings(document_) {
  const { session, rows: listed, shown, stale, undo: steps, unread } = document_;
  if (bench.session && session !== bench.session) {
    for (const kept of [bench.chosen, bench.fittable, bench.unticked]) kept.clear();
    bench.lost = true;
    complain(`${STARTED_AGAIN} Reload this page, and drop the recordings again.`);
  }
  Object.assign(bench, { session, rows: listed, shown, unread: unread || 0 });
  for (const row of listed) {  // ticked as soon as it can be fitted, and not any longer than that
    const good = sound(row), before = bench.fittable.get(row.id);
    if (good && !before && !bench.unticked.delete(row.id)) bench.chosen.add(row.id);
    if (!good && (before || !readable(row))) bench.chosen.delete(row.id);
    bench.fittable.set(row.id, good);
  }
  const here = new Set(listed.map(row => row.id));
  for (const id of [...bench.fittable.keys()]) if (!here.has(id)) { bench.fittable.delete(id); bench.chosen.delete(id); }
  busyWith(unread ? `reading ${unread} more` : "");
  drawTable();
  bench.corrected = -1;
  drawMatrix();
  if (!window.EXPORTED && listed.length !== bench.count) {
    tab(listed.length ? "recordings" : "motion");
    if (listed.length && !bench.count) openTask("data");
  }
  bench.count = listed.length;
  byId("stale").hidden = !stale;
  byId("stale").textContent = stale;
  advise();
  byId("clear").hidden = !listed.length;
  ["undo_correction", "redo_correction"].forEach((name, k) => { byId(name).disabled = !(steps && steps[k]); });
  byId("sine").hidden = bench.shown < 0;
  viewSignals();
  keepState();
}

/** @typedef {(row: Row) => boolean} OfRow */
/** @type {OfRow} */
const readable = row => !row.unread && !row.problem, /** @type {OfRow} */ sound = row => readable(row) && !row.doubt;
// ---- the table: each cell is a field, and what is typed above it goes to several -------------------------------------
const CELLS = { added_mass_kg: "load [kg]", body_mass_kg: "body mass [kg]", unit: "unit" };
function drawTable() {
  const table = byId("recordings"), held = /** @type {any} */ (document.activeElement), place = held && held.dataset.key && table.contains(held) ? [held.dataset.id, held.dataset.key] : null;
  const forms = new Map([...table.querySelectorAll("form")].map(box => [+box.dataset.id, box])), head = element("tr");
  head.append(...["fit", "file", "Hz", "seconds", "load [kg]", "body [kg]", "unit", "status", "more"].map(text => element("th", text, { scope: "col" })));
  table.replaceChildren(head);
  for (const row of bench.rows) {
    table.append(recordingRow(row));
    const box = forms.get(row.id);  // half filled in, it stays
    if (box && !(row.id === bench.corrected && readable(row))) unfold(row.id, box);
  }
  if (place) focusCell(...place); else if (held && held.isConnected) held.focus();
  const scope = byId("scope"), chosen = scope.value, doubtful = bench.rows.filter(row => row.doubt).length;
  const scopes = [["ticked", bench.chosen.size], ["in doubt", doubtful], ["all", bench.rows.length]].filter(([, n]) => n);
  scope.replaceChildren(...scopes.map(([name, n]) => element("option", `${name} (${n})`, { value: name })));
  scope.value = scopes.some(([name]) => name === chosen) ? chosen : scopes.length ? scopes[0][0] : "";
  byId("tick_all").textContent = allTicked() ? "untick all" : "tick all";
  byId("tick_all").disabled = !bench.chosen.size && !bench.rows.some(sound);
  placeTable();
}
function focusCell(id, key) { const cell = byId("recordings").querySelector(`input[data-id="${id}"][data-key="${key}"]`); if (cell) cell.focus(); }
const allTicked = () => bench.chosen.size > 0 && bench.rows.every(row => bench.chosen.has(row.id) || !sound(row));
const inScope = () => bench.rows.filter(row => ({ ticked: bench.chosen.has(row.id), "in doubt": row.doubt, all: true })[byId("scope").value]);

let lastTick = -1;
/** @param {Row} row */
function recordingRow(row) {
  const { id } = row, tr = element("tr", "", { className: row.unread || row.problem ? "wrong" : row.doubt || row.warnings.length ? "warned" : "" }), shown = id === bench.shown;
  tr.dataset.id = id;
  const pick = element("input", "", { type: "checkbox", checked: bench.chosen.has(id), disabled: !readable(row), title: "fit this one; with Shift all between" });
  pick.setAttribute("aria-label", `fit ${row.file}`);
  pick.onclick = event => {
    const order = bench.rows.map(r => r.id), from = event.shiftKey && order.includes(lastTick) ? order.indexOf(lastTick) : order.indexOf(id), to = order.indexOf(id);
    for (const r of bench.rows.slice(Math.min(from, to), Math.max(from, to) + 1)) if (readable(r)) bench.chosen[pick.checked ? "add" : "delete"](r.id);
    lastTick = id;
    ticksChanged();
  };
  const name = element("button", row.file.split("/").pop(), { title: [row.file, row.subject ? `subject ${row.subject}` : "", row.samples ? `${row.samples} samples at ${number(row.rate_hz)} Hz` : ""].filter(Boolean).join("; ") });
  name.setAttribute("aria-pressed", shown);
  name.onclick = () => showRecording(row);
  const cells = Object.entries(CELLS).map(([key, label]) => cellField(row, key, label));
  const status = element("td", "", { className: "status" });
  const text = row.unread || row.problem || row.doubt || (shown ? row.warnings.join(" ") : "");
  if (readable(row) && row.warnings.length) status.append(element("span", row.doubt ? "⚠ in doubt: " : `⚠ ${row.warnings.length} warning${row.warnings.length > 1 ? "s" : ""} `, { title: row.warnings[0], className: "mark" }));
  status.append(text || (row.warnings.length ? "" : "sound"));
  if (row.doubt && row.believed) status.append(" ", titled(element("button", "it is right"), `the numbers of ${row.file} are in ${row.unit}`, () => correct([[id, { unit: row.unit }]])));
  const more = titled(element("button", "…", { className: "more" }), `channels, units and masses of ${row.file}`, () => { const open_ = formOf(id); if (open_) open_.closest("tr").remove(); else tellServer("columns", { number: id }); });
  const away = titled(element("button", "×", { className: "more" }), `remove ${row.file}`, () => tellServer("remove", { numbers: [id] }));
  const at = row.frequency_hz ? number(row.frequency_hz) : readable(row) ? "broadband" : "";
  const used = row.start_s || row.end_s ? `${number(row.start_s || 0)} to ${row.end_s ? number(row.end_s) : "end"}` : row.seconds ? number(row.seconds) : "";
  for (const content of [pick, name, at, used, ...cells]) tr.insertCell().append(content);
  tr.append(status);
  tr.insertCell().append(more, " ", away);
  return tr;
}
function titled(b, title, action) { Object.assign(b, { title, onclick: action }); b.setAttribute("aria-label", title); return b; }

// A field of the table. Enter goes down; a pasted column of a spreadsheet fills what is below.
function cellField(row, key, label) {
  const { id } = row, is = row[key] === null || row[key] === undefined ? "" : String(row[key]), input = element("input", "", { type: "text", value: is, placeholder: key === "added_mass_kg" ? "0" : key === "unit" ? "" : "?" });
  Object.assign(input.dataset, { id, key });
  input.setAttribute("aria-label", `${label} of ${row.file}`);
  if (key === "unit") input.setAttribute("list", "units"); else input.inputMode = "decimal";
  const take = () => { if (input.value.trim() !== is) fill([[id, input.value]], key, input); };
  input.onchange = take;
  input.onkeydown = event => {
    if (event.key === "Escape") { input.value = is; drawTable(); }
    if (event.key !== "Enter") return;
    const next = bench.rows[bench.rows.findIndex(r => r.id === id) + 1];
    if (next) focusCell(next.id, key); else input.blur();
  };
  input.onpaste = event => {
    const lines = event.clipboardData.getData("text").trimEnd().split(/\r?\n/);
    if (lines.length < 2) return;
    event.preventDefault();
    fill(bench.rows.slice(bench.rows.findIndex(r => r.id === id)).map((r, k) => [r.id, lines[k]]).filter(([, text]) => text !== undefined), key, input);
  };
  return input;
}

// A cell keeps what cannot be taken, and its row says why; the next drawing of the table brings its value back.
function refuse(input, text) {
  const tr = input.closest("tr");
  input.classList.add("refused");
  input.setAttribute("aria-invalid", "true");
  if (!tr) { complain(text); return; }
  const reason = element("span", text, { id: "refused" });
  reason.setAttribute("role", "alert");
  input.setAttribute("aria-describedby", "refused");
  tr.className = "wrong";
  tr.querySelector(".status").replaceChildren(reason);
}
/** @type {any} the cell whose text the server has */
let sentCell = null;

// Texts for one column, each checked before any is sent.
function fill(texts, key, input) {
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
function correct(changes, cell = null) { sentCell = cell; tellServer("correct", { changes }, changes.length > 1 ? `reading ${changes.length} recordings` : "reading"); }
function ticksChanged() {
  drawTable();
  if (bench.chosen.size) byId("scope").value = "ticked";  // who ticks means these
  advise();
  keepState();
}
if (!window.EXPORTED) {
  for (const input of byId("all").querySelectorAll("input")) input.onchange = () => {
    if (!input.value.trim()) return;
    fill(inScope().map(row => [row.id, input.value]), input.dataset.key, input);
    if (!input.classList.contains("refused")) input.value = "";
  };
  byId("tick_all").onclick = () => {
    const off = allTicked();
    for (const row of bench.rows) if (off) bench.chosen.delete(row.id); else if (sound(row)) bench.chosen.add(row.id);
    ticksChanged();
  };
  byId("undo_correction").onclick = () => tellServer("undo", {}, "reading");
  byId("redo_correction").onclick = () => tellServer("undo", { again: true }, "reading");
  byId("keep_study").onclick = () => tellServer("keep_study", { numbers: ticked() }, "writing the study");
}

function showRecording(row) {
  tellServer("use", { number: row.id }, `reading ${row.file}`);
  viewed.id = row.id;
  viewSignals();
}

// Subjects and loads against frequencies, coloured by how well each recording was fitted; a click shows it. What was
// recorded again at a frequency has a line of its own.
function drawMatrix() {
  const box = byId("matrix"), steady = bench.rows.filter(row => row.frequency_hz);
  box.hidden = steady.length < 4;
  if (box.hidden) { box.replaceChildren(); return; }
  const condition = row => `${row.subject || ""} ${row.added_mass_kg ? `+ ${number(row.added_mass_kg)} kg` : "no load"}`.trim();
  const columns = [];  // what was set alike is measured within a tenth of a hertz
  for (const row of [...steady].sort((a, b) => a.frequency_hz - b.frequency_hz)) {
    if (columns.length && row.frequency_hz - columns.at(-1)[0].frequency_hz < 0.1) columns.at(-1).push(row); else columns.push([row]);
  }
  const last = file => file.split("/").pop(), fits = new Map(), namedTwice = name => bench.rows.filter(row => last(row.file) === name).length > 1;
  const fitted = bench.found ? bench.found.traces.map(t => ({ file: t.file, ...t.models[shownBranchName()] })) : (bench.fit && bench.fit.recordings) || [];
  for (const r of fitted) fits.set(r.file, r.fit_percent).set(`*/${last(r.file)}`, r.fit_percent);
  const fitOf = row => fits.get(row.label || row.file) ?? (namedTwice(last(row.file)) ? null : fits.get(`*/${last(row.file)}`));  // a result of another place
  const cell = (row, repeats) => {
    const td = element("td");
    if (!row) return td;
    const fit = fitOf(row), known = typeof fit === "number", pick = element("button", known ? fit.toFixed(1) : "·");
    const again = repeats.length > 1 ? ` (${repeats.indexOf(row) + 1} of ${repeats.length} at ${number(row.frequency_hz)} Hz)` : "";
    pick.title = `${row.file}${again}${known ? `: fit ${fit.toFixed(1)} %` : ""}`;
    pick.setAttribute("aria-label", pick.title);
    pick.setAttribute("aria-pressed", row.id === bench.shown);
    if (known) pick.style.setProperty("--share", `${100 * Math.max(0, Math.min(1, (fit - 80) / 20))}%`);
    pick.onclick = () => showRecording(row);
    td.append(pick);
    return td;
  };
  const line = (heading, scope, cells) => {
    const tr = element("tr");
    tr.append(element("th", heading, { scope }), ...cells);
    return tr;
  };
  const lines = [...new Set(steady.map(condition))].flatMap(name => {
    const cells = columns.map(column => column.filter(row => condition(row) === name).sort((a, b) => a.id - b.id));
    return Array.from({ length: Math.max(...cells.map(repeats => repeats.length)) }, (_, k) =>
      line(k ? `repeat ${k + 1}` : name, "row", cells.map(repeats => cell(repeats[k], repeats))));
  });
  box.style.setProperty("--columns", String(columns.length));
  const hertz = columns.map(([row]) => element("th", String(+row.frequency_hz.toFixed(1)), { scope: "col" }));
  box.replaceChildren(element("caption", "fit of each recording [%]"), line("Hz", "col", hertz), ...lines);
  nameBranch();
}

// The form by which channels, units, masses and loads are corrected. Numbers that are none are said at their fields.
function correctionForm({ number: id, columns, said }) {
  const at = bench.rows.findIndex(row => row.id === id), row = bench.rows[at], box = element("form"), numbers = [];
  if (!row) return;
  box.dataset.id = id;
  const field = (label, name, value, list) => {
    const wrap = element("label", label), input = element(list ? "select" : "input", "", { name });
    if (list) for (const [v, text] of list) input.append(element("option", text, { value: v }));
    input.value = value === undefined || value === null ? "" : value;
    wrap.append(input);
    return wrap;
  };
  const numberField = (label, name, value) => {
    const wrap = field(label, name, value), input = wrap.lastChild, remark = remarkIn(wrap, input);
    input.oninput = () => remark("");
    numbers.push({ input, remark });
    return wrap;
  };
  const names = [["", "as the file says"], ...columns.map(c => [c.name, c.unit ? `${c.name} [${c.unit}]` : c.name])];
  for (const channel of ["time", "base", "malleolus"]) {
    const told = (said.channels || {})[channel] || {}, set = element("fieldset");
    set.append(element("legend", channel), field("column", `${channel}.column`, told.column, names), field("unit", `${channel}.unit`, told.unit));
    if (channel !== "time") set.append(field("sign", `${channel}.sign`, told.sign, [["", "+"], ["-1", "−"]]), field("per m/s², or 100 mV/g", `${channel}.sensitivity`, told.sensitivity));
    box.append(set);
  }
  const last = element("fieldset");
  last.append(element("legend", "recording"), numberField("rate [Hz], without time", "rate_hz", said.rate_hz));
  const apply = element("button", "Read it so", { type: "submit" }), alike = bench.rows.filter(r => r.unread).map(r => r.id), others = alike.filter(n => n !== id).length;
  box.append(last, apply);
  if (row.unread && others) box.append(" ", element("button", `and the ${others} others that cannot be read`, { type: "submit", value: "all" }));
  box.remark = remarkIn(box, apply);
  box.addEventListener("input", () => box.remark(""));
  box.onsubmit = event => {
    event.preventDefault();
    const wrong = numbers.filter(({ input, remark }) => {
      const typed = input.value.trim() ? typedNumber(input.value) : null, problem = typeof typed === "string" ? typed : "";
      remark(problem);
      if (typeof typed === "number") input.value = typed;
      return problem;
    });
    if (wrong.length) { wrong[0].input.focus(); return; }
    const told = { channels: { time: {}, base: {}, malleolus: {} } };
    for (const [name, typed] of new FormData(box)) {
      const [channel, key] = name.split("."), value = String(typed).trim();
      if (key) { if (value) told.channels[channel][key] = value; } else told[name] = value;
    }
    bench.corrected = id;
    correct((event.submitter && event.submitter.value === "all" ? alike : [id]).map(n => [n, told]));
  };
  unfold(id, box);
}
const formOf = id => byId("recordings").querySelector(`form[data-id="${id}"]`);
function unfold(id, box) {
  const old = formOf(id), tr = element("tr");
  if (old) old.closest("tr").remove();
  tr.append(Object.assign(element("td"), { colSpan: 9 }));
  tr.firstChild.append(box);
  byId("recordings").querySelector(`tr[data-id="${id}"]`).after(tr);
}
