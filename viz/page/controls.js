// The sliders and buttons of a model: shaker, picture, parameters.
import { KEY } from "./address.js";
import { ask } from "./ask.js";
import { button, byId, element, rowIn } from "./dom.js";
import { EXPORTED } from "./exported.js";
import { SCALE } from "./feet.js";
import { hasTwin } from "./live.js";
import { takeAway } from "./made.js";
import { SOFTWARE, pose, showAt, stage } from "./picture.js";
import { clock } from "./playback.js";
import { slider } from "./slider.js";
import { bench, firstFoot, isMass, page, state } from "./store.js";
import { KEYS, filmPlan, takeAwaySection } from "./take.js";
import { themeButton } from "./theme.js";
import { remember, setValues } from "./values.js";

/** @type {Record<string, any>} buttons that stay pressed */
const switches = {};
/** @param {boolean} offered the model's values are taken */
export function buildControls(offered) {
  for (const id of ["excitation", "showing", "parameters"]) for (const old of byId(id).querySelectorAll("label, .row:not(#choosing), p")) old.remove();
  page.sliders = { ...shakerSliders(byId("excitation")), ...pictureSliders(byId("showing")), ...parameterSliders(byId("parameters"), offered) };
}

/** @type {(shaker: HTMLElement) => Record<string, Slider>} */
function shakerSliders(shaker) {
  const { model } = page, { settings } = model, /** @type {Record<string, Slider>} */ made = {};
  const moved = (/** @type {"frequency" | "peak_to_peak" | "added_mass"} */ name) => (/** @type {number} */ v) => { state[name] = v; ask(); };
  if (!model.recorded && model.periodic) {
    const held = EXPORTED && EXPORTED.live && EXPORTED.live.frequencies, ends = held ? [held[0], held.at(-1)] : [1, 60];
    made.frequency = slider(shaker, "frequency", "Frequency", "Hz", ends[0], ends[1], state.frequency, moved("frequency"), { step: 0.5, nominal: settings.frequency });
    if (!held) made.peak = slider(shaker, "peak_to_peak", "Acceleration, peak to peak", "m/s²", 0, 40, state.peak_to_peak, moved("peak_to_peak"), { step: 0.1, nominal: settings.peak_to_peak });
  } else shaker.append(element("p", model.excitation));
  if (model.can_add_mass) made.mass = slider(shaker, "added_mass", "Mass on the knee", "kg", 0, 10, state.added_mass, moved("added_mass"), { step: 0.1, nominal: settings.added_mass });
  return made;
}

/** @type {(picture: HTMLElement) => Record<string, Slider>} */
function pictureSliders(picture) {
  const { look, feet } = page.model;
  const slow = slider(picture, "slow", "Slow motion", "× slower", 1, 200, state.slow, (/** @type {number} */ v) => { state.slow = v; clock.fresh = true; }, { log: true, nominal: look.slow });
  const amplify = slider(picture, "amplify", "Motion drawn larger", "×", 1, 1000, state.amplify || 10, (/** @type {number} */ v) => { state.amplify = v; clock.fresh = true; },
    { log: true, hint: "set automatically until you move it" });
  amplify.home = () => { state.amplify = look.amplify; clock.fresh = true; };
  amplify.show = best => { amplify.nominal(look.amplify || best); amplify.set(state.amplify === null ? best : state.amplify); };
  const looks = rowIn(picture);
  switches.skin = button(looks, "Skin", () => showSkin(!stage.skinShown), "K");
  showSkin(stage.skinShown);
  switches.ride = button(looks, "Ride with the table", () => ride(!stage.riding), "The table is drawn at rest: its motion is subtracted");
  ride(stage.riding);
  themeButton(looks);
  if (SOFTWARE) picture.append(element("p", "No graphics card draws this page: its picture is coarser where that is slow, and while a fit runs fewer pictures are drawn.", { className: "hint" }));
  if (feet.b) {
    switches.apart = button(looks, "Side by side", () => apart(!stage.apart));
    apart(stage.apart, false);
  }
  const duration = () => clock.length() * state.slow;
  takeAwaySection(stage, () => "foot", {
    page: !EXPORTED && KEY ? takeAway : null,
    film: () => ({ ...filmPlan(duration(), firstFoot().periodic), drawAt: showAt }),
    scene: () => ({ keys: KEYS, seconds: duration(), periodic: firstFoot().periodic, unit: 1 / SCALE, pose: (/** @type {number} */ share) => { clock.time = share * clock.length(); pose(); } }),
  });
  return { slow, amplify };
}

/** @type {(list: HTMLElement, offered: boolean) => Record<string, Slider>} */
function parameterSliders(list, offered) {
  list.hidden = Boolean(EXPORTED) && !hasTwin;  // such a file holds the motions of one foot
  if (list.hidden) return {};
  const { parameters } = page.model;
  if (offered) setValues(Object.fromEntries(parameters.filter(p => !(p.name in state.values)).map(p => [p.name, p.value])));
  return Object.fromEntries(parameters.map(p => [p.name, slider(list, `parameter_${p.name}`, p.words ? `${p.words} ${p.name}` : p.name, p.unit, p.lower, p.upper, state.values[p.name] ?? p.nominal, (/** @type {number} */ v, /** @type {boolean | undefined} */ typed) => {
    remember(typed ? "" : p.name);
    setValues({ [p.name]: v });
    ask();
  }, { log: p.logarithmic, nominal: p.nominal, ends: true, hint: `${p.name} [${p.unit}], ${p.lower} to ${p.upper}; ${p.source}`, fitted: fitting(p) })]));
}

/** @param {Parameter} p what a fit may do with it: whether it is free, and between which bounds */
function fitting(p) {
  if (EXPORTED || isMass(p.name)) return null;
  return {
    free: bench.free[p.name] !== false, bounds: bench.bounds[p.name] || [p.lower, p.upper],
    release: (/** @type {boolean} */ on) => { bench.free = { ...bench.free, [p.name]: on }; },
    bound: (/** @type {number} */ low, /** @type {number} */ high) => {
      const { [p.name]: _, ...others } = bench.bounds;
      bench.bounds = low === p.lower && high === p.upper ? others : { ...others, [p.name]: [low, high] };
    },
  };
}

/** @param {boolean} shown */
export function showSkin(shown) { stage.showSkin(shown); switches.skin.setAttribute("aria-pressed", shown); }
/** @param {boolean} on */
export function ride(on) { stage.riding = on; clock.fresh = true; switches.ride.setAttribute("aria-pressed", on); }
/** @param {boolean} on */
export function apart(on, look = true) {
  stage.apart = on;
  clock.fresh = true;
  switches.apart.setAttribute("aria-pressed", on);
  if (look) stage.view(stage.viewed);
}
