// What the server makes to be saved or opened: report, results, study, and the page to take away.
import { withToken } from "./address.js";
import { settings } from "./ask.js";
import { busyWith, byId, element, save } from "./dom.js";
import { bench } from "./store.js";
import { tellServer } from "./server.js";
import { on } from "./stream.js";

let wantedPath = "";  // of the report or the results that this page waits for
for (const [id, path] of [["save_report", "report"], ["save_results", "results"]]) byId(id).onclick = () => {
  wantedPath = path;
  if (!bench.found) { receiveReport(); return; }  // of a fit that was made before
  tellServer("report", {}, "writing the report");
};
function receiveReport() {
  if (!wantedPath) return;  // another page asked
  busyWith("");
  const address = withToken(wantedPath);
  if (wantedPath === "results") save(address, "results.zip");
  else if (!open(address, "_blank")) byId("data_state").replaceChildren("the report is ready: ", element("a", "open it", { href: address, target: "_blank" }));
  wantedPath = "";
}
export function forgetReport() { wantedPath = ""; }

export function takeAway() {
  tellServer("take", { said: settings() });
  busyWith("writing the file");
}

/** @type {(path: string, name: string) => () => void} */
const saved = (path, name) => () => { busyWith(""); save(withToken(path), name); };
on("reported", receiveReport);
on("taken", saved("take", "foot.html"));
on("kept", saved("study", "study.zip"));
on("session_kept", saved("session", "session.zip"));
