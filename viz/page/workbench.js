// The workbench: recordings in, a fit of them, what it found. All of it is done by the server, as a script would do it.
"use strict";
const KEY = (document.querySelector("meta[name=key]") || {}).content || "";
// Recordings have ids that the session gives once; `good` says of each whether it could be fitted when it was listed last.
const bench = { session: "", rows: [], shown: -1, chosen: new Set(), good: new Map(), corrected: -1, stale: "", fit: null, found: null, number: 0, branch: 0, free: {}, bounds: {}, plots: null, wanted: "", began: 0 };

function tellServer(type, more = {}) {
  if (!["open", "check"].includes(type)) complain("");
  if (socket && socket.readyState === 1) socket.send(JSON.stringify({ type, key: KEY, ...more }));
}
const EARLIER = "This page belongs to an earlier session: reload it.";
const AGAIN = "The command was started again: recordings, ticks and fits of before are gone.";

function element(tag, text = "", more = {}) { return Object.assign(document.createElement(tag), { textContent: text }, more); }

// ---- files in -------------------------------------------------------------------------------------------------------
async function upload(files) {
  const names = [];
  complain("");
  for (const { file, name } of files) {
    busyWith(`reading ${name}`);
    const answer = await fetch(`/upload?name=${encodeURIComponent(name)}`, { method: "POST", headers: { "X-Key": KEY }, body: file }).catch(() => null);
    const known = answer && (answer.headers.get("Content-Type") || "").startsWith("application/json");
    const said = known ? await answer.json() : { text: answer && answer.status === 403 ? EARLIER : `${name} could not be sent; it may be larger than 64 MB.` };
    if (said.text) complain([complaints, said.text].filter(Boolean).join("\n")); else names.push(said.name);
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
  byId("bundled").onclick = () => { busyWith("reading the bundled study"); tellServer("bundled"); };
}

function busyWith(text) { byId("data_state").textContent = text; }
let complaints = "";
function complain(text) { complaints = text; busyWith(""); say([broken, complaints].filter(Boolean).join("\n")); }

// ---- the list of recordings -----------------------------------------------------------------------------------------
function listData(document_) {
  const { session, rows: listed, shown, stale } = document_;
  if (bench.session && session !== bench.session) {
    for (const kept of [bench.chosen, bench.good, bench.unticked]) kept.clear();
    bench.lost = true;
    complain(`${AGAIN} Reload this page, and drop the recordings again.`);
  }
  Object.assign(bench, { session, rows: listed, shown, stale });
  for (const row of listed) {  // ticked as soon as it can be fitted, and not any longer than that
    const good = !row.unread && !row.problem, before = bench.good.get(row.id);
    if (good && !before && !bench.unticked.delete(row.id)) bench.chosen.add(row.id);
    if (!good) bench.chosen.delete(row.id);
    bench.good.set(row.id, good);
  }
  const here = new Set(listed.map(row => row.id));
  for (const id of [...bench.good.keys()]) if (!here.has(id)) { bench.good.delete(id); bench.chosen.delete(id); }
  busyWith("");
  const list = byId("recordings"), held = document.activeElement, forms = [...list.querySelectorAll("form")];
  list.replaceChildren(...listed.map(item));
  for (const box of forms) {  // half filled in, it stays
    const id = +box.dataset.id, at = listed.findIndex(row => row.id === id);
    if (at >= 0 && !(id === bench.corrected && bench.good.get(id))) list.children[at].append(box);
  }
  bench.corrected = -1;
  if (held && held.isConnected) held.focus();
  matrix();
  advise();
  byId("stale").hidden = !stale;
  byId("stale").textContent = stale;
  byId("fit").hidden = !(listed.length || bench.fit);
  byId("clear").hidden = !listed.length;
  byId("sine").hidden = bench.shown < 0;
  keepState();
}

// What the arch, and any other model with many constants, asks for, before it is fitted.
function advise() {
  if (!model || window.EXPORTED) return;
  const free = model.parameters.filter(p => !MASSES.has(p.name) && bench.free[p.name] !== false).length, few = 2 * bench.chosen.size < free;
  byId("advice").hidden = model.quick || !few || !bench.rows.length;
  byId("advice_text").textContent = `This model has ${free} constants, which so few recordings leave unknown, and its fit takes a minute or more.`;
}

function item(row) {
  const number = row.id, li = element("li"), shown = number === bench.shown, wrong = row.unread || row.problem;
  li.className = wrong ? "wrong" : row.warnings.length ? "warned" : "";
  const pick = element("input", "", { type: "checkbox", checked: bench.chosen.has(number), disabled: Boolean(wrong), title: "fit this one" });
  pick.setAttribute("aria-label", `fit ${row.file}`);
  pick.onchange = () => { if (pick.checked) bench.chosen.add(number); else bench.chosen.delete(number); advise(); keepState(); };
  const at = row.frequency_hz ? `${number_(row.frequency_hz)} Hz` : wrong ? "" : "broadband";
  const name = element("button", row.file.split("/").pop(), { title: row.file });
  name.title = [row.file, row.subject ? `subject ${row.subject}` : "", row.body_mass_kg ? `body mass ${number_(row.body_mass_kg)} kg` : "body mass unknown", row.samples ? `${row.samples} samples at ${number_(row.rate_hz)} Hz` : ""].filter(Boolean).join("; ");
  name.setAttribute("aria-pressed", shown);
  name.onclick = () => tellServer("use", { number });
  const about = [at, row.added_mass_kg ? `+ ${number_(row.added_mass_kg)} kg` : "", wrong || row.body_mass_kg ? "" : "mass unknown"];
  const small = element("small", about.filter(Boolean).join(" · "));
  if (!wrong && row.warnings.length) small.append(about.some(Boolean) ? " · " : "", element("span", `⚠ ${row.warnings.length} warning${row.warnings.length > 1 ? "s" : ""}`, { title: row.warnings[0], className: "mark" }));
  const more = element("button", "…", { title: `channels, units and masses of ${row.file}`, className: "more" });
  more.setAttribute("aria-label", more.title);
  more.onclick = () => { const open = li.querySelector("form"); if (open) open.remove(); else tellServer("columns", { number }); };
  const away = element("button", "×", { title: `remove ${row.file}`, className: "more" });
  away.setAttribute("aria-label", away.title);
  away.onclick = () => tellServer("remove", { numbers: [number] });
  li.append(pick, name, small, more, away);
  for (const text of [row.unread, row.problem, ...(shown ? row.warnings : [])].filter(Boolean)) li.append(element("p", text));
  return li;
}

// Subjects and loads against frequencies, coloured by how well each recording was fitted; a click shows it.
function matrix() {
  const box = byId("matrix"), good = bench.rows.filter(row => row.frequency_hz);
  const who = row => `${row.subject || ""} ${row.added_mass_kg ? `+ ${number_(row.added_mass_kg)} kg` : "no load"}`.trim();
  const lines = [...new Set(good.map(who))], hertz = [...new Set(good.map(row => +row.frequency_hz.toFixed(1)))].sort((a, b) => a - b);
  box.hidden = good.length < 4;
  if (box.hidden) { box.replaceChildren(); return; }
  const last = file => file.split("/").pop(), fits = new Map(), twice = name => bench.rows.filter(row => last(row.file) === name).length > 1;
  const said = bench.found ? bench.found.traces.map(t => ({ file: t.file, ...t.models[branchName()] })) : (bench.fit && bench.fit.recordings) || [];
  for (const r of said) fits.set(r.file, r.fit_percent).set(`*/${last(r.file)}`, r.fit_percent);
  const fitOf = row => fits.get(row.label || row.file) ?? (twice(last(row.file)) ? null : fits.get(`*/${last(row.file)}`));  // a result of another place
  const head = element("tr");
  head.append(...["Hz", ...hertz].map(text => element("th", text, { scope: "col" })));
  box.replaceChildren(element("caption", "fit of each recording [%]"), head, ...lines.map(line => {
    const tr = element("tr");
    tr.append(element("th", line, { scope: "row" }), ...hertz.map(f => {
      const td = element("td"), row = good.find(r => who(r) === line && Math.abs(r.frequency_hz - f) < 0.06);
      if (!row) return td;
      const fit = fitOf(row), known = typeof fit === "number", cell = element("button", known ? fit.toFixed(0) : "·");
      cell.title = known ? `${row.file}: fit ${fit.toFixed(1)} %` : row.file;
      cell.setAttribute("aria-label", cell.title);
      cell.setAttribute("aria-pressed", row.id === bench.shown);
      if (known) cell.style.background = `hsl(${Math.max(0, Math.min(1, (fit - 80) / 20)) * 130} 45% 26%)`;
      cell.onclick = () => tellServer("use", { number: row.id });
      td.append(cell);
      return td;
    }));
    return tr;
  }));
  whose();
}

const number_ = v => number(+v);

// The form by which channels, units, masses and loads are corrected.
function form({ number, columns, said }) {
  const at = bench.rows.findIndex(row => row.id === number), row = bench.rows[at], box = element("form");
  if (!row) return;
  const li = byId("recordings").children[at], old = li.querySelector("form");
  if (old) old.remove();
  box.dataset.id = number;
  const field = (label, name, value, list) => {
    const wrap = element("label", label), input = element(list ? "select" : "input", "", { name });
    if (list) for (const [v, text] of list) input.append(element("option", text, { value: v }));
    input.value = value === undefined || value === null ? "" : value;
    wrap.append(input);
    return wrap;
  };
  const names = [["", "as the file says"], ...columns.map(c => [c.name, c.unit ? `${c.name} [${c.unit}]` : c.name])];
  for (const channel of ["time", "base", "malleolus"]) {
    const told = (said.channels || {})[channel] || {}, set = element("fieldset");
    set.append(element("legend", channel), field("column", `${channel}.column`, told.column, names), field("unit", `${channel}.unit`, told.unit));
    if (channel !== "time") set.append(field("sign", `${channel}.sign`, told.sign, [["", "+"], ["-1", "−"]]), field("per m/s²", `${channel}.sensitivity`, told.sensitivity));
    box.append(set);
  }
  const last = element("fieldset");
  last.append(element("legend", "recording"), field("rate [Hz], without time", "rate_hz", said.rate_hz), field("body mass [kg]", "body_mass_kg", row.body_mass_kg), field("on the knee [kg]", "added_mass_kg", row.added_mass_kg));
  const apply = element("button", "Read it so", { type: "submit" });
  box.append(last, apply);
  box.onsubmit = event => {
    event.preventDefault();
    const told = { channels: {} };
    for (const [name, value] of new FormData(box)) {
      const [channel, key] = name.split(".");
      if (key) { if (value.trim()) (told.channels[channel] = told.channels[channel] || {})[key] = value.trim(); } else told[name] = value.trim();
    }
    bench.corrected = number;
    tellServer("correct", { number, said: told });
  };
  li.append(box);
}

// ---- the fit --------------------------------------------------------------------------------------------------------
function askFit() {
  const free = model.parameters.filter(p => !MASSES.has(p.name)), held = free.filter(p => bench.free[p.name] === false);
  const said = { starts: +byId("starts").value };
  if (held.length) said.free = free.filter(p => bench.free[p.name] !== false).map(p => p.name);
  said.values = Object.fromEntries(held.filter(p => p.name in state.values).map(p => [p.name, state.values[p.name]]));
  said.bounds = Object.fromEntries(Object.entries(bench.bounds).filter(([name]) => model.parameters.some(p => p.name === name)));
  bench.asked = performance.now();
  tellServer("fit", { numbers: ticked(), said });
}
const ticked = () => [...bench.chosen].sort((a, b) => a - b);
const MASSES = new Set(["m_S", "m_F", "m_T", "added_mass"]);

function progress({ running, what, done, total }) {
  for (const id of ["start_fit", "start_rivals"]) byId(id).disabled = running;
  byId("stop_fit").hidden = !running;
  const bar = byId("fit_progress");
  bar.hidden = !running;
  if (total) Object.assign(bar, { max: total, value: done }); else bar.removeAttribute("value");
  byId("fit_state").textContent = what ? `${what}${total ? `: ${done} of ${total} done` : ""}` : "";
  if (running && !bench.began) bench.began = performance.now();
  if (!running) bench.began = 0;
  passing();
}
// Seconds of what runs; no part of the line that is read aloud.
function passing() { byId("fit_seconds").textContent = bench.began ? `${Math.floor((performance.now() - bench.began) / 1000)} s` : ""; }
if (!window.EXPORTED) setInterval(passing, 1000);

function fitted(document_) {
  const another = document_.number !== bench.number;  // else this page lost its connection and has it again
  Object.assign(bench, { found: document_, number: document_.number });
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
  byId("odds").textContent = fit.odds ? `odds ${fit.odds} for ${fit.branches[0].name}` : "";
  const head = element("tr");
  for (const text of ["", ...fit.branches.map(b => b.name), "known"]) head.append(element("th", text));
  const body = fit.branches[0].rows.map((row, k) => {
    const tr = element("tr");
    const name = element("th", row.name, { title: row.key }), said = b => ((b.rows[k] || {}).interval || number(row.value)).replace(" ± ", " ±\u00a0").replace(" to ", "\u00a0to ");
    if (row.unit) name.append(" ", element("small", row.unit));
    tr.append(name, ...fit.branches.map(b => element("td", said(b))), element("td", row.known.replace(/identi(?=fi)/, "identi\u00ad")));
    return tr;
  });
  byId("estimates").replaceChildren(head, ...body);
  bands();
}

// Nothing was found with this model.
function forgetFit() {
  Object.assign(bench, { fit: null, found: null, number: 0, branch: 0 });
  byId("script_box").hidden = byId("tab_fit").hidden = true;
  byId("tabs").hidden = byId("tab_rivals").hidden;
  if (!byId("fit_plots").hidden) tab("motion");
  matrix();
}

function bands() {
  const branch = bench.fit && bench.fit.branches[bench.branch];
  for (const row of branch ? branch.rows : []) if (row.name in rows && "lower" in row) rows[row.name].band([row.lower, row.upper], row.interval);
  byId("branches").querySelectorAll("button").forEach((b, k) => b.setAttribute("aria-pressed", k === bench.branch));
  drawChi();
  drawTrace();
  matrix();
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
const FOUND = { trace: "malleolus [m/s²]", left: "residual [m/s²]", chi: "chi-square of each harmonic, if the model is true" };
function drawFit() {
  const found = bench.found;
  if (!found || !found.data) return;
  byId("tabs").hidden = byId("tab_fit").hidden = false;
  if (!bench.plots) {
    tab("fit");
    const into = byId("fit_plots");
    bench.plots = { size: new Plot(into, "transmissibility, fitted", "frequency [Hz]", "", { wide: true }), lag: new Plot(into, "phase lag behind the base [°]", "frequency [Hz]", ""),
      trace: new Plot(into, FOUND.trace, "time [ms]", ""), left: new Plot(into, FOUND.left, "time [ms]", ""), chi: new Plot(into, FOUND.chi, "frequency [Hz]", "") };
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
  drawChi();
  drawTrace();
  whose();
}

// The branch that is shown; the likelier one until another is chosen.
function branchName() { const all = (bench.fit && bench.fit.branches) || []; return all.length ? (all[bench.branch] || all[0]).name : ""; }

// The branch whose constants the foot has just now; none once a slider was moved, or where there is one only.
function branchWorn() {
  const all = (bench.fit && bench.fit.branches) || [], nominal = Object.fromEntries(model.parameters.map(p => [p.name, p.nominal]));
  const worn = all.length > 1 && all[bench.branch] && Object.entries(all[bench.branch].values).every(([name, v]) => (state.values[name] ?? nominal[name]) === v);
  return worn ? all[bench.branch].name : "";
}

function drawChi() {
  if (!bench.plots || !bench.found) return;
  const known = r => r.chi_square_if_model_true !== null, chi = bench.found.chi_square.filter(r => known(r) && r.branch === branchName());
  const order = chi.sort((a, b) => a.frequency_hz * a.harmonic - b.frequency_hz * b.harmonic);
  bench.plots.chi.box.hidden = !bench.found.chi_square.some(known);
  if (!chi.length) bench.plots.chi.none(NO_TRACE());
  else bench.plots.chi.set([{ label: "", colour: ANKLE, x: order.map(r => r.frequency_hz * r.harmonic), y: order.map(r => r.chi_square_if_model_true), points: 5 }]);
}
const NO_TRACE = () => `The ${branchName()} was found only with whatever else may be true; the model alone has no trace of it.`;

// Traces, residuals, chi-square and the matrix are of the branch that is shown; where there are two they say so.
function whose() {
  const of = ((bench.fit && bench.fit.branches) || []).length > 1 ? ` · ${branchName()}` : "";
  if (bench.plots) for (const [key, title] of Object.entries(FOUND)) bench.plots[key].retitle(title + of);
  const caption = byId("matrix").querySelector("caption");
  if (caption) caption.textContent = `fit of each recording [%]${of}`;
}

// Measured and modelled malleolus of the recording that is shown, and what the model leaves; of no other one.
function drawTrace() {
  if (!bench.plots || !bench.found) return;
  const row = bench.rows.find(r => r.id === bench.shown), trace = row && bench.found.traces.find(t => t.file === (row.label || row.file));
  if (!trace) {
    const sentence = row ? `${row.file.split("/").pop()} is not in this fit.` : "Click a recording of this fit to see it.";
    for (const key of ["trace", "left"]) bench.plots[key].none(sentence);
    return;
  }
  const mine = trace.models[branchName()];
  if (!mine) {
    for (const key of ["trace", "left"]) bench.plots[key].none(NO_TRACE());
    return;
  }
  const x = trace.time_s.map(t => 1e3 * t);
  bench.plots.trace.set([{ label: "measured", colour: SEEN, x, y: trace.measured, points: 3 }, { label: `model, ${mine.fit_percent.toFixed(1)} %`, colour: ANKLE, x, y: mine.model }]);
  bench.plots.left.set([{ label: "", colour: ANKLE, x, y: trace.measured.map((v, k) => v - mine.model[k]) }]);
}

function unwrapped(degrees) {
  let turns = 0;
  return degrees.map((v, k) => { if (k) turns -= 360 * Math.round((v - degrees[k - 1]) / 360); return v + turns; });
}

// Rival models side by side, and what they say together; the words are those of the command.
function compared({ columns, rows, notes, adequate, script }) {
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

const TABS = ["motion", "fit", "rivals"];
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
    bench.wanted = path;
    if (!bench.found) { reported(); return; }  // of a fit that was made before
    byId("fit_state").textContent = "writing the report";
    tellServer("report");
  };
function reported() {
  if (!bench.wanted) return;  // another page asked
  byId("fit_state").textContent = "";
  if (bench.wanted === "/report") {
    if (!open("/report", "_blank")) byId("fit_state").replaceChildren("the report is ready: ", element("a", "open it", { href: "/report", target: "_blank" }));
  } else if (bench.wanted) save(bench.wanted, "results.zip");
  bench.wanted = "";
}

function takeAway() {
  const { frequency, peak_to_peak, added_mass, values, delay_s } = state;
  tellServer("take", { said: { frequency, peak_to_peak, added_mass, values, delay_s } });
  busyWith("writing the file");
}
function taken() {
  busyWith("");
  save("/take", "foot.html");
}

// A sentence in place of what was asked for; nothing waits for that any longer.
function refused({ text, of }) {
  if (of === "report" || !of) { bench.wanted = ""; byId("fit_state").textContent = ""; }
  if (of === "correct") bench.corrected = -1;
  if (of === "save") byId("editor_state").textContent = "not saved";
  complain(text);
}

// ---- what a reload keeps: this tab's sliders, branch and ticks, for the session of the command -----------------------
bench.unticked = new Set();
function keepState() {
  if (window.EXPORTED || !model || !bench.session || bench.lost) return;
  const { number, branch, free, bounds } = bench, off = bench.rows.map(row => row.id).filter(id => !bench.chosen.has(id));
  try { sessionStorage.setItem("fasbody", JSON.stringify({ key: KEY, name: model.name, state, bench: { number, branch, free, bounds }, off, held: bench.rows.length })); } catch { /* no room, or not allowed */ }
}
function recall() {
  let kept = null;
  try { kept = JSON.parse(sessionStorage.getItem("fasbody")); } catch { /* not allowed */ }
  if (kept && kept.key !== KEY && kept.held && !window.EXPORTED) complain(`${AGAIN} Drop the recordings again.`);
  if (window.EXPORTED || !kept || kept.key !== KEY || kept.name !== model.name) return false;
  Object.assign(state, kept.state);
  Object.assign(bench, kept.bench);
  bench.unticked = new Set(kept.off);
  return true;
}

// What the server says beside models and motions; false if it is none of that.
function benchReceives(document_) {
  const kinds = { data: listData, columns: form, progress, fitted, rivals: compared, taken, complaint: refused, saved: d => saved(d), models: d => listModels(d), checked: d => checked(d), reported };
  if (!(document_.type in kinds)) return false;
  kinds[document_.type](document_);
  return true;
}
