// What an exported page answers itself.
import { EXPORTED } from "./exported.js";
import { page, state } from "./store.js";
import { inflated } from "./stream.js";
import { twinAnswer } from "./twin.js";

/** @type {Motion[] | null} */
let grid = null;
// Whether a file holds what moves its parameters; else it has the motions of one foot.
export const hasTwin = Boolean(EXPORTED && EXPORTED.live && EXPORTED.live.twin);

// The next motion: computed here, or the nearest of those that the file holds; null where neither can be.
export function liveAnswer() {
  const { live } = EXPORTED;
  if (!live) return null;
  if (live.twin) return twinAnswer({ ...live.twin, curve_hz: page.model.curve_hz }, state, page.motion && page.motion.feet.measured);
  if (!grid) return null;
  const near = (/** @type {number[]} */ list, /** @type {number} */ v) => list.reduce((best, x, k) => (Math.abs(x - v) < Math.abs(list[best] - v) ? k : best), 0);
  const i = near(live.frequencies, state.frequency), j = near(live.loads, state.added_mass);
  Object.assign(state, { frequency: live.frequencies[i], added_mass: live.loads[j] });
  return grid[j * live.frequencies.length + i];
}

export async function unpackGrid() {
  const { live } = EXPORTED;
  if (live && live.grid) grid = JSON.parse(new TextDecoder().decode(await inflated(live.grid)));
}
