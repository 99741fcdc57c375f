// The page: controls from the model's declarations, one request in flight, playing, plots, keys.
"use strict";
const BASE = "#8fa3b8", ANKLE = "#ffb454", OTHER = "#6cb6ff", SEEN = "#7ee0a1";
const stage = new Stage(byId("pane"), VIEWS);
stage.addGround(TABLE - 0.5);
const state = { frequency: 20, peak_to_peak: 17.9, added_mass: 0, values: {}, slow: 20, amplify: 10 };
const stats = { frames: 0, motions: 0, posed: [], drawn: [], seconds: [] };
let model = null, motion = null, playing = true, time = 0, last = 0, asked = 0, request = 0, fresh = false, broken = "";

// ---- controls -------------------------------------------------------------------------------------------------------
const rows = {};
function buildControls() {
  for (const id of ["excitation", "showing", "parameters"]) for (const old of byId(id).querySelectorAll("label, .row, p")) old.remove();
  const shaker = byId("excitation"), s = state;
  if (model.periodic) {
    rows.frequency = slider(shaker, "frequency", "Frequency", "Hz", 1, 60, s.frequency, v => { s.frequency = v; ask(); }, { step: 0.5 });
    rows.peak = slider(shaker, "peak_to_peak", "Acceleration, peak to peak", "m/s²", 0, 40, s.peak_to_peak, v => { s.peak_to_peak = v; ask(); }, { step: 0.1 });
  } else {
    const note = document.createElement("p");
    note.textContent = model.excitation;
    shaker.append(note);
  }
  if (model.can_add_mass) rows.mass = slider(shaker, "added_mass", "Mass on the knee", "kg", 0, 10, s.added_mass, v => { s.added_mass = v; ask(); }, { step: 0.1 });
  const picture = byId("showing");
  rows.slow = slider(picture, "slow", "Slow motion", "× slower", 1, 200, s.slow, v => { s.slow = v; }, { log: true });
  rows.amplify = slider(picture, "amplify", "Motion shown larger", "×", 1, 100, s.amplify, v => { s.amplify = v; }, { log: true });
  const posture = document.createElement("label");
  posture.innerHTML = "<span>Posture <small>(picture only)</small></span><select id=posture><option value=0>midstance</option>" +
    "<option value=-10>plantarflexion 10°</option><option value=10>dorsiflexion 10°</option></select>";
  posture.title = "The models know no posture: the measurements of the thesis show its effect at 10 Hz only.";
  posture.querySelector("select").value = String(stage.posture);
  posture.querySelector("select").onchange = e => { stage.posture = +e.target.value; };
  picture.append(posture);
  const looks = rowIn(picture);
  rows.skin = button(looks, "Skin", () => showSkin(!stage.skinShown), "K");
  showSkin(stage.skinShown);
  rows.ride = button(looks, "Ride with the table", () => ride(!stage.riding), "The table is drawn at rest: its motion is taken from everything");
  ride(stage.riding);
  if (Object.keys(model.feet).length > 1) button(looks, "Side by side", b => { stage.apart = !stage.apart; b.textContent = stage.apart ? "Overlaid" : "Side by side"; });
  button(looks, "Save PNG", () => stage.save("foot.png"));
  const list = byId("parameters");
  for (const p of model.parameters) {
    const value = p.name in s.values ? s.values[p.name] : p.value;
    if (value !== p.nominal) s.values[p.name] = value;
    rows[p.name] = slider(list, `parameter_${p.name}`, p.name, p.unit, p.lower, p.upper, value, (v, row) => {
      s.values[p.name] = v;
      row.classList.add("changed");
      ask();
    }, { log: p.logarithmic, hint: `${p.name} [${p.unit}], ${p.lower} to ${p.upper}; ${p.source}` });
    rows[p.name].classList.toggle("changed", value !== p.nominal);
  }
}
byId("reset").onclick = () => { state.values = {}; for (const p of model.parameters) { rows[p.name].set(p.nominal); rows[p.name].classList.remove("changed"); } ask(); };

for (const name of Object.keys(VIEWS)) button(byId("cameras"), name, () => stage.view(name), `camera: ${name}`);
byId("play").onclick = () => play(!playing);
byId("step").onclick = () => stepOn(1);
byId("seek").oninput = e => { play(false); time = +e.target.value * length(); };
function play(on) { playing = on; byId("play").textContent = on ? "Pause" : "Play"; }
function showSkin(shown) { stage.showSkin(shown); rows.skin.setAttribute("aria-pressed", shown); }
function ride(on) { stage.riding = on; fresh = true; rows.ride.setAttribute("aria-pressed", on); }
function stepOn(n) { play(false); time += n * length() / lead().frames; }
const lead = () => Object.values(motion.feet)[0], length = () => (motion ? lead().duration : 1);

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
    busy = false;
    ask();
  } else if (document_.type === "broken") {  // the model's file: told until it is mended
    broken = document_.text;
    say(broken);
  } else {
    busy = false;
    if (document_.type === "motion") {
      motion = document_;
      fresh = true;
      stats.motions += 1;
      stats.seconds.push(document_.seconds);
      say(broken);
      stage.pose(motion, frame(), stage.gain(motion, state.amplify));
      stats.posed.push(performance.now() - asked);
    } else say([broken, document_.text].filter(Boolean).join("\n"));
    if (wanted) { wanted = false; ask(); }
  }
}

// Nothing is posed before the scene is whole.
function forget() { busy = true; motion = null; stage.feet = {}; }

async function start() {
  if (QUALITY === "low" || QUALITY === "none") stage.setQuality(0);
  const own = window.EXPORTED;
  if (!own) { connect(stage, forget, receive); return; }
  document.body.classList.add("exported");
  await unpack(stage, own.scene);
  receive(own.model);
  for (const input of document.querySelectorAll("#excitation input, #parameters input")) input.disabled = true;
  receive(own.motion);
}

// ---- drawing --------------------------------------------------------------------------------------------------------
const plots = { traces: canvas("traces", true), curve: canvas("curve", true), pad: canvas("pad_loop"), ankle: canvas("ankle_loop") };
const frame = () => { const foot = lead(); return (((time / foot.duration) % 1) + 1) % 1 * (foot.periodic ? foot.frames : foot.frames - 1); };

function draw() {
  const feet = Object.entries(motion.feet), first = lead(), at = frame() / first.frames;
  const colour = name => ({ b: OTHER, measured: SEEN })[name] || ANKLE;
  const label = name => ({ b: "other", measured: "measured" })[name] || "malleolus";
  plotTraces(plots.traces, "acceleration [m/s²]", first.duration,
    [["base", BASE, first.base], ...feet.map(([n, f]) => [label(n), colour(n), f.malleolus, n !== "a"])], at);
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
  for (const [title, key, ramp, sign] of [["fascia: tension", "fascia", "tension", 1], ["fat pad: compression", "fat pad", "pressure", -1]]) {
    if (!loops[key]) continue;
    const top = Math.max(...loops[key].force.map(Math.abs)), item = document.createElement("div"), bar = document.createElement("i");
    bar.style.background = `linear-gradient(90deg, ${RAMPS[ramp].join(", ")})`;
    item.append(title, bar);
    for (const v of [-top, top]) { const s = document.createElement("span"); s.textContent = `${v > 0 ? "+" : "−"}${Math.abs(v).toPrecision(3)} N`; item.append(s); }
    box.append(item);
  }
}

function report() {
  const foot = lead(), gain = stage.gain(motion, state.amplify);
  const shown = `shown ${gain.toPrecision(3)}× larger${gain < 0.999 * state.amplify ? " (as much as fits)" : ""}, ${state.slow.toPrecision(3)}× slower`;
  const ratio = foot.ratio === null ? model.excitation : `${state.frequency} Hz, transmissibility ${foot.ratio.toFixed(2)}, phase ${foot.phase.toFixed(0)}°`;
  byId("state").textContent = `${model.feet.a.title} · ${ratio} · ${shown}`;
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
    if (fresh) {  // reading a pixel waits for the picture
      const gl = stage.renderer.getContext();
      gl.readPixels(0, 0, 1, 1, gl.RGBA, gl.UNSIGNED_BYTE, new Uint8Array(4));
      stats.drawn.push(performance.now() - asked);
      fresh = false;
    }
    stats.frames += 1;
    stage.adapt(performance.now() - started, passed * 1000);
  }
}

addEventListener("keydown", event => {
  if (event.target.matches("input, select, textarea") && event.key !== " ") return;
  if (event.ctrlKey || event.metaKey || event.altKey || !motion) return;
  const change = { ArrowRight: 0.5, ArrowLeft: -0.5, ArrowUp: 5, ArrowDown: -5 }[event.key], views = Object.keys(VIEWS);
  if (event.key === " ") { if (event.target.matches("button")) return; play(!playing); }
  else if (event.key === ".") stepOn(1);
  else if (event.key === ",") stepOn(-1);
  else if (event.key === "k") showSkin(!stage.skinShown);
  else if (+event.key >= 1 && +event.key <= views.length) stage.view(views[+event.key - 1]);
  else if (change && model.periodic && rows.frequency && !window.EXPORTED) {
    state.frequency = Math.min(60, Math.max(1, state.frequency + change));
    rows.frequency.set(state.frequency);
    ask();
  } else return;
  event.preventDefault();
});
Object.assign(window, { stage, stats, state, showAt, play });
requestAnimationFrame(tick);
start();
