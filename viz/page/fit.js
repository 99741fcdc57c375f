// The fit: what is asked, how far it is, what it found as words, table and plots; and its rivals.
"use strict";
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

function showProgress({ running, what, done, total, share, left_s, seconds }) {
  bench.running = running;
  advise();
  const bar = byId("fit_progress");
  bar.hidden = !running;
  if (total) Object.assign(bar, { max: 1, value: share }); else bar.removeAttribute("value");
  byId("fit_state").textContent = what;
  const left = left_s === null ? "" : `, about ${left_s < 90 ? `${Math.ceil(left_s)} s` : `${Math.round(left_s / 60)} min`} left`;
  bench.fitSteps = total ? `, ${done} of about ${total} steps${left}` : "";
  bench.fitBegan = running ? performance.now() - 1000 * seconds : 0;
  showSeconds();
}
// Seconds of what runs; no part of the line that is read aloud.
function showSeconds() { byId("fit_seconds").textContent = bench.fitBegan ? `${Math.floor((performance.now() - bench.fitBegan) / 1000)} s${bench.fitSteps}` : ""; }
if (!window.EXPORTED) setInterval(showSeconds, 1000);

/** @param {Fitted} document_ */
function receiveFit(document_) {
  const another = document_.number !== bench.fitNumber;  // else this page lost its connection and has it again
  Object.assign(bench, { found: document_, fitNumber: document_.number });
  if (another) bench.branch = 0;
  showFit(document_.fit);
  drawHistory();
  if (document_.script) { byId("script").textContent = document_.script; byId("script_box").hidden = false; }
  drawFit();
  if (another && document_.data) tab("fit");
  if (!window.EXPORTED && another) { showBranch(0); openTask("fit"); }
  keepState();
  stats.fitted = performance.now() - bench.asked;
}

// Sentence, verdict, both branches beside each other, notes: the words of the report.
/** @param {Fit} fit */
function showFit(fit) {
  bench.fit = fit && fit.branches ? fit : null;
  byId("found").hidden = !bench.fit;
  byId("no_fit").hidden = Boolean(bench.fit) || !byId("compared").hidden;
  for (const id of ["save_report", "save_results"]) byId(id).hidden = !(bench.found || (fit && fit.reported));
  for (const p of model ? model.parameters : []) if (rows[p.name]) rows[p.name].band(null);
  if (!bench.fit) { forgetFit(); return; }
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
  head.append(element("th", "status", { title: branches.length > 1 ? `of the ${shown.name}` : "" }));
  byId("estimates").replaceChildren(head, ...shown.rows.map((row, k) => {
    const tr = element("tr"), name = element("th", row.name, { title: row.key });
    const interval = b => { const own = b.rows[k] || row; return (own.interval || number(own.value)).replace(" ± ", " ±\u00a0").replace(" to ", "\u00a0to "); };
    if (row.unit) name.append(" ", element("small", row.unit));
    const atRest = b => { const own = (b.rows[k] || row).at_rest; return own ? { title: `at rest ${own}` } : {}; };
    tr.append(name, ...branches.map(b => element("td", interval(b), atRest(b))), element("td", row.known));
    return tr;
  }));
}

// Nothing was found with this model.
function forgetFit() {
  Object.assign(bench, { fit: null, found: null, fitNumber: 0, branch: 0 });
  byId("script_box").hidden = byId("tab_fit").hidden = true;
  if (!byId("fit_plots").hidden) tab("motion");
  drawMatrix();
  drawHistory();
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
  byId("tab_fit").hidden = false;
  if (!bench.plots) {
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
  byId("compared").hidden = byId("tab_rivals").hidden = false;
  byId("no_fit").hidden = true;
  openTask("fit");
  byId("rivals_sentence").textContent = [sentence, ...more].join(" ");
  byId("rivals_script").textContent = script;
  byId("rivals").replaceChildren(row("th", columns), ...rows.map((texts, k) => Object.assign(row("td", texts), { className: adequate[k] ? "" : "ruled" })));
  tab("rivals");
}
