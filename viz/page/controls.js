// What every page has: sliders, buttons, error line, cameras, play and step.
"use strict";
/** @type {(id: string) => any} an element of the page's template, of whatever kind it is */
const byId = id => document.getElementById(id);

// An address of the page's server, below that of a notebook which brings it. There, and in a frame, no cookie opens it:
// each address has the session's key.
const KEY = /** @type {any} */ (document.querySelector("meta[name=key]") || {}).content || "";
const KEYED = window !== window.top || location.pathname !== "/";
function withToken(path) {
  const address = new URL(path, document.baseURI);
  if (KEYED && KEY) address.searchParams.set("token", KEY);
  return address.href;
}

// What is read or made, and which share of it is done, where that is known; all of it leaves a note without a bar.
function busyWith(text, share = NaN) {
  byId("data_state").textContent = text;
  byId("busy_bar").hidden = !text || share >= 1;
  if (share < 1) byId("busy_bar").value = share; else byId("busy_bar").removeAttribute("value");
}

// A slider's row. Where its thumb is within half a step of `nominal` the value is exactly that; a double click or the
// row's ↺ takes it there. `changed` gets each value that the user chooses. What was wrong with a typed number stands in
// the row, and goes when it is another one.
function slider(parent, key, label, unit, low, high, value, changed, { log = false, step = 0, hint = "", nominal = value, ends = false, fitted = null } = {}) {
  const row = /** @type {Slider} */ (document.createElement("label"));
  row.innerHTML = "<span></span><button type=button class=back>↺</button><output tabindex=0 role=button></output><input type=range><i class=band hidden></i><small class=ends hidden><span></span><em></em><span></span></small>";
  const [name, back, shown, input, band, bounds] = /** @type {any[]} */ ([...row.children]), remarkValue = remarkIn(row, shown);
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
    shown.setAttribute("aria-label", `${shown.textContent}: type ${label}`);
    input.setAttribute("aria-valuetext", `${number(v)} ${unit}`);
    row.classList.toggle("moved", v !== nominal);
  };
  row.remark = remarkValue;
  row.set = v => { if (v !== row.value) remarkValue(""); row.value = v; input.value = toInput(v); write(v); };
  row.home = () => { remarkValue(""); row.set(nominal); changed(nominal); };
  input.oninput = () => { remarkValue(""); const v = snapped(+input.value); row.value = v; write(v); changed(v); };
  row.ondblclick = back.onclick = event => { event.preventDefault(); row.home(); };
  shown.title = "click to type a value";
  const inside = v => Math.min(high, Math.max(low, v)), bound = v => `${v > high ? "Above" : "Below"} the bound; ${number(inside(v))} ${unit} is used.`;
  editable(shown, remarkValue, () => row.value, v => { row.set(inside(v)); changed(inside(v), true); return inside(v) === v ? "" : bound(v); });
  // The interval of a fit, as a band along the slider.
  row.band = (limits, text = "") => {
    band.hidden = !limits;
    if (!limits) return;
    const [a, b] = limits.map(v => Math.min(1, Math.max(0, (toInput(Math.min(high, Math.max(low, v))) - +input.min) / (+input.max - +input.min))));
    // the middle of the thumb, 16 px wide, goes from 8 px to 8 px before the end
    Object.assign(band.style, { marginLeft: `calc(8px + (100% - 16px) * ${a})`, width: `max(3px, (100% - 16px) * ${b - a})` });
    band.title = `95 %: ${text}`;
  };
  if (fitted) {
    const free = Object.assign(document.createElement("input"), { type: "checkbox", checked: fitted.free, title: "free in the fit" });
    free.setAttribute("aria-label", `${label}: free in the fit`);
    free.className = "free";
    free.onchange = () => fitted.release(free.checked);
    name.prepend(free);
    const limits = [...fitted.bounds], both = [bounds.firstChild, bounds.lastChild];
    // The slider keeps its scale; bounds that are narrower say that they are those of the fit.
    const writeBounds = () => both.forEach((end, k) => {
      const own = limits[k] === [low, high][k];
      end.textContent = own ? number(limits[k]) : `fit ${k ? "≤" : "≥"} ${number(limits[k])}`;
      end.classList.toggle("narrowed", !own);
    });
    both.forEach((end, k) => {
      end.title = "bound of the fit; click to type another";
      end.tabIndex = 0;
      end.setAttribute("role", "button");
      editable(end, remarkIn(row, end), () => limits[k], v => {
        if (k ? inside(v) <= limits[0] : inside(v) >= limits[1]) return `Not taken; a fit needs ${k ? "an upper bound above its lower one" : "a lower bound below its upper one"}.`;
        limits[k] = inside(v);
        writeBounds();
        fitted.bound(...limits);
        return inside(v) === v ? "" : bound(v);
      });
    });
    writeBounds();
  }
  row.set(value);
  parent.append(row);
  return row;
}

// What was typed, as a number; a sentence where it is none, or may be either of two. Groups of three digits may be apart
// by a space of any width or by an apostrophe, and a comma is a decimal one where no group of thousands can be meant.
function typedNumber(text) {
  const plain = text.trim().replace(/^[−–]/, "-").replace(/(e)[−–]/i, "$1-"), [, sign, digits, power] = /^([+-]?)([^eE]*)([eE][+-]?\d+)?$/.exec(plain) || [null, "", "", ""];
  const one = String.raw`\d+(?:[.,]\d*)?|[.,]\d+|\d{1,3}(?:[\s'’]\d{3})+(?:[.,]\d*)?|\d{1,3}(?:,\d{3}){2,}(?:\.\d*)?|\d{1,3},\d{3}\.\d*`;
  if (!plain || !new RegExp(`^(?:${one})$`).test(digits)) return `${JSON.stringify(text.trim())} is not a number.`;
  if (/^[1-9]\d{0,2},\d{3}$/.test(digits)) return `${text.trim()} may mean ${digits.replace(",", "")} or ${digits.replace(",", ".")}; type one of them.`;
  const grouped = /,.*[,.]/.test(digits) ? digits.replaceAll(",", "") : digits;
  const found = Number(sign + grouped.replace(/[\s'’]/g, "").replace(",", ".") + (power || ""));
  return Number.isFinite(found) ? found : `${text.trim()} is too large.`;
}

// A number that becomes a field when it is clicked, or reached and entered; Enter takes it, Escape leaves it. `taken`
// answers with a sentence where it could not be taken as typed, which `remark` shows.
function editable(shown, remark, value, taken) {
  const open = event => {
    if (shown.querySelector("input")) return;
    event.preventDefault();
    event.stopPropagation();
    const field = document.createElement("input"), text = shown.textContent;
    const was = String(+(+value()).toPrecision(7));
    Object.assign(field, { type: "text", inputMode: "decimal", value: was });
    field.setAttribute("aria-label", "value");
    const close = keep => {
      const v = typedNumber(field.value);
      field.onblur = null;
      shown.textContent = text;
      const another = keep && field.value !== was && field.value.trim();
      remark(!another ? "" : typeof v === "number" ? taken(v) : v);
      shown.focus();
    };
    field.onkeydown = e => { e.stopPropagation(); if (e.key === "Enter") { e.preventDefault(); close(true); } else if (e.key === "Escape") close(false); };
    field.onblur = () => close(true);
    shown.replaceChildren(field);
    field.select();
  };
  shown.onclick = open;
  shown.onkeydown = event => { if (event.key === "Enter" && event.target === shown) open(event); };
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

// Light or dark: as the system has it, until the button says otherwise; the foot's own ground stays dark.
const wantsLight = matchMedia("(prefers-color-scheme: light)");
let theme = "";
try { theme = localStorage.getItem("fasbody_theme") || ""; } catch { /* not allowed */ }
const isLight = () => (theme ? theme === "light" : wantsLight.matches);
function showTheme() {
  document.documentElement.style.colorScheme = theme || "";
  for (const b of document.querySelectorAll("button.theme")) b.textContent = isLight() ? "Dark page" : "Light page";
  if (typeof Plot !== "undefined") for (const plot of Plot.all) plot.redraw();
}
wantsLight.onchange = showTheme;
function themeButton(parent) {
  const b = button(parent, "", () => {
    theme = isLight() ? "dark" : "light";
    try { localStorage.setItem("fasbody_theme", theme); } catch { /* not allowed */ }
    showTheme();
  }, "light or dark colours; at first those of the system");
  b.className = "theme";
  showTheme();
}

function say(text) {
  byId("error").textContent = text || "";
  byId("error").hidden = !text;
}

// A line for one sentence on one field, at the end of what holds it; the function that writes it, and takes it away.
function remarkIn(box, field) {
  const line = Object.assign(document.createElement("small"), { className: "remark", hidden: true });
  line.setAttribute("role", "alert");
  box.append(line);
  return text => {
    line.textContent = text;
    line.hidden = !text;
    field.classList.toggle("refused", Boolean(text));
  };
}

// The line under the title breaks between its parts, not within them.
function tell(parts) {
  const box = byId("state"), text = parts.filter(Boolean);
  if (box.textContent === text.join(" · ")) return;
  box.title = text.join(" · ");
  box.replaceChildren(...text.flatMap((part, i) => [...(i ? [" · "] : []), Object.assign(document.createElement("span"), { textContent: part })]));
}

// ---- time: `motionLength()` [s] and `stepping()`, steps in it, are the page's ----------------------------------------------
let playing = true, time = 0, last = 0, fresh = false;
const passedShare = () => ((time / motionLength()) % 1 + 1) % 1;
function play(on) { playing = on; byId("play").textContent = on ? "Pause" : "Play"; }
function stepOn(n) { play(false); time += n * motionLength() / stepping(); fresh = true; }
byId("play").onclick = () => play(!playing);
if (matchMedia("(prefers-reduced-motion: reduce)").matches) play(false);
byId("step").onclick = () => stepOn(1);
byId("seek").oninput = e => { play(false); time = +e.target.value * motionLength(); fresh = true; };
function cameras(stage) { for (const name of Object.keys(stage.views)) button(byId("cameras"), name, () => stage.view(name), `camera: ${name}`); }

// What a slider that has the focus keeps for itself.
const MOVES = new Set(["ArrowLeft", "ArrowRight", "ArrowUp", "ArrowDown", "Home", "End", "PageUp", "PageDown"]);
// A button clicked with the mouse would take the next space; one reached with the keyboard keeps the focus.
addEventListener("click", (/** @type {any} */ event) => { const b = event.target.closest("button"); if (b && event.detail > 0) b.blur(); });

// Keys of every page; `own(key)` says whether the page takes another one. Nothing is taken from a field or a shortcut.
function keys(ready, own) {
  addEventListener("keydown", (/** @type {any} */ event) => {
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
