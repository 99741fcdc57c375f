// The fits of this session: a list in which each can be shown, compared with the one that is shown, or deleted.
"use strict";
/** @param {{ fits: Summary[] }} document_ */
function showHistory({ fits }) {
  bench.history = fits;
  drawHistory();
  byId("tab_pair").hidden = byId("tab_pair").hidden || fits.length < 2;
  if (byId("tab_pair").hidden && !byId("pair_plots").hidden) tab("motion");
}

function drawHistory() {
  const fits = bench.history;
  byId("history").hidden = !fits.length;
  byId("fits").replaceChildren(...[...fits].reverse().map(fit => {
    const li = element("li"), shown = fit.number === bench.fitNumber, what = `fit ${fit.number}`;
    const name = element("button", `${what}${fit.at ? `, ${timeOf(fit.at)}` : ""}`, { title: `show it: ${fit.files.join(", ")}`, onclick: () => tellServer("show_fit", { number: fit.number }) });
    name.setAttribute("aria-pressed", shown);
    const about = [fit.fit, fit.verdict, `${fit.model}, ${fit.recordings} recording${fit.recordings === "1" ? "" : "s"}`, fit.settings, ...fit.constants];
    const row = element("div", "", { className: "row" });
    row.append(name);
    if (!shown && bench.fitNumber) row.append(titled(element("button", "compare"), `compare ${what} with the one that is shown`, () => compareWith(fit.number)));
    row.append(titled(element("button", "×", { className: "more" }), `delete ${what}`, () => tellServer("remove_fit", { number: fit.number })));
    li.append(row, element("small", about.filter(Boolean).join(" · ")));
    return li;
  }));
}

// The time of a fit; with its day where that was another one.
function timeOf(at) {
  const when = new Date(1000 * at), clock = when.toLocaleTimeString([], { hour: "2-digit", minute: "2-digit" });
  return when.toDateString() === new Date().toDateString() ? clock : `${when.toLocaleDateString()} ${clock}`;
}

function compareWith(number) { tellServer("compare_fits", { numbers: [bench.fitNumber, number], name: shownBranchName() }); }

/** @param {Comparison} document_ */
function showComparison({ columns, rows, independent, fits }) {
  const line = (tag, texts) => {
    const tr = element("tr");
    tr.append(...texts.map((text, k) => element(k ? tag : "th", text, k && tag === "td" ? {} : { scope: k ? "col" : "row" })));
    return tr;
  };
  const caption = element("caption", independent ? "" : "Both fits have recordings in common, so their differences have no interval.");
  byId("pair").replaceChildren(caption, line("th", columns), ...rows.map(texts => line("td", texts.slice(1, 3).includes("–") ? [...texts.slice(0, 3), "–"] : texts)));
  byId("tab_pair").hidden = false;
  tab("pair");
  const into = byId("pair_plots"), by = (a, b) => a.frequency_hz - b.frequency_hz;
  bench.pair ||= { size: new Plot(into, "transmissibility of two fits", "frequency [Hz]", ""), lag: new Plot(into, "phase lag of two fits [°]", "frequency [Hz]", "") };
  const size = [], lag = [];
  fits.forEach((fit, k) => {  // the second one is dashed, its points are smaller: it may lie over the first; paler under a load
    const [name] = fit.name.split(",");
    for (const load of [...new Set(fit.data.map(r => r.added_mass_kg))].sort((a, b) => a - b)) {
      const data = fit.data.filter(r => r.added_mass_kg === load).sort(by), curve = fit.curves.filter(r => r.added_mass_kg === load && r.branch === fit.branch).sort(by);
      const label = `${name}${load ? `, ${number(load)} kg` : ""}${k ? " (dashed)" : ""}`, dashed = k > 0, colour = [[OTHER, ANKLE], PALE][+(load > 0)][k];
      const x = data.map(r => r.frequency_hz), u = curve.map(r => r.frequency_hz), lags = points => unwrapped(points.map(r => r.phase_lag_deg));
      size.push({ label: "", colour, x, y: data.map(r => r.transmissibility), low: data.map(r => r.lower), high: data.map(r => r.upper), points: [8, 4][k] });
      size.push({ label, colour, x: u, y: curve.map(r => r.transmissibility), dashed });
      lag.push({ label: "", colour, x, y: lags(data), points: [8, 4][k] }, { label, colour, x: u, y: lags(curve), dashed });
    }
  });
  bench.pair.size.set(size, [0, 1.1 * Math.max(1, ...size.map(s => largestOf(s.y)))]);
  bench.pair.lag.set(lag);
}
