// The recording that was clicked last as it was recorded: traces, spectra, the seconds that are fitted, and its columns.
import { ANKLE, BASE, OTHER, SEEN } from "./colours.js";
import { correct } from "./corrections.js";
import { busyWith, byId, element } from "./dom.js";
import { EXPORTED } from "./exported.js";
import { number, typedNumber } from "./numbers.js";
import { Plot } from "./plots.js";
import { effect, store } from "./reactive.js";
import { complain, tellServer } from "./server.js";
import { bench, page, ticked } from "./store.js";
import { on } from "./stream.js";

/** @type {{ id: number, plots: Record<"base" | "sensors" | "spectrum", Plot> | null }} */
export const viewed = store({ id: -1, plots: null });
let viewedKey = "", length_s = 0;  // what of it was asked for last, and its seconds

/** @param {Row} row drives the table, and is seen */
export function showRecording(row) {
  tellServer("use", { number: row.id }, `reading ${row.file}`);
  viewed.id = row.id;
}

effect(() => {
  const row = bench.rows.find(r => r.id === viewed.id) || bench.rows.find(r => r.id === bench.shown) || bench.rows[0];
  if (page.strip !== "signals" || !row) return;
  const key = JSON.stringify([row.id, row.unit, row.start_s, row.end_s, row.problem, row.unread]);
  if (key === viewedKey) return;
  viewedKey = key;
  viewed.id = row.id;
  tellServer("signals", { number: row.id }, `reading ${row.file}`);
});

function makeSignalPlots() {
  const into = byId("signals_plots"), plot = (/** @type {string} */ title, /** @type {string} */ x, more = {}) => new Plot(into, title, x, "", more);
  const made = { base: plot("base [m/s²]", "time [s]"), sensors: plot("malleolus [m/s²]", "time [s]"), spectrum: plot("amplitude spectrum [m/s²]", "frequency [Hz]", { log: true }) };
  for (const trace of [made.base, made.sensors]) { trace.box.classList.add("trace"); trace.zoomed = showRange; }
  return made;
}

on("signals", ({ number: id, traces, spectra, seconds, rate_hz, part_s, refused, used, unused }) => {
  const row = bench.rows.find(r => r.id === id);
  if (!row) return;
  busyWith("");
  const plots = viewed.plots ||= makeSignalPlots();
  length_s = seconds;
  const { base, ...sensors } = traces, names = Object.keys(sensors), colours = [ANKLE, SEEN, OTHER, "#e58fc4", "#f3e37c"];
  const series = (/** @type {string} */ colour, /** @type {string} */ label, /** @type {Signal} */ { time_s, m_s2 }) => ({ label, colour, x: time_s, y: m_s2 });
  for (const plot of [plots.base, plots.sensors]) plot.used = part_s || null;
  plots.base.set([series(BASE, "", base)]);
  plots.sensors.retitle(`${names.join(", ")} [m/s²]`);
  plots.sensors.set(names.map((name, k) => series(colours[k % colours.length], names.length > 1 ? name : "", sensors[name])));
  plots.spectrum.set(Object.entries(spectra).map(([name, s]) => ({ label: name, colour: name === "base" ? BASE : colours[names.indexOf(name) % colours.length], x: s.frequency_hz, y: s.m_s2 })));
  showRange(...(part_s || /** @type {[number, number]} */ ([0, seconds])));
  byId("signals_file").textContent = `${row.file}: ${number(seconds)} s at ${number(rate_hz)} Hz${part_s ? `, of which ${number(part_s[0])} to ${number(part_s[1])} s are ${refused ? "chosen" : "fitted"}` : ""}`;
  byId("all_seconds").disabled = !part_s;
  byId("signals_used").replaceChildren(...used.map(text => element("li", text)), element("li", unused.length ? `not used: ${unused.join("; ")}` : "no other columns"));
});

/** @type {(from: number, to: number) => void} the seconds that are seen, which can be used or typed over */
function showRange(from, to) { byId("start_s").value = String(+Math.max(0, from).toFixed(3)); byId("end_s").value = String(+Math.min(length_s, to).toFixed(3)); }

if (!EXPORTED) {
  byId("seconds").onsubmit = (/** @type {SubmitEvent} */ event) => {
    event.preventDefault();
    const ends = [byId("start_s"), byId("end_s")].map(input => typedNumber(input.value)), wrong = ends.find(v => typeof v === "string");
    if (typeof wrong === "string") { complain(wrong); return; }
    const submitter = /** @type {HTMLButtonElement | null} */ (event.submitter), ids = submitter && submitter.value === "ticked" ? ticked() : [viewed.id];
    correct(ids.map(id => [id, { start_s: ends[0], end_s: ends[1] }]));
  };
  byId("all_seconds").onclick = () => correct([[viewed.id, { start_s: null, end_s: null }]]);
}
