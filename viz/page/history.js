// The fits of this session: a list in which each can be shown, compared with the one that is shown, or deleted.
import { ANKLE, OTHER, PALE } from "./colours.js";
import { byId, element, lineOf, titled } from "./dom.js";
import { fitted, lagOf, loadsOf, ofLoad, rangeOf } from "./fit_plots.js";
import { number } from "./numbers.js";
import { tab } from "./panels.js";
import { Plot } from "./plots.js";
import { effect } from "./reactive.js";
import { tellServer } from "./server.js";
import { bench, page, shownBranch } from "./store.js";
import { on } from "./stream.js";

on("history", ({ fits }) => {
  bench.history = fits;
  if (fits.length >= 2) return;
  byId("tab_pair").hidden = true;
  if (page.strip === "pair") tab("motion");
});

effect(() => {
  const fits = bench.history;
  byId("history").hidden = !fits.length;
  byId("fits").replaceChildren(...[...fits].reverse().map(fit => {
    const li = element("li"), isShown = fit.number === bench.fitNumber, what = `fit ${fit.number}`, row = element("div", "", { className: "row" });
    const name = element("button", `${what}${fit.at ? `, ${timeOf(fit.at)}` : ""}`, { title: `show it: ${fit.files.join(", ")}`, onclick: () => tellServer("show_fit", { number: fit.number }) });
    name.setAttribute("aria-pressed", isShown);
    row.append(name);
    if (!isShown && bench.fitNumber) row.append(titled(element("button", "compare"), `compare ${what} with the one that is shown`, () => compareWith(fit.number)));
    row.append(titled(element("button", "×", { className: "more" }), `delete ${what}`, () => tellServer("remove_fit", { number: fit.number })));
    const about = [fit.fit, fit.verdict, `${fit.model}, ${fit.recordings} recording${fit.recordings === "1" ? "" : "s"}`, fit.settings, ...fit.constants];
    li.append(row, element("small", about.filter(Boolean).join(" · ")));
    return li;
  }));
});

/** @type {(at: number) => string} the time of a fit; with its day where that was another one */
function timeOf(at) {
  const when = new Date(1000 * at), time = when.toLocaleTimeString([], { hour: "2-digit", minute: "2-digit" });
  return when.toDateString() === new Date().toDateString() ? time : `${when.toLocaleDateString()} ${time}`;
}

/** @param {number} fit */
function compareWith(fit) { const branch = shownBranch(); tellServer("compare_fits", { numbers: [bench.fitNumber, fit], name: branch ? branch.name : "" }); }

on("comparison", ({ columns, rows, independent, fits }) => {
  const caption = element("caption", independent ? "" : "Both fits have recordings in common, so their differences have no interval.");
  byId("pair").replaceChildren(caption, lineOf(columns, "th"), ...rows.map(texts => lineOf(texts)));
  byId("tab_pair").hidden = false;
  tab("pair");
  const into = byId("pair_plots"), /** @type {Series[]} */ size = [], /** @type {Series[]} */ lag = [];
  const pair = fitted.pair ||= { size: new Plot(into, "transmissibility of two fits", "frequency [Hz]", ""), lag: new Plot(into, "phase lag of two fits [°]", "frequency [Hz]", "") };
  fits.forEach((fit, k) => {  // the second one is dashed, its points are smaller: it may lie over the first; paler under a load
    const [name] = fit.name.split(",");
    for (const load of loadsOf(fit.data)) {
      const data = ofLoad(fit.data, load), curve = ofLoad(fit.curves.filter(r => r.branch === fit.branch), load), x = data.map(r => r.frequency_hz), u = curve.map(r => r.frequency_hz);
      const label = `${name}${load ? `, ${number(load)} kg` : ""}${k ? " (dashed)" : ""}`, dashed = k > 0, colour = [[OTHER, ANKLE], PALE][+(load > 0)][k];
      size.push({ label: "", colour, x, y: data.map(r => r.transmissibility), low: data.map(r => r.lower), high: data.map(r => r.upper), points: [8, 4][k] });
      size.push({ label, colour, x: u, y: curve.map(r => r.transmissibility), dashed });
      lag.push({ label: "", colour, x, y: lagOf(data), points: [8, 4][k] }, { label, colour, x: u, y: lagOf(curve), dashed });
    }
  });
  pair.size.set(size, rangeOf(size));
  pair.lag.set(lag);
});
