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
    Object.assign(bench, { chosen: new Set(), unticked: new Set(), fittable: new Map(), lost: true });
    complain(`${STARTED_AGAIN} Reload this page, and drop the recordings again.`);
  }
  const count = rows.length;
  forgetSent(rows);
  busyWith(unread ? `reading ${unread} more` : "");
  if (!EXPORTED && count !== bench.count) {
    tab(count ? "recordings" : "motion");
    if (count && !bench.count) openTask("data");
  }
  const sound = rows.filter(isSound).map(row => row.id), unticked = new Set([...bench.unticked].filter(id => !sound.includes(id)));
  Object.assign(bench, { session, rows, shown, stale, count, chosen: ticksOf(rows), unticked, fittable: new Map(rows.map(row => [row.id, isSound(row)])), undo: undo || [0, 0], unread: unread || 0 });
});

/** @type {(rows: Row[]) => Set<number>} a recording is ticked as soon as it can be fitted, and not any longer than that */
function ticksOf(rows) {
  const { chosen, fittable, unticked } = bench;
  return new Set(rows.filter(row => {
    const good = isSound(row), before = fittable.get(row.id);
    if (good && !before) return chosen.has(row.id) || !unticked.has(row.id);
    return chosen.has(row.id) && (good || (!before && isReadable(row)));
  }).map(row => row.id));
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
