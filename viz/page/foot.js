// The page: controls from the model's declarations, one request in flight, playing, plots, keys.
"use strict";
const BASE = "#8fa3b8", ANKLE = "#ffb454", OTHER = "#6cb6ff", SEEN = "#7ee0a1";
const stage = new Feet(byId("pane"));
stage.addGround(TABLE - 0.5);
/** @type {State} */
const state = { frequency: 20, peak_to_peak: 17.9, added_mass: 0, values: {}, delay_s: 0, slow: 20, amplify: null };
const stats = { frames: 0, motions: 0, posed: [], drawn: [], seconds: [] };
let /** @type {Model} */ model = null, /** @type {Motion} */ motion = null, drawn = null, asked = 0, request = 0, arrived = false, broken = "";

// ---- controls -------------------------------------------------------------------------------------------------------
/** @type {Record<string, Slider> & { skin?: any, ride?: any, apart?: any }} */
const rows = {};
function buildControls(offered) {
  for (const id of ["excitation", "showing", "parameters"]) for (const old of byId(id).querySelectorAll("label, .row:not(#choosing), p")) old.remove();
  const shaker = byId("excitation"), s = state;
  if (!model.recorded && model.periodic) {
    const held = window.EXPORTED && EXPORTED.live && EXPORTED.live.frequencies, ends = held ? [held[0], held.at(-1)] : [1, 60];
    rows.frequency = slider(shaker, "frequency", "Frequency", "Hz", ...ends, s.frequency, v => { s.frequency = v; ask(); }, { step: 0.5, nominal: model.settings.frequency });
    if (!held) rows.peak = slider(shaker, "peak_to_peak", "Acceleration, peak to peak", "m/s²", 0, 40, s.peak_to_peak, v => { s.peak_to_peak = v; ask(); }, { step: 0.1, nominal: model.settings.peak_to_peak });
  } else {
    const note = document.createElement("p");
    note.textContent = model.excitation;
    shaker.append(note);
  }
  if (model.can_add_mass) rows.mass = slider(shaker, "added_mass", "Mass on the knee", "kg", 0, 10, s.added_mass, v => { s.added_mass = v; ask(); }, { step: 0.1, nominal: model.settings.added_mass });
  const picture = byId("showing");
  rows.slow = slider(picture, "slow", "Slow motion", "× slower", 1, 200, s.slow, v => { s.slow = v; fresh = true; }, { log: true, nominal: model.look.slow });
  rows.amplify = slider(picture, "amplify", "Motion drawn larger", "×", 1, 1000, s.amplify || 10, v => { s.amplify = v; fresh = true; },
    { log: true, hint: "set automatically until you move it" });
  rows.amplify.home = () => { s.amplify = model.look.amplify; fresh = true; };
  rows.amplify.show = best => { rows.amplify.nominal(model.look.amplify || best); rows.amplify.set(s.amplify === null ? best : s.amplify); };
  const looks = rowIn(picture);
  rows.skin = button(looks, "Skin", () => showSkin(!stage.skinShown), "K");
  showSkin(stage.skinShown);
  rows.ride = button(looks, "Ride with the table", () => ride(!stage.riding), "The table is drawn at rest: its motion is subtracted");
  ride(stage.riding);
  themeButton(looks);
  if (SOFTWARE) picture.append(element("p", "No graphics card draws this page: its picture is coarser where that is slow, and while a fit runs fewer pictures are drawn.", { className: "hint" }));
  if (model.feet.b) rows.apart = button(looks, "Side by side", () => apart(!stage.apart));
  if (rows.apart) apart(stage.apart, false);
  takeAwaySection(stage, () => "foot", {
    page: !window.EXPORTED && KEY ? takeAway : null,
    film: () => ({ ...filmPlan(motionLength() * s.slow, firstFoot().periodic), drawAt: showAt }),
    scene: () => ({ keys: KEYS, seconds: motionLength() * s.slow, periodic: firstFoot().periodic, unit: 1 / SCALE,
      pose: share => { time = share * motionLength(); stage.pose(motion, frame(), stage.gain(motion, state.amplify)); } }),
  });
  if (window.EXPORTED && !(EXPORTED.live && EXPORTED.live.twin)) {
    byId("parameters").hidden = true;  // this file holds the motions of one foot
    return;
  }
  const list = byId("parameters");
  for (const p of model.parameters) {
    const value = p.name in s.values ? s.values[p.name] : offered ? p.value : p.nominal;
    if (value !== p.nominal) s.values[p.name] = value;
    rows[p.name] = slider(list, `parameter_${p.name}`, p.words ? `${p.words} ${p.name}` : p.name, p.unit, p.lower, p.upper, value, (v, typed) => {
      remember(typed ? "" : p.name);
      if (v === p.nominal) delete s.values[p.name]; else s.values[p.name] = v;
      ask();
    }, { log: p.logarithmic, nominal: p.nominal, ends: true, hint: `${p.name} [${p.unit}], ${p.lower} to ${p.upper}; ${p.source}`, fitted: fitting(p) });
  }
}
// What a fit may do with a parameter: whether it is free, and between which bounds.
function fitting(p) {
  if (window.EXPORTED || MASSES.has(p.name)) return null;
  return {
    free: bench.free[p.name] !== false, bounds: bench.bounds[p.name] || [p.lower, p.upper],
    release: on => { bench.free[p.name] = on; advise(); },
    bound: (low, high) => { if (low === p.lower && high === p.upper) delete bench.bounds[p.name]; else bench.bounds[p.name] = [low, high]; },
  };
}

// The values before, for undo, and those that were undone: one step for each parameter that is moved.
const past = [], undone = [];
let lastMoved = "";
const valuesNow = () => ({ values: { ...state.values }, delay_s: state.delay_s, branch: bench.branch });
function remember(name = "") {
  if (name && name === lastMoved) return;
  lastMoved = name;
  undone.length = 0;
  past.push(valuesNow());
  if (past.length > 100) past.shift();
}
function undo(from = past, to = undone) {
  const before = from.pop();
  lastMoved = "";
  if (!before) return;
  forgetRemarks();
  to.push(valuesNow());
  const { branch, ...values } = before;
  Object.assign(state, values);
  bench.branch = branch;
  bands();
  for (const p of model.parameters) rows[p.name].set(p.name in state.values ? state.values[p.name] : p.nominal);
  ask();
}
const redo = () => undo(undone, past);
byId("undo").onclick = () => undo();
byId("redo").onclick = redo;
addEventListener("keydown", (/** @type {any} */ event) => {
  const key = event.key.toLowerCase(), again = key === "y" || (key === "z" && event.shiftKey);
  if (!(event.ctrlKey || event.metaKey) || !(again || key === "z") || event.target.closest("#editor, input:not([type=range]), textarea")) return;
  event.preventDefault();
  if (again) redo(); else undo();
});
byId("reset").onclick = () => { forgetRemarks(); remember(); state.values = {}; state.delay_s = 0; for (const p of model.parameters) rows[p.name].set(p.nominal); ask(); };
function forgetRemarks() { for (const p of model.parameters) if (rows[p.name]) rows[p.name].remark(""); }
cameras(stage);

function showSkin(shown) { stage.showSkin(shown); rows.skin.setAttribute("aria-pressed", shown); }
function ride(on) { stage.riding = on; fresh = true; rows.ride.setAttribute("aria-pressed", on); }
function apart(on, look = true) {
  stage.apart = on;
  fresh = true;
  rows.apart.setAttribute("aria-pressed", on);
  if (look) stage.view(stage.viewed);
}
const firstFoot = () => Object.values(motion.feet)[0], motionLength = () => (motion ? firstFoot().duration : 1), stepping = () => (motion ? firstFoot().frames : 1);

// ---- the server -----------------------------------------------------------------------------------------------------
let busy = false, wanted = false, again = 0;
const PATIENT = 1000;  // [ms] after which a newer request takes the place of one that is computed
function ask() {
  if (window.EXPORTED) {
    const answer = motion && liveAnswer();
    if (answer) receive(answer);
    return;
  }
  if (!socket || socket.readyState !== 1) return;
  if (busy && performance.now() - asked < PATIENT) {
    wanted = true;
    clearTimeout(again);
    again = setTimeout(() => { if (wanted) { wanted = false; ask(); } }, PATIENT);
    return;
  }
  busy = true;
  asked = performance.now();
  request += 1;
  keepState();
  const { frequency, peak_to_peak, added_mass, values, delay_s } = state;
  socket.send(JSON.stringify({ type: "simulate", request, frequency, peak_to_peak, added_mass, values, delay_s }));
}

function receive(document_) {
  if (workbenchReceives(document_)) return;
  if (document_.type === "model") {
    const first = model === null, other = first || (document_.name !== model.name && !document_.same);
    let offered = other;
    model = document_;
    motion = null;  // of another model
    if ("draft" in model) markDraft(model.draft);
    stage.setModel(model);
    if (first) { Object.assign(state, model.settings, model.look); offered = !recall(); if (offered && model.fit.branches) openTask("fit"); }
    else if (other) {  // values of the same name are not its own
      Object.assign(state, { values: {}, delay_s: 0 });
      Object.assign(bench, { free: {}, bounds: {} });
      past.length = undone.length = 0;
      forgetFit();
      byId("compared").hidden = byId("tab_rivals").hidden = true;
      if (!byId("rivals_plots").hidden) tab("motion");  // recordings and signals are of any model
    }
    if (!first && model.adopt) { for (const name of ["frequency", "added_mass"]) state[name] = model.settings[name]; }
    const known = new Set(model.parameters.map(p => p.name));
    for (const name of Object.keys(state.values)) if (!known.has(name)) delete state.values[name];
    buildControls(offered);
    showFit(model.fit);
    advise();
    if (bench.plots) drawTrace();
    broken = model.error;
    say([broken, complaints].filter(Boolean).join("\n"));
    busy = false;
    ask();
    setTimeout(() => { if (busy && !motion) tell([model.feet.a.title, model.recorded ? model.excitation : "", "computing the motion"]); }, 300);
  } else if (document_.type === "broken") {  // the model's file: told until it is mended
    broken = document_.text;
    say(broken);
  } else {
    busy = false;
    if (document_.type === "motion") {
      motion = document_;
      fresh = arrived = true;
      stats.motions += 1;
      stats.seconds.push(document_.seconds);
      say([broken, complaints].filter(Boolean).join("\n"));
      hold(motion.held);
      stage.pose(motion, frame(), stage.gain(motion, state.amplify));
      stats.posed.push(performance.now() - asked);
      showOtherValues(motion.other);
    } else {
      say([broken, document_.text, complaints].filter(Boolean).join("\n"));
      if (!motion) showAtRest("no motion to show");
    }
    if (wanted) { wanted = false; ask(); }
  }
}

// Parameters that a bound has stopped: their sliders go there, and a sentence at each says so.
function hold(held) {
  for (const { name, unit } of model.parameters.filter(p => p.name in held)) {
    state.values[name] = held[name];
    rows[name].set(held[name]);
    rows[name].remark(`${name} is held at its bound in the model, ${number(held[name])} ${unit}.`);
  }
}

// What the compared foot has where it differs.
function showOtherValues(other) {
  for (const p of model.parameters) if (rows[p.name]) rows[p.name].beside(p.name in other ? `other foot ${number(other[p.name])}` : "");
}

// Nothing is posed before the scene is whole; a server that was started again does not know what is to be taken away.
function forget() { busy = true; motion = null; stage.feet = {}; stage.viewer.delete_path(["meshcat", "foot"]); }

// There is no motion: the feet at rest, and nothing of an earlier motion beside them.
function showAtRest(sentence) {
  const still = ([name, foot]) => [name, { frames: 1, duration: 1, periodic: true, bodies: foot.bodies.flatMap(() => Array(6).fill(0)), loops: {} }];
  stage.pose({ feet: Object.fromEntries(Object.entries(model.feet).filter(([name]) => name !== "measured").map(still)) }, 0, 1);
  tell([model.feet.a.title, model.recorded ? model.excitation : "", sentence]);
  for (const plot of Object.values(plots)) { plot.none(sentence); plot.marks([]); }
  byId("legend").replaceChildren();
  byId("clock").textContent = "";
}

// ---- drawing --------------------------------------------------------------------------------------------------------
const COLOURS = { b: OTHER, measured: SEEN };
const colourOf = name => COLOURS[name] || ANKLE, seriesName = name => ({ a: "malleolus", b: "other", measured: "measured" })[name];
const plots = {
  traces: new Plot(byId("motion_plots"), "acceleration [m/s²]", "time [ms]", "", { wide: true }),
  curve: new Plot(byId("motion_plots"), "transmissibility", "frequency [Hz]", "", { wide: true }),
  pad: new Plot(byId("motion_plots"), "fat pad, force [N]", "compression [mm]", "", { loop: true }),
  ankle: new Plot(byId("motion_plots"), "ankle, force [N]", "compression [mm]", "", { loop: true }),
};
/** @type {[Plot, string][]} */
const LOOPS = [[plots.pad, "fat pad"], [plots.ankle, "ankle"]];
const frame = () => { const foot = firstFoot(); return passedShare() * (foot.periodic ? foot.frames : foot.frames - 1); };

// A motion's curves; a period ends as it began.
function draw() {
  const feet = Object.entries(motion.feet), first = firstFoot();
  const times = first.base.map((_, k) => 1e3 * first.duration * k / first.frames);
  const whole = v => (first.periodic ? [...v, v[0]] : v), x = first.periodic ? [...times, 1e3 * first.duration] : times;
  const seen = motion.feet.measured && motion.feet.measured.points, worn = wornBranchName();
  const seriesLabel = n => [model.feet.b ? model.feet[n].title : "", n === "a" ? worn : ""].filter(Boolean).join(" · ");
  plots.traces.set([
    { label: "base", colour: BASE, x, y: whole(first.base) },
    ...feet.filter(([n]) => n !== "measured" || !seen).map(([n, f]) => ({ label: n === "a" && worn ? worn : seriesName(n), colour: colourOf(n), x, y: whole(f.malleolus), dashed: n !== "a" })),
    ...(seen ? [{ label: "measured", colour: SEEN, x: seen.time.map(t => 1e3 * t), y: seen.malleolus, points: 3 }] : []),
  ]);
  const curves = feet.filter(([n]) => n !== "measured");
  const dots = feet.filter(([, f]) => f.ratio !== null).map(([n, f]) => ({ label: "", colour: colourOf(n), x: [shownFrequency()], y: [f.ratio], points: 9 }));
  const top = 1.1 * Math.max(1.2, ...curves.map(([, f]) => Math.max(...f.transmissibility)), ...dots.map(d => d.y[0]));
  plots.curve.set([...curves.map(([n, f]) => ({ label: seriesLabel(n), colour: colourOf(n), x: model.curve_hz, y: f.transmissibility })), ...dots], [0, top]);
  for (const [plot, key] of LOOPS) {
    plot.box.hidden = !first.loops[key];
    plot.set(curves.filter(([, f]) => f.loops[key]).map(([n, f]) => ({ label: seriesLabel(n), colour: colourOf(n), x: f.loops[key].x.map(v => -1e3 * v), y: f.loops[key].force.map(v => -v) })));
  }
}
const shownFrequency = () => 1 / firstFoot().duration;

// Where the moment that is shown lies on the curves.
function follow() {
  if (drawn !== motion) { draw(); drawn = motion; }
  const feet = Object.entries(motion.feet), t = 1e3 * passedShare() * motionLength(), at = frame();
  plots.traces.marks([[t, sample(firstFoot().base, firstFoot(), at), BASE], ...feet.map(([n, f]) => [t, sample(f.malleolus, f, at), colourOf(n)])]);
  for (const [plot, key] of LOOPS)
    plot.marks(feet.filter(([, f]) => f.loops[key]).map(([n, f]) => [-1e3 * sample(f.loops[key].x, f, at), -sample(f.loops[key].force, f, at), colourOf(n)]));
}

function legend() {
  const box = byId("legend"), loops = firstFoot().loops;
  box.replaceChildren();
  for (const [title, key, ramp] of [["fascia: change of tension", "fascia", "tension"], ["fat pad: change of compression", "fat pad", "pressure"]]) {
    if (!loops[key]) continue;
    const top = largest(motion, key).toPrecision(3), item = document.createElement("div"), bar = document.createElement("i");
    bar.style.background = `linear-gradient(90deg, ${RAMPS[ramp].join(", ")})`;
    const [part, change] = title.split(":");
    item.append(part, element("span", `:${change}`), bar);
    item.title = title;
    const ends = document.createElement("p");
    for (const textContent of [`−${top} N`, "0", `+${top} N`]) ends.append(Object.assign(document.createElement("span"), { textContent }));
    item.append(ends);
    box.append(item);
  }
}

const behind = degrees => `${Math.abs(degrees).toFixed(0)}° ${degrees > 0 ? "ahead of" : "behind"} the base`;
function tellState() {
  const foot = firstFoot(), seen = motion.feet.measured, gain = stage.gain(motion, state.amplify);
  const capped = state.amplify !== null && gain < 0.999 * state.amplify ? ", as much as fits" : "";
  const shown = `drawn ${gain.toPrecision(3)}× larger${capped}${stage.riding ? ", relative to the table" : ""}, ${state.slow.toPrecision(3)}× slower`;
  const also = value => (seen && seen.ratio !== null ? ` (measured ${value(seen)})` : "");
  const numbers = foot.ratio === null ? [foot.periodic ? "the table is at rest" : ""] : [
    `transmissibility ${foot.ratio.toFixed(3)}${also(f => f.ratio.toFixed(3))}`,
    `malleolus ${behind(foot.phase)}${also(f => `${Math.abs(f.phase).toFixed(0)}°`)}`];
  const fit = seen && seen.fit_percent !== null ? `fit with these values ${seen.fit_percent.toFixed(1)} %` : "";
  const base = foot.periodic && !model.recorded ? `${number(state.frequency)} Hz` : model.excitation;
  tell([`${model.feet.a.title}${bench.draft ? " (draft, not saved)" : ""}, ${base}`, ...numbers, fit, model.about, shown]);
}

// Show one share (0 to 1) of the motion and draw it now: for pictures and films.
function showAt(share) {
  play(false);
  time = share * motionLength();
  stage.pose(motion, frame(), stage.gain(motion, state.amplify));
  follow();
  stage.render();
}

// Where the processor draws, a running fit needs it more, and only a few pictures are drawn [ms between two].
const CALM = 250, SOFTWARE = !stage.blind && drawnBySoftware(stage.renderer.getContext());
let painted = 0;
function drawnBySoftware(gl) {
  const about = gl.getExtension("WEBGL_debug_renderer_info");
  return /swiftshader|llvmpipe|softpipe|software|basic render/i.test(String(gl.getParameter(about ? about.UNMASKED_RENDERER_WEBGL : gl.RENDERER)));
}

function tick(now) {
  requestAnimationFrame(tick);
  const passed = Math.min(0.1, (now - last) / 1000);
  last = now;
  if (motion && model && playing) time += passed / state.slow;
  if (motion && model && !(SOFTWARE && bench.fitBegan && !fresh && now - painted < CALM)) {
    painted = now;
    const started = performance.now();
    if (playing || fresh || stage.viewer.needs_render) {
      stage.pose(motion, frame(), stage.gain(motion, state.amplify));
      if (fresh) { legend(); tellState(); rows.amplify.show(stage.gain(motion, null)); }
      follow();
      byId("seek").value = frame() / firstFoot().frames;
      byId("clock").textContent = `${(1e3 * (((time % motionLength()) + motionLength()) % motionLength())).toFixed(1)} of ${(1e3 * motionLength()).toFixed(1)} ms`;
    }
    if (stage.viewer.needs_render) stage.render();
    fresh = false;
    if (arrived && !stage.blind) {  // reading a pixel waits for the picture
      const gl = stage.renderer.getContext();
      gl.readPixels(0, 0, 1, 1, gl.RGBA, gl.UNSIGNED_BYTE, new Uint8Array(4));
      stats.drawn.push(performance.now() - asked);
      arrived = false;
    }
    stats.frames += 1;
    stage.adapt(performance.now() - started, passed * 1000);
  } else if (model && !motion && !busy && stage.viewer.needs_render) stage.render();
}

keys(() => motion, key => {
  const change = { ArrowRight: 0.5, ArrowLeft: -0.5, ArrowUp: 5, ArrowDown: -5 }[key], views = Object.keys(VIEWS);
  if (key === "k") showSkin(!stage.skinShown);
  else if (+key >= 1 && +key <= views.length) stage.view(views[+key - 1]);
  else if (change && !model.recorded && model.periodic && rows.frequency) {
    state.frequency = Math.min(60, Math.max(1, state.frequency + change));
    rows.frequency.set(state.frequency);
    ask();
  } else return false;
  return true;
});
Object.assign(window, { stage, stats, state, showAt, play });
