// The page: controls from the model's declarations, one request in flight, playing, plots, keys.
"use strict";
const BASE = "#8fa3b8", ANKLE = "#ffb454", OTHER = "#6cb6ff", SEEN = "#7ee0a1";
const stage = new Feet(byId("pane"));
stage.addGround(TABLE - 0.5);
const state = { frequency: 20, peak_to_peak: 17.9, added_mass: 0, values: {}, slow: 20, amplify: 10 };
const stats = { frames: 0, motions: 0, posed: [], drawn: [], seconds: [] };
let model = null, motion = null, asked = 0, request = 0, arrived = false, broken = "";

// ---- controls -------------------------------------------------------------------------------------------------------
const rows = {};
function buildControls() {
  for (const id of ["excitation", "showing", "parameters"]) for (const old of byId(id).querySelectorAll("label, .row, p")) old.remove();
  const shaker = byId("excitation"), s = state;
  if (model.periodic) {
    rows.frequency = slider(shaker, "frequency", "Frequency", "Hz", 1, 60, s.frequency, v => { s.frequency = v; ask(); }, { step: 0.5, nominal: model.settings.frequency });
    rows.peak = slider(shaker, "peak_to_peak", "Acceleration, peak to peak", "m/s²", 0, 40, s.peak_to_peak, v => { s.peak_to_peak = v; ask(); }, { step: 0.1, nominal: model.settings.peak_to_peak });
  } else {
    const note = document.createElement("p");
    note.textContent = model.excitation;
    shaker.append(note);
  }
  if (model.can_add_mass) rows.mass = slider(shaker, "added_mass", "Mass on the knee", "kg", 0, 10, s.added_mass, v => { s.added_mass = v; ask(); }, { step: 0.1, nominal: model.settings.added_mass });
  const picture = byId("showing");
  rows.slow = slider(picture, "slow", "Slow motion", "× slower", 1, 200, s.slow, v => { s.slow = v; fresh = true; }, { log: true, nominal: model.look.slow });
  rows.amplify = slider(picture, "amplify", "Motion shown larger", "×", 1, 100, s.amplify, v => { s.amplify = v; fresh = true; }, { log: true, nominal: model.look.amplify });
  picture.append(postures());
  const looks = rowIn(picture);
  rows.skin = button(looks, "Skin", () => showSkin(!stage.skinShown), "K");
  showSkin(stage.skinShown);
  rows.ride = button(looks, "Ride with the table", () => ride(!stage.riding), "The table is drawn at rest: its motion is taken from everything");
  ride(stage.riding);
  if (Object.keys(model.feet).length > 1) rows.apart = button(looks, "Side by side", () => apart(!stage.apart));
  if (rows.apart) apart(stage.apart, false);
  button(looks, "Save PNG", () => stage.save("foot.png"));
  const list = byId("parameters");
  for (const p of model.parameters) {
    const value = p.name in s.values ? s.values[p.name] : p.value;
    if (value !== p.nominal) s.values[p.name] = value;
    rows[p.name] = slider(list, `parameter_${p.name}`, p.words ? `${p.words} ${p.name}` : p.name, p.unit, p.lower, p.upper, value, v => {
      if (v === p.nominal) delete s.values[p.name]; else s.values[p.name] = v;
      ask();
    }, { log: p.logarithmic, nominal: p.nominal, ends: true, hint: `${p.name} [${p.unit}], ${p.lower} to ${p.upper}; ${p.source}` });
  }
}
byId("reset").onclick = () => { state.values = {}; for (const p of model.parameters) rows[p.name].set(p.nominal); ask(); };
cameras(stage);

function postures() {
  const label = document.createElement("label");
  label.className = "choose";
  label.innerHTML = "<span>Posture of the picture</span><select id=posture><option value=0>midstance</option>" +
    "<option value=-10>plantarflexion 10°</option><option value=10>dorsiflexion 10°</option></select>" +
    "<small hidden>Turns the picture only. The models know no posture: motion, curves and numbers stay those of midstance.</small>";
  const [, select, note] = label.children, tellIt = () => { note.hidden = !stage.posture; };
  select.value = String(stage.posture);
  select.onchange = () => { stage.posture = +select.value; fresh = true; tellIt(); };
  tellIt();
  return label;
}

function showSkin(shown) { stage.showSkin(shown); rows.skin.setAttribute("aria-pressed", shown); }
function ride(on) { stage.riding = on; fresh = true; rows.ride.setAttribute("aria-pressed", on); }
function apart(on, look = true) {
  stage.apart = on;
  fresh = true;
  rows.apart.setAttribute("aria-pressed", on);
  if (look) stage.view(stage.viewed);
}
const lead = () => Object.values(motion.feet)[0], length = () => (motion ? lead().duration : 1), stepping = () => lead().frames;

// ---- the server -----------------------------------------------------------------------------------------------------
let busy = false, wanted = false;
function ask() {
  if (!socket || socket.readyState !== 1) return;
  if (busy) { wanted = true; return; }
  busy = true;
  asked = performance.now();
  request += 1;
  const { frequency, peak_to_peak, added_mass, values } = state;
  socket.send(JSON.stringify({ type: "simulate", request, frequency, peak_to_peak, added_mass, values }));
}

function receive(document_) {
  if (document_.type === "model") {
    const first = model === null;
    model = document_;
    motion = null;  // of another model
    stage.setModel(model);
    if (first) Object.assign(state, model.settings, model.look);
    const known = new Set(model.parameters.map(p => p.name));
    for (const name of Object.keys(state.values)) if (!known.has(name)) delete state.values[name];
    buildControls();
    broken = model.error;
    say(broken);
    if (window.EXPORTED) for (const input of document.querySelectorAll("#excitation input, #parameters input")) input.disabled = true;
    busy = false;
    ask();
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
      say([broken, stopped(motion.held)].filter(Boolean).join("\n"));
      stage.pose(motion, frame(), stage.gain(motion, state.amplify));
      stats.posed.push(performance.now() - asked);
      besides(motion.other);
    } else say([broken, document_.text].filter(Boolean).join("\n"));
    if (wanted) { wanted = false; ask(); }
  }
}

// Parameters that a bound has stopped: their sliders go there, and a sentence says so.
function stopped(held) {
  const moved = model.parameters.filter(p => p.name in held);
  for (const { name } of moved) { state.values[name] = held[name]; rows[name].set(held[name]); }
  return moved.map(p => `${p.name} is held at the bound that the model declares, ${number(held[p.name])} ${p.unit}.`).join("\n");
}

// What the compared foot has where it differs.
function besides(other) {
  for (const p of model.parameters) rows[p.name].beside(p.name in other ? `other foot ${number(other[p.name])}` : "");
}

// Nothing is posed before the scene is whole.
function forget() { busy = true; motion = null; stage.feet = {}; }

// ---- drawing --------------------------------------------------------------------------------------------------------
const plots = { traces: canvas("traces", true), curve: canvas("curve", true), pad: canvas("pad_loop"), ankle: canvas("ankle_loop") };
const frame = () => { const foot = lead(); return passedShare() * (foot.periodic ? foot.frames : foot.frames - 1); };

function draw() {
  const feet = Object.entries(motion.feet), first = lead(), at = frame() / first.frames;
  const colour = name => ({ b: OTHER, measured: SEEN })[name] || ANKLE;
  const label = name => ({ b: "other", measured: "measured" })[name] || "malleolus";
  plotTraces(plots.traces, "acceleration [m/s²]", first.duration,
    [["base", BASE, first.base], ...feet.map(([n, f]) => [label(n), colour(n), f.malleolus, n !== "a"])], at, first.periodic);
  const curves = feet.filter(([n]) => n !== "measured");
  plotCurve(plots.curve, "transmissibility", model.curve_hz, curves.map(([n, f]) => [model.feet[n].title, colour(n), f.transmissibility]),
    curves.filter(([, f]) => f.ratio !== null).map(([n, f]) => [state.frequency, f.ratio, colour(n)]));
  const loops = key => curves.filter(([, f]) => f.loops[key]).map(([n, f]) => [n, colour(n), f.loops[key].x, f.loops[key].force]);
  plotLoop(plots.pad, "fat pad, force [N]", loops("fat pad"), at);
  plotLoop(plots.ankle, "ankle, force [N]", loops("ankle"), at);
}

function legend() {
  const box = byId("legend"), loops = lead().loops;
  box.replaceChildren();
  for (const [title, key, ramp] of [["fascia: change of tension", "fascia", "tension"], ["fat pad: change of compression", "fat pad", "pressure"]]) {
    if (!loops[key]) continue;
    const top = largest(motion, key).toPrecision(3), item = document.createElement("div"), bar = document.createElement("i");
    bar.style.background = `linear-gradient(90deg, ${RAMPS[ramp].join(", ")})`;
    item.append(title, bar);
    const ends = document.createElement("p");
    for (const textContent of [`−${top} N`, "0", `+${top} N`]) ends.append(Object.assign(document.createElement("span"), { textContent }));
    item.append(ends);
    box.append(item);
  }
}

function report() {
  const foot = lead(), gain = stage.gain(motion, state.amplify);
  const shown = `shown ${gain.toPrecision(3)}× larger${gain < 0.999 * state.amplify ? " (as much as fits)" : ""}, ${state.slow.toPrecision(3)}× slower`;
  const ratio = foot.ratio === null ? (foot.periodic ? "the table is at rest" : "") : `transmissibility ${foot.ratio.toFixed(2)}, phase ${foot.phase.toFixed(0).replace("-", "−")}°`;
  const base = foot.periodic ? `${state.frequency} Hz` : model.excitation;
  tell([`${model.feet.a.title}, ${base}`, ratio, shown, stage.posture ? "posture drawn, not simulated" : ""]);
}

// Show one share (0 to 1) of the motion and draw it now: for pictures and films.
function showAt(share) {
  play(false);
  time = share * length();
  stage.pose(motion, frame(), stage.gain(motion, state.amplify));
  draw();
  stage.render();
}

function tick(now) {
  requestAnimationFrame(tick);
  const passed = Math.min(0.1, (now - last) / 1000);
  last = now;
  if (motion && model) {
    if (playing) time += passed / state.slow;
    const started = performance.now();
    if (playing || fresh || stage.viewer.needs_render || byId("seek").value !== String(time)) {
      stage.pose(motion, frame(), stage.gain(motion, state.amplify));
      draw();
      if (fresh) legend();
      report();
      byId("seek").value = frame() / lead().frames;
      byId("clock").textContent = `${(1e3 * (((time % length()) + length()) % length())).toFixed(1)} of ${(1e3 * length()).toFixed(1)} ms`;
    }
    if (stage.viewer.needs_render) stage.render();
    fresh = false;
    if (arrived) {  // reading a pixel waits for the picture
      const gl = stage.renderer.getContext();
      gl.readPixels(0, 0, 1, 1, gl.RGBA, gl.UNSIGNED_BYTE, new Uint8Array(4));
      stats.drawn.push(performance.now() - asked);
      arrived = false;
    }
    stats.frames += 1;
    stage.adapt(performance.now() - started, passed * 1000);
  }
}

keys(() => motion, key => {
  const change = { ArrowRight: 0.5, ArrowLeft: -0.5, ArrowUp: 5, ArrowDown: -5 }[key], views = Object.keys(VIEWS);
  if (key === "k") showSkin(!stage.skinShown);
  else if (+key >= 1 && +key <= views.length) stage.view(views[+key - 1]);
  else if (change && model.periodic && rows.frequency && !window.EXPORTED) {
    state.frequency = Math.min(60, Math.max(1, state.frequency + change));
    rows.frequency.set(state.frequency);
    ask();
  } else return false;
  return true;
});
Object.assign(window, { stage, stats, state, showAt, play });
requestAnimationFrame(tick);
start(stage, forget, receive, ["model", "motion"]);
