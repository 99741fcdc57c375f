// Corrections of recordings: sent, undone, and refused in the place where they were typed.
import { byId, element } from "./dom.js";
import { EXPORTED } from "./exported.js";
import { effect } from "./reactive.js";
import { complain, tellServer } from "./server.js";
import { bench, isReadable } from "./store.js";

/** @type {any} the cell or form whose text the server has */
let sent = null;

/** @type {(changes: [number, object][], from?: any) => void} by recording; from a cell or a form */
export function correct(changes, from = null) { sent = from; tellServer("correct", { changes }, changes.length > 1 ? `reading ${changes.length} recordings` : "reading"); }

/** @type {(input: any, text: string) => void} a cell keeps what cannot be taken, and its row says why, until the table is drawn again */
export function refuse(input, text) {
  const tr = input.closest("tr");
  input.classList.add("refused");
  input.setAttribute("aria-invalid", "true");
  if (!tr) { complain(text); return; }
  const reason = element("span", text, { id: "refused" });
  reason.setAttribute("role", "alert");
  input.setAttribute("aria-describedby", "refused");
  tr.className = "wrong";
  tr.querySelector(".status").replaceChildren(reason);
}

/** @type {(text: string) => void} a sentence of the server on what was sent last */
export function refuseSent(text) {
  complain("");
  if (!sent || !sent.isConnected) complain(text);
  else if (sent.remark) sent.remark(text);
  else refuse(sent, text);
}

/** @type {(id: number) => any} */
export const formOf = id => byId("recordings").querySelector(`form[data-id="${id}"]`);
/** @type {(rows: Row[]) => void} what was sent was taken; its form goes once its recording can be read */
export function forgetSent(rows) {
  const read = sent && sent.remark && rows.some(row => row.id === +sent.dataset.id && isReadable(row)) && formOf(sent.dataset.id);
  if (read) read.closest("tr").remove();
  sent = null;
}

if (!EXPORTED) {
  byId("undo_correction").onclick = () => tellServer("undo", {}, "reading");
  byId("redo_correction").onclick = () => tellServer("undo", { again: true }, "reading");
  effect(() => ["undo_correction", "redo_correction"].forEach((name, k) => { byId(name).disabled = !bench.undo[k]; }));
}
