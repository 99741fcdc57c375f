// The two masses of Eq. 4.29 in the page of an exported file: the periodic motion by shooting.

/** @typedef {Record<string, number>} Constants */
/** @typedef {[number, number]} Complex real and imaginary part */
/** @typedef {{ values: Constants, carrier: string, frequency?: number, harmonics?: Complex[], step: number, curve_hz: number[] }} Live */

/** @type {(x: number[], p: Constants, u: number, f: number[]) => Complex} rates of (z1, z2, z1', z2') under the base acceleration u, into f; returns the forces of ankle and fat pad */
function rates(x, p, u, f) {
  const c_T = p.c_11 * Math.exp(-p.c_12 * x[0]) * Math.cos(p.c_13 * x[0]), c_F = p.c_21 * Math.exp(-p.c_22 * x[1]) * Math.cos(p.c_23 * x[1]);
  const f_T = c_T * x[2] + p.k_T * x[0], f_F = c_F * x[3] + p.k_F * x[1];
  f[0] = x[2];
  f[1] = x[3];
  f[2] = (f_F - f_T) / p.m_F - f_T / p.m_S;
  f[3] = (f_T - f_F) / p.m_F - u;
  return [f_T, f_F];
}

/**
 * One period by fourth-order Runge-Kutta from x; u are the values at half steps. `seen` gets each step's state and forces.
 * @type {(x0: number[], p: Constants, u: Float64Array, h: number, seen?: (step: number, x: number[], forces: Complex) => void) => number[]}
 */
function period(x0, p, u, h, seen) {
  const n = (u.length - 1) / 2, x = x0.slice(), k = [0, 1, 2, 3].map(() => [0, 0, 0, 0]), t = [0, 0, 0, 0];
  for (let i = 0; i < n; i++) {
    for (let s = 0; s < 4; s++) {
      const w = s === 0 ? 0 : s === 3 ? h : 0.5 * h;
      for (let j = 0; j < 4; j++) t[j] = s ? x[j] + w * k[s - 1][j] : x[j];
      const forces = rates(t, p, u[2 * i + ((s + 1) >> 1)], k[s]);
      if (s === 0 && seen) seen(i, x, forces);
    }
    for (let j = 0; j < 4; j++) x[j] += h / 6 * (k[0][j] + 2 * k[1][j] + 2 * k[2][j] + k[3][j]);
  }
  return x;
}

/** @type {(A: number[][], b: number[]) => number[]} solve A y = b of four rows, A in rows */
function solve4(A, b) {
  const M = A.map((row, i) => [...row, b[i]]);
  for (let c = 0; c < 4; c++) {
    let best = c;
    for (let r = c + 1; r < 4; r++) if (Math.abs(M[r][c]) > Math.abs(M[best][c])) best = r;
    [M[c], M[best]] = [M[best], M[c]];
    for (let r = 0; r < 4; r++) if (r !== c) { const q = M[r][c] / M[c][c]; for (let j = c; j < 5; j++) M[r][j] -= q * M[c][j]; }
  }
  return M.map((row, i) => row[4] / row[i]);
}

/** @type {(p: Constants, u: Float64Array, h: number) => number[] | null} Newton on the initial states, whose derivatives after a period are taken by differences */
function orbit(p, u, h) {
  let x = [0, 0, 0, 0];
  const size = [1e-6, 1e-6, 1e-4, 1e-4];
  for (let pass = 0; pass < 60; pass++) {
    const end = period(x, p, u, h), A = [0, 1, 2, 3].map(() => [0, 0, 0, 0]);
    for (let j = 0; j < 4; j++) {
      const up = x.slice(), down = x.slice();
      up[j] += size[j];
      down[j] -= size[j];
      const a = period(up, p, u, h), b = period(down, p, u, h);
      for (let i = 0; i < 4; i++) A[i][j] = +(i === j) - (a[i] - b[i]) / (2 * size[j]);
    }
    const step = solve4(A, end.map((v, i) => v - x[i]));
    x = x.map((v, i) => v + step[i]);
    const gap = Math.max(...step.map((v, i) => Math.abs(v) / Math.max(size[i], Math.abs(x[i]))));
    if (!Number.isFinite(gap)) return null;
    if (gap < 1e-10) return x;
  }
  return null;
}

/** @type {(p: Constants, hertz: number[]) => number[]} |T| of the linear model at frequencies [Hz] */
function linearCurve(p, hertz) {
  return hertz.map(f => {  // (k - w^2 m) of both masses, complex
    const w = 2 * Math.PI * f, /** @type {Complex} */ aT = [p.k_T, w * p.c_11], /** @type {Complex} */ aF = [p.k_F, w * p.c_21];
    const times = (/** @type {Complex} */ a, /** @type {Complex} */ b) => /** @type {Complex} */ ([a[0] * b[0] - a[1] * b[1], a[0] * b[1] + a[1] * b[0]]), size = (/** @type {Complex} */ a) => Math.hypot(a[0], a[1]);
    const /** @type {Complex} */ shank = [aT[0] - w * w * p.m_S, aT[1]], /** @type {Complex} */ foot = [aT[0] + aF[0] - w * w * p.m_F, aT[1] + aF[1]];
    const d = times(shank, foot), t = times(aT, aT);
    return size(times(aT, aF)) / size([d[0] - t[0], d[1] - t[1]]);
  });
}

/** @type {(live: Live, state: State, measured?: FootMotion) => Motion | { type: "error", text: string }} the answer to a page's settings, in the form of the server's */
export function twinAnswer(live, state, measured) {
  const p = { ...live.values, ...state.values }, FRAMES = 64, turn = 2 * Math.PI;
  p[live.carrier] += state.added_mass;
  const f = live.frequency || state.frequency, /** @type {Complex[]} */ U = live.harmonics || [[0, -0.5 * state.peak_to_peak]];
  const count = FRAMES * Math.ceil(1 / (f * live.step * FRAMES)), h = 1 / (f * count);
  const at = (/** @type {number} */ t, /** @type {number} */ order) => U.reduce((sum, [re, im], k) => {
    const w = turn * f * (k + 1), c = Math.cos(w * t), s = Math.sin(w * t);
    return sum + (order === 1 ? w * (-re * s - im * c) : (re * c - im * s) * (order === -2 ? -1 / (w * w) : 1));
  }, 0);
  const u = new Float64Array(2 * count + 1);
  for (let k = 0; k <= count; k++) u[2 * k] = at(k * h, 0);
  for (let k = 0; k < count; k++) u[2 * k + 1] = 0.5 * (u[2 * k] + u[2 * k + 2]) + h / 8 * (at(k * h, 1) - at((k + 1) * h, 1));
  const x = orbit(p, u, h);
  if (!x) return { type: "error", text: "this foot is too stiff or too damped for this page; move the sliders back." };
  const y = new Float64Array(count), every = count / FRAMES, /** @type {number[]} */ rows = [], /** @type {Loop} */ pad = { x: [], force: [] }, /** @type {Loop} */ ankle = { x: [], force: [] };
  period(x, p, u, h, (k, z, [f_T, f_F]) => {
    y[k] = -f_T / p.m_S;
    if (k % every) return;
    const table = at(k * h, -2), still = [0, 0, 0, 0];
    rows.push(0, table, ...still, 0, table + z[1], ...still, 0, table + z[1] + z[0], ...still);
    pad.x.push(z[1]);
    pad.force.push(f_F);
    ankle.x.push(z[0]);
    ankle.force.push(f_T);
  });
  const line = (/** @type {Float64Array} */ values) => [...values].reduce(([re, im], v, k) => [re + v * Math.cos(turn * k / count), im - v * Math.sin(turn * k / count)], [0, 0]);
  const Y = line(y), B = line(u.filter((_, k) => k % 2 === 0 && k < 2 * count)), size = Math.hypot(...B);
  /** @type {FootMotion} */
  const foot = {
    frames: FRAMES, duration: 1 / f, periodic: true, bodies: rows, base: [...u].filter((_, k) => k % (2 * every) === 0).slice(0, FRAMES),
    malleolus: [...y].filter((_, k) => k % every === 0), loops: { "fat pad": pad, ankle }, transmissibility: linearCurve(p, live.curve_hz),
    ratio: size > 1e-9 ? Math.hypot(...Y) / size : null, phase: size > 1e-9 ? Math.atan2(Y[1] * B[0] - Y[0] * B[1], Y[0] * B[0] + Y[1] * B[1]) * 180 / Math.PI : null,
  };
  /** @type {Record<string, FootMotion>} */
  const feet = { a: foot };
  if (measured && measured.points) feet.measured = { ...measured, fit_percent: fitPercent(measured.points, foot) };
  return { type: "motion", feet, held: {}, other: {} };
}

/** @type {(points: { time: number[], malleolus: number[] }, foot: FootMotion) => number} fit in percent of the measured points, as Eq. 3.20 has it */
function fitPercent(points, foot) {
  const n = foot.frames, turn = 2 * Math.PI, /** @type {number[][]} */ lines = [];
  for (let h = 1; h < n / 2; h++) lines.push(foot.malleolus.reduce(([re, im], v, k) => [re + v * Math.cos(turn * h * k / n) / n, im - v * Math.sin(turn * h * k / n) / n], [0, 0]));
  const mean = points.malleolus.reduce((a, v) => a + v, 0) / points.malleolus.length;
  let left = 0, all = 0;
  points.time.forEach((t, k) => {
    const follows = lines.reduce((sum, [re, im], h) => { const a = turn * (h + 1) * t / foot.duration; return sum + 2 * (re * Math.cos(a) - im * Math.sin(a)); }, 0);
    left += (points.malleolus[k] - follows) ** 2;
    all += (points.malleolus[k] - mean) ** 2;
  });
  return 100 * (1 - Math.sqrt(left / all));
}
