// What every page has: its sliders, buttons and error line.
"use strict";
const byId = id => document.getElementById(id);

function slider(parent, key, label, unit, low, high, value, changed, { log = false, step = 0, hint = "" } = {}) {
  const row = document.createElement("label");
  row.innerHTML = "<span></span><output></output><input type=range>";
  const [name, shown, input] = row.children;
  name.textContent = label;
  row.title = hint;
  input.id = key;
  Object.assign(input, log ? { min: 0, max: 1000, step: 1 } : { min: low, max: high, step: step || (high - low) / 500 });
  const toInput = v => (log ? 1000 * Math.log(v / low) / Math.log(high / low) : v);
  const fromInput = v => (log ? low * (high / low) ** (v / 1000) : v);
  const write = v => { shown.textContent = `${+v.toPrecision(4)} ${unit}`; };
  row.set = v => { input.value = toInput(v); write(v); };
  input.oninput = () => { const v = fromInput(+input.value); write(v); changed(v, row); };
  row.set(value);
  parent.append(row);
  return row;
}

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
