// The workbench: recordings in, a fit of them, what it found. All of it is done by the server, as a script would do it.
"use strict";
/** @type {Bench} */
const bench = {
  // Recordings: as the server lists them, by ids that the session gives once; the one that drives the table, -1 for none.
  session: "", rows: [], shown: -1, lost: false,
  // Ids that are ticked, those whose tick was taken away before a reload, and of each whether it could be fitted.
  chosen: new Set(), unticked: new Set(), fittable: new Map(),
  count: 0, unread: 0, running: false,  // recordings listed before, those that are still to be read, and whether a fit runs
  corrected: -1,  // id of the recording whose form was sent
  // The fit: its words and branches as the report has them, the server's document with its curves, and its number.
  fit: null, found: null, fitNumber: 0, branch: 0, plots: null,
  history: [], pair: null,  // fits of the session, and the plots of two of them
  task: "model",
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
const OTHER_SESSION = "This page belongs to an earlier session: open the address that the command printed.";
const STARTED_AGAIN = "The command was restarted: earlier recordings, ticks and fits are gone.";

function element(tag, text = "", more = {}) { return Object.assign(document.createElement(tag), { textContent: text }, more); }
let complaints = "";
function complain(text) { complaints = text; busyWith(""); say([broken, complaints].filter(Boolean).join("\n")); }

// What to do next, in a sentence beside the buttons that do it; a fit says its verdict here.
function advise() {
  if (!model || window.EXPORTED) return;
  const free = model.parameters.filter(p => !MASSES.has(p.name) && bench.free[p.name] !== false).length, count = bench.chosen.size;
  const slow = !model.quick && bench.rows.length > 0, bare = bench.rows.filter(row => bench.chosen.has(row.id) && !row.body_mass_kg).length;
  const unloaded = bench.rows.every(row => !bench.chosen.has(row.id) || !row.added_mass_kg);
  const doubtful = bench.rows.filter(row => row.doubt && !bench.chosen.has(row.id)).length, fit = bench.fit && bench.fit.verdict ? bench.fit : null;
  const verdict = fit && { decided: `decided: ${fit.branches[0].name}`, undecided: "the branch is undecided", "not compared": "one branch" }[fit.verdict];
  const parts = !bench.rows.length && !fit ? ["Drop recordings anywhere on this page, or try the example."] : [
    fit ? `Fit ${(+fit.fit_percent).toFixed(1)} %${verdict ? `; ${verdict}` : ""}.` : `${count} of ${bench.rows.length} recordings ticked.`,
    !bench.rows.length ? "Drop recordings anywhere on this page to fit again." : byId("stale").hidden ? "" : "Out of date; fit again.",
    doubtful ? `${doubtful} in an uncertain unit: confirm it in the table.` : "",
    bare ? `${bare} without body mass: type it above the table for all, or in the table.` : "",
    !fit && count > 1 && unloaded ? "All loads are 0 kg: fill in the column if the knee carried one." : "",
    slow && !fit ? `This model has ${free} constants${2 * count < free ? ", too many for so few recordings" : ""}; its fit takes a minute or more.` : ""];
  byId("next").textContent = parts.filter(Boolean).join(" ");
  const held = /** @type {any} */ (document.activeElement);
  byId("two_masses").hidden = !slow;
  byId("bundled").hidden = bench.rows.length > 0 && !bench.unread;
  byId("stop_fit").hidden = !bench.running;
  for (const id of ["start_fit", "start_rivals"]) byId(id).disabled = bench.running || !count || bench.unread > 0;
  if (held.closest("#bar .row") && (held.hidden || held.disabled)) {  // its button is gone: the focus goes on to the next one
    const next = ["stop_fit", "start_fit"].map(byId).find(b => !b.hidden && !b.disabled) || byId("tasks").querySelector("[aria-pressed=true]");
    next.focus();
  }
}

// Tasks of the column beside the foot, one of which is open; Fit and what to do next stand above them.
const TASKS = { data: "Data", fit: "Fit", model: "Model", take: "Take away" };
function openTask(name) {
  bench.task = name;
  document.body.dataset.task = name;
  for (const b of byId("tasks").children) b.setAttribute("aria-pressed", b.dataset.name === name);
  keepState();
}
for (const [name, label] of Object.entries(TASKS)) {
  const b = button(byId("tasks"), label, () => {
    openTask(name);
    if (innerWidth <= 700) document.querySelector(`section[data-task="${name}"]`).scrollIntoView();  // below the plots
  });
  b.dataset.name = name;
  b.hidden = Boolean(window.EXPORTED) && name === "data";
}
openTask("model");

// Plots and table below the foot, one of which is open, or none; where there is room the table has the column beside it.
const TABS = ["recordings", "signals", "motion", "fit", "rivals", "pair"], roomy = matchMedia("(min-width: 1250px)");
let strip = "motion";
function tab(name) {
  if (name === "recordings" && roomy.matches) { openTask("data"); return; }
  strip = name;
  Plot.close();
  for (const id of TABS) { byId(`${id}_plots`).hidden = id !== name; byId(`tab_${id}`).setAttribute("aria-pressed", id === name); }
  placeTable();
  viewSignals();
  keepState();
}
function placeTable() {
  const table = byId("recordings_plots"), aside = roomy.matches, none = !bench.rows.length, into = byId(aside ? "data" : "plots");
  if (table.parentElement !== into) into.append(table);
  if (aside) table.hidden = none;
  byId("tab_recordings").hidden = aside || none;
  byId("tab_signals").hidden = none;
}
roomy.onchange = () => { if (!roomy.matches) tab(strip); else if (strip === "recordings") tab("motion"); else placeTable(); };
for (const id of TABS) Object.assign(byId(`tab_${id}`), { title: "once more: fold it away", onclick: () => tab(strip === id ? "" : id) });
if (innerWidth > 700 && innerHeight >= 560 && innerHeight < 640) tab("");  // the foot has half of a low window
byId("start_fit").onclick = askFit;
byId("two_masses").onclick = () => tellServer("choose", { name: "two_dof" });
byId("start_rivals").onclick = () => { tellServer("rivals", { numbers: ticked(), said: {} }); };
byId("stop_fit").onclick = () => tellServer("stop");
byId("sine").onclick = () => tellServer("sine");
for (const [id, path] of [["save_report", "report"], ["save_results", "results"]]) byId(id).onclick = () => {
    bench.wantedPath = path;
    if (!bench.found) { receiveReport(); return; }  // of a fit that was made before
    tellServer("report", {}, "writing the report");
  };
function receiveReport() {
  if (!bench.wantedPath) return;  // another page asked
  busyWith("");
  if (bench.wantedPath === "report") {
    if (!open(withToken("report"), "_blank")) byId("data_state").replaceChildren("the report is ready: ", element("a", "open it", { href: withToken("report"), target: "_blank" }));
  } else if (bench.wantedPath) save(withToken(bench.wantedPath), "results.zip");
  bench.wantedPath = "";
}

function takeAway() {
  const { frequency, peak_to_peak, added_mass, values, delay_s } = state;
  tellServer("take", { said: { frequency, peak_to_peak, added_mass, values, delay_s } });
  busyWith("writing the file");
}
function saveOfflinePage() {
  busyWith("");
  save(withToken("take"), "foot.html");
}

// A sentence in place of what was asked for; nothing waits for that any longer.
function receiveComplaint({ text, of }) {
  if (of === "report" || !of) bench.wantedPath = "";
  const open_ = of === "correct" && formOf(bench.corrected);
  if (of === "correct") bench.corrected = -1;
  if (open_) { complain(""); open_.remark(text); return; }
  if (of === "correct" && sentCell && sentCell.isConnected) { complain(""); refuse(sentCell, text); return; }
  if (of === "save") byId("editor_state").textContent = "not saved";
  complain(text);
}

// What the server says beside models and motions; false if it is none of that.
function workbenchReceives(document_) {
  const kinds = {
    data: showRecordings, columns: correctionForm, signals: showSignals, progress: showProgress, fitted: receiveFit, rivals: showRivals, history: showHistory, comparison: showComparison,
    reported: receiveReport, kept: () => { busyWith(""); save(withToken("study"), "study.zip"); }, session_kept: saveSession, session: receiveSession, taken: saveOfflinePage, complaint: receiveComplaint,
    // an exported page has no editor
    saved: d => showSaved(d), models: d => listModels(d), checked: d => showCheck(d),
  };
  if (!(document_.type in kinds)) return false;
  kinds[document_.type](document_);
  return true;
}
