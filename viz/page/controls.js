// What every page has: sliders, buttons, error line, cameras, play and step.
"use strict";
const byId = id => document.getElementById(id);

// A slider's row. Where its thumb is within half a step of `nominal` the value is exactly that; a double click or the
// row's ↺ takes it there. `changed` gets each value that the user chooses.
function slider(parent, key, label, unit, low, high, value, changed, { log = false, step = 0, hint = "", nominal = value, ends = false } = {}) {
  const row = document.createElement("label");
  row.innerHTML = "<span></span><button type=button class=back>↺</button><output></output><input type=range><small class=ends hidden><span></span><em></em><span></span></small>";
  const [name, back, shown, input, bounds] = row.children;
  bounds.hidden = !ends;
  [bounds.firstChild.textContent, bounds.lastChild.textContent] = [number(low), number(high)];
  row.beside = text => { bounds.children[1].textContent = text; };
  name.textContent = label;
  back.title = `back to ${number(nominal)} ${unit}`;
  row.title = [hint, `double click: ${back.title}`].filter(Boolean).join("; ");
  input.id = key;
  input.setAttribute("aria-label", label);
  Object.assign(input, log ? { min: 0, max: 1000, step: 1 } : { min: low, max: high, step: step || (high - low) / 500 });
  const toInput = v => (log ? 1000 * Math.log(v / low) / Math.log(high / low) : v);
  const fromInput = v => (log ? low * (high / low) ** (v / 1000) : v);
  const snapped = v => (Math.abs(v - toInput(nominal)) <= 0.5 * +input.step ? nominal : fromInput(v));
  row.nominal = v => { nominal = v; };
  const write = v => {
    shown.textContent = `${number(v)} ${unit}`;
    input.setAttribute("aria-valuetext", `${number(v)} ${unit}`);
    row.classList.toggle("moved", v !== nominal);
  };
  row.set = v => { input.value = toInput(v); write(v); };
  row.home = () => { row.set(nominal); changed(nominal); };
  input.oninput = () => { const v = snapped(+input.value); write(v); changed(v); };
  row.ondblclick = back.onclick = event => { event.preventDefault(); row.home(); };
  row.set(value);
  parent.append(row);
  return row;
}

// Four digits, thousands apart.
function number(v) { return (+v.toPrecision(4)).toLocaleString("en", { maximumFractionDigits: 9 }).replaceAll(",", "\u202f"); }

function button(parent, label, action, title = "") {
  const b = document.createElement("button");
  b.textContent = label;
  b.title = title;
  b.onclick = () => action(b);
  parent.append(b);
  return b;
}

function rowIn(parent) {
  const row = document.createElement("div");
  row.className = "row";
  parent.append(row);
  return row;
}

function say(text) {
  byId("error").textContent = text || "";
  byId("error").hidden = !text;
}

// The line under the title breaks between its parts, not within them.
function tell(parts) {
  const box = byId("state"), text = parts.filter(Boolean);
  if (box.textContent === text.join(" · ")) return;
  box.replaceChildren(...text.flatMap((part, i) => [...(i ? [" · "] : []), Object.assign(document.createElement("span"), { textContent: part })]));
}

// ---- time: `length()` [s] and `stepping()`, steps in it, are the page's ----------------------------------------------
let playing = true, time = 0, last = 0, fresh = false;
const passedShare = () => ((time / length()) % 1 + 1) % 1;
function play(on) { playing = on; byId("play").textContent = on ? "Pause" : "Play"; }
function stepOn(n) { play(false); time += n * length() / stepping(); fresh = true; }
byId("play").onclick = () => play(!playing);
byId("step").onclick = () => stepOn(1);
byId("seek").oninput = e => { play(false); time = +e.target.value * length(); fresh = true; };
function cameras(stage) { for (const name of Object.keys(stage.views)) button(byId("cameras"), name, () => stage.view(name), `camera: ${name}`); }

// What a slider that has the focus keeps for itself.
const MOVES = new Set(["ArrowLeft", "ArrowRight", "ArrowUp", "ArrowDown", "Home", "End", "PageUp", "PageDown"]);
// A button clicked with the mouse would take the next space; one reached with the keyboard keeps the focus.
addEventListener("click", event => { const b = event.target.closest("button"); if (b && event.detail > 0) b.blur(); });

// Keys of every page; `own(key)` says whether the page takes another one. Nothing is taken from a field or a shortcut.
function keys(ready, own) {
  addEventListener("keydown", event => {
    if (event.target.matches("select, textarea, input:not([type=range])")) return;
    if (event.target.matches("input") && MOVES.has(event.key)) return;
    if (event.ctrlKey || event.metaKey || event.altKey || !ready()) return;
    if (event.key === " ") { if (event.target.matches("button")) return; play(!playing); }
    else if (event.key === ".") stepOn(1);
    else if (event.key === ",") stepOn(-1);
    else if (!own(event.key)) return;
    event.preventDefault();
  });
}
