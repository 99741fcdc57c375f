// Rival models side by side, and what they say together; the words are those of the command.
import { byId, lineOf } from "./dom.js";
import { openTask, tab } from "./panels.js";
import { effect } from "./reactive.js";
import { tellServer } from "./server.js";
import { bench, page, ticked } from "./store.js";
import { on } from "./stream.js";

byId("start_rivals").onclick = () => tellServer("rivals", { numbers: ticked(), said: {} });
on("rivals", rivals => {
  bench.rivals = rivals;
  openTask("fit");
  tab("rivals");
});
export function forgetRivals() {
  bench.rivals = null;
  if (page.strip === "rivals") tab("motion");
}
effect(() => {
  const { rivals } = bench;
  byId("compared").hidden = byId("tab_rivals").hidden = !rivals;
  if (!rivals) return;
  byId("rivals_sentence").textContent = rivals.notes.join(" ");
  byId("rivals_script").textContent = rivals.script;
  byId("rivals").replaceChildren(lineOf(rivals.columns, "th"), ...rivals.rows.map((texts, k) => Object.assign(lineOf(texts), { className: rivals.adequate[k] ? "" : "ruled" })));
});
