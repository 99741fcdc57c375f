// The plots of a motion, and where the moment that is shown lies on them.
import { ANKLE, BASE, OTHER, SEEN } from "./colours.js";
import { byId } from "./dom.js";
import { sample } from "./motion.js";
import { clock, passedShare } from "./playback.js";
import { Plot } from "./plots.js";
import { firstFoot, page, wornBranchName } from "./store.js";

clock.length = () => (page.motion ? firstFoot().duration : 1);
clock.steps = () => (page.motion ? firstFoot().frames : 1);
export const frame = () => { const foot = firstFoot(); return passedShare() * (foot.periodic ? foot.frames : foot.frames - 1); };

/** @type {Record<string, string>} */
const COLOURS = { b: OTHER, measured: SEEN };
/** @type {Record<string, string>} */
const NAMES = { a: "malleolus", b: "other", measured: "measured" };
/** @type {(name: string) => string} */
const colourOf = name => COLOURS[name] || ANKLE;

const into = byId("motion_plots");
export const plots = {
  traces: new Plot(into, "acceleration [m/s²]", "time [ms]", "", { wide: true }),
  curve: new Plot(into, "transmissibility", "frequency [Hz]", "", { wide: true }),
  pad: new Plot(into, "fat pad, force [N]", "compression [mm]", "", { loop: true }),
  ankle: new Plot(into, "ankle, force [N]", "compression [mm]", "", { loop: true }),
};
/** @type {[Plot, string][]} */
const LOOPS = [[plots.pad, "fat pad"], [plots.ankle, "ankle"]];
/** @type {Motion | null} the motion whose curves are drawn */
let drawn = null;
export const isDrawn = () => drawn === page.motion;

// A motion's curves; a period ends as it began.
function draw() {
  const { model, motion } = page, feet = Object.entries(motion.feet), first = firstFoot();
  const times = first.base.map((_, k) => 1e3 * first.duration * k / first.frames);
  const whole = (/** @type {number[]} */ v) => (first.periodic ? [...v, v[0]] : v), x = first.periodic ? [...times, 1e3 * first.duration] : times;
  const seen = motion.feet.measured && motion.feet.measured.points, worn = wornBranchName();
  const seriesLabel = (/** @type {string} */ n) => [model.feet.b ? model.feet[n].title : "", n === "a" ? worn : ""].filter(Boolean).join(" · ");
  plots.traces.set([
    { label: "base", colour: BASE, x, y: whole(first.base) },
    ...feet.filter(([n]) => n !== "measured" || !seen).map(([n, f]) => ({ label: n === "a" && worn ? worn : NAMES[n], colour: colourOf(n), x, y: whole(f.malleolus), dashed: n !== "a" })),
    ...(seen ? [{ label: "measured", colour: SEEN, x: seen.time.map(t => 1e3 * t), y: seen.malleolus, points: 3 }] : []),
  ]);
  const curves = feet.filter(([n]) => n !== "measured");
  const dots = feet.flatMap(([n, f]) => (f.ratio === null ? [] : [{ label: "", colour: colourOf(n), x: [1 / first.duration], y: [f.ratio], points: 9 }]));
  const top = 1.1 * Math.max(1.2, ...curves.map(([, f]) => Math.max(...f.transmissibility)), ...dots.map(d => d.y[0]));
  plots.curve.set([...curves.map(([n, f]) => ({ label: seriesLabel(n), colour: colourOf(n), x: model.curve_hz, y: f.transmissibility })), ...dots], [0, top]);
  for (const [plot, key] of LOOPS) {
    plot.box.hidden = !first.loops[key];
    plot.set(curves.filter(([, f]) => f.loops[key]).map(([n, f]) => ({ label: seriesLabel(n), colour: colourOf(n), x: f.loops[key].x.map(v => -1e3 * v), y: f.loops[key].force.map(v => -v) })));
  }
}

// Where the moment that is shown lies on the curves.
export function follow() {
  if (!isDrawn()) { draw(); drawn = page.motion; }
  const feet = Object.entries(page.motion.feet), first = firstFoot(), t = 1e3 * passedShare() * clock.length(), at = frame();
  plots.traces.marks([[t, sample(first.base, first, at), BASE], ...feet.map(([n, f]) => [t, sample(f.malleolus, f, at), colourOf(n)])]);
  for (const [plot, key] of LOOPS)
    plot.marks(feet.filter(([, f]) => f.loops[key]).map(([n, f]) => [-1e3 * sample(f.loops[key].x, f, at), -sample(f.loops[key].force, f, at), colourOf(n)]));
}

/** @param {string} sentence in place of curves */
export function showNoCurves(sentence) { for (const plot of Object.values(plots)) { plot.none(sentence); plot.marks([]); } }
