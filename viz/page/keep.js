// What a reload keeps: this tab's sliders, branch, ticks, and what is open.
import { KEY } from "./address.js";
import { EXPORTED } from "./exported.js";
import { openTask, tab } from "./panels.js";
import { effect } from "./reactive.js";
import { STARTED_AGAIN, complain } from "./server.js";
import { bench, page, state } from "./store.js";

if (!EXPORTED) effect(() => {
  const { model, task, strip } = page, { session, lost, rows, chosen, fitNumber, branch, free, bounds } = bench;
  if (!model || !session || lost) return;
  const off = rows.map(row => row.id).filter(id => !chosen.has(id));
  try { sessionStorage.setItem("fasbody", JSON.stringify({ key: KEY, name: model.name, state, bench: { fitNumber, branch, free, bounds }, task, strip, off, held: rows.length })); } catch { /* no room, or not allowed */ }
});

// Whether there was anything of this model.
export function recall() {
  let kept = null;
  try { kept = JSON.parse(sessionStorage.getItem("fasbody") || "null"); } catch { /* not allowed */ }
  if (EXPORTED || !kept) return false;
  if (kept.key !== KEY && kept.held) complain(`${STARTED_AGAIN} Drop the recordings again.`);
  if (kept.key !== KEY || kept.name !== page.model.name) return false;
  Object.assign(state, kept.state);
  Object.assign(bench, kept.bench, { count: kept.held, unticked: new Set(kept.off) });
  openTask(kept.task);
  tab(["rivals", "pair"].includes(kept.strip) || (kept.strip && !kept.held) ? "motion" : kept.strip);
  return true;
}
