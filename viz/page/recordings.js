// The recordings as the server lists them: which of them are ticked, and what the page opens for them.
import { forgetSent } from "./corrections.js";
import { busyWith, byId } from "./dom.js";
import { EXPORTED } from "./exported.js";
import { openTask, tab } from "./panels.js";
import { effect } from "./reactive.js";
import { STARTED_AGAIN, complain, tellServer } from "./server.js";
import { bench, isReadable, isSound } from "./store.js";
import { on } from "./stream.js";

on("data", ({ session, rows, shown, stale, undo, unread }) => {
  if (bench.session && session !== bench.session) {
    for (const kept of [bench.fittable, bench.unticked]) kept.clear();
    Object.assign(bench, { chosen: new Set(), lost: true });
    complain(`${STARTED_AGAIN} Reload this page, and drop the recordings again.`);
  }
  const count = rows.length;
  forgetSent(rows);
  busyWith(unread ? `reading ${unread} more` : "");
  if (!EXPORTED && count !== bench.count) {
    tab(count ? "recordings" : "motion");
    if (count && !bench.count) openTask("data");
  }
  Object.assign(bench, { session, rows, shown, stale, count, chosen: ticksOf(rows), undo: undo || [0, 0], unread: unread || 0 });
});

/** @type {(rows: Row[]) => Set<number>} a recording is ticked as soon as it can be fitted, and not any longer than that */
function ticksOf(rows) {
  const { fittable, unticked } = bench, here = new Set(rows.map(row => row.id)), chosen = new Set([...bench.chosen].filter(id => here.has(id)));
  for (const row of rows) {
    const good = isSound(row), before = fittable.get(row.id);
    if (good && !before && !unticked.delete(row.id)) chosen.add(row.id);
    if (!good && (before || !isReadable(row))) chosen.delete(row.id);
    fittable.set(row.id, good);
  }
  for (const id of [...fittable.keys()]) if (!here.has(id)) fittable.delete(id);
  return chosen;
}

effect(() => {
  byId("clear").hidden = !bench.rows.length;
  byId("sine").hidden = bench.shown < 0;
  byId("stale").hidden = !bench.stale;
  byId("stale").textContent = bench.stale;
});
if (!EXPORTED) byId("bundled").onclick = () => tellServer("bundled", {}, "reading the bundled study");
byId("sine").onclick = () => tellServer("sine");
byId("clear").onclick = () => tellServer("remove", { numbers: bench.rows.map(row => row.id) });
