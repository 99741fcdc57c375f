// The plots that are seen, for print: as vectors, as a picture, as numbers.
import { PRINT } from "./colours.js";
import { tickText } from "./numbers.js";
import { Plot } from "./plots.js";

const PANEL = { width: 300, height: 230, left: 46, right: 12, top: 26, bottom: 36 };

function seenPlots() {
  const shown = Plot.seen();
  if (!shown.length) throw new Error("No plot is seen; choose motion or another tab with plots.");
  return shown;
}

// The plots that are seen, three beside each other; its text, width and height in CSS pixels.
export function plotsSvg() {
  const shown = seenPlots(), columns = shown.length === 4 ? 2 : Math.min(3, shown.length), width = columns * PANEL.width, height = Math.ceil(shown.length / columns) * PANEL.height;
  const svg = document.createElementNS("http://www.w3.org/2000/svg", "svg");
  for (const [key, value] of Object.entries({ width, height, viewBox: `0 0 ${width} ${height}`, "font-family": "Helvetica, Arial, sans-serif", "font-size": 10 })) svg.setAttribute(key, String(value));
  const ground = svg.appendChild(document.createElementNS(svg.namespaceURI, "rect"));
  for (const [key, value] of Object.entries({ width, height, fill: "#ffffff" })) ground.setAttribute(key, String(value));
  shown.forEach((plot, k) => svgOf(plot, svg, PANEL.width * (k % columns), PANEL.height * Math.floor(k / columns), `clip${k}`));
  return { text: new XMLSerializer().serializeToString(svg), width, height };
}

/** @type {(plot: Plot, svg: SVGElement, x: number, y: number, clip: string) => void} */
function svgOf(plot, svg, x, y, clip) {
  const group = svg.appendChild(document.createElementNS(svg.namespaceURI, "g")), { width, height, left, right, top, bottom } = PANEL;
  group.setAttribute("transform", `translate(${x} ${y})`);
  const put = (/** @type {string} */ tag, /** @type {Record<string, any>} */ about, /** @type {any} */ text = "", /** @type {Element} */ into = group) => {
    const node = into.appendChild(document.createElementNS(svg.namespaceURI, tag));
    for (const [key, value] of Object.entries(about)) node.setAttribute(key, value);
    node.textContent = text;
    return node;
  };
  const { x: across, y: up } = plot.plot.scales, w = width - left - right, h = height - top - bottom, round = (/** @type {number} */ v) => +v.toFixed(2);
  const X = (/** @type {number} */ v) => round(left + w * (v - across.min) / (across.max - across.min)), level = (/** @type {number} */ v) => (plot.log ? Math.log10(v) : v);
  const Y = (/** @type {number} */ v) => round(top + h * (1 - (level(v) - level(up.min)) / (level(up.max) - level(up.min)))), tens = Math.ceil(Math.log10(up.min));
  put("rect", { x: left, y: top, width: w, height: h }, "", put("clipPath", { id: clip }));
  for (const v of ticks(across.min, across.max, 6)) {
    put("path", { d: `M${X(v)} ${top}V${top + h}`, stroke: "#e3e3e3", fill: "none" });
    put("text", { x: X(v), y: top + h + 13, "text-anchor": "middle" }, tickText(v));
  }
  for (const v of plot.log ? Array.from({ length: Math.floor(Math.log10(up.max)) - tens + 1 }, (_, k) => 10 ** (tens + k)) : ticks(up.min, up.max, 6)) {
    put("path", { d: `M${left} ${Y(v)}H${left + w}`, stroke: "#e3e3e3", fill: "none" });
    put("text", { x: left - 5, y: Y(v) + 3.5, "text-anchor": "end" }, tickText(v));
  }
  put("rect", { x: left, y: top, width: w, height: h, fill: "none", stroke: "#333333" });
  put("text", { x: left + w / 2, y: top + h + 28, "text-anchor": "middle" }, plot.x);
  const title = put("text", { x: 4, y: 14 }, plot.title), data = put("g", { "clip-path": `url(#${clip})`, fill: "none", "stroke-width": 1.2 });
  for (const s of plot.series) {
    const ink = PRINT[s.colour] || s.colour, known = (/** @type {number} */ k) => Number.isFinite(s.x[k]) && Number.isFinite(s.y[k]), at = [...s.x.keys()].filter(known);
    if (s.label) put("tspan", { fill: ink, dx: 8 }, s.label, title);
    if (s.points) for (const k of at) put("circle", { cx: X(s.x[k]), cy: Y(s.y[k]), r: s.points === true ? 2.6 : s.points / 2, fill: ink }, "", data);
    else if (at.length) put("path", { d: `M${at.map(k => `${X(s.x[k])} ${Y(s.y[k])}`).join("L")}${plot.loop ? "Z" : ""}`, stroke: ink, ...(s.dashed ? { "stroke-dasharray": "4 3" } : {}) }, "", data);
    if (s.low && s.high) for (const k of at) if (Number.isFinite(s.low[k]) && Number.isFinite(s.high[k])) put("path", { d: `M${X(s.x[k])} ${Y(s.low[k])}V${Y(s.high[k])}`, stroke: ink }, "", data);
  }
}

/** @type {(low: number, high: number, count: number) => number[]} round numbers between two, about so many */
function ticks(low, high, count) {
  const raw = (high - low) / count, ten = 10 ** Math.floor(Math.log10(raw)), step = [1, 2, 5, 10].map(m => m * ten).find(v => v >= raw) || raw, first = Math.ceil(low / step - 1e-9);
  return Array.from({ length: Math.max(0, Math.floor(high / step + 1e-9) - first + 1) }, (_, k) => +((first + k) * step).toPrecision(12));
}

export async function plotsPng() {
  const { text, width, height } = plotsSvg(), image = new Image(), address = URL.createObjectURL(new Blob([text], { type: "image/svg+xml" }));
  await new Promise((done, failed) => { image.onload = done; image.onerror = () => failed(new Error("this browser does not draw the plots; take the SVG")); image.src = address; });
  const canvas = Object.assign(document.createElement("canvas"), { width: 3 * width, height: 3 * height });
  /** @type {CanvasRenderingContext2D} */ (canvas.getContext("2d")).drawImage(image, 0, 0, canvas.width, canvas.height);
  URL.revokeObjectURL(address);
  return new Promise(done => { canvas.toBlob(done, "image/png"); });
}

export function plotsCsv() {
  const quoted = (/** @type {any} */ text) => `"${text.replaceAll('"', '""')}"`;
  const rows = seenPlots().flatMap(plot => plot.rows().map(([label, ...numbers]) => [...[plot.title, plot.x, label].map(quoted), ...numbers].join(",")));
  return `plot,x axis,series,x,y,lower,upper\n${rows.join("\n")}\n`;
}
