// A motion between its frames: poses of bodies, samples of forces, and their largest.
import { THREE } from "./three.js";

/** @param {number[]} pose */
export function vector(pose) { return new THREE.Vector3(pose[0], pose[1], pose[2]); }
/** @param {number[]} pose */
export function quaternion(pose) { return new THREE.Quaternion(pose[4], pose[5], pose[6], pose[3]); }

/** @type {(shown: FootMotion, at: number, body: number) => number[]} displacement and rotation vector of one body between two frames */
export function blend(shown, at, body) {
  const n = shown.frames, width = shown.bodies.length / n, k = Math.floor(at) % n, u = at - Math.floor(at);
  const next = shown.periodic ? (k + 1) % n : Math.min(k + 1, n - 1), out = [];
  for (let j = 0; j < 6; j++) {
    const a = shown.bodies[k * width + 6 * body + j], b = shown.bodies[next * width + 6 * body + j];
    out.push(a + (b - a) * u);
  }
  return out;
}

/** @type {(values: number[], shown: FootMotion, at: number) => number} one value of a loop between two frames */
export function sample(values, shown, at) {
  const n = shown.frames, k = Math.floor(at) % n, u = at - Math.floor(at), next = shown.periodic ? (k + 1) % n : Math.min(k + 1, n - 1);
  return values[k] + (values[next] - values[k]) * u;
}

/** @type {(motion: Motion, loop: string) => number} largest change of a loop's force in any foot */
export function largest(motion, loop) {
  if (!motion.tops) motion.tops = {};
  if (!(loop in motion.tops)) {
    const forces = Object.values(motion.feet).flatMap(f => (f.loops[loop] ? f.loops[loop].force : []));
    motion.tops[loop] = forces.reduce((m, v) => Math.max(m, Math.abs(v)), 0);
  }
  return motion.tops[loop];
}
