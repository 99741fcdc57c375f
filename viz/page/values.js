// The model's values: undo, redo and reset, one step for each parameter that is moved.
import { ask } from "./ask.js";
import { byId } from "./dom.js";
import { effect } from "./reactive.js";
import { bench, page, state, valueOf } from "./store.js";

const MOST_STEPS = 100;  // steps that are kept
/** @typedef {{ values: Record<string, number>, delay_s: number, branch: number }} Step */
/** @type {Step[]} */
const past = [], /** @type {Step[]} */ undone = [];
let lastMoved = "";
const stepNow = () => ({ values: state.values, delay_s: state.delay_s, branch: bench.branch });

/** @param {string} name of the parameter that is moved; none for a step of its own */
export function remember(name = "") {
  if (name && name === lastMoved) return;
  lastMoved = name;
  undone.length = 0;
  past.push(stepNow());
  if (past.length > MOST_STEPS) past.shift();
}
export function forgetSteps() { past.length = undone.length = 0; }

function undo(from = past, to = undone) {
  const before = from.pop();
  lastMoved = "";
  if (!before) return;
  forgetRemarks();
  to.push(stepNow());
  const { branch, ...values } = before;
  Object.assign(state, values);
  bench.branch = branch;
  ask();
}
function forgetRemarks() { for (const p of page.model.parameters) page.sliders[p.name]?.remark(""); }

/** @type {(changed: Record<string, number>, from?: Record<string, number>) => void} the nominal ones need not be sent */
export function setValues(changed, from = state.values) {
  const values = { ...from, ...changed };
  for (const p of page.model.parameters) if (values[p.name] === p.nominal) delete values[p.name];
  state.values = values;
}

byId("undo").onclick = () => undo();
byId("redo").onclick = () => undo(undone, past);
byId("reset").onclick = () => { forgetRemarks(); remember(); Object.assign(state, { values: {}, delay_s: 0 }); ask(); };
addEventListener("keydown", (/** @type {any} */ event) => {
  const key = event.key.toLowerCase(), again = key === "y" || (key === "z" && event.shiftKey);
  if (!(event.ctrlKey || event.metaKey) || !(again || key === "z") || event.target.closest("#editor, input:not([type=range]), textarea")) return;
  event.preventDefault();
  if (again) undo(undone, past); else undo();
});

// The sliders go where the values are.
effect(() => {
  const { model, sliders } = page, { frequency, peak_to_peak, added_mass } = state;
  for (const [name, value] of Object.entries({ frequency, peak: peak_to_peak, mass: added_mass })) sliders[name]?.set(value);
  for (const p of model ? model.parameters : []) sliders[p.name]?.set(valueOf(p.name));
});
