// Small plots on canvases of their own: traces over time, a curve, a loop.
"use strict";
const INK = "#93a3b3", GRID = "#27323e";

function canvas(id, wide) {
  const element = document.createElement("canvas");
  element.id = id;
  if (wide) element.className = "wide";
  document.getElementById("plots").append(element);
  return element;
}

// Clears the canvas; entries [label, colour] go beside the title, or under it where there is no room.
function begin(element, title, entries = []) {
  const ratio = devicePixelRatio || 1, w = element.clientWidth, h = element.clientHeight;
  if (element.width !== Math.round(w * ratio) || element.height !== Math.round(h * ratio)) {
    element.width = Math.round(w * ratio);
    element.height = Math.round(h * ratio);
  }
  const ink = element.getContext("2d");
  ink.setTransform(ratio, 0, 0, ratio, 0, 0);
  ink.clearRect(0, 0, w, h);
  ink.font = "11px system-ui, sans-serif";
  ink.fillStyle = INK;
  ink.textAlign = "left";
  ink.fillText(title, 8, 13);
  const crowded = ink.measureText(title).width + 20 > names(ink, w, entries, 0);
  names(ink, w, entries, crowded ? 27 : 13);
  return [ink, w, h, crowded ? 38 : 24];
}

// About `count` round numbers, and never fewer than three: a single 0 would be no scale.
function ticks(low, high, count) {
  const raw = (high - low) / count || 1, power = 10 ** Math.floor(Math.log10(raw)), out = [];
  const least = s => Math.floor(high / s + 1e-9) - Math.ceil(low / s - 1e-9) >= 2;
  const steps = [10, 5, 2, 1, 0.5, 0.2].map(f => f * power), wanted = steps.filter(s => s >= raw * 0.999).pop();
  const step = steps.find(s => s <= wanted && least(s));
  for (let v = Math.ceil(low / step) * step; v <= high + 1e-9 * step; v += step) out.push(Math.abs(v) < 1e-9 * step ? 0 : v);
  return out;
}

// Axes with numbers; returns the maps from values to pixels.
function axes(ink, w, h, top, x, y, xName) {
  const left = 40, right = w - 10, bottom = h - 26;
  const X = v => left + (right - left) * (v - x[0]) / (x[1] - x[0]), Y = v => bottom - (bottom - top) * (v - y[0]) / (y[1] - y[0]);
  ink.strokeStyle = GRID;
  ink.lineWidth = 1;
  ink.fillStyle = INK;
  for (const v of ticks(y[0], y[1], 4)) {
    line(ink, [[left, Y(v)], [right, Y(v)]]);
    ink.textAlign = "right";
    ink.fillText(mark(v), left - 5, Y(v) + 4);
  }
  ink.textAlign = "center";
  for (const v of ticks(x[0], x[1], w > 240 ? 5 : 3)) {
    line(ink, [[X(v), top], [X(v), bottom]]);
    ink.fillText(mark(v), X(v), bottom + 12);
  }
  ink.textAlign = "right";
  ink.fillText(xName, right, h - 3);
  return [X, Y];
}

function mark(v) { return Math.abs(v) >= 1e4 ? v.toExponential(0) : String(+v.toPrecision(3)); }

function line(ink, points) {
  ink.beginPath();
  points.forEach(([x, y], k) => (k ? ink.lineTo(x, y) : ink.moveTo(x, y)));
  ink.stroke();
}

function dot(ink, x, y, colour, radius = 4) {
  ink.fillStyle = colour;
  ink.beginPath();
  ink.arc(x, y, radius, 0, 7);
  ink.fill();
}

// Write labels from the right at height `y` (0 only measures); returns where they begin.
function names(ink, w, entries, y) {
  ink.textAlign = "right";
  let x = w - 10;
  for (const [label, colour] of entries.slice().reverse()) {
    ink.fillStyle = colour;
    if (y) ink.fillText(label, x, y);
    x -= ink.measureText(label).width + 12;
  }
  return x;
}

// series: [label, colour, values, dashed]; `at` is the share of the duration that has passed. A period ends as it began.
function plotTraces(element, title, duration, series, at, periodic) {
  const [ink, w, h, above] = begin(element, title, series.map(s => [s[0], s[1]]));
  const top = 1.08 * Math.max(1e-9, ...series.map(s => s[2].reduce((m, v) => Math.max(m, Math.abs(v)), 0)));
  const [X, Y] = axes(ink, w, h, above, [0, 1e3 * duration], [-top, top], "time [ms]");
  for (const [, colour, values, dashed] of series) {
    ink.strokeStyle = colour;
    ink.lineWidth = 1.6;
    ink.setLineDash(dashed ? [4, 3] : []);
    const whole = periodic ? [...values, values[0]] : values;
    line(ink, whole.map((v, k) => [X(1e3 * duration * k / values.length), Y(v)]));
    ink.setLineDash([]);
    const k = Math.min(values.length - 1, Math.floor(at * values.length));
    dot(ink, X(1e3 * duration * at), Y(values[k]), colour, 3);
  }
}

// curves: [label, colour, values]; points: [x, y, colour].
function plotCurve(element, title, x, curves, points) {
  const [ink, w, h, above] = begin(element, title, curves.length > 1 ? curves.map(c => [c[0], c[1]]) : []);
  const top = 1.1 * Math.max(1.2, ...curves.map(c => Math.max(...c[2])), ...points.map(p => p[1]));
  const [X, Y] = axes(ink, w, h, above, [0, x[x.length - 1]], [0, top], "frequency [Hz]");
  ink.strokeStyle = "#4a5a6a";
  ink.setLineDash([2, 3]);
  line(ink, [[X(0), Y(1)], [X(x[x.length - 1]), Y(1)]]);
  ink.setLineDash([]);
  for (const [, colour, values] of curves) {
    ink.strokeStyle = colour;
    ink.lineWidth = 1.8;
    line(ink, values.map((v, k) => [X(x[k]), Y(v)]));
  }
  for (const [px, py, colour] of points) if (py !== null) dot(ink, X(px), Y(py), colour, 4.5);
}

// loops: [label, colour, x [m], force [N]]; drawn compression to the right.
function plotLoop(element, title, loops, at) {
  const [ink, w, h, above] = begin(element, title);
  const spread = k => 1.15 * Math.max(1e-9, ...loops.map(l => l[k].reduce((m, v) => Math.max(m, Math.abs(v)), 0)));
  const wide = 1e3 * spread(2), tall = spread(3);
  const [X, Y] = axes(ink, w, h, above, [-wide, wide], [-tall, tall], "compression [mm]");
  for (const [, colour, x, force] of loops) {
    ink.strokeStyle = colour;
    ink.lineWidth = 1.7;
    const points = x.map((v, k) => [X(-1e3 * v), Y(-force[k])]);
    line(ink, [...points, points[0]]);
    dot(ink, ...points[Math.min(points.length - 1, Math.floor(at * points.length))], colour);
  }
}
