// A session's file: the server has recordings, model and fits, the page its ticks, sliders and what a fit may change.
import { ask } from "./ask.js";
import { buildControls } from "./controls.js";
import { busyWith, byId } from "./dom.js";
import { EXPORTED } from "./exported.js";
import { upload } from "./files.js";
import { openTask } from "./panels.js";
import { tellServer } from "./server.js";
import { bench, isSound, state, ticked } from "./store.js";
import { on } from "./stream.js";

function pageState() {
  const { free, bounds, branch } = bench;
  return { ticked: ticked(), free, bounds, branch, starts: +byId("starts").value, state };
}
on("session", ({ page: kept, ids, note }) => {
  const { free, bounds, branch } = kept;
  Object.assign(bench, { free, bounds, branch, chosen: new Set(kept.ticked.map((/** @type {number} */ id) => ids[id]).filter((/** @type {number | undefined} */ id) => id !== undefined)), fittable: new Map(bench.rows.map(row => [row.id, isSound(row)])) });
  Object.assign(state, kept.state);
  byId("starts").value = kept.starts;
  buildControls(false);
  openTask(bench.fit ? "fit" : "data");
  ask();
  busyWith(note, 1);
});
if (!EXPORTED) {
  byId("save_session").onclick = () => tellServer("save_session", { said: pageState() }, "writing the session");
  byId("open_session").onclick = () => byId("session_file").click();
  byId("session_file").onchange = (/** @type {any} */ event) => upload([...event.target.files].map(file => ({ file, name: file.name })));
}
