// The fit: what is asked, how far it is, and what it found in words.
import { ask } from "./ask.js";
import { byId, element, remarkIn } from "./dom.js";
import { EXPORTED } from "./exported.js";
import { hasTwin } from "./live.js";
import { number } from "./numbers.js";
import { openTask, tab } from "./panels.js";
import { effect } from "./reactive.js";
import { tellServer } from "./server.js";
import { bench, isMass, page, shownBranch, state, stats, ticked } from "./store.js";
import { on } from "./stream.js";
import { remember, setValues } from "./values.js";

const MOST_STARTS = 64;
const starts = byId("starts"), remarkStarts = remarkIn(starts.closest(".row"), starts);
function areStartsSound() {
  const sound = Number.isInteger(+starts.value) && starts.value >= 1 && starts.value <= MOST_STARTS;
  remarkStarts(sound ? "" : `A fit has 1 to ${MOST_STARTS} starts.`);
  return sound;
}
starts.oninput = () => { if (starts.classList.contains("refused")) areStartsSound(); };

function askFit() {
  const { parameters } = page.model, free = parameters.filter(p => !isMass(p.name)), held = free.filter(p => bench.free[p.name] === false);
  if (!areStartsSound()) { starts.focus(); return; }
  const said = {
    starts: +starts.value,
    ...(held.length ? { free: free.filter(p => bench.free[p.name] !== false).map(p => p.name) } : {}),
    values: Object.fromEntries(held.filter(p => p.name in state.values).map(p => [p.name, state.values[p.name]])),
    bounds: Object.fromEntries(Object.entries(bench.bounds).filter(([name]) => parameters.some(p => p.name === name))),
  };
  bench.asked = performance.now();
  tellServer("fit", { numbers: ticked(), said });
}
byId("start_fit").onclick = askFit;
byId("two_masses").onclick = () => tellServer("choose", { name: "two_dof" });
byId("stop_fit").onclick = () => tellServer("stop");

let steps = "";  // how many of them are done
on("progress", ({ running, what, done, total, share, left_s, seconds }) => {
  const bar = byId("fit_progress"), left = left_s === null ? "" : `, about ${left_s < 90 ? `${Math.ceil(left_s)} s` : `${Math.round(left_s / 60)} min`} left`;
  bar.hidden = !running;
  if (total) Object.assign(bar, { max: 1, value: share }); else bar.removeAttribute("value");
  byId("fit_state").textContent = what;
  steps = total ? `, ${done} of about ${total} steps${left}` : "";
  Object.assign(bench, { running, fitBegan: running ? performance.now() - 1000 * seconds : 0 });
  showSeconds();
});
// Seconds of what runs; no part of the line that is read aloud.
function showSeconds() { byId("fit_seconds").textContent = bench.fitBegan ? `${Math.floor((performance.now() - bench.fitBegan) / 1000)} s${steps}` : ""; }
if (!EXPORTED) setInterval(showSeconds, 1000);

on("fitted", found => {
  const another = found.number !== bench.fitNumber;  // else this page lost its connection and has it again
  if (another) bench.branch = 0;
  showFit(found.fit, found);
  if (another && found.data) tab("fit");
  if (!EXPORTED && another && bench.fit) { showBranch(0); openTask("fit"); }
  stats.fitted = performance.now() - bench.asked;
});

/** @type {(fit: Fit | null, found?: Fitted | null) => void} words, and where the server has them the curves; what is empty forgets the fit */
export function showFit(fit, found = null) {
  if (!fit || !fit.branches) { forgetFit(); return; }
  Object.assign(bench, { fit, ...(found ? { found, fitNumber: found.number } : {}) });
  if (EXPORTED) bench.stale = fit.stale || "";
}
// Nothing was found with this model.
export function forgetFit() {
  Object.assign(bench, { fit: null, found: null, fitNumber: 0, branch: 0 });
  if (page.strip === "fit") tab("motion");
}

/** @param {number} k the foot gets a branch's constants; flipping between the two shows what the data cannot tell apart */
export function showBranch(k) {
  const branch = bench.fit && bench.fit.branches[k];
  if (!branch || (EXPORTED && !hasTwin)) return;
  remember();
  bench.branch = k;
  state.delay_s = branch.delay_s;
  setValues(branch.values, {});
  ask();
}

// Sentence, verdict, notes: the words of the report.
effect(() => {
  const { fit, found, rivals } = bench;
  byId("found").hidden = !fit;
  byId("no_fit").hidden = Boolean(fit || rivals);
  byId("script_box").hidden = !(found && found.script);
  if (!fit) return;
  for (const id of ["save_report", "save_results"]) byId(id).hidden = !(found || fit.reported);
  byId("sentence").textContent = fit.sentence || (fit.verdict ? `Fit ${(+fit.fit_percent).toFixed(1)} %; ${fit.verdict}.` : "");
  byId("reason").textContent = fit.reason;
  byId("script").textContent = found ? found.script : "";
  byId("notes").replaceChildren(...fit.warnings.map(text => element("li", text)));
  byId("branches").replaceChildren(...fit.branches.map((branch, k) => element("button", branch.name, { title: "the foot with this branch's constants", onclick: () => showBranch(k) })));
  byId("verdict").className = fit.verdict;
});
effect(() => {
  const branches = bench.fit ? byId("branches").children : [];
  [...branches].forEach((b, k) => b.setAttribute("aria-pressed", k === bench.branch));
});

// What both branches say of each constant; what is known of it is of the branch that is shown, whose name is lit.
effect(() => {
  const shown = shownBranch();
  if (!bench.fit || !shown) return;
  const { branches, at } = bench.fit, both = branches.length > 1, head = element("tr");
  head.append(element("th", at || ""), ...branches.map(b => element("th", b.name, { className: b === shown && both ? "shown" : "" })), element("th", "status", { title: both ? `of the ${shown.name}` : "" }));
  byId("estimates").replaceChildren(head, ...shown.rows.map((row, k) => {
    const tr = element("tr"), name = element("th", row.name, { title: row.key });
    if (row.unit) name.append(" ", element("small", row.unit));
    const cells = branches.map(b => {
      const own = b.rows[k] || row, interval = (own.interval || number(own.value)).replace(" ± ", " ±\u00a0").replace(" to ", "\u00a0to ");
      return element("td", interval, own.at_rest ? { title: `at rest ${own.at_rest}` } : {});
    });
    tr.append(name, ...cells, element("td", row.known));
    return tr;
  }));
});

// Its intervals, as bands along the sliders.
effect(() => {
  const { sliders, model } = page, branch = bench.fit && bench.fit.branches[bench.branch];
  for (const p of model ? model.parameters : []) {
    const row = branch ? branch.rows.find(r => r.name === p.name && "lower" in r) : null;
    sliders[p.name]?.band(row ? /** @type {[number, number]} */ ([row.lower, row.upper]) : null, row ? row.interval : "");
  }
});
