// Time in slow motion: play, pause, step, seek, and the keys of every page.
import { byId } from "./dom.js";

// `length` of the motion [s] and `steps` in it are the page's; `fresh`: draw also while nothing plays.
export const clock = { playing: true, time: 0, last: 0, fresh: false, length: () => 1, steps: () => 1 };
export const passedShare = () => ((clock.time / clock.length()) % 1 + 1) % 1;

/** @param {boolean} on */
export function play(on) { clock.playing = on; byId("play").textContent = on ? "Pause" : "Play"; }

/** @param {number} share of the motion; the next picture is drawn there */
export function seek(share) { play(false); clock.time = share * clock.length(); clock.fresh = true; }

/** @param {number} n */
function stepOn(n) { play(false); clock.time += n * clock.length() / clock.steps(); clock.fresh = true; }

// Seconds since the last picture, a tenth at the most: a computer that stood still leaves no hole in the motion.
export function secondsPassed(now = 0) {
  const passed = Math.min(0.1, (now - clock.last) / 1000);
  clock.last = now;
  return passed;
}
byId("play").onclick = () => play(!clock.playing);
byId("step").onclick = () => stepOn(1);
byId("seek").oninput = (/** @type {any} */ event) => seek(+event.target.value);
if (matchMedia("(prefers-reduced-motion: reduce)").matches) play(false);

// What a slider that has the focus keeps for itself.
const MOVES = new Set(["ArrowLeft", "ArrowRight", "ArrowUp", "ArrowDown", "Home", "End", "PageUp", "PageDown"]);

/**
 * `own(key)` says whether the page takes another key. Nothing is taken from a field or a shortcut.
 * @type {(ready: () => any, own: (key: string) => boolean) => void}
 */
export function keys(ready, own) {
  addEventListener("keydown", (/** @type {any} */ event) => {
    if (event.target.matches("select, textarea, input:not([type=range])")) return;
    if (event.target.matches("input") && MOVES.has(event.key)) return;
    if (event.ctrlKey || event.metaKey || event.altKey || !ready()) return;
    if (event.key === " ") { if (event.target.matches("button")) return; play(!clock.playing); }
    else if (event.key === ".") stepOn(1);
    else if (event.key === ",") stepOn(-1);
    else if (!own(event.key)) return;
    event.preventDefault();
  });
}
