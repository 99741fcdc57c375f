// The workbench: recordings in, a fit of them, what it found. All of it is done by the server, as a script would do it.
"use strict";
const KEY = (document.querySelector("meta[name=key]") || {}).content || "";
const bench = {
  // Recordings: as the server lists them, by ids that the session gives once; the one that drives the table, -1 for none.
  session: "", rows: [], shown: -1, lost: false,
  // Ids that are ticked, those whose tick was taken away before a reload, and of each whether it could be fitted.
  chosen: new Set(), unticked: new Set(), fittable: new Map(),
  count: 0, running: false,  // recordings listed before, and whether a fit runs
  corrected: -1,  // id of the recording whose form was sent
  // The fit: its words and branches as the report has them, the server's document with its curves, and its number.
  fit: null, found: null, fitNumber: 0, branch: 0, plots: null,
  free: {}, bounds: {},  // what the next fit may change, by parameter
  asked: 0, fitBegan: 0,  // when Fit was pressed, and when the running one began; 0 while none runs [ms]
  wantedPath: "",  // of the report or the results that this page waits for
  draft: false,  // the model that is shown is not saved
};

// Ask for something; `working` says what, until the answer comes.
function tellServer(type, more = {}, working = "") {
  if (!["open", "check"].includes(type)) complain("");
  if (!socket || socket.readyState !== 1) return;
  socket.send(JSON.stringify({ type, key: KEY, ...more }));
  if (working) busyWith(working);
}
const OTHER_SESSION = "This page belongs to an earlier session: reload it.";
const STARTED_AGAIN = "The command was started again: recordings, ticks and fits of before are gone.";

function element(tag, text = "", more = {}) { return Object.assign(document.createElement(tag), { textContent: text }, more); }

// ---- files in -------------------------------------------------------------------------------------------------------
async function upload(files) {
  const names = [];
  complain("");
  for (const { file, name } of files) {
    busyWith(`reading ${name}`);
    const answer = await fetch(`/upload?name=${encodeURIComponent(name)}`, { method: "POST", headers: { "X-Key": KEY }, body: file }).catch(() => null);
    const known = answer && (answer.headers.get("Content-Type") || "").startsWith("application/json");
    const said = known ? await answer.json() : { text: answer && answer.status === 403 ? OTHER_SESSION : `${name} could not be sent; it may be larger than 64 MB.` };
    if (said.text) complain([complaints, said.text].filter(Boolean).join("\n")); else names.push(...said.names);
  }
  if (names.length) tellServer("open", { names }); else busyWith("");
}

// What was dropped: files, and whole folders of them.
async function dropped(items) {
  const found = [];
  async function walk(entry, path) {
    if (entry.isFile) found.push({ name: path + entry.name, file: await new Promise((done, failed) => entry.file(done, failed)) });
    else {
      const reader = entry.createReader();
      for (;;) {
        const some = await new Promise((done, failed) => reader.readEntries(done, failed));
        if (!some.length) break;
        for (const one of some) await walk(one, `${path}${entry.name}/`);
      }
    }
  }
  const entries = [...items].map(item => (item.webkitGetAsEntry ? item.webkitGetAsEntry() : null));
  const plain = [...items].map(item => (item.getAsFile ? item.getAsFile() : null));
  for (const [k, entry] of entries.entries()) { if (entry) await walk(entry, ""); else if (plain[k]) found.push({ name: plain[k].name, file: plain[k] }); }
  await upload(found);
}

if (!window.EXPORTED) {
  addEventListener("dragover", event => { event.preventDefault(); document.body.classList.add("dropping"); });
  addEventListener("dragleave", event => { if (!event.relatedTarget) document.body.classList.remove("dropping"); });
  addEventListener("drop", event => { event.preventDefault(); document.body.classList.remove("dropping"); dropped(event.dataTransfer.items); });
  for (const [id, picker] of [["choose_files", "files"], ["choose_folder", "folder"]]) {
    byId(id).onclick = () => byId(picker).click();
    byId(picker).onchange = event => upload([...event.target.files].map(file => ({ file, name: file.webkitRelativePath || file.name })));
  }
  byId("clear").onclick = () => tellServer("remove", { numbers: bench.rows.map(row => row.id) });
  byId("bundled").onclick = () => tellServer("bundled", {}, "reading the bundled study");
}

function busyWith(text) { byId("data_state").textContent = text; }
let complaints = "";
function complain(text) { complaints = text; busyWith(""); say([broken, complaints].filter(Boolean).join("\n")); }

// ---- the list of recordings -----------------------------------------------------------------------------------------
function showRecordings(document_) {
  const { session, rows: listed, shown, stale } = document_;
  if (bench.session && session !== bench.session) {
    for (const kept of [bench.chosen, bench.fittable, bench.unticked]) kept.clear();
    bench.lost = true;
    complain(`${STARTED_AGAIN} Reload this page, and drop the recordings again.`);
  }
  Object.assign(bench, { session, rows: listed, shown });
  for (const row of listed) {  // ticked as soon as it can be fitted, and not any longer than that
    const good = sound(row), before = bench.fittable.get(row.id);
    if (good && !before && !bench.unticked.delete(row.id)) bench.chosen.add(row.id);
    if (!good && (before || !readable(row))) bench.chosen.delete(row.id);
    bench.fittable.set(row.id, good);
  }
  const here = new Set(listed.map(row => row.id));
  for (const id of [...bench.fittable.keys()]) if (!here.has(id)) { bench.fittable.delete(id); bench.chosen.delete(id); }
  busyWith("");
  drawTable();
  bench.corrected = -1;
  drawMatrix();
  if (!window.EXPORTED && listed.length !== bench.count) tab(listed.length ? "recordings" : "motion");
  bench.count = listed.length;
  byId("stale").hidden = !stale;
  byId("stale").textContent = stale;
  advise();
  byId("clear").hidden = !listed.length;
  byId("sine").hidden = bench.shown < 0;
  keepState();
}

const readable = row => !row.unread && !row.problem, sound = row => readable(row) && !row.doubt;

// What to do next, in a sentence beside the buttons that do it; a fit says its verdict here.
function advise() {
  if (!model || window.EXPORTED) return;
  const free = model.parameters.filter(p => !MASSES.has(p.name) && bench.free[p.name] !== false).length, count = bench.chosen.size;
  const slow = !model.quick && bench.rows.length > 0, bare = bench.rows.filter(row => bench.chosen.has(row.id) && !row.body_mass_kg).length;
  const doubtful = bench.rows.filter(row => row.doubt && !bench.chosen.has(row.id)).length, fit = bench.fit && bench.fit.verdict ? bench.fit : null;
  const verdict = fit && { decided: `the data decide for the ${fit.branches[0].name}`, undecided: "no branch is decided", "not compared": "one branch" }[fit.verdict];
  const parts = !bench.rows.length && !fit ? ["Drop recordings anywhere on this page, or try the example."] : [
    fit ? `Fit ${(+fit.fit_percent).toFixed(1)} %${verdict ? `; ${verdict}` : ""}.` : `${count} of ${bench.rows.length} recordings ticked.`,
    byId("stale").hidden ? "" : "Out of date; fit again.",
    doubtful ? `${doubtful} in doubt: say the unit in the table.` : "",
    bare ? `${bare} without body mass: type it in the table, once for all.` : "",
    slow && !fit ? `This model has ${free} constants${2 * count < free ? ", which so few recordings leave unknown" : ""}; its fit takes a minute or more.` : ""];
  byId("next").textContent = parts.filter(Boolean).join(" ");
  byId("two_masses").hidden = !slow;
  byId("bundled").hidden = bench.rows.length > 0;
  for (const id of ["start_fit", "start_rivals"]) byId(id).disabled = bench.running || !count;
}

// ---- the table of recordings: each cell is a field, and what is typed above it goes to several ------------------------
const CELLS = { added_mass_kg: "load [kg]", body_mass_kg: "body mass [kg]", unit: "unit" };
function drawTable() {
  const table = byId("recordings"), held = document.activeElement, place = held && held.dataset.key && table.contains(held) ? [held.dataset.id, held.dataset.key] : null;
  const forms = new Map([...table.querySelectorAll("form")].map(box => [+box.dataset.id, box])), head = element("tr");
  head.append(...["", "file", "Hz", ...Object.values(CELLS), "status", ""].map(text => element("th", text, { scope: "col" })));
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
  byId("tab_recordings").hidden = !bench.rows.length;
  byId("tabs").hidden = !bench.rows.length && byId("tab_fit").hidden && byId("tab_rivals").hidden;
}
function focusCell(id, key) { const cell = byId("recordings").querySelector(`input[data-id="${id}"][data-key="${key}"]`); if (cell) cell.focus(); }
const allTicked = () => bench.rows.every(row => bench.chosen.has(row.id) || !sound(row));
const inScope = () => bench.rows.filter(row => ({ ticked: bench.chosen.has(row.id), "in doubt": row.doubt, all: true })[byId("scope").value]);

let lastTick = -1;
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
  if (row.doubt) status.append(" ", titled(element("button", "it is right"), `the numbers of ${row.file} are in ${row.unit}`, () => correct([[id, { unit: row.unit }]])));
  const more = titled(element("button", "…", { className: "more" }), `channels, units and masses of ${row.file}`, () => { const open_ = formOf(id); if (open_) open_.closest("tr").remove(); else tellServer("columns", { number: id }); });
  const away = titled(element("button", "×", { className: "more" }), `remove ${row.file}`, () => tellServer("remove", { numbers: [id] }));
  const at = row.frequency_hz ? number(row.frequency_hz) : readable(row) ? "broadband" : "";
  for (const content of [pick, name, at, ...cells]) tr.insertCell().append(content);
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
    if (event.key === "Escape") input.value = is;
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

// Texts for one column, each checked before any is sent.
function fill(texts, key, input) {
  const changes = [];
  for (const [id, text] of texts) {
    const v = key === "unit" || !text.trim() ? text.trim() : typedNumber(text);
    if (key !== "unit" && typeof v === "string" && v) { input.classList.add("refused"); complain(v); return; }
    changes.push([id, { [key]: v }]);
  }
  input.classList.remove("refused");
  if (changes.length) correct(changes);
}
function correct(changes) { tellServer("correct", { changes }, changes.length > 1 ? `reading ${changes.length} recordings` : "reading"); }
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
  byId("keep_study").onclick = () => tellServer("keep_study", { numbers: ticked() }, "writing the study");
}

function showRecording(row) { tellServer("use", { number: row.id }, `reading ${row.file}`); }

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
    const fit = fitOf(row), known = typeof fit === "number", pick = element("button", known ? fit.toFixed(0) : "·");
    const again = repeats.length > 1 ? ` (${repeats.indexOf(row) + 1} of ${repeats.length} at ${number(row.frequency_hz)} Hz)` : "";
    pick.title = `${row.file}${again}${known ? `: fit ${fit.toFixed(1)} %` : ""}`;
    pick.setAttribute("aria-label", pick.title);
    pick.setAttribute("aria-pressed", row.id === bench.shown);
    if (known) pick.style.background = `hsl(${Math.max(0, Math.min(1, (fit - 80) / 20)) * 130} 45% 26%)`;
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
  const hertz = columns.map(([row]) => element("th", +row.frequency_hz.toFixed(1), { scope: "col" }));
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
    for (const [name, value] of new FormData(box)) {
      const [channel, key] = name.split(".");
      if (key) { if (value.trim()) told.channels[channel][key] = value.trim(); } else told[name] = value.trim();
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
  tr.append(Object.assign(element("td"), { colSpan: 8 }));
  tr.firstChild.append(box);
  byId("recordings").querySelector(`tr[data-id="${id}"]`).after(tr);
}

// ---- the fit --------------------------------------------------------------------------------------------------------
function askFit() {
  const free = model.parameters.filter(p => !MASSES.has(p.name)), held = free.filter(p => bench.free[p.name] === false);
  if (!startsAreSound()) { byId("starts").focus(); return; }
  const settings = { starts: +byId("starts").value };
  if (held.length) settings.free = free.filter(p => bench.free[p.name] !== false).map(p => p.name);
  settings.values = Object.fromEntries(held.filter(p => p.name in state.values).map(p => [p.name, state.values[p.name]]));
  settings.bounds = Object.fromEntries(Object.entries(bench.bounds).filter(([name]) => model.parameters.some(p => p.name === name)));
  bench.asked = performance.now();
  tellServer("fit", { numbers: ticked(), said: settings });
}
const remarkStarts = window.EXPORTED ? null : remarkIn(byId("starts").closest(".row"), byId("starts"));
function startsAreSound() {
  const starts = +byId("starts").value, sound = Number.isInteger(starts) && starts >= 1 && starts <= 64;
  remarkStarts(sound ? "" : "A fit has 1 to 64 starts.");
  return sound;
}
byId("starts").oninput = () => { if (!byId("starts").classList.contains("refused")) return; startsAreSound(); };
const ticked = () => [...bench.chosen].sort((a, b) => a - b);
const MASSES = new Set(["m_S", "m_F", "m_T", "added_mass"]);

function showProgress({ running, what, done, total }) {
  bench.running = running;
  advise();
  byId("stop_fit").hidden = !running;
  const bar = byId("fit_progress");
  bar.hidden = !running;
  if (total) Object.assign(bar, { max: total, value: done }); else bar.removeAttribute("value");
  byId("fit_state").textContent = what ? `${what}${total ? `: ${done} of ${total} done` : ""}` : "";
  if (running && !bench.fitBegan) bench.fitBegan = performance.now();
  if (!running) bench.fitBegan = 0;
  showSeconds();
}
// Seconds of what runs; no part of the line that is read aloud.
function showSeconds() { byId("fit_seconds").textContent = bench.fitBegan ? `${Math.floor((performance.now() - bench.fitBegan) / 1000)} s` : ""; }
if (!window.EXPORTED) setInterval(showSeconds, 1000);

function receiveFit(document_) {
  const another = document_.number !== bench.fitNumber;  // else this page lost its connection and has it again
  Object.assign(bench, { found: document_, fitNumber: document_.number });
  if (another) bench.branch = 0;
  showFit(document_.fit);
  if (document_.script) { byId("script").textContent = document_.script; byId("script_box").hidden = false; }
  drawFit();
  if (!window.EXPORTED && another) showBranch(0);
  keepState();
  stats.fitted = performance.now() - bench.asked;
}

// Sentence, verdict, both branches beside each other, notes: the words of the report.
function showFit(fit) {
  bench.fit = fit && fit.branches ? fit : null;
  byId("found").hidden = !bench.fit;
  for (const id of ["save_report", "save_results"]) byId(id).hidden = !(bench.found || (fit && fit.reported));
  for (const p of model ? model.parameters : []) if (rows[p.name]) rows[p.name].band(null);
  if (!bench.fit) { forgetFit(); return; }
  byId("fit").hidden = false;
  byId("sentence").textContent = fit.sentence || (fit.verdict ? `Fit ${(+fit.fit_percent).toFixed(1)} %; ${fit.verdict}.` : "");
  byId("reason").textContent = fit.reason;
  if (window.EXPORTED) { byId("stale").hidden = !fit.stale; byId("stale").textContent = fit.stale || ""; }
  byId("notes").replaceChildren(...fit.warnings.map(text => element("li", text)));
  byId("branches").replaceChildren(...fit.branches.map((branch, k) => {
    const b = element("button", branch.name, { title: "the foot with this branch's constants" });
    b.onclick = () => showBranch(k);
    return b;
  }));
  byId("verdict").className = fit.verdict;
  bands();
  advise();
}

// What both branches say of each constant; what is known of it is of the branch that is shown, whose name is lit.
function drawEstimates() {
  const { branches } = bench.fit, shown = branches[bench.branch] || branches[0], head = element("tr");
  head.append(element("th", bench.fit.at || ""), ...branches.map(b => element("th", b.name, { className: b === shown && branches.length > 1 ? "shown" : "" })));
  head.append(element("th", "known", { title: branches.length > 1 ? `of the ${shown.name}` : "" }));
  byId("estimates").replaceChildren(head, ...shown.rows.map((row, k) => {
    const tr = element("tr"), name = element("th", row.name, { title: row.key });
    const interval = b => { const own = b.rows[k] || row; return (own.interval || number(own.value)).replace(" ± ", " ±\u00a0").replace(" to ", "\u00a0to "); };
    if (row.unit) name.append(" ", element("small", row.unit));
    const atRest = b => { const own = (b.rows[k] || row).at_rest; return own ? { title: `at rest ${own}` } : {}; };
    tr.append(name, ...branches.map(b => element("td", interval(b), atRest(b))), element("td", row.known.replace(/identi(?=fi)/, "identi\u00ad")));
    return tr;
  }));
}

// Nothing was found with this model.
function forgetFit() {
  Object.assign(bench, { fit: null, found: null, fitNumber: 0, branch: 0 });
  byId("script_box").hidden = byId("tab_fit").hidden = true;
  byId("tabs").hidden = byId("tab_rivals").hidden && !bench.rows.length;
  if (!byId("fit_plots").hidden) tab("motion");
  drawMatrix();
  advise();
}

function bands() {
  const branch = bench.fit && bench.fit.branches[bench.branch];
  if (bench.fit) drawEstimates();
  for (const row of branch ? branch.rows : []) if (row.name in rows && "lower" in row) rows[row.name].band([row.lower, row.upper], row.interval);
  byId("branches").querySelectorAll("button").forEach((b, k) => b.setAttribute("aria-pressed", k === bench.branch));
  drawChiSquare();
  drawTrace();
  drawMatrix();
}

// The foot gets a branch's constants; flipping between the two shows what the data cannot tell apart.
function showBranch(k) {
  const branch = bench.fit.branches[k];
  if (window.EXPORTED && !(EXPORTED.live && EXPORTED.live.twin)) return;
  remember();
  bench.branch = k;
  state.values = { ...branch.values };
  state.delay_s = branch.delay_s;
  for (const p of model.parameters) {
    const v = p.name in state.values ? state.values[p.name] : p.nominal;
    if (v === p.nominal) delete state.values[p.name];
    rows[p.name].set(v);
  }
  bands();
  ask();
}

// Colours of the loads, and paler ones for the mirror's dashes, which lie over them.
const LOADS = ["#6cb6ff", "#ffb454", "#7ee0a1", "#e58fc4", "#f3e37c"], PALE = ["#cfe6ff", "#ffe6c4", "#d4f5df", "#f6d6ea", "#fbf5cf"];
const FIT_TITLES = { trace: "malleolus [m/s²]", residual: "residual [m/s²]", chi: "chi-square of each harmonic" };
function drawFit() {
  const found = bench.found;
  if (!found || !found.data) return;
  byId("tabs").hidden = byId("tab_fit").hidden = false;
  if (!bench.plots) {
    tab("fit");
    const into = byId("fit_plots");
    bench.plots = { size: new Plot(into, "transmissibility, fitted", "frequency [Hz]", "", { wide: true }), lag: new Plot(into, "phase lag behind the base [°]", "frequency [Hz]", ""),
      trace: new Plot(into, FIT_TITLES.trace, "time [ms]", ""), residual: new Plot(into, FIT_TITLES.residual, "time [ms]", ""), chi: new Plot(into, FIT_TITLES.chi, "frequency [Hz]", "") };
  }
  const loads = [...new Set(found.data.map(r => r.added_mass_kg))].sort((a, b) => a - b), size = [], lag = [], over = [[], []];
  const by = key => (a, b) => a[key] - b[key];
  loads.forEach((load, k) => {
    const colour = LOADS[k % LOADS.length], mine = found.data.filter(r => r.added_mass_kg === load).sort(by("frequency_hz"));
    const label = loads.length > 1 ? `${load} kg` : "data", x = mine.map(r => r.frequency_hz);
    size.push({ label, colour, x, y: mine.map(r => r.transmissibility), low: mine.map(r => r.lower), high: mine.map(r => r.upper), points: true });
    lag.push({ label: "", colour, x, y: unwrapped(mine.map(r => r.phase_lag_deg)), points: true });
    bench.fit.branches.forEach((branch, b) => {
      const curve = found.curves.filter(r => r.added_mass_kg === load && r.branch === branch.name).sort(by("frequency_hz")), u = curve.map(r => r.frequency_hz);
      const ink = b ? (loads.length > 1 ? PALE[k % PALE.length] : "#e58fc4") : colour, [sizes, lags] = b ? over : [size, lag];  // of one load each has a colour of its own
      sizes.push({ label: k ? "" : `${branch.name}${b ? " (dashed)" : ""}`, colour: ink, x: u, y: curve.map(r => r.transmissibility), dashed: b > 0 });
      lags.push({ label: "", colour: ink, x: u, y: unwrapped(curve.map(r => r.phase_lag_deg)), dashed: b > 0 });
    });
  });
  size.push(...over[0]);
  lag.push(...over[1]);
  bench.plots.size.set(size, [0, 1.1 * Math.max(1, ...size.map(s => largestOf(s.y)))]);
  bench.plots.lag.set(lag);
  drawChiSquare();
  drawTrace();
  nameBranch();
}

// The branch that is shown; the likelier one until another is chosen.
function shownBranchName() { const all = (bench.fit && bench.fit.branches) || []; return all.length ? (all[bench.branch] || all[0]).name : ""; }

// The branch whose constants the foot has just now; none once a slider was moved, or where there is one only.
function wornBranchName() {
  const all = (bench.fit && bench.fit.branches) || [], nominal = Object.fromEntries(model.parameters.map(p => [p.name, p.nominal]));
  const worn = all.length > 1 && all[bench.branch] && Object.entries(all[bench.branch].values).every(([name, v]) => (state.values[name] ?? nominal[name]) === v);
  return worn ? all[bench.branch].name : "";
}

function drawChiSquare() {
  if (!bench.plots || !bench.found) return;
  const whole = r => r.chi_square ?? r.chi_square_if_model_true, chi = bench.found.chi_square.filter(r => r.branch === shownBranchName());
  const order = chi.sort((a, b) => a.frequency_hz * a.harmonic - b.frequency_hz * b.harmonic);
  bench.plots.chi.box.hidden = !chi.length;
  bench.plots.chi.set([{ label: "", colour: ANKLE, x: order.map(r => r.frequency_hz * r.harmonic), y: order.map(whole), points: 5 }]);
}

// Traces, residuals, chi-square and the matrix are of the branch that is shown; where there are two they say so.
function nameBranch() {
  const of = ((bench.fit && bench.fit.branches) || []).length > 1 ? ` · ${shownBranchName()}` : "";
  if (bench.plots) for (const [key, title] of Object.entries(FIT_TITLES)) bench.plots[key].retitle(title + of);
  const caption = byId("matrix").querySelector("caption");
  if (caption) caption.textContent = `fit of each recording [%]${of}`;
}

// Measured and modelled malleolus of the recording that is shown, and what the model leaves; of no other one.
function drawTrace() {
  if (!bench.plots || !bench.found) return;
  const row = bench.rows.find(r => r.id === bench.shown), trace = row && bench.found.traces.find(t => t.file === (row.label || row.file));
  if (!trace) {
    const sentence = row ? `${row.file.split("/").pop()} is not in this fit.` : "Click a recording of this fit to see it.";
    for (const key of ["trace", "residual"]) bench.plots[key].none(sentence);
    return;
  }
  const mine = trace.models[shownBranchName()];
  const x = trace.time_s.map(t => 1e3 * t);
  bench.plots.trace.set([{ label: "measured", colour: SEEN, x, y: trace.measured, points: 3 }, { label: `model, ${mine.fit_percent.toFixed(1)} %`, colour: ANKLE, x, y: mine.model }]);
  bench.plots.residual.set([{ label: "", colour: ANKLE, x, y: trace.measured.map((v, k) => v - mine.model[k]) }]);
}

function unwrapped(degrees) {
  let turns = 0;
  return degrees.map((v, k) => { if (k) turns -= 360 * Math.round((v - degrees[k - 1]) / 360); return v + turns; });
}

// Rival models side by side, and what they say together; the words are those of the command.
function showRivals({ columns, rows, notes, adequate, script }) {
  const [sentence, ...more] = notes, row = (tag, texts) => {
    const tr = element("tr");
    tr.append(...texts.map((text, k) => element(k ? tag : "th", text, k && tag === "td" ? {} : { scope: k ? "col" : "row" })));
    return tr;
  };
  byId("fit").hidden = byId("compared").hidden = byId("tabs").hidden = byId("tab_rivals").hidden = false;
  byId("rivals_sentence").textContent = [sentence, ...more].join(" ");
  byId("rivals_script").textContent = script;
  byId("rivals").replaceChildren(row("th", columns), ...rows.map((texts, k) => Object.assign(row("td", texts), { className: adequate[k] ? "" : "ruled" })));
  tab("rivals");
}

const TABS = ["recordings", "motion", "fit", "rivals"];
function tab(name) {
  for (const id of TABS) { byId(`${id}_plots`).hidden = id !== name; byId(`tab_${id}`).setAttribute("aria-pressed", id === name); }
}
for (const id of TABS) byId(`tab_${id}`).onclick = () => tab(id);
byId("start_fit").onclick = askFit;
byId("two_masses").onclick = () => tellServer("choose", { name: "two_dof" });
byId("start_rivals").onclick = () => { tellServer("rivals", { numbers: ticked(), said: {} }); };
byId("stop_fit").onclick = () => tellServer("stop");
byId("sine").onclick = () => tellServer("sine");
for (const [id, path] of [["save_report", "/report"], ["save_results", "/results"]]) byId(id).onclick = () => {
    bench.wantedPath = path;
    if (!bench.found) { receiveReport(); return; }  // of a fit that was made before
    byId("fit_state").textContent = "writing the report";
    tellServer("report");
  };
function receiveReport() {
  if (!bench.wantedPath) return;  // another page asked
  byId("fit_state").textContent = "";
  if (bench.wantedPath === "/report") {
    if (!open("/report", "_blank")) byId("fit_state").replaceChildren("the report is ready: ", element("a", "open it", { href: "/report", target: "_blank" }));
  } else if (bench.wantedPath) save(bench.wantedPath, "results.zip");
  bench.wantedPath = "";
}

function takeAway() {
  const { frequency, peak_to_peak, added_mass, values, delay_s } = state;
  tellServer("take", { said: { frequency, peak_to_peak, added_mass, values, delay_s } });
  busyWith("writing the file");
}
function saveOfflinePage() {
  busyWith("");
  save("/take", "foot.html");
}

// A sentence in place of what was asked for; nothing waits for that any longer.
function receiveComplaint({ text, of }) {
  if (of === "report" || !of) { bench.wantedPath = ""; byId("fit_state").textContent = ""; }
  const open_ = of === "correct" && formOf(bench.corrected);
  if (of === "correct") bench.corrected = -1;
  if (open_) { complain(""); open_.remark(text); return; }
  if (of === "save") byId("editor_state").textContent = "not saved";
  complain(text);
}

// ---- what a reload keeps: this tab's sliders, branch and ticks, for the session of the command -----------------------
function keepState() {
  if (window.EXPORTED || !model || !bench.session || bench.lost) return;
  const { fitNumber, branch, free, bounds } = bench, off = bench.rows.map(row => row.id).filter(id => !bench.chosen.has(id));
  try { sessionStorage.setItem("fasbody", JSON.stringify({ key: KEY, name: model.name, state, bench: { fitNumber, branch, free, bounds }, off, held: bench.rows.length })); } catch { /* no room, or not allowed */ }
}
function recall() {
  let kept = null;
  try { kept = JSON.parse(sessionStorage.getItem("fasbody")); } catch { /* not allowed */ }
  if (kept && kept.key !== KEY && kept.held && !window.EXPORTED) complain(`${STARTED_AGAIN} Drop the recordings again.`);
  if (window.EXPORTED || !kept || kept.key !== KEY || kept.name !== model.name) return false;
  Object.assign(state, kept.state);
  Object.assign(bench, kept.bench);
  bench.unticked = new Set(kept.off);
  return true;
}

// What the server says beside models and motions; false if it is none of that.
function workbenchReceives(document_) {
  const kinds = {
    data: showRecordings, columns: correctionForm, progress: showProgress, fitted: receiveFit, rivals: showRivals,
    reported: receiveReport, kept: () => { busyWith(""); save("/study", "study.zip"); }, taken: saveOfflinePage, complaint: receiveComplaint,
    // an exported page has no editor
    saved: d => showSaved(d), models: d => listModels(d), checked: d => showCheck(d),
  };
  if (!(document_.type in kinds)) return false;
  kinds[document_.type](document_);
  return true;
}
