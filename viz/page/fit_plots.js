// The plots of a fit: transmissibility and phase lag with both branches, and of the branch that is shown the trace of a
// recording, what the model leaves of it, and chi-square.
import { ANKLE, LOADS, PALE, SEEN } from "./colours.js";
import { byId } from "./dom.js";
import { largestOf, unwrapped } from "./numbers.js";
import { Plot } from "./plots.js";
import { effect, store } from "./reactive.js";
import { bench, branchNote, shownBranch } from "./store.js";

/** @typedef {"size" | "lag" | "trace" | "residual" | "chi"} PlotName */
const TITLES = { trace: "malleolus [m/s²]", residual: "residual [m/s²]", chi: "chi-square of each harmonic" };
/** @type {{ plots: Record<PlotName, Plot> | null, pair: Record<"size" | "lag", Plot> | null }} made when they are needed; a pair is of two fits */
export const fitted = store({ plots: null, pair: null });

function makeFitPlots() {
  const into = byId("fit_plots"), hertz = "frequency [Hz]", plot = (/** @type {string} */ title, /** @type {string} */ x) => new Plot(into, title, x, "");
  return { size: new Plot(into, "transmissibility, fitted", hertz, "", { wide: true }), lag: plot("phase lag behind the base [°]", hertz),
    trace: plot(TITLES.trace, "time [ms]"), residual: plot(TITLES.residual, "time [ms]"), chi: plot(TITLES.chi, hertz) };
}

/** @type {<T extends { frequency_hz: number, added_mass_kg: number }>(points: T[], load: number) => T[]} those of a load, by frequency */
export const ofLoad = (points, load) => points.filter(r => r.added_mass_kg === load).sort((a, b) => a.frequency_hz - b.frequency_hz);
/** @type {(points: Point[]) => number[]} */
export const loadsOf = points => [...new Set(points.map(r => r.added_mass_kg))].sort((a, b) => a - b);
/** @type {(points: Point[]) => number[]} */
export const lagOf = points => unwrapped(points.map(r => r.phase_lag_deg));
/** @type {(series: Series[]) => [number, number]} */
export const rangeOf = series => [0, 1.1 * Math.max(1, ...series.map(s => largestOf(s.y)))];

effect(() => {
  const { found, fit } = bench;
  byId("tab_fit").hidden = !(found && found.data && fit);
  if (!found || !found.data || !fit) return;
  fitted.plots ||= makeFitPlots();
  const loads = loadsOf(found.data), /** @type {Series[]} */ size = [], /** @type {Series[]} */ lag = [];
  const /** @type {Series[][]} */ over = [[], []];
  loads.forEach((load, k) => {
    const colour = LOADS[k % LOADS.length], mine = ofLoad(found.data, load), x = mine.map(r => r.frequency_hz);
    size.push({ label: loads.length > 1 ? `${load} kg` : "data", colour, x, y: mine.map(r => r.transmissibility), low: mine.map(r => r.lower), high: mine.map(r => r.upper), points: true });
    lag.push({ label: "", colour, x, y: lagOf(mine), points: true });
    fit.branches.forEach((branch, b) => {
      const curve = ofLoad(found.curves.filter(r => r.branch === branch.name), load), u = curve.map(r => r.frequency_hz);
      const ink = b ? (loads.length > 1 ? PALE[k % PALE.length] : "#e58fc4") : colour, [sizes, lags] = b ? over : [size, lag];  // of one load each has a colour of its own
      sizes.push({ label: k ? "" : `${branch.name}${b ? " (dashed)" : ""}`, colour: ink, x: u, y: curve.map(r => r.transmissibility), dashed: b > 0 });
      lags.push({ label: "", colour: ink, x: u, y: lagOf(curve), dashed: b > 0 });
    });
  });
  size.push(...over[0]);
  lag.push(...over[1]);
  fitted.plots.size.set(size, rangeOf(size));
  fitted.plots.lag.set(lag);
});

// Traces, residuals and chi-square are of the branch that is shown; where there are two they say so.
effect(() => {
  const { plots } = fitted, note = branchNote();
  if (plots) for (const [name, title] of Object.entries(TITLES)) plots[/** @type {PlotName} */ (name)].retitle(title + (note && ` · ${note}`));
});

effect(() => {
  const { plots } = fitted, { found } = bench, branch = shownBranch();
  if (!plots || !found || !branch) return;
  const chi = found.chi_square.filter(r => r.branch === branch.name).sort((a, b) => a.frequency_hz * a.harmonic - b.frequency_hz * b.harmonic);
  plots.chi.box.hidden = !chi.length;
  plots.chi.set([{ label: "", colour: ANKLE, x: chi.map(r => r.frequency_hz * r.harmonic), y: chi.map(r => r.chi_square ?? r.chi_square_if_model_true), points: 5 }]);
});

// Measured and modelled malleolus of the recording that is shown, and what the model leaves; of no other one.
effect(() => {
  const { plots } = fitted, { found } = bench, branch = shownBranch();
  if (!plots || !found || !branch) return;
  const row = bench.rows.find(r => r.id === bench.shown), trace = row && found.traces.find(t => t.file === (row.label || row.file));
  if (!trace) {
    const sentence = row ? `${row.file.split("/").pop()} is not in this fit.` : "Click a recording of this fit to see it.";
    for (const plot of [plots.trace, plots.residual]) plot.none(sentence);
    return;
  }
  const mine = trace.models[branch.name], x = trace.time_s.map(t => 1e3 * t);
  plots.trace.set([{ label: "measured", colour: SEEN, x, y: trace.measured, points: 3 }, { label: `model, ${mine.fit_percent.toFixed(1)} %`, colour: ANKLE, x, y: mine.model }]);
  plots.residual.set([{ label: "", colour: ANKLE, x, y: trace.measured.map((v, k) => v - mine.model[k]) }]);
});
