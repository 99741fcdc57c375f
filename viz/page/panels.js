// Tasks of the column beside the foot, one of which is open; plots and table below the foot, one of which is open, or none.
import { button, byId } from "./dom.js";
import { EXPORTED } from "./exported.js";
import { Plot } from "./plots.js";
import { effect, store } from "./reactive.js";
import { bench, page } from "./store.js";

const TASKS = { data: "Data", fit: "Fit", model: "Model", take: "Take away" };
const STRIPS = ["recordings", "signals", "motion", "fit", "rivals", "pair"];
// Where there is room the table has the column beside the foot.
const query = matchMedia("(min-width: 1250px)"), layout = store({ roomy: query.matches });

/** @param {string} name */
export function openTask(name) { page.task = name; }

/** @param {string} name */
export function tab(name) {
  if (name === "recordings" && layout.roomy) { openTask("data"); return; }
  page.strip = name;
  Plot.close();
}

for (const [name, label] of Object.entries(TASKS)) {
  const b = button(byId("tasks"), label, () => {
    openTask(name);
    if (innerWidth <= 700) document.querySelector(`section[data-task="${name}"]`)?.scrollIntoView();  // below the plots
  });
  b.dataset.name = name;
  b.hidden = Boolean(EXPORTED) && name === "data";
}
effect(() => {
  document.body.dataset.task = page.task;
  for (const b of byId("tasks").children) b.setAttribute("aria-pressed", b.dataset.name === page.task);
});

for (const name of STRIPS) Object.assign(byId(`tab_${name}`), { title: "once more: fold it away", onclick: () => tab(page.strip === name ? "" : name) });
effect(() => {
  for (const name of STRIPS) { byId(`${name}_plots`).hidden = name !== page.strip; byId(`tab_${name}`).setAttribute("aria-pressed", name === page.strip); }
  const table = byId("recordings_plots"), none = !bench.rows.length, into = byId(layout.roomy ? "data" : "plots");
  if (table.parentElement !== into) into.append(table);
  if (layout.roomy) table.hidden = none;
  byId("tab_recordings").hidden = layout.roomy || none;
  byId("tab_signals").hidden = none;
});
query.onchange = () => { layout.roomy = query.matches; if (layout.roomy && page.strip === "recordings") tab("motion"); };
if (innerWidth > 700 && innerHeight >= 560 && innerHeight < 640) tab("");  // the foot has half of a low window
