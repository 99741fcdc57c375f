// What is kept: by a reload this tab's sliders, branch and ticks, by a session's file all of it.
"use strict";
function keepState() {
  if (window.EXPORTED || !model || !bench.session || bench.lost) return;
  const { fitNumber, branch, free, bounds, task } = bench, off = bench.rows.map(row => row.id).filter(id => !bench.chosen.has(id));
  try { sessionStorage.setItem("fasbody", JSON.stringify({ key: KEY, name: model.name, state, bench: { fitNumber, branch, free, bounds }, task, strip, off, held: bench.rows.length })); } catch { /* no room, or not allowed */ }
}
function recall() {
  let kept = null;
  try { kept = JSON.parse(sessionStorage.getItem("fasbody")); } catch { /* not allowed */ }
  if (kept && kept.key !== KEY && kept.held && !window.EXPORTED) complain(`${STARTED_AGAIN} Drop the recordings again.`);
  if (window.EXPORTED || !kept || kept.key !== KEY || kept.name !== model.name) return false;
  Object.assign(state, kept.state);
  Object.assign(bench, kept.bench);
  bench.count = kept.held;
  openTask(kept.task);
  tab(["rivals", "pair"].includes(kept.strip) || (kept.strip && !kept.held) ? "motion" : kept.strip);
  bench.unticked = new Set(kept.off);
  return true;
}

// ---- a session's file: the server has recordings, model and fits, the page its ticks, sliders and what a fit may change
function pageState() {
  const { free, bounds, branch } = bench;
  return { ticked: ticked(), free, bounds, branch, starts: +byId("starts").value, state };
}
function saveSession() { busyWith(""); save(withToken("session"), "session.zip"); }
function receiveSession({ page, ids, note }) {
  bench.chosen = new Set(page.ticked.map(id => ids[id]).filter(id => id !== undefined));
  Object.assign(bench, { free: page.free, bounds: page.bounds, branch: page.branch });
  Object.assign(state, page.state);
  byId("starts").value = page.starts;
  buildControls(false);
  for (const row of bench.rows) bench.fittable.set(row.id, sound(row));
  drawTable();
  if (bench.fit) { bands(); drawFit(); }
  advise();
  openTask(bench.fit ? "fit" : "data");
  ask();
  busyWith(note, 1);
}
if (!window.EXPORTED) {
  byId("save_session").onclick = () => tellServer("save_session", { said: pageState() }, "writing the session");
  byId("open_session").onclick = () => byId("session_file").click();
  byId("session_file").onchange = event => upload([...event.target.files].map(file => ({ file, name: file.name })));
}
