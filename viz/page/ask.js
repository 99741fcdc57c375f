// Motions: one request in flight, and what is done with the answer.
import { EXPORTED } from "./exported.js";
import { liveAnswer } from "./live.js";
import { number } from "./numbers.js";
import { forgetFeet, showAtRest, showMotion, tellTitle } from "./picture.js";
import { page, state, stats } from "./store.js";
import { isConnected, on, receive, send } from "./stream.js";

const PATIENT = 1000;  // [ms] after which a newer request takes the place of one that is computed
const WAITING = 300;  // [ms] after which the page says that it waits
let asked = 0, request = 0, again = 0;

export function ask() {
  if (EXPORTED) {
    const answer = page.motion && liveAnswer();
    if (answer) receive(answer);
    return;
  }
  if (!isConnected()) return;
  if (page.busy && performance.now() - asked < PATIENT) {
    page.wanted = true;
    clearTimeout(again);
    again = setTimeout(askWanted, PATIENT);
    return;
  }
  page.busy = true;
  asked = performance.now();
  request += 1;
  send({ type: "simulate", request, ...settings() });
}
function askWanted() { if (page.wanted) { page.wanted = false; ask(); } }

// What the server needs to know for a motion.
export function settings() {
  const { frequency, peak_to_peak, added_mass, values, delay_s } = state;
  return { frequency, peak_to_peak, added_mass, values, delay_s };
}

// Of another model: what was asked for before is of no use.
export function askAnew() {
  Object.assign(page, { problem: "", busy: false });
  ask();
  setTimeout(() => { if (page.busy && !page.motion) tellTitle("computing the motion"); }, WAITING);
}

// A server that was started again does not know what is to be taken away.
export function forget() {
  Object.assign(page, { busy: true, motion: null });
  forgetFeet();
}

on("motion", motion => {
  Object.assign(page, { busy: false, motion, problem: "" });
  stats.motions += 1;
  stats.seconds.push(motion.seconds);
  hold(motion.held);
  showMotion(asked);
  showOtherValues(motion.other);
  askWanted();
});
on("error", ({ text }) => {
  Object.assign(page, { busy: false, problem: text });
  if (!page.motion) showAtRest("no motion to show");
  askWanted();
});

/** @param {Record<string, number>} held parameters that a bound has stopped: their sliders go there, and a sentence at each says so */
function hold(held) {
  if (Object.keys(held).length) state.values = { ...state.values, ...held };
  for (const { name, unit } of page.model.parameters.filter(p => p.name in held)) {
    page.sliders[name].set(held[name]);
    page.sliders[name].remark(`${name} is held at its bound in the model, ${number(held[name])} ${unit}.`);
  }
}

/** @param {Record<string, number>} other what the compared foot has where it differs */
function showOtherValues(other) {
  for (const { name } of page.model.parameters) page.sliders[name]?.beside(name in other ? `other foot ${number(other[name])}` : "");
}
