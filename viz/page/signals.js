// The recording that was clicked last as it was recorded: traces, spectra, the seconds that are fitted, and its columns.
"use strict";
/** @type {{ id: number, row: string, plots: Record<string, Plot> | null, seconds: number }} */
const viewed = { id: -1, row: "", plots: null, seconds: 0 };
function viewSignals() {
  const row = bench.rows.find(r => r.id === viewed.id) || bench.rows.find(r => r.id === bench.shown) || bench.rows[0];
  if (byId("signals_plots").hidden || !row) return;
  const key = JSON.stringify([row.id, row.unit, row.start_s, row.end_s, row.problem, row.unread]);
  if (key === viewed.row) return;
  Object.assign(viewed, { id: row.id, row: key });
  tellServer("signals", { number: row.id }, `reading ${row.file}`);
}

/** @param {Signals} document_ */
function showSignals({ number: id, traces, spectra, seconds, rate_hz, part_s, refused, used, unused }) {
  const row = bench.rows.find(r => r.id === id), into = byId("signals_plots");
  if (!row) return;
  busyWith("");
  if (!viewed.plots) {
    const plot = (title, x, more = {}) => new Plot(into, title, x, "", more);
    viewed.plots = { base: plot("base [m/s²]", "time [s]"), sensors: plot("malleolus [m/s²]", "time [s]"), spectrum: plot("amplitude spectrum [m/s²]", "frequency [Hz]", { log: true }) };
    for (const name of ["base", "sensors"]) { viewed.plots[name].box.classList.add("trace"); viewed.plots[name].zoomed = showRange; }
  }
  viewed.seconds = seconds;
  const { base, ...sensors } = traces, { plots } = viewed, names = Object.keys(sensors), colours = [ANKLE, SEEN, OTHER, "#e58fc4", "#f3e37c"];
  const series = (colour, label, { time_s, m_s2 }) => ({ label, colour, x: time_s, y: m_s2 });
  for (const plot of [plots.base, plots.sensors]) plot.used = part_s || null;
  plots.base.set([series(BASE, "", base)]);
  plots.sensors.retitle(`${names.join(", ")} [m/s²]`);
  plots.sensors.set(names.map((name, k) => series(colours[k % colours.length], names.length > 1 ? name : "", sensors[name])));
  plots.spectrum.set(Object.entries(spectra).map(([name, s]) => ({ label: name, colour: name === "base" ? BASE : colours[names.indexOf(name) % colours.length], x: s.frequency_hz, y: s.m_s2 })));
  showRange(...(part_s || [0, seconds]));
  byId("signals_file").textContent = `${row.file}: ${number(seconds)} s at ${number(rate_hz)} Hz${part_s ? `, of which ${number(part_s[0])} to ${number(part_s[1])} s are ${refused ? "chosen" : "fitted"}` : ""}`;
  byId("all_seconds").disabled = !part_s;
  byId("signals_used").replaceChildren(...used.map(text => element("li", text)), element("li", unused.length ? `not used: ${unused.join("; ")}` : "no other columns"));
}

// The seconds that are seen, which can be used or typed over.
function showRange(from, to) { byId("start_s").value = String(+Math.max(0, from).toFixed(3)); byId("end_s").value = String(+Math.min(viewed.seconds, to).toFixed(3)); }

if (!window.EXPORTED) {
  byId("seconds").onsubmit = event => {
    event.preventDefault();
    const ends = [byId("start_s"), byId("end_s")].map(input => typedNumber(input.value)), wrong = ends.find(v => typeof v === "string");
    if (wrong) { complain(wrong); return; }
    const ids = event.submitter && event.submitter.value === "ticked" ? ticked() : [viewed.id];
    correct(ids.map(id => [id, { start_s: ends[0], end_s: ends[1] }]));
  };
  byId("all_seconds").onclick = () => correct([[viewed.id, { start_s: null, end_s: null }]]);
}
