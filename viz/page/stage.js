// The stage: meshcat's canvas with our renderer, and feet that are posed from a motion. Lengths in decimetres.
"use strict";
const THREE = MeshCat.THREE, SCALE = 10, TABLE = -0.2, LARGEST = 1.1;
const VIEWS = {
  medial: [[0.02, 1.05, 5.5], [0.27, 0.62, 0]], lateral: [[0.45, 1.05, -5.5], [0.27, 0.62, 0]],
  front: [[5.9, 1.75, 1.4], [0.2, 0.48, 0]], above: [[0.3, 5.6, 0.02], [0.3, 0.2, 0]],
  behind: [[-5.2, 1.5, 1.8], [0.1, 0.52, 0]], corner: [[3.8, 2.0, 4.5], [0.24, 0.60, 0]],
};
// ?quality=fixed keeps the best, low starts with the least, none draws nothing (to measure the rest); otherwise the
// machine's speed decides.
const QUALITY = new URLSearchParams(location.search).get("quality");
// Colour ramps (sRGB): slack to tense, unloaded to compressed, still to most moved.
const RAMPS = { tension: ["#dfe6ee", "#f0a24f", "#b3162f"], pressure: ["#f6e3a1", "#f0b23c", "#d9481c"],
  displacement: ["#3a4fa3", "#2d9fa8", "#8fd36a", "#ffd84d"] };

class Stage {
  // Args: the element to draw in; named cameras, [eye, target] each, the first one is taken.
  constructor(pane, views) {
    this.pane = pane;
    this.views = views;
    this.renderer = new THREE.WebGLRenderer({ antialias: QUALITY !== "low", preserveDrawingBuffer: true });
    const r = this.renderer;
    r.shadowMap.enabled = true;
    r.shadowMap.type = THREE.PCFSoftShadowMap;
    r.outputEncoding = THREE.sRGBEncoding;
    r.toneMapping = THREE.ACESFilmicToneMapping;
    pane.appendChild(r.domElement);
    this.viewer = new MeshCat.Viewer(pane, false, r);
    const size = this.viewer.set_3d_pane_size.bind(this.viewer);
    this.viewer.set_3d_pane_size = () => size(pane.clientWidth, pane.clientHeight);
    new ResizeObserver(() => this.viewer.set_3d_pane_size()).observe(pane);
    const camera = new THREE.PerspectiveCamera(26, 1, 0.05, 60);
    this.viewer.set_object(["Cameras", "default", "rotated"], camera);
    this.viewer.set_camera(camera);
    this.camera = camera;
    this.view(Object.keys(views)[0]);
    this.feet = {};
    this.model = null;
    this.posture = 0;
    this.apart = false;
    this.skinShown = true;
    this.riding = false;
    this.quality = 2;
    this.slowFrames = [];
  }

  view(name) {
    const [eye, target] = this.views[name];
    this.camera.position.set(...eye);
    this.viewer.controls.target.set(...target);
    this.viewer.controls.update();
    this.viewer.set_dirty();
  }

  addGround(height) {
    const grid = new THREE.GridHelper(18, 36, 0x3a4c5f, 0x24313e);
    grid.position.set(0.3, 0, height);
    grid.rotation.x = Math.PI / 2;  // meshcat's scene has z up
    grid.material.transparent = true;
    grid.material.opacity = 0.55;
    this.viewer.scene.add(grid);
    this.viewer.scene.fog = new THREE.Fog(0x10161f, 6.2, 11.5);
  }

  node(...path) { return this.viewer.scene_tree.find(["meshcat", "foot", ...path]).object; }

  // A new model: everything that is kept of the old one is forgotten.
  setModel(model) {
    this.model = model;
    this.feet = {};
    for (const [name, foot] of Object.entries(model.feet)) {
      const segments = foot.segments.map(s => ({
        name: s.name, body: s.body, bind: vector(s.bind), rest: vector(s.rest),
        turned: quaternion(s.rest).multiply(quaternion(s.bind).invert()), node: this.node(name, s.name),
      }));
      const soft = foot.soft.map(part => ({ name: part, node: this.node(name, part), mesh: null }));
      this.feet[name] = { ...foot, segments, soft };
    }
    this.dress();
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

  showSkin(shown) {
    this.skinShown = shown;
    for (const foot of Object.values(this.feet)) for (const part of foot.soft)
      if (part.name === "skin" && part.mesh) part.mesh.visible = shown;
    this.viewer.set_dirty();
  }

  // The body whose motion is taken from a foot's, -1 for none.
  table(name) {
    const base = this.riding && this.feet[name] && this.feet[name].segments.find(s => s.name === "base");
    return base ? base.body : -1;
  }

  // How much larger the motion may be drawn so that the table stays on the picture.
  gain(motion, wanted) {
    let largest = 1e-9;
    for (const [name, foot] of Object.entries(motion.feet)) {
      const width = foot.bodies.length / foot.frames, base = 6 * this.table(name);
      for (let i = 0; i < foot.bodies.length; i += 6) for (const j of [0, 1]) {
        const carried = base < 0 ? 0 : foot.bodies[i - i % width + base + j];
        largest = Math.max(largest, Math.abs(foot.bodies[i + j] - carried));
      }
    }
    return Math.min(wanted, LARGEST / (SCALE * largest));
  }

  // Pose every foot at frame `at` (may be a fraction) of its motion, enlarged `gain` times.
  pose(motion, at, gain) {
    this.dress();
    const names = Object.keys(this.feet);
    names.forEach((name, order) => {
      const foot = this.feet[name], shown = motion.feet[name];
      if (!shown) return;
      const aside = this.apart && order ? -1.75 * order : 0;
      const table = this.table(name), carried = table < 0 ? [0, 0, 0] : blend(shown, at, table);
      for (const s of foot.segments) {
        const d = blend(shown, at, s.body);
        for (const j of [0, 1, 2]) d[j] -= carried[j];
        s.shift = new THREE.Vector3(d[0], d[1], d[2]).multiplyScalar(gain * SCALE);
        const angle = gain * Math.hypot(d[3], d[4], d[5]) || 0, axis = new THREE.Vector3(d[3], d[4], d[5]).normalize();
        s.q = new THREE.Quaternion().setFromAxisAngle(axis, angle).multiply(s.turned);
        s.p = s.rest.clone().multiplyScalar(SCALE).add(s.shift);
        this.tilt(foot, s);
        s.p.z += aside;
        if (foot.dressed && s.name === "base") {
          for (const [part, height] of [["base", TABLE - 0.06], ["shaker", TABLE - 0.30]]) {
            const table = this.node(name, part);
            if (!foot.ghost) table.position.set(0.30, height + s.shift.y, -0.02);
          }
        } else {
          s.node.position.copy(s.p);
          s.node.quaternion.copy(s.q);
        }
      }
      for (const part of foot.soft) if (part.mesh) this.bend(foot, part);
      this.paint(foot, shown, at);
    });
    this.viewer.set_dirty();
  }

  // Plantarflexion or dorsiflexion turns the foot about toes or heel under an upright leg: the picture only.
  tilt(foot, s) {
    s.flat = s.q.clone();
    if (!this.posture || !foot.dressed) return;
    const pivot = new THREE.Vector3(this.posture < 0 ? 1.28 : -0.70, TABLE, 0);
    const turn = new THREE.Quaternion().setFromAxisAngle(new THREE.Vector3(0, 0, 1), THREE.MathUtils.degToRad(this.posture));
    if (s.name === "tibia") {
      const ankle = new THREE.Vector3(-0.34, 0.45, 0), moved = ankle.clone().sub(pivot).applyQuaternion(turn).add(pivot);
      s.p.add(moved.sub(ankle));
    } else if (s.name !== "base") {
      s.p.sub(pivot).applyQuaternion(turn).add(pivot);
      s.q.premultiply(turn);
    }
  }

  // Blend the segments' motions by each vertex's weights; a squeezed pad bulges.
  bend(foot, part) {
    const base = foot.segments.length - 1, raised = this.posture > 0 ? "forefoot_pad" : this.posture < 0 ? "heel_pad" : "";
    const carrier = part.name === "heel_pad" ? 0 : 3;
    const moves = foot.segments.map((s, i) => {
      const own = i === base && (part.name === raised || (part.name === "skin" && raised)) ? foot.segments[carrier] : s;
      const bind = own.bind, m = new THREE.Matrix4().makeRotationFromQuaternion(own.q).elements;
      const b = [SCALE * bind.x, SCALE * bind.y, SCALE * bind.z];
      return [m[0], m[4], m[8], own.p.x - m[0] * b[0] - m[4] * b[1] - m[8] * b[2],
        m[1], m[5], m[9], own.p.y - m[1] * b[0] - m[5] * b[1] - m[9] * b[2],
        m[2], m[6], m[10], own.p.z - m[2] * b[0] - m[6] * b[1] - m[10] * b[2]];
    });
    const from = part.still, weights = part.weights, to = part.mesh.geometry.attributes.position, n = moves.length;
    const pad = part.name.endsWith("pad"), squeeze = pad ? this.squeeze(foot, part.name) : 1, wide = 1 / Math.sqrt(squeeze) - 1;
    const cx = part.name === "heel_pad" ? -0.68 : 0.95, cz = part.name === "heel_pad" ? -0.05 : -0.05;
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

  squeeze(foot, name) {
    const bone = foot.segments[name === "heel_pad" ? 0 : 3], table = foot.segments[foot.segments.length - 1];
    const at = new THREE.Vector3(name === "heel_pad" ? -0.7 : 0.95, 0, 0);
    const local = at.sub(bone.bind.clone().multiplyScalar(SCALE)).applyQuaternion(bone.flat);
    const height = local.y + bone.rest.y * SCALE + bone.shift.y - TABLE - table.shift.y;
    return Math.min(2.2, Math.max(0.3, height / -TABLE));
  }

  paint(foot, shown, at) {
    if (foot.ghost) return;
    for (const [parts, loop, ramp, sign] of [
      [["heel_pad", "forefoot_pad"], "fat pad", "pressure", -1], [["aponeurosis"], "fascia", "tension", 1]]) {
      const force = shown.loops[loop] && shown.loops[loop].force;
      if (!force) continue;
      const top = Math.max(...force.map(Math.abs)) || 1;
      const colour = shade(ramp, 0.5 + 0.5 * sign * sample(force, shown, at) / top);
      for (const part of foot.soft) if (parts.includes(part.name) && part.mesh) part.mesh.material.color.copy(colour);
    }
  }

  render() { if (QUALITY === "none") this.viewer.needs_render = false; else this.viewer.render(); }

  // Quality 2 has shadows and the screen's own resolution, 1 no shadows, 0 fewer pixels too.
  setQuality(level) {
    this.quality = level;
    this.viewer.scene.traverse(o => { if (o.isDirectionalLight && o.shadow) o.castShadow = o.castShadow && level > 1; });
    this.renderer.shadowMap.enabled = level > 1;
    this.viewer.scene.traverse(o => { if (o.material) o.material.needsUpdate = true; });
    this.renderer.setPixelRatio(level > 0 ? Math.min(2, devicePixelRatio) : 0.7);
    this.viewer.set_3d_pane_size();
  }

  // Automatic quality: if the first frames are slow, shadows go first, then pixels.
  adapt(spent, passed) {
    if (this.quality === 0 || QUALITY === "fixed") return;
    this.slowFrames.push(Math.max(spent, passed));
    if (this.slowFrames.length < 12) return;
    const middle = this.slowFrames.slice(4).sort((a, b) => a - b)[4];
    this.slowFrames.length = 0;
    if (middle > 70) this.setQuality(this.quality - 1);
  }

  save(name) {
    this.render();
    const link = document.createElement("a");
    link.href = this.renderer.domElement.toDataURL("image/png");
    link.download = name;
    link.click();
  }
}

function vector(pose) { return new THREE.Vector3(pose[0], pose[1], pose[2]); }
function quaternion(pose) { return new THREE.Quaternion(pose[4], pose[5], pose[6], pose[3]); }

// Displacement and rotation vector of one body between two frames.
function blend(shown, at, body) {
  const n = shown.frames, width = shown.bodies.length / n, k = Math.floor(at) % n, u = at - Math.floor(at);
  const next = shown.periodic ? (k + 1) % n : Math.min(k + 1, n - 1), out = [];
  for (let j = 0; j < 6; j++) {
    const a = shown.bodies[k * width + 6 * body + j], b = shown.bodies[next * width + 6 * body + j];
    out.push(a + (b - a) * u);
  }
  return out;
}

function sample(values, shown, at) {
  const n = shown.frames, k = Math.floor(at) % n, u = at - Math.floor(at), next = shown.periodic ? (k + 1) % n : Math.min(k + 1, n - 1);
  return values[k] + (values[next] - values[k]) * u;
}

function shade(ramp, t) {
  const stops = RAMPS[ramp], x = Math.min(1, Math.max(0, t)) * (stops.length - 1), k = Math.min(stops.length - 2, Math.floor(x));
  const colour = new THREE.Color(stops[k]).lerp(new THREE.Color(stops[k + 1]), x - k);
  return colour.convertSRGBToLinear();
}

// Transparent where the surface faces the eye, bright at its edge.
function rim(material, power, least, colour) {
  if (material.userData.rim) return;
  material.userData.rim = true;
  material.customProgramCacheKey = () => `rim ${power} ${least} ${colour}`;
  material.onBeforeCompile = shader => {
    shader.fragmentShader = shader.fragmentShader.replace("#include <dithering_fragment>",
      `float edge = pow(1.0 - abs(dot(normalize(vViewPosition), normal)), ${power.toFixed(2)});
       gl_FragColor.a *= mix(${least.toFixed(2)}, 1.0, edge);
       gl_FragColor.rgb = mix(gl_FragColor.rgb, vec3(${colour}), edge * .6);
       #include <dithering_fragment>`);
  };
  material.needsUpdate = true;
}
