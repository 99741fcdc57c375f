// Numbers as people type and read them.

// What was typed, as a number; a sentence where it is none, or may be either of two. Groups of three digits may be apart
// by a space of any width or by an apostrophe, and a comma is a decimal one where no group of thousands can be meant.
/** @type {(text: string) => number | string} */
export function typedNumber(text) {
  const plain = text.trim().replace(/^[−–]/, "-").replace(/(e)[−–]/i, "$1-"), [, sign, digits, power] = /^([+-]?)([^eE]*)([eE][+-]?\d+)?$/.exec(plain) || [null, "", "", ""];
  const one = String.raw`\d+(?:[.,]\d*)?|[.,]\d+|\d{1,3}(?:[\s'’]\d{3})+(?:[.,]\d*)?|\d{1,3}(?:,\d{3}){2,}(?:\.\d*)?|\d{1,3},\d{3}\.\d*`;
  if (!plain || !new RegExp(`^(?:${one})$`).test(digits)) return `${JSON.stringify(text.trim())} is not a number.`;
  if (/^[1-9]\d{0,2},\d{3}$/.test(digits)) return `${text.trim()} may mean ${digits.replace(",", "")} or ${digits.replace(",", ".")}; type one of them.`;
  const grouped = /,.*[,.]/.test(digits) ? digits.replaceAll(",", "") : digits;
  const found = Number(sign + grouped.replace(/[\s'’]/g, "").replace(",", ".") + (power || ""));
  return Number.isFinite(found) ? found : `${text.trim()} is too large.`;
}

/** @type {(v: number) => string} four digits, thousands apart */
export function number(v) { return (+v.toPrecision(4)).toLocaleString("en", { maximumFractionDigits: 9 }).replaceAll(",", "\u202f"); }

/** @type {(v: number | null, digits?: number) => string} */
export function tickText(v, digits = 3) { return v === null ? "" : Math.abs(v) >= 1e5 ? v.toExponential(Math.max(0, digits - 3)) : String(+v.toPrecision(digits)).replace("-", "−"); }

/** @type {(values: number[]) => string[]} ticks with as many digits as tell them apart */
export function distinct(values) {
  for (let digits = 3; digits < 9; digits++) {
    const texts = values.map(v => tickText(v, digits));
    if (new Set(texts).size === texts.length) return texts;
  }
  return values.map(v => tickText(v));
}

/** @type {(values: number[]) => number} */
export function largestOf(values) { return values.reduce((m, v) => Math.max(m, Math.abs(v)), 0); }

/** @type {(degrees: number[]) => number[]} a phase without jumps of whole turns */
export function unwrapped(degrees) {
  let turns = 0;
  return degrees.map((v, k) => { if (k) turns -= 360 * Math.round((v - degrees[k - 1]) / 360); return v + turns; });
}
