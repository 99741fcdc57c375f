// What to do next, in a sentence beside the buttons that do it; a fit says its verdict here.
import { byId } from "./dom.js";
import { EXPORTED } from "./exported.js";
import { effect } from "./reactive.js";
import { bench, isMass, page } from "./store.js";

function advise() {
  const { model } = page;
  if (!model) return;
  const { rows, chosen, stale } = bench, fit = bench.fit && bench.fit.verdict ? bench.fit : null;
  const free = model.parameters.filter(p => !isMass(p.name) && bench.free[p.name] !== false).length, count = chosen.size;
  const slow = !model.quick && rows.length > 0, bare = rows.filter(row => chosen.has(row.id) && !row.body_mass_kg).length;
  const unloaded = rows.every(row => !chosen.has(row.id) || !row.added_mass_kg), doubtful = rows.filter(row => row.doubt && !chosen.has(row.id)).length;
  const verdict = fit && { decided: `decided: ${fit.branches[0].name}`, undecided: "the branch is undecided", "not compared": "one branch" }[fit.verdict];
  const parts = !rows.length && !fit ? ["Drop recordings anywhere on this page, or try the example."] : [
    fit ? `Fit ${(+fit.fit_percent).toFixed(1)} %${verdict ? `; ${verdict}` : ""}.` : `${count} of ${rows.length} recordings ticked.`,
    !rows.length ? "Drop recordings anywhere on this page to fit again." : stale ? "Out of date; fit again." : "",
    doubtful ? `${doubtful} in an uncertain unit: confirm it in the table.` : "",
    bare ? `${bare} without body mass: type it above the table for all, or in the table.` : "",
    !fit && count > 1 && unloaded ? "All loads are 0 kg: fill in the column if the knee carried one." : "",
    slow && !fit ? `This model has ${free} constants${2 * count < free ? ", too many for so few recordings" : ""}; its fit takes a minute or more.` : ""];
  byId("next").textContent = parts.filter(Boolean).join(" ");
  const held = /** @type {any} */ (document.activeElement);
  byId("two_masses").hidden = !slow;
  byId("bundled").hidden = rows.length > 0 && !bench.unread;
  byId("stop_fit").hidden = !bench.running;
  for (const id of ["start_fit", "start_rivals"]) byId(id).disabled = bench.running || !count || bench.unread > 0;
  if (held.closest("#bar .row") && (held.hidden || held.disabled)) {  // its button is gone: the focus goes on to the next one
    const next = ["stop_fit", "start_fit"].map(byId).find(b => !b.hidden && !b.disabled) || byId("tasks").querySelector("[aria-pressed=true]");
    next.focus();
  }
}
if (!EXPORTED) effect(advise);
