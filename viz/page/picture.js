// The feet as they are drawn: posed, with their colours' legend and the line that says what is seen.
import { byId, element, tell } from "./dom.js";
import { Feet, TABLE } from "./feet.js";
import { largest } from "./motion.js";
import { follow, frame, showNoCurves } from "./motion_plots.js";
import { number } from "./numbers.js";
import { clock, passedShare, play, secondsPassed } from "./playback.js";
import { RAMPS } from "./stage.js";
import { bench, firstFoot, page, state, stats } from "./store.js";

export const stage = new Feet(byId("pane"));
stage.addGround(TABLE - 0.5);
// Where the processor draws, a running fit needs it more, and only a few pictures are drawn [ms between two].
const CALM = 250;
export const SOFTWARE = !stage.blind && isDrawnBySoftware(stage.renderer.getContext());
let painted = 0, since = 0, arrived = false;

/** @param {WebGLRenderingContext} gl */
function isDrawnBySoftware(gl) {
  const about = gl.getExtension("WEBGL_debug_renderer_info");
  return /swiftshader|llvmpipe|softpipe|software|basic render/i.test(String(gl.getParameter(about ? about.UNMASKED_RENDERER_WEBGL : gl.RENDERER)));
}

export function pose() { stage.pose(page.motion, frame(), stage.gain(page.motion, state.amplify)); }

/** @param {number} when the motion was asked for [ms] */
export function showMotion(when) {
  since = when;
  clock.fresh = arrived = true;
  pose();
  stats.posed.push(performance.now() - since);
}

// Show one share (0 to 1) of the motion and draw it now: for pictures and films.
export function showAt(share = 0) {
  play(false);
  clock.time = share * clock.length();
  pose();
  follow();
  stage.render();
}

/** @param {string} sentence in place of a motion: the feet at rest, and nothing of an earlier motion beside them */
export function showAtRest(sentence) {
  const { model } = page, still = (/** @type {[string, any]} */ [name, foot]) => [name, { frames: 1, duration: 1, periodic: true, bodies: foot.bodies.flatMap(() => Array(6).fill(0)), loops: {} }];
  stage.pose({ feet: Object.fromEntries(Object.entries(model.feet).filter(([name]) => name !== "measured").map(still)) }, 0, 1);
  tellTitle(sentence);
  showNoCurves(sentence);
  byId("legend").replaceChildren();
  byId("clock").textContent = "";
}
/** @param {string} sentence in place of numbers */
export function tellTitle(sentence) { const { model } = page; tell([model.feet.a.title, model.recorded ? model.excitation : "", sentence]); }

// Nothing is posed before the scene is whole.
export function forgetFeet() { stage.feet = {}; stage.viewer.delete_path(["meshcat", "foot"]); }

/** @type {[string, string, keyof typeof RAMPS][]} title, loop and ramp */
const PAINTS = [["fascia: change of tension", "fascia", "tension"], ["fat pad: change of compression", "fat pad", "pressure"]];
function legend() {
  const box = byId("legend"), loops = firstFoot().loops;
  box.replaceChildren();
  for (const [title, key, ramp] of PAINTS) {
    if (!loops[key]) continue;
    const top = largest(page.motion, key).toPrecision(3), [part, change] = title.split(":"), item = element("div", part, { title }), bar = element("i"), ends = element("p");
    bar.style.background = `linear-gradient(90deg, ${RAMPS[ramp].join(", ")})`;
    ends.append(...[`−${top} N`, "0", `+${top} N`].map(text => element("span", text)));
    item.append(element("span", `:${change}`), bar, ends);
    box.append(item);
  }
}

const behind = (/** @type {number} */ degrees) => `${Math.abs(degrees).toFixed(0)}° ${degrees > 0 ? "ahead of" : "behind"} the base`;
function tellState() {
  const { model, motion } = page, foot = firstFoot(), seen = motion.feet.measured, gain = stage.gain(motion, state.amplify);
  const capped = state.amplify !== null && gain < 0.999 * state.amplify ? ", as much as fits" : "";
  const shown = `drawn ${gain.toPrecision(3)}× larger${capped}${stage.riding ? ", relative to the table" : ""}, ${state.slow.toPrecision(3)}× slower`;
  const also = (/** @type {(foot: any) => string} */ value) => (seen && seen.ratio !== null ? ` (measured ${value(seen)})` : "");
  const numbers = foot.ratio === null || foot.phase === null ? [foot.periodic ? "the table is at rest" : ""] : [
    `transmissibility ${foot.ratio.toFixed(3)}${also(f => f.ratio.toFixed(3))}`,
    `malleolus ${behind(foot.phase)}${also(f => `${Math.abs(f.phase).toFixed(0)}°`)}`];
  const fit = seen && typeof seen.fit_percent === "number" ? `fit with these values ${seen.fit_percent.toFixed(1)} %` : "";
  const base = foot.periodic && !model.recorded ? `${number(state.frequency)} Hz` : model.excitation;
  tell([`${model.feet.a.title}${bench.draft ? " (draft, not saved)" : ""}, ${base}`, ...numbers, fit, model.about, shown]);
}

export function tick(now = 0) {
  requestAnimationFrame(tick);
  const passed = secondsPassed(now), { model, motion } = page;
  if (motion && model && clock.playing) clock.time += passed / state.slow;
  if (motion && model && !(SOFTWARE && bench.fitBegan && !clock.fresh && now - painted < CALM)) {
    painted = now;
    const started = performance.now();
    if (clock.playing || clock.fresh || stage.viewer.needs_render) {
      pose();
      if (clock.fresh) { legend(); tellState(); page.sliders.amplify.show?.(stage.gain(motion, null)); }
      follow();
      byId("seek").value = frame() / firstFoot().frames;
      byId("clock").textContent = `${(1e3 * passedShare() * clock.length()).toFixed(1)} of ${(1e3 * clock.length()).toFixed(1)} ms`;
    }
    if (stage.viewer.needs_render) stage.render();
    clock.fresh = false;
    if (arrived && !stage.blind) {  // reading a pixel waits for the picture
      const gl = stage.renderer.getContext();
      gl.readPixels(0, 0, 1, 1, gl.RGBA, gl.UNSIGNED_BYTE, new Uint8Array(4));
      stats.drawn.push(performance.now() - since);
      arrived = false;
    }
    stats.frames += 1;
    stage.adapt(performance.now() - started, passed * 1000);
  } else if (model && !motion && !page.busy && stage.viewer.needs_render) stage.render();
}
