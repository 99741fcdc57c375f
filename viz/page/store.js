// What the foot's page knows. Whoever shows a field reads it in an `effect`, so that nobody has to ask for a redraw.
import { store } from "./reactive.js";

/** @type {State} */
export const state = store({ frequency: 20, peak_to_peak: 17.9, added_mass: 0, values: {}, delay_s: 0, slow: 20, amplify: null });

/** @type {Page} */
export const page = store({
  model: /** @type {any} */ (null), motion: /** @type {any} */ (null), sliders: {},  // null until the server sends them
  busy: false, wanted: false,  // a motion is computed, and another one is to be asked for then
  broken: "", problem: "", complaint: "",  // of the model's file; of the last motion; of what was asked for
  task: "model", strip: "motion",  // what is open beside the foot, and below it
});

/** @type {Bench} */
export const bench = store({
  // Recordings: as the server lists them, by ids that the session gives once; the one that drives the table, -1 for none.
  session: "", rows: [], shown: -1, lost: false, stale: "", undo: [0, 0],
  // Ids that are ticked, those whose tick was taken away before a reload, and of each whether it could be fitted.
  chosen: new Set(), unticked: new Set(), fittable: new Map(),
  count: 0, unread: 0,  // recordings listed before, and those that are still to be read
  // The fit: its words and branches as the report has them, the server's document with its curves, and its number.
  fit: null, found: null, fitNumber: 0, branch: 0,
  history: [], rivals: null,
  free: {}, bounds: {},  // what the next fit may change, by parameter
  asked: 0, fitBegan: 0,  // when Fit was pressed, and when the running one began; 0 while none runs [ms]
  running: false, draft: false,  // a fit runs; the model that is shown is not saved
});

// Counts and times [ms] of this page, for whoever measures it.
/** @type {{ frames: number, motions: number, posed: number[], drawn: number[], seconds: (number | undefined)[], fitted: number }} */
export const stats = { frames: 0, motions: 0, posed: [], drawn: [], seconds: [], fitted: 0 };

// Parameters that no fit changes.
const MASSES = new Set(["m_S", "m_F", "m_T", "added_mass"]);
/** @type {(name: string) => boolean} */
export const isMass = name => MASSES.has(name);

export const ticked = () => [...bench.chosen].sort((a, b) => a - b);
/** @type {(row: Row) => boolean} */
export const isReadable = row => !row.unread && !row.problem;
/** @type {(row: Row) => boolean} */
export const isSound = row => isReadable(row) && !row.doubt;

/** @type {(name: string) => number} */
export function valueOf(name) { return state.values[name] ?? parameterOf(name)?.nominal; }
/** @type {(name: string) => Parameter | undefined} */
export function parameterOf(name) { return page.model.parameters.find(p => p.name === name); }

// The branch that is shown; the likelier one until another is chosen.
export function shownBranch() { return bench.fit ? bench.fit.branches[bench.branch] || bench.fit.branches[0] : null; }
// Its name, where there are two; and only while the foot has its constants, no slider was moved.
export function branchNote() { return bench.fit && bench.fit.branches.length > 1 ? /** @type {Branch} */ (shownBranch()).name : ""; }
export function wornBranchName() {
  const branch = bench.fit && bench.fit.branches.length > 1 ? bench.fit.branches[bench.branch] : null;
  return branch && Object.entries(branch.values).every(([name, v]) => valueOf(name) === v) ? branch.name : "";
}

// The foot whose motion the clock follows.
export const firstFoot = () => Object.values(page.motion.feet)[0];
