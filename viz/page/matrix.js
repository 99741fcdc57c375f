// Subjects and loads against frequencies, coloured by how well each recording was fitted; a click shows it. What was
// recorded again at a frequency has a line of its own.
import { byId, element } from "./dom.js";
import { number } from "./numbers.js";
import { effect } from "./reactive.js";
import { showRecording } from "./signals.js";
import { bench, branchNote, shownBranch } from "./store.js";

/** @typedef {Row & { frequency_hz: number }} Steady */

function drawMatrix() {
  const box = byId("matrix"), steady = /** @type {Steady[]} */ (bench.rows.filter(row => row.frequency_hz));
  box.hidden = steady.length < 4;
  if (box.hidden) { box.replaceChildren(); return; }
  const fitOf = fitsByFile(), columns = columnsOf(steady), names = [...new Set(steady.map(condition))];
  const lines = names.flatMap(name => {
    const cells = columns.map(column => column.filter(row => condition(row) === name).sort((a, b) => a.id - b.id));
    return Array.from({ length: Math.max(...cells.map(repeats => repeats.length)) }, (_, k) =>
      line(k ? `repeat ${k + 1}` : name, "row", cells.map(repeats => cellOf(repeats[k], repeats, fitOf))));
  });
  box.style.setProperty("--columns", String(columns.length));
  const hertz = columns.map(([row]) => element("th", String(+row.frequency_hz.toFixed(1)), { scope: "col" })), note = branchNote();
  box.replaceChildren(element("caption", `fit of each recording [%]${note && ` · ${note}`}`), line("Hz", "col", hertz), ...lines);
}

/** @type {(row: Row) => string} */
const condition = row => `${row.subject || ""} ${row.added_mass_kg ? `+ ${number(row.added_mass_kg)} kg` : "no load"}`.trim();
/** @type {(file: string) => string} */
const last = file => file.slice(file.lastIndexOf("/") + 1);

/** @type {(heading: string, scope: string, cells: HTMLElement[]) => any} */
function line(heading, scope, cells) {
  const tr = element("tr");
  tr.append(element("th", heading, { scope }), ...cells);
  return tr;
}

/** @type {(steady: Steady[]) => Steady[][]} what was set alike is measured within a tenth of a hertz */
function columnsOf(steady) {
  /** @type {Steady[][]} */
  const columns = [];
  for (const row of [...steady].sort((a, b) => a.frequency_hz - b.frequency_hz)) {
    const column = columns.at(-1);
    if (column && row.frequency_hz - column[0].frequency_hz < 0.1) column.push(row); else columns.push([row]);
  }
  return columns;
}

/** @type {() => (row: Row) => number | null | undefined} the fit of a recording [%]; of one in another place by its name, if that is unique */
function fitsByFile() {
  const fits = new Map(), branch = shownBranch(), isUnique = (/** @type {string} */ name) => bench.rows.filter(row => last(row.file) === name).length === 1;
  const fitted = bench.found && branch ? bench.found.traces.map(t => ({ file: t.file, ...t.models[branch.name] })) : (bench.fit && bench.fit.recordings) || [];
  for (const r of fitted) fits.set(r.file, r.fit_percent).set(`*/${last(r.file)}`, r.fit_percent);
  return row => fits.get(row.label || row.file) ?? (isUnique(last(row.file)) ? fits.get(`*/${last(row.file)}`) : null);
}

/** @type {(row: Steady | undefined, repeats: Steady[], fitOf: (row: Row) => number | null | undefined) => any} */
function cellOf(row, repeats, fitOf) {
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
}
effect(drawMatrix);
