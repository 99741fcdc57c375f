// The form by which channels, units, masses and loads are corrected. Numbers that are none are said at their fields.
import { correct, formOf } from "./corrections.js";
import { byId, element, remarkIn } from "./dom.js";
import { typedNumber } from "./numbers.js";
import { bench } from "./store.js";
import { on } from "./stream.js";

on("columns", ({ number: id, columns, said }) => {
  const at = bench.rows.findIndex(row => row.id === id), row = bench.rows[at], box = element("form"), /** @type {{ input: any, remark: (text: string) => void }[]} */ numbers = [];
  if (!row) return;
  box.dataset.id = id;
  const field = (/** @type {string} */ label, /** @type {string} */ name, /** @type {any} */ value, /** @type {string[][] | undefined} */ list = undefined) => {
    const wrap = element("label", label), input = element(list ? "select" : "input", "", { name });
    if (list) for (const [v, text] of list) input.append(element("option", text, { value: v }));
    input.value = value === undefined || value === null ? "" : value;
    wrap.append(input);
    return wrap;
  };
  const numberField = (/** @type {string} */ label, /** @type {string} */ name, /** @type {any} */ value) => {
    const wrap = field(label, name, value), input = wrap.lastChild, remark = remarkIn(wrap, input);
    input.oninput = () => remark("");
    numbers.push({ input, remark });
    return wrap;
  };
  const names = [["", "as the file says"], ...columns.map(c => [c.name, c.unit ? `${c.name} [${c.unit}]` : c.name])];
  for (const channel of ["time", "base", "malleolus"]) {
    const told = (said.channels || {})[channel] || {}, set = element("fieldset");
    set.append(element("legend", channel), field("column", `${channel}.column`, told.column, names), field("unit", `${channel}.unit`, told.unit));
    if (channel !== "time") set.append(field("sign", `${channel}.sign`, told.sign, [["", "+"], ["-1", "−"]]), field("per m/s², or 100 mV/g", `${channel}.sensitivity`, told.sensitivity));
    box.append(set);
  }
  const last = element("fieldset");
  last.append(element("legend", "recording"), numberField("rate [Hz], without time", "rate_hz", said.rate_hz));
  const apply = element("button", "Read it so", { type: "submit" }), alike = bench.rows.filter(r => r.unread).map(r => r.id), others = alike.filter(n => n !== id).length;
  box.append(last, apply);
  if (row.unread && others) box.append(" ", element("button", `and the ${others} others that cannot be read`, { type: "submit", value: "all" }));
  box.remark = remarkIn(box, apply);
  box.addEventListener("input", () => box.remark(""));
  box.onsubmit = (/** @type {any} */ event) => {
    event.preventDefault();
    const wrong = numbers.filter(({ input, remark }) => {
      const typed = input.value.trim() ? typedNumber(input.value) : null, problem = typeof typed === "string" ? typed : "";
      remark(problem);
      if (typeof typed === "number") input.value = typed;
      return problem;
    });
    if (wrong.length) { wrong[0].input.focus(); return; }
    const /** @type {any} */ told = { channels: { time: {}, base: {}, malleolus: {} } };
    for (const [name, typed] of new FormData(box)) {
      const [channel, key] = name.split("."), value = String(typed).trim();
      if (key) { if (value) told.channels[channel][key] = value; } else told[name] = value;
    }
    correct((event.submitter && event.submitter.value === "all" ? alike : [id]).map(n => [n, told]), box);
  };
  unfold(id, box);
});

/** @type {(id: number, box: HTMLElement) => void} */
export function unfold(id, box) {
  const old = formOf(id), tr = element("tr"), td = element("td", "", { colSpan: 9 });
  if (old) old.closest("tr").remove();
  td.append(box);
  tr.append(td);
  byId("recordings").querySelector(`tr[data-id="${id}"]`).after(tr);
}
