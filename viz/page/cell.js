// The cell's page: mode chooser, the surfaces moved along the chosen mode, colours, keys.
import { withToken } from "./address.js";
import { button, byId, element, rowIn, save, say, tell } from "./dom.js";
import { EXPORTED } from "./exported.js";
import { number } from "./numbers.js";
import { clock, keys, passedShare, play, secondsPassed } from "./playback.js";
import { Plot } from "./plots.js";
import { effect } from "./reactive.js";
import { slider } from "./slider.js";
import { RAMPS, Stage, cameras, shade } from "./stage.js";
import { connection, on, start } from "./stream.js";
import { KEYS, filmPlan, takeAwaySection } from "./take.js";
import { themeButton } from "./theme.js";
import { THREE } from "./three.js";

const CAMERAS = {
  corner: [[2.3, 1.75, 3.9], [0, 0.08, 0]], side: [[0, 0.75, 4.6], [0, 0.12, 0]],
  end: [[4.2, 0.85, 0], [0, 0.12, 0]], above: [[0, 4.7, 0.02], [0, 0, 0]],
};
// How large the motion is drawn, of the height, and how opaque the wall is: of a body, and of a cell with its nucleus.
const LARGE = [0.2, 0.5], CLEAR = [1, 0.55];
const NUCLEUS = "#e0245e";
const stage = new Stage(byId("pane"), CAMERAS);
stage.addGround(-0.055);
const state = { mode: 1, amplitude: 1, slow: 1, opacity: 0.55, lines: true };
const stats = { frames: 0, motions: 0 }, shown = { cell: null, parts: [] };
let meshButton = null;
const chosen = () => shown.cell.modes[state.mode - 1];
Object.assign(clock, { length: () => 1 / chosen().hz, steps: () => 48 });

// ---- controls -------------------------------------------------------------------------------------------------------
function buildControls() {
  const { cell } = shown;
  for (const id of ["modes", "showing"]) for (const old of byId(id).querySelectorAll("label, button, .row")) old.remove();
  cell.modes.forEach((mode, i) => {
    const b = button(byId("modes"), "", () => choose(i + 1), i < 9 ? `key ${i + 1}` : "");
    b.className = "choice";
    for (const [tag, text] of [["b", i + 1], ["i", hertz(mode.hz)], ["span", mode.label]]) b.append(element(tag, text));
  });
  const first = cell.modes[0].hz, picture = byId("showing");
  const [unit, um] = cell.unit;
  slider(picture, "amplitude", "Largest displacement", unit, 0, cell.height_um / um, state.amplitude / um, v => { state.amplitude = v * um; clock.fresh = true; },
    { hint: "The size of a mode shape is arbitrary; this sets the size in the picture.", nominal: LARGE[+!cell.body] * cell.height_um / um });
  slider(picture, "slow", "Slow motion", "× slower", 0.2 * first, 20 * first, state.slow, v => { state.slow = v; clock.fresh = true; }, { log: true, nominal: 2 * first });
  slider(picture, "opacity", "Opacity", "", 0.1, 1, state.opacity, v => { state.opacity = v; clock.fresh = true; }, { step: 0.01, nominal: CLEAR[+!cell.body] });
  const looks = rowIn(picture);
  themeButton(looks);
  meshButton = button(looks, "Mesh", () => showLines(!state.lines), "M");
  meshButton.setAttribute("aria-pressed", state.lines);
  takeAwaySection(stage, () => `${(cell.body || "cell").replace(/\.\w+$/, "").replace(/\W+/g, "_")}-mode-${state.mode}`, {
    page: !EXPORTED && (() => save(withToken("take"), "cell.html")),
    film: () => ({ ...filmPlan(clock.length() * state.slow, true), drawAt: showAt }),
    scene: () => ({ keys: KEYS, seconds: clock.length() * state.slow, periodic: true, unit: (cell.body ? 1e-6 : 1e-3) / cell.scale,
      pose: share => { clock.time = share * clock.length(); pose(); } }),
  });
}

function hertz(hz) { return hz >= 1000 ? `${(hz / 1000).toPrecision(4)} kHz` : `${hz.toPrecision(4)} Hz`; }

function choose(number) {
  const { cell } = shown;
  if (number < 1 || number > cell.modes.length) return;
  const at = passedShare();
  state.mode = number;
  clock.time = at * clock.length();  // the same place in the period
  byId("modes").querySelectorAll("button").forEach((b, i) => b.setAttribute("aria-pressed", i + 1 === number));
  paint();
  markMode();
  clock.fresh = true;
}

function showLines(on_) {
  state.lines = on_;
  meshButton.setAttribute("aria-pressed", on_);
  clock.fresh = true;
}

cameras(stage);

// ---- the result -----------------------------------------------------------------------------------------------------
on("broken", ({ text }) => say(text));
effect(() => say(connection.lost));
on("model", document_ => {
  const first = shown.cell === null, /** @type {any} */ cell = shown.cell = document_;
  if (first) Object.assign(state, { mode: cell.mode, amplitude: LARGE[+!cell.body] * cell.height_um, opacity: CLEAR[+!cell.body], slow: 2 * cell.modes[0].hz });
  if (first && cell.body) {  // in the middle of the picture, and all of it
    const tall = cell.height_um * cell.scale, off = Math.max(1, tall / 1.5), up = 0.5 * tall;
    stage.views = Object.fromEntries(Object.entries(CAMERAS).map(([name, [[x, y, z], target]]) => [name, [[off * x, off * y + up, off * z], [target[0], up, target[2]]]]));
    stage.view(stage.viewed);
  }
  if (cell.body) document.title = document.querySelector("h1").textContent = `Mode shapes of ${cell.body}`;
  state.mode = Math.min(state.mode, cell.modes.length);
  shown.parts = cell.parts.map(dress);
  legend();
  spectrum();
  buildControls();
  choose(state.mode);
  pose();
  say(cell.error);
  stats.motions += 1;
});

function dress(name) {
  const mesh = stage.viewer.scene_tree.find(["meshcat", "cell", name]).object.children[0], at = mesh.geometry.attributes;
  const part = { name, mesh, still: at.position.array.slice(), lines: null };
  at.position.setUsage(THREE.DynamicDrawUsage);
  if (name === "wall") {
    part.lines = new THREE.Mesh(mesh.geometry, new THREE.MeshBasicMaterial({ color: 0xffffff, wireframe: true, transparent: true, opacity: 0.12, depthWrite: false }));
    part.lines.frustumCulled = false;
    mesh.add(part.lines);
  }
  mesh.castShadow = false;
  mesh.receiveShadow = false;
  return part;
}

// Colour the wall by the size of the displacement, which is the mode's and does not change in time.
function paint() {
  for (const { name, mesh } of shown.parts) {
    if (name !== "wall") continue;
    const colour = mesh.geometry.attributes.color, u = mesh.geometry.attributes[`mode${state.mode}`].array;
    for (let i = 0; i < u.length; i += 3) shade("displacement", Math.hypot(u[i], u[i + 1], u[i + 2])).toArray(colour.array, i);
    colour.needsUpdate = true;
  }
}

function pose() {
  const { cell } = shown;
  const gain = state.amplitude * cell.scale * Math.sin(2 * Math.PI * passedShare());
  for (const { name, mesh, still, lines } of shown.parts) {
    const at = mesh.geometry.attributes, to = at.position, u = at[`mode${state.mode}`].array;
    for (let i = 0; i < still.length; i++) to.array[i] = still[i] + gain * u[i];
    to.needsUpdate = true;
    mesh.geometry.computeVertexNormals();
    if (name === "wall") Object.assign(mesh.material, { opacity: state.opacity });
    if (lines) lines.visible = state.lines;
  }
  stage.viewer.set_dirty();
}

// Frequency of every mode with its error, and how much of it is the nucleus; the dot is the chosen one.
const plots = { hz: new Plot(byId("mode_plots"), "natural frequency [Hz]", "mode", "", { wide: true, whole: true }), nucleus: new Plot(byId("mode_plots"), "nucleus' share of kinetic energy [%]", "mode", "", { whole: true }) };
function spectrum() {
  const { cell } = shown;
  const x = cell.modes.map((_, i) => i + 1), y = cell.modes.map(m => m.hz), known = cell.modes.every(m => m.error !== null);
  const limits = known ? { low: cell.modes.map(m => m.hz * (1 - m.error)), high: cell.modes.map(m => m.hz * (1 + m.error)) } : {};
  plots.hz.set([{ label: "", colour: "#ffb454", x, y, points: true, ...limits }]);
  plots.nucleus.box.hidden = !cell.modes.some(m => m.nucleus_share);
  plots.nucleus.set([{ label: "", colour: NUCLEUS, x, y: cell.modes.map(m => 100 * (m.nucleus_share || 0)), points: true }]);
}
function markMode() {
  const mode = chosen();
  plots.hz.marks([[state.mode, mode.hz, "#ffffff"]]);
  plots.nucleus.marks([[state.mode, 100 * (mode.nucleus_share || 0), "#ffffff"]]);
}

function legend() {
  const { cell } = shown;
  const box = byId("legend"), item = element("div"), bar = element("i");
  bar.style.background = `linear-gradient(90deg, ${RAMPS.displacement.join(", ")})`;
  item.append("displacement of the surface", bar);
  const ends = element("p");
  for (const text of ["0", "largest"]) ends.append(element("span", text));
  item.append(ends);
  box.replaceChildren(item);
  if (!cell.parts.includes("nucleus")) return;
  const inner = element("div"), patch = element("i");
  patch.style.background = NUCLEUS;
  inner.append("nucleus", patch);
  box.append(inner);
}

function tellState() {
  const { cell } = shown;
  const mode = chosen(), error = mode.error === null ? "" : ` ± ${(100 * mode.error).toFixed(2)} %`;
  const share = mode.nucleus_share === null ? "" : `nucleus ${(100 * mode.nucleus_share).toFixed(1)} % of the kinetic energy`;
  tell([cell.title, `mode ${state.mode} of ${cell.modes.length}: ${mode.label}, ${hertz(mode.hz)}${error}`, share, `${number(+state.slow.toPrecision(3))}× slower`]);
  byId("seek").value = passedShare();
  byId("clock").textContent = `${(1e3 * passedShare() * clock.length()).toPrecision(3)} of ${(1e3 * clock.length()).toPrecision(3)} ms`;
}

// Show one share (0 to 1) of the period and draw it now: for pictures and films.
function showAt(share) {
  play(false);
  clock.time = share * clock.length();
  pose();
  tellState();
  stage.render();
}

// ---- drawing --------------------------------------------------------------------------------------------------------
function tick(now) {
  requestAnimationFrame(tick);
  const passed = secondsPassed(now);
  if (!shown.cell || !shown.parts.length) return;
  const started = performance.now();
  if (clock.playing) clock.time += passed / state.slow;
  if (clock.playing || clock.fresh) { pose(); tellState(); }
  clock.fresh = false;
  if (stage.viewer.needs_render) stage.render();
  stats.frames += 1;
  stage.adapt(performance.now() - started, passed * 1000);
}

keys(() => shown.cell, key => {
  const change = { ArrowRight: 1, ArrowDown: 1, ArrowLeft: -1, ArrowUp: -1 }[key];
  if (key === "m") showLines(!state.lines);
  else if (+key >= 1 && +key <= 9) choose(+key);
  else if (change) choose(state.mode + change);
  else return false;
  return true;
});
// The page's one name in the window: what drives it from outside, for films, pictures, measurements and tests.
window.fasbody = { stage, stats, state, clock, plots, shown, showAt, play, choose };
requestAnimationFrame(tick);
start(stage, () => { shown.parts = []; }, ["model"]);
