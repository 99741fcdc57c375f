// The scene as binary glTF 2.0: what is seen, with the motion that is shown, for Blender and every other viewer of glTF.
import { THREE } from "./three.js";


// Args: the stage; keys of the motion, seconds that it lasts, whether it ends as it began; pose(share) poses the scene;
// metres in a unit of the scene. What bends is sent at every second key, between which viewers go straight.
export function sceneGlb(stage, { keys, seconds, periodic, pose, unit }) {
  const meshes = [], last = periodic ? keys - 1 : keys;
  const walk = (node, path) => {
    const o = node.object;
    if (!o.visible) return;
    if (o.isMesh) meshes.push({ o, name: path.filter(name => name !== "<object>").join(" "), bends: o.geometry.attributes.position.usage === THREE.DynamicDrawUsage, moved: [], bent: [] });
    for (const [name, child] of Object.entries(node.children)) walk(child, [...path, name]);
  };
  walk(stage.viewer.scene_tree.find(["meshcat"]), []);
  for (let k = 0; k <= last; k++) {
    pose(Math.min(k / keys, 1 - 1e-9));
    stage.viewer.scene.updateMatrixWorld(true);
    for (const mesh of meshes) {
      const p = new THREE.Vector3(), q = new THREE.Quaternion(), s = new THREE.Vector3();
      mesh.o.matrixWorld.decompose(p, q, s);
      const before = mesh.moved.at(-1);
      if (before && before.q.dot(q) < 0) q.set(-q.x, -q.y, -q.z, -q.w);  // the shorter way round
      mesh.moved.push({ p, q, s });
      if (mesh.bends && k % 2 === 0) mesh.bent.push(mesh.o.geometry.attributes.position.array.slice());
    }
  }
  if (periodic) for (const mesh of meshes) { mesh.moved.push(mesh.moved[0]); mesh.bent.push(mesh.bent[0]); }
  const file = new GlbFile(), times = file.numbers(Array.from({ length: keys + 1 }, (_, k) => seconds * k / keys), "SCALAR", true);
  const fewer = file.numbers(Array.from({ length: keys / 2 + 1 }, (_, k) => 2 * seconds * k / keys), "SCALAR", true);
  const nodes = meshes.map(mesh => file.mesh(mesh, times, fewer));
  file.json.nodes.push({ name: "fasbody", scale: [unit, unit, unit], children: nodes });
  file.json.scenes[0].nodes = [file.json.nodes.length - 1];
  return file.whole();
}

class GlbFile {
  constructor() {
    this.json = { asset: { version: "2.0", generator: "fasbody" }, scene: 0, scenes: [{ nodes: [] }], nodes: [], meshes: [], materials: [],
      animations: [{ name: "motion", samplers: [], channels: [] }], accessors: [], bufferViews: [], buffers: [{ byteLength: 0 }] };
    this.parts = [];
  }

  // An accessor of numbers; `limits` where glTF asks for them.
  numbers(values, type, limits = false, /** @type {any} */ Kind = Float32Array, target = undefined) {
    const array = values instanceof Kind ? values : new Kind(values), width = { SCALAR: 1, VEC3: 3, VEC4: 4 }[type], buffer = this.json.buffers[0];
    const bytes = new Uint8Array(4 * Math.ceil(array.byteLength / 4));
    bytes.set(new Uint8Array(array.buffer, array.byteOffset, array.byteLength));
    this.parts.push(bytes);
    this.json.bufferViews.push({ buffer: 0, byteOffset: buffer.byteLength, byteLength: array.byteLength, target });
    buffer.byteLength += bytes.length;
    const accessor = { bufferView: this.json.bufferViews.length - 1, componentType: Kind === Float32Array ? 5126 : 5125, count: array.length / width, type };
    if (limits) {
      accessor.min = Array(width).fill(Infinity);
      accessor.max = Array(width).fill(-Infinity);
      array.forEach((v, i) => { accessor.min[i % width] = Math.min(accessor.min[i % width], v); accessor.max[i % width] = Math.max(accessor.max[i % width], v); });
    }
    return this.json.accessors.push(accessor) - 1;
  }

  material({ material }) {
    const { r, g, b } = material.color, clear = material.transparent && material.opacity < 1, seen = material.userData.rim ? 0.35 : 1;  // faint but at its rim
    const look = { baseColorFactor: [r, g, b, clear ? seen * material.opacity : 1], metallicFactor: 0, roughnessFactor: 0.6 };
    return this.json.materials.push({ pbrMetallicRoughness: look, alphaMode: clear ? "BLEND" : "OPAQUE", doubleSided: material.side === THREE.DoubleSide }) - 1;
  }

  // A node with its mesh, and the channels that move and bend it.
  mesh({ o, name, bends, moved, bent }, times, fewer) {
    const { position, normal, color } = o.geometry.attributes, first = bends ? bent[0] : position.array, VERTICES = 34962;
    const attributes = { POSITION: this.numbers(first, "VEC3", true, Float32Array, VERTICES) };
    if (normal) attributes.NORMAL = this.numbers(unit(normal.array), "VEC3", false, Float32Array, VERTICES);
    if (color && o.material.vertexColors) attributes.COLOR_0 = this.numbers(color.array, "VEC3", false, Float32Array, VERTICES);
    const primitive = { attributes, material: this.material(o) }, mesh = { name, primitives: [primitive] };
    if (o.geometry.index) primitive.indices = this.numbers(Uint32Array.from(o.geometry.index.array), "SCALAR", false, Uint32Array, 34963);
    const { p, q, s } = moved[0], node = { name, mesh: this.json.meshes.length, translation: p.toArray(), rotation: q.toArray(), scale: s.toArray() };
    const at = this.json.nodes.push(node) - 1, { samplers, channels } = this.json.animations[0];
    const channel = (path, input, output) => channels.push({ sampler: samplers.push({ input, output, interpolation: "LINEAR" }) - 1, target: { node: at, path } });
    for (const [path, key, type] of [["translation", "p", "VEC3"], ["rotation", "q", "VEC4"], ["scale", "s", "VEC3"]]) {
      const values = moved.map(m => m[key].toArray());
      if (values.some(v => v.some((x, i) => Math.abs(x - values[0][i]) > 1e-7))) channel(path, times, this.numbers(values.flat(), type));
    }
    const shapes = bent.slice(1).filter(shape => shape !== bent[0]);
    if (shapes.length) {
      primitive.targets = shapes.map(shape => ({ POSITION: this.numbers(shape.map((v, i) => v - first[i]), "VEC3", true, Float32Array, VERTICES) }));
      mesh.weights = shapes.map(() => 0);
      channel("weights", fewer, this.numbers(bent.flatMap(shape => shapes.map(other => +(other === shape))), "SCALAR"));
    }
    this.json.meshes.push(mesh);
    return at;
  }

  whole() {
    const text = new TextEncoder().encode(JSON.stringify(this.json)), told = new Uint8Array(4 * Math.ceil(text.length / 4)).fill(32), binary = this.json.buffers[0].byteLength;
    told.set(text);
    const word = (...values) => Uint32Array.from(values);
    return new Blob([word(0x46546c67, 2, 28 + told.length + binary), word(told.length, 0x4e4f534a), told, word(binary, 0x004e4942), ...this.parts], { type: "model/gltf-binary" });
  }
}

// Normals of length one; a vertex that has none gets one upwards.
function unit(values) {
  const out = Float32Array.from(values);
  for (let i = 0; i < out.length; i += 3) {
    const size = Math.hypot(out[i], out[i + 1], out[i + 2]);
    if (size > 1e-9) for (const j of [0, 1, 2]) out[i + j] /= size; else out[i + 1] = 1;
  }
  return out;
}
