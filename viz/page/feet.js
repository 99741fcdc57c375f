// The feet on the stage, posed from a motion. Lengths in decimetres.
import { blend, largest, quaternion, sample, vector } from "./motion.js";
import { Stage, rim, shade } from "./stage.js";
import { THREE } from "./three.js";

// LARGEST: how far anything may be drawn from rest; SEEN_BEST: how far the largest deformation is drawn unless asked.
// LEVER: what a turn of a bone moves, about [m].
export const SCALE = 10, TABLE = -0.2;
const LARGEST = 0.5, SEEN_BEST = 0.18, LEVER = 0.06;
export const VIEWS = {
  medial: [[0.02, 1.05, 5.8], [0.27, 0.62, 0]], lateral: [[0.45, 1.05, -5.8], [0.27, 0.62, 0]],
  front: [[6.5, 1.87, 1.52], [0.2, 0.48, 0]], above: [[0.3, 5.6, 0.02], [0.3, 0.2, 0]],
  behind: [[-6.0, 1.64, 2.05], [0.1, 0.52, 0]], corner: [[4.05, 2.1, 4.8], [0.24, 0.60, 0]],
};
// What the cameras are made for, lowest and highest place.
const ROOM = [[-1.1, -0.5, -1], [1.7, 1.9, 1]];
// How far apart feet stand side by side, and the width of one foot's table.
const APART = 1.75, WIDTH = 1.5;
// Middle of each pad, along and across.
/** @type {Record<string, number[]>} */
const PADS = { heel_pad: [-0.69, -0.05], forefoot_pad: [0.95, -0.05] };
// Where the aponeurosis begins and ends.
/** @type {Record<string, number[]>} */
const INSERTIONS = { calcaneus_talus: [-0.66, -0.02, 0], metatarsals: [0.98, -0.09, 0] };

/** @typedef {any} Drawn a foot of the model's document, with its nodes and where they are */

export class Feet extends Stage {
  /** @param {HTMLElement} pane */
  constructor(pane) {
    super(pane, VIEWS);
    /** @type {Record<string, Drawn>} */
    this.feet = {};
    this.model = null;
    this.apart = false;
    this.skinShown = true;
    this.riding = true;
  }

  /** @param {string} name legs need room, the camera looks at their middle from further away; and so do two feet side by side, between them */
  view(name) {
    super.view(name);
    this.stepBack();
    const wide = this.apart ? Object.keys(this.feet).filter(f => f !== "measured").length - 1 : 0;
    if (!wide) return;
    const target = this.viewer.controls.target, eye = this.camera.position.sub(target).multiplyScalar(1 + 0.3 * wide);
    target.z -= 0.5 * APART * wide;
    eye.y += 1.3 * wide;  // from the side one would hide the other
    this.camera.position.copy(eye.add(target));
    this.viewer.controls.update();
    this.placed = this.camera.position.clone();
  }

  // Away from what the cameras are made for, so that all that stands on the table is seen.
  stepBack() {
    const boxes = Object.values(this.feet || {}).map(f => f.reach).filter(reach => reach && reach.length);
    const box = [0, 1].map(end => ROOM[end].map((made, i) => (end ? Math.max : Math.min)(made, ...boxes.map(b => SCALE * b[end][i]))));
    const size = (/** @type {number[][]} */ [low, high], /** @type {number} */ i) => high[i] - low[i], further = Math.max(...[0, 1].map(i => size(box, i) / size(ROOM, i)));
    if (further === 1) return;
    const target = this.viewer.controls.target, eye = this.camera.position.sub(target).multiplyScalar(further);
    const [x, y, z] = [0, 1, 2].map(i => 0.5 * (box[0][i] + box[1][i] - ROOM[0][i] - ROOM[1][i]));
    target.add(new THREE.Vector3(x, y, z));
    this.camera.position.copy(eye.add(target));
    this.viewer.controls.update();
    const fog = this.viewer.scene.fog;
    if (fog) Object.assign(fog, { near: further * fog.near, far: further * fog.far });
    this.placed = this.camera.position.clone();
  }

  /** @param {string[]} path */
  node(...path) { return this.viewer.scene_tree.find(["meshcat", "foot", ...path]).object; }

  /** @param {Model} model everything that is kept of the one before is forgotten */
  setModel(model) {
    this.model = model;
    this.feet = {};
    for (const [name, foot] of Object.entries(model.feet)) {
      const part = (/** @type {any} */ s) => ({
        name: s.name, body: s.body, bind: vector(s.bind), rest: vector(s.rest),
        turned: quaternion(s.rest).multiply(quaternion(s.bind).invert()), node: this.node(name, s.name),
      });
      const soft = foot.soft.map((/** @type {string} */ part) => ({ name: part, node: this.node(name, part), mesh: null }));
      this.feet[name] = { ...foot, segments: foot.segments.map(part), worn: foot.worn.map(part), soft };
    }
    this.dress();
    if (!this.placed || this.placed.equals(this.camera.position)) this.view(this.viewed);  // nobody has moved it
  }

  dress() {
    for (const foot of Object.values(this.feet)) for (const part of foot.soft) {
      const mesh = part.node.children[0];
      if (!mesh || !mesh.geometry || mesh === part.mesh) continue;
      const attribute = mesh.geometry.attributes;
      part.mesh = mesh;
      part.still = mesh.userData.still || (mesh.userData.still = attribute.position.array.slice());
      part.weights = attribute.weights.array;
      attribute.position.setUsage(THREE.DynamicDrawUsage);
      if (part.name === "skin") rim(mesh.material, 2.1, 0.10, "1.0, .76, .62");
      if (part.name.endsWith("pad")) rim(mesh.material, 1.5, 0.6, "1.0, .90, .62");
      if (part.name === "skin") mesh.visible = this.skinShown;
    }
  }

  /** @param {boolean} shown */
  showSkin(shown) {
    this.skinShown = shown;
    for (const foot of Object.values(this.feet)) for (const part of foot.soft)
      if (part.name === "skin" && part.mesh) part.mesh.visible = shown;
    this.viewer.set_dirty();
  }

  /** @param {string} name @returns {number} the body whose motion is taken from a foot's, -1 for none */
  table(name) { return this.riding && this.feet[name] ? this.feet[name].table : -1; }

  /** @type {(motion: Motion) => number[]} largest motion of any foot [dm]: of all that is drawn, and of what the table does not carry, turns included */
  travel(motion) {
    if (!motion.travel) motion.travel = {};
    const known = motion.travel[String(this.riding)];
    if (known) return known;
    let drawn = 1e-9, relative = 1e-9;
    for (const [name, foot] of Object.entries(motion.feet)) {
      const width = foot.bodies.length / foot.frames, base = 6 * (this.feet[name] || { table: 0 }).table, b = foot.bodies;
      for (let i = 0; i < b.length; i += 6) {
        const at = i - i % width + base, turn = LEVER * Math.hypot(b[i + 3], b[i + 4], b[i + 5]);
        const own = Math.hypot(b[i] - b[at], b[i + 1] - b[at + 1]) + turn;
        relative = Math.max(relative, own);
        drawn = Math.max(drawn, this.riding ? own : Math.hypot(b[i], b[i + 1]) + turn);
      }
    }
    return (motion.travel[String(this.riding)] = [SCALE * drawn, SCALE * relative]);
  }

  /**
   * How many times larger the motion is drawn: as wanted, or (null) so that the largest deformation is well seen; and
   * never so much that the foot leaves the picture.
   * @type {(motion: Motion, wanted: number | null) => number}
   */
  gain(motion, wanted) {
    const [drawn, relative] = this.travel(motion);
    return Math.min(wanted === null ? SEEN_BEST / relative : wanted, LARGEST / drawn);
  }

  /** @type {(motion: any, at: number, gain: number) => void} pose every foot at frame `at` (may be a fraction) of its motion, enlarged `gain` times */
  pose(motion, at, gain) {
    this.dress();
    const names = Object.keys(this.feet);
    const beside = names.filter(name => name !== "measured"), wide = this.apart ? APART * (beside.length - 1) : 0;
    names.forEach((name, order) => {
      const foot = this.feet[name], shown = motion.feet[name];
      if (name === "measured") for (const s of foot.segments) s.node.visible = Boolean(shown);  // nothing is measured at rest
      if (!shown) return;
      const aside = this.apart && name !== "measured" ? -APART * order : 0;
      const table = this.table(name), carried = table < 0 ? [0, 0, 0] : blend(shown, at, table);
      for (const s of [...foot.segments, ...foot.worn]) {
        const d = blend(shown, at, s.body);
        for (const j of [0, 1, 2]) d[j] -= carried[j];
        s.shift = new THREE.Vector3(d[0], d[1], d[2]).multiplyScalar(gain * SCALE);
        const angle = gain * Math.hypot(d[3], d[4], d[5]) || 0, axis = new THREE.Vector3(d[3], d[4], d[5]).normalize();
        s.q = new THREE.Quaternion().setFromAxisAngle(axis, angle).multiply(s.turned);
        s.p = s.rest.clone().multiplyScalar(SCALE).add(s.shift);
        s.p.z += aside;
        if (foot.dressed && s.name === "base") {
          for (const [part, height] of Object.entries({ base: TABLE - 0.06, shaker: TABLE - 0.30 })) {
            const table = this.node(name, part);  // one under all feet
            if (!foot.ghost) table.position.set(0.30, height + s.shift.y, -0.02 - wide / 2);
            if (!foot.ghost) table.scale.z = 1 + wide / WIDTH;
          }
        } else {
          if (foot.dressed && foot.ghost && s.name !== "ring") solid(s.node.children[0], this.apart, 0.38);
          s.node.position.copy(s.p);
          s.node.quaternion.copy(s.q);
        }
      }
      for (const part of foot.soft) if (part.mesh) this.bend(foot, part);
      this.paint(foot, shown, at, motion);
    });
    this.viewer.set_dirty();
  }

  /** @type {(s: any, p: any, q: any) => number[]} rows of the matrix that moves what is bound to a segment */
  move(s, p, q) {
    const m = new THREE.Matrix4().makeRotationFromQuaternion(q).elements, b = s.bind.clone().multiplyScalar(SCALE);
    return [m[0], m[4], m[8], p.x - m[0] * b.x - m[4] * b.y - m[8] * b.z,
      m[1], m[5], m[9], p.y - m[1] * b.x - m[5] * b.y - m[9] * b.z,
      m[2], m[6], m[10], p.z - m[2] * b.x - m[6] * b.y - m[10] * b.z];
  }

  /** @type {(move: number[], point: number[]) => number[]} the same for what is stretched between points of two segments: it goes with the point and does not turn */
  carry(move, [x, y, z]) {
    const to = [0, 4, 8].map(i => move[i] * x + move[i + 1] * y + move[i + 2] * z + move[i + 3]);
    return [1, 0, 0, to[0] - x, 0, 1, 0, to[1] - y, 0, 0, 1, to[2] - z];
  }

  /** @type {(foot: Drawn, part: any) => void} blend the segments' motions by each vertex's weights; a squeezed pad bulges */
  bend(foot, part) {
    const moves = foot.segments.map((/** @type {any} */ s) => this.move(s, s.p, s.q));
    if (part.name === "aponeurosis") foot.segments.forEach((/** @type {any} */ s, /** @type {number} */ i) => { if (s.name in INSERTIONS) moves[i] = this.carry(moves[i], INSERTIONS[s.name]); });
    const from = part.still, weights = part.weights, to = part.mesh.geometry.attributes.position, n = moves.length;
    const pad = part.name.endsWith("pad"), squeeze = pad ? this.squeeze(foot, part.name) : 1, wide = 1 / Math.sqrt(squeeze) - 1;
    const [cx, cz] = PADS[part.name] || [0, 0];
    const out = to.array, M = new Float64Array(12);
    for (let v = 0, i = 0, w = 0; i < from.length; v++, i += 3, w += n) {
      M.fill(0);
      for (let s = 0; s < n; s++) {
        const share = weights[w + s];
        if (share) { const move = moves[s]; for (let k = 0; k < 12; k++) M[k] += share * move[k]; }
      }
      let x = from[i], z = from[i + 2];
      const y = from[i + 1];
      if (pad) { const bulge = wide * Math.min(1, 2 * weights[w + n - 1]); x += (x - cx) * bulge; z += (z - cz) * bulge; }
      out[i] = M[0] * x + M[1] * y + M[2] * z + M[3];
      out[i + 1] = M[4] * x + M[5] * y + M[6] * z + M[7];
      out[i + 2] = M[8] * x + M[9] * y + M[10] * z + M[11];
    }
    to.needsUpdate = true;
  }

  /** @type {(foot: Drawn, name: string) => number} */
  squeeze(foot, name) {
    const bone = foot.segments[name === "heel_pad" ? 0 : 3], table = foot.segments[foot.segments.length - 1];
    const at = new THREE.Vector3(PADS[name][0], 0, 0);
    const local = at.sub(bone.bind.clone().multiplyScalar(SCALE)).applyQuaternion(bone.q);
    const height = local.y + bone.rest.y * SCALE + bone.shift.y - TABLE - table.shift.y;
    return Math.min(2.2, Math.max(0.3, height / -TABLE));
  }

  /** @type {(foot: Drawn, shown: FootMotion, at: number, motion: Motion) => void} colour pads and fascia by the change of their force, on one scale for all feet; a ghost only where it stands beside */
  paint(foot, shown, at, motion) {
    for (const [parts, loop, ramp, sign] of PAINTED) {
      const force = shown.loops[loop] && shown.loops[loop].force;
      if (!force) continue;
      const coloured = !foot.ghost || this.apart, top = largest(motion, loop) || 1;
      const colour = shade(ramp, 0.5 + 0.5 * sign * sample(force, shown, at) / top);
      for (const part of foot.soft) {
        if (!parts.includes(part.name) || !part.mesh) continue;
        const look = part.mesh.material, own = look.userData;
        if (!own.colour) Object.assign(own, { colour: look.color.clone(), opacity: look.opacity });
        look.color.copy(coloured ? colour : own.colour);
        if (foot.ghost) solid(part.mesh, this.apart, own.opacity);
      }
    }
  }
}

// What is coloured: parts, loop whose force it is, ramp, and which way the force points.
/** @type {[string[], string, keyof typeof import("./stage.js").RAMPS, number][]} */
const PAINTED = [[["heel_pad", "forefoot_pad"], "fat pad", "pressure", -1], [["aponeurosis"], "fascia", "tension", 1]];

/** @type {(mesh: any, on: boolean, faint: number) => void} a ghost lets the foot be seen that it lies over; beside it there is no need for that */
function solid(mesh, on, faint) {
  if (mesh && mesh.material) Object.assign(mesh.material, { opacity: on ? 0.9 : faint, depthWrite: on });
}
