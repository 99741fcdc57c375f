// Plots on uPlot: lines, points with limits, and loops; drag zooms, a double click shows all, ⤓ saves the
// numbers, ⤢ or a double click on the title opens the plot over the others. Those of one abscissa share a cursor.
import { PRINT } from "./colours.js";
import { download, element } from "./dom.js";
import { distinct, largestOf, tickText } from "./numbers.js";
import { effect } from "./reactive.js";
import { isLight } from "./theme.js";
import { uPlot } from "./vendor/uplot.js";

const DENSE = 2000;  // points of a curve that is drawn thin
const tone = (/** @type {string} */ colour) => (isLight() ? PRINT[colour] || colour : colour);
const inks = () => (isLight() ? { ink: "#4c5b69", grid: "#d9dfe5" } : { ink: "#93a3b3", grid: "#27323e" });

export class Plot {
  // All that were made, and those that are seen now.
  /** @type {Plot[]} */ static all = [];
  static seen() { return Plot.all.filter(plot => plot.plot && !plot.box.hidden && plot.pane.clientWidth > 0); }

  title = ""; x = ""; y = ""; loop = false; whole = false; log = false; key = "";
  /** @type {Series[]} */ series = [];
  /** @type {[number, number] | null} */ range = null;
  /** @type {[number, number] | null} a part of the abscissa; what is beside it is faded */ used = null;
  /** @type {((from: number, to: number) => void) | null} gets the part that is seen */ zoomed = null;
  /** @type {any} */ plot = null;
  /** @type {any[]} */ dots = [];
  /** @type {any} */ at = null;
  /** @type {any} */ head;
  /** @type {any} */ pane;

  /**
   * Args: the element to go into; title; names of the axes; whether it is a loop; twice as wide; of whole numbers; and
   * with a logarithmic ordinate.
   * @param {HTMLElement} parent @param {string} title @param {string} x @param {string} y
   */
  constructor(parent, title, x, y, { loop = false, wide = false, whole = false, log = false } = {}) {
    Object.assign(this, { title, x, y, loop, whole, log });
    this.box = element("figure", "", { className: wide ? "wide" : "" });
    this.box.innerHTML = "<figcaption><b></b><button type=button title='the numbers as CSV' aria-label='save the numbers as CSV'>⤓</button><button type=button title='full size; Escape closes it' aria-label='full size' aria-pressed=false>⤢</button><span></span></figcaption><div></div>";
    [this.head, this.pane] = this.box.children;
    this.head.firstChild.textContent = this.head.firstChild.title = title;
    this.pane.setAttribute("role", "img");
    this.pane.setAttribute("aria-label", `${title} over ${x}`);
    this.head.children[1].onclick = () => download(`${title.replace(/\W+/g, "_")}.csv`, this.csv());
    this.head.children[2].onclick = this.head.firstChild.ondblclick = () => this.open();
    this.instead = element("p", "", { hidden: true });
    this.tip = element("div", "", { className: "tip", hidden: true });
    this.pane.append(this.instead, this.tip);
    parent.append(this.box);
    Plot.all.push(this);
    new ResizeObserver(() => this.fit()).observe(this.pane);
  }

  /** @param {string} title */
  retitle(title) {
    this.title = this.head.firstChild.textContent = this.head.firstChild.title = title;
    this.pane.setAttribute("aria-label", `${title} over ${this.x}`);
  }
  // Over the foot and the other plots, or back in its place; not two at once.
  open(on = !this.box.classList.contains("whole")) {
    if (on) Plot.close();
    this.box.classList.toggle("whole", on);
    this.head.children[2].setAttribute("aria-pressed", on);
  }
  static close() { for (const plot of Plot.all) plot.open(false); }
  /** @param {string} sentence in place of curves */
  none(sentence) {
    this.set([]);
    this.instead.textContent = sentence;
    this.instead.hidden = false;
  }

  /**
   * @param {Series[]} series
   * @param {[number, number] | null} range of the ordinate, or null for what the data need
   */
  set(series, range = null) {
    const key = JSON.stringify(series.map(s => [s.label, s.colour, s.points, s.dashed, s.x.length > DENSE]));
    Object.assign(this, { series, range });
    this.instead.hidden = true;
    if (key !== this.key || !this.plot) this.make();
    this.key = key;
    this.plot.setData(this.data());
    this.place();
  }

  data() {
    if (this.loop) {
      const wide = 1.1 * Math.max(this.series.length ? 1e-12 : 1, ...this.series.map(s => largestOf(s.x)));
      return [[-wide, 0, wide], ...this.series.map(() => [null, null, null])];
    }
    const all = this.series.filter(s => s.x.length).map(s => [s.x, s.y]);
    const joined = all.length ? uPlot.join(all) : [[0, 1]];
    let at = 1;
    return [joined[0], ...this.series.map(s => (s.x.length ? joined[at++] : joined[0].map(() => null)))];
  }

  make() {
    if (this.plot) this.plot.destroy();
    const { ink, grid } = inks();
    const axis = (/** @type {string} */ label, /** @type {number} */ size) => ({ stroke: ink, grid: { stroke: grid, width: 1 }, ticks: { show: false }, font: "12px system-ui", labelFont: "12px system-ui",
      label: label || undefined, labelSize: label ? 15 : 0, labelGap: 0, gap: 3, size, space: size > 30 ? 22 : 36, values: (/** @type {any} */ u, /** @type {number[]} */ marks) => distinct(marks) });
    const extent = () => {
      if (this.range) return this.range;
      if (this.loop) { const tall = 1.1 * Math.max(this.series.length ? 1e-12 : 1, ...this.series.map(s => largestOf(s.y))); return [-tall, tall]; }
      return null;
    };
    const shown = (/** @type {any} */ u, /** @type {number | null} */ low, /** @type {number} */ high) => extent() || (low === null ? [0, 1] : uPlot.rangeNum(low, high, 0.08, true));
    // a point at the end is a whole point
    const across = (/** @type {any} */ u, /** @type {number | null} */ low, /** @type {number} */ high) => {
      if (low === null) return [0, 1];
      const room = this.whole ? 0.5 : this.series.some(s => s.points && s.x.length > 1) ? 0.025 * (high - low) : 0;
      return high > low || this.whole ? [low - room, high + room] : [low - 1, high + 1];
    };
    this.plot = new uPlot({
      ...this.size(), legend: { show: false }, padding: [6, 14, 0, 0], cursor: { ...(this.loop ? {} : { sync: { key: this.x, filters: { sub: () => this.pane.clientWidth > 0 } } }), y: false, points: { size: 6 }, drag: { x: !this.loop, y: this.loop } },
      scales: { x: { time: false, range: across }, y: this.log ? { distr: 3 } : { range: shown } },
      axes: [{ ...axis(this.across(), 20), ...(this.whole ? { incrs: [1, 2, 5, 10, 20, 50, 100] } : {}) }, { ...axis(this.y, 38), ...(this.log ? { values: (/** @type {any} */ u, /** @type {(number | null)[]} */ marks) => marks.map(v => tickText(v)) } : {}), size: (/** @type {any} */ u, /** @type {string[] | null} */ texts) => Math.max(38, 8 + 6.3 * Math.max(...(texts || []).map(text => text.length))) }],
      series: [{}, ...this.series.map(s => ({
        stroke: tone(s.colour), width: s.x.length > DENSE ? 1 : 1.6, dash: s.dashed ? [4, 3] : undefined, spanGaps: true,
        ...(s.points ? { paths: () => null, points: { show: true, size: s.points === true ? 6 : s.points, fill: tone(s.colour), width: 0 } } : { points: { show: false } }),
      }))],
      hooks: { draw: [(/** @type {any} */ u) => this.drawLoopsAndLimits(u)], setCursor: [(/** @type {any} */ u) => this.tell(u)], setSize: [() => this.place()], setScale: [(/** @type {any} */ u, /** @type {string} */ key) => { this.place(); if (key === "x" && this.zoomed) this.zoomed(u.scales.x.min, u.scales.x.max); }] },
    }, this.data(), this.pane);
    this.dots = [];
    this.tell({ cursor: {} });
  }

  /** @param {any} u loops, and the limits of points */
  drawLoopsAndLimits(u) {
    const ink = u.ctx;
    ink.save();
    ink.setLineDash([]);  // of the last curve
    ink.beginPath();
    ink.rect(u.bbox.left, u.bbox.top, u.bbox.width, u.bbox.height);
    ink.clip();
    if (this.used) {  // what is not used is faded
      const [from, to] = this.used.map(v => u.valToPos(v, "x", true)), { left, top, width, height } = u.bbox;
      ink.fillStyle = isLight() ? "#ffffffb8" : "#10161db8";
      ink.fillRect(left, top, from - left, height);
      ink.fillRect(to, top, left + width - to, height);
    }
    for (const s of this.series) {
      ink.strokeStyle = tone(s.colour);
      ink.lineWidth = 1.6 * devicePixelRatio;
      ink.beginPath();
      const X = (/** @type {number} */ v) => u.valToPos(v, "x", true), Y = (/** @type {number} */ v) => u.valToPos(v, "y", true);
      if (this.loop) { s.x.forEach((v, k) => ink.lineTo(X(v), Y(s.y[k]))); ink.closePath(); }
      const { low, high } = s;
      if (low && high) s.x.forEach((v, k) => { if (Number.isFinite(low[k]) && Number.isFinite(high[k])) { ink.moveTo(X(v), Y(low[k])); ink.lineTo(X(v), Y(high[k])); } });
      ink.stroke();
    }
    ink.restore();
  }

  /** @param {any} u names of the series under the title; their values under the mouse lie over the curves, so that nothing moves */
  tell(u) {
    const at = u.cursor.idx, known = at !== null && at !== undefined && !this.loop, item = (/** @type {Series} */ s, /** @type {string} */ textContent) => {
      const span = element("span", textContent);
      span.style.color = tone(s.colour);
      return span;
    };
    const names = this.series.filter(s => s.label), value = (/** @type {Series} */ s) => this.plot.data[this.series.indexOf(s) + 1][at];
    if (!known) this.head.lastChild.replaceChildren(...names.map(s => item(s, s.label)));
    const under = known ? this.series.filter(s => Number.isFinite(value(s))) : [];
    this.tip.hidden = !under.length;
    if (under.length) this.tip.replaceChildren(`at ${tickText(this.plot.data[0][at])}: `, ...under.map(s => item(s, `${s.label} ${tickText(value(s))}`)));
  }

  /** @param {any[][]} dots [x, y, colour] that move with time; the canvas is not drawn again for them */
  marks(dots) {
    while (this.dots.length < dots.length) { const dot = element("i"); this.plot.over.append(dot); this.dots.push(dot); }
    this.at = dots;
    this.place();
  }

  place() {
    this.dots.forEach((dot, k) => {
      const [x, y, colour] = (this.at && this.at[k]) || [null];
      dot.hidden = x === null || !this.plot;
      if (dot.hidden) return;
      const left = this.plot.valToPos(x, "x"), top = this.plot.valToPos(y, "y");
      dot.hidden = !(left >= 0 && left <= this.plot.over.clientWidth);
      dot.style.cssText = `background: ${tone(colour)}; transform: translate(${left - 4}px, ${top - 4}px)`;
    });
  }

  size() { return { width: Math.max(40, this.pane.clientWidth), height: Math.max(40, this.pane.clientHeight) }; }
  redraw() { if (this.plot) { this.make(); this.place(); } }
  fit() {
    if (!this.plot) return;
    this.plot.axes[0].label = this.across();
    this.plot.setSize(this.size());
  }
  // The abscissa's name; where there is no room for it, its unit.
  across() { return this.pane.clientWidth < 7.5 * this.x.length + 46 ? (/\[.*\]/.exec(this.x) || [this.x])[0] : this.x; }

  // Its numbers: series, abscissa, ordinate and limits of each point.
  rows() { return this.series.flatMap(s => s.x.map((x, k) => [s.label || this.title, x, s.y[k], s.low ? s.low[k] : "", s.high ? s.high[k] : ""])); }
  csv() { return `series,x,y,lower,upper\n# x: ${this.x}; y: ${this.y || this.title}\n${this.rows().map(row => `${row.join(",")}\n`).join("")}`; }
}

addEventListener("keydown", event => { if (event.key === "Escape") Plot.close(); });
effect(() => { isLight(); for (const plot of Plot.all) plot.redraw(); });
