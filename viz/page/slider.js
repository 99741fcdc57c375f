// A slider's row: its name, value and thumb, its bounds, and the interval of a fit as a band.
import { element, remarkIn } from "./dom.js";
import { number, typedNumber } from "./numbers.js";

/**
 * A slider's row. Where its thumb is within half a step of `nominal` the value is exactly that; a double click or the
 * row's ↺ takes it there. `changed` gets each value that the user chooses. What was wrong with a typed number stands in
 * the row, and goes when it is another one.
 * @typedef {{ free: boolean, bounds: [number, number], release: (on: boolean) => void, bound: (low: number, high: number) => void }} Fitting
 * @typedef {{ log?: boolean, step?: number, hint?: string, nominal?: number, ends?: boolean, fitted?: Fitting | null }} More
 * @type {(parent: HTMLElement, key: string, label: string, unit: string, low: number, high: number, value: number, changed: (v: number, typed?: boolean) => void, more?: More) => Slider}
 */
export function slider(parent, key, label, unit, low, high, value, changed, { log = false, step = 0, hint = "", nominal = value, ends = false, fitted = null } = {}) {
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
  const toInput = (/** @type {number} */ v) => (log ? 1000 * Math.log(v / low) / Math.log(high / low) : v);
  const fromInput = (/** @type {number} */ v) => (log ? low * (high / low) ** (v / 1000) : v);
  const snapped = (/** @type {number} */ v) => (Math.abs(v - toInput(nominal)) <= 0.5 * +input.step ? nominal : fromInput(v));
  row.nominal = v => { nominal = v; };
  const write = (/** @type {number} */ v) => {
    shown.textContent = `${number(v)} ${unit}`;
    shown.setAttribute("aria-label", `${shown.textContent}: type ${label}`);
    input.setAttribute("aria-valuetext", `${number(v)} ${unit}`);
    row.classList.toggle("moved", v !== nominal);
  };
  row.remark = remarkValue;
  row.set = v => { if (v !== row.value) remarkValue(""); row.value = v; input.value = toInput(v); write(v); };
  row.home = () => { remarkValue(""); row.set(nominal); changed(nominal); };
  input.oninput = () => { remarkValue(""); const v = snapped(+input.value); row.value = v; write(v); changed(v); };
  row.ondblclick = back.onclick = (/** @type {Event} */ event) => { event.preventDefault(); row.home(); };
  shown.title = "click to type a value";
  const inside = (/** @type {number} */ v) => Math.min(high, Math.max(low, v)), bound = (/** @type {number} */ v) => `${v > high ? "Above" : "Below"} the bound; ${number(inside(v))} ${unit} is used.`;
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
    const free = element("input", "", { type: "checkbox", checked: fitted.free, title: "free in the fit" });
    free.setAttribute("aria-label", `${label}: free in the fit`);
    free.className = "free";
    free.onchange = () => fitted.release(free.checked);
    name.prepend(free);
    /** @type {[number, number]} */
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

/**
 * A number that becomes a field when it is clicked, or reached and entered; Enter takes it, Escape leaves it. `taken`
 * answers with a sentence where it could not be taken as typed, which `remark` shows.
 * @type {(shown: any, remark: (text: string) => void, value: () => number, taken: (v: number) => string) => void}
 */
function editable(shown, remark, value, taken) {
  const open = (/** @type {Event} */ event) => {
    if (shown.querySelector("input")) return;
    event.preventDefault();
    event.stopPropagation();
    const field = element("input"), text = shown.textContent;
    const was = String(+(+value()).toPrecision(7));
    Object.assign(field, { type: "text", inputMode: "decimal", value: was });
    field.setAttribute("aria-label", "value");
    const close = (/** @type {boolean} */ keep) => {
      const v = typedNumber(field.value);
      field.onblur = null;
      shown.textContent = text;
      const another = keep && field.value !== was && field.value.trim();
      remark(!another ? "" : typeof v === "number" ? taken(v) : v);
      shown.focus();
    };
    field.onkeydown = (/** @type {KeyboardEvent} */ e) => { e.stopPropagation(); if (e.key === "Enter") { e.preventDefault(); close(true); } else if (e.key === "Escape") close(false); };
    field.onblur = () => close(true);
    shown.replaceChildren(field);
    field.select();
  };
  shown.onclick = open;
  shown.onkeydown = (/** @type {KeyboardEvent} */ event) => { if (event.key === "Enter" && event.target === shown) open(event); };
}
