// The stage: meshcat's canvas with our renderer, cameras and quality.
import { button, byId, element, save } from "./dom.js";
import { THREE, Viewer } from "./three.js";

// ?quality=fixed keeps the best, low starts with the least, none draws nothing (to measure the rest); otherwise the
// machine's speed decides.
export const QUALITY = new URLSearchParams(location.search).get("quality");
// Colour ramps (sRGB): less to more tension and compression about none of it changed, still to most moved.
export const RAMPS = { tension: ["#2f6fd6", "#e9edf0", "#c2182f"], pressure: ["#2aa79b", "#f6e7b4", "#d9481c"],
  displacement: ["#3a4fa3", "#2d9fa8", "#8fd36a", "#ffd84d"] };

// Where fog begins and ends, and the width over height of a picture that the cameras' distances are made for.
const FOG = [6.2, 11.5], WIDEST = 1.35;

export class Stage {
  /**
   * @param {HTMLElement} pane to draw in
   * @param {Record<string, number[][]>} views named cameras, eye and target each; the first one is taken
   */
  constructor(pane, views) {
    this.pane = pane;
    this.views = views;
    try {
      this.renderer = new THREE.WebGLRenderer({ antialias: QUALITY !== "low", preserveDrawingBuffer: true });
    } catch {  // all but the picture works
      this.renderer = { domElement: document.createElement("canvas"), shadowMap: {}, setPixelRatio() {}, setSize() {}, render() {} };
      this.blind = true;
      const text = "This browser cannot draw in three dimensions: WebGL is off or missing. Turn on hardware acceleration in its settings, or use another browser. All else works.";
      pane.append(element("p", text, { className: "blind" }));
    }
    const r = this.renderer;
    r.shadowMap.enabled = true;
    r.shadowMap.type = THREE.PCFSoftShadowMap;
    r.outputEncoding = THREE.sRGBEncoding;
    r.toneMapping = THREE.ACESFilmicToneMapping;
    pane.appendChild(r.domElement);
    this.viewer = new Viewer(pane, false, r);
    // meshcat makes controls for each object, which nobody sees here, and fails where a scene comes a second time
    Object.getPrototypeOf(this.viewer.scene_tree).create_controls = function () { this.vis_controller = { updateDisplay() {} }; };
    const size = this.viewer.set_3d_pane_size.bind(this.viewer);
    this.viewer.set_3d_pane_size = () => size(pane.clientWidth, pane.clientHeight);
    new ResizeObserver(() => {
      this.viewer.set_3d_pane_size();
      if (this.placed && this.placed.equals(this.camera.position)) this.view(this.viewed);  // nobody has moved it
    }).observe(pane);
    const camera = new THREE.PerspectiveCamera(26, 1, 0.05, 60);
    this.viewer.set_object(["Cameras", "default", "rotated"], camera);
    this.viewer.set_camera(camera);
    this.camera = camera;
    this.viewed = Object.keys(views)[0];
    this.view(this.viewed);
    this.quality = 2;
    /** @type {number[]} */
    this.slowFrames = [];
  }

  /** @param {string} name place the camera; where the picture is narrow, as far away as it takes to keep all of it in */
  view(name) {
    const [eye, target] = this.views[name].map((/** @type {number[]} */ v) => new THREE.Vector3(...v)), fog = this.viewer.scene.fog;
    const { clientWidth: w, clientHeight: h } = this.pane, further = Math.max(1, WIDEST * h / (w || WIDEST * h));
    this.viewed = name;
    this.camera.position.copy(eye.sub(target).multiplyScalar(further).add(target));
    this.viewer.controls.target.copy(target);
    this.viewer.controls.update();
    if (fog) Object.assign(fog, { near: FOG[0] * further, far: FOG[1] * further });
    this.placed = this.camera.position.clone();
    this.viewer.set_dirty();
  }

  /** @param {number} height */
  addGround(height) {
    const grid = new THREE.GridHelper(18, 36, 0x3a4c5f, 0x24313e);
    grid.position.set(0.3, 0, height);
    grid.rotation.x = Math.PI / 2;  // meshcat's scene has z up
    grid.material.transparent = true;
    grid.material.opacity = 0.55;
    this.viewer.scene.add(grid);
    this.viewer.scene.fog = new THREE.Fog(0x10161f, ...FOG);
    this.view(this.viewed);
  }

  render() { if (QUALITY === "none") this.viewer.needs_render = false; else this.viewer.render(); }

  /** @param {number} level 2 has shadows and the screen's own resolution, 1 no shadows, 0 fewer pixels too */
  setQuality(level) {
    this.quality = level;
    this.viewer.scene.traverse((/** @type {any} */ o) => { if (o.isDirectionalLight && o.shadow) o.castShadow = o.castShadow && level > 1; });
    this.renderer.shadowMap.enabled = level > 1;
    this.viewer.scene.traverse((/** @type {any} */ o) => { if (o.material) o.material.needsUpdate = true; });
    this.renderer.setPixelRatio(level > 0 ? Math.min(2, devicePixelRatio) : 0.7);
    this.viewer.set_3d_pane_size();
  }

  /** @type {(spent: number, passed: number) => void} automatic quality: if the first frames are slow, shadows go first, then pixels */
  adapt(spent, passed) {
    if (this.quality === 0 || QUALITY === "fixed") return;
    this.slowFrames.push(Math.max(spent, passed));
    if (this.slowFrames.length < 12) return;
    const middle = this.slowFrames.slice(4).sort((a, b) => a - b)[4];
    this.slowFrames.length = 0;
    if (middle > 70) this.setQuality(this.quality - 1);
  }

  /** @param {string} name */
  save(name) {
    this.render();
    save(this.renderer.domElement.toDataURL("image/png"), name);
  }
}

/** @param {Stage} stage */
export function cameras(stage) { for (const name of Object.keys(stage.views)) button(byId("cameras"), name, () => stage.view(name), `camera: ${name}`); }

/** @type {(ramp: keyof typeof RAMPS, t: number) => any} */
export function shade(ramp, t) {
  const stops = RAMPS[ramp], x = Math.min(1, Math.max(0, t)) * (stops.length - 1), k = Math.min(stops.length - 2, Math.floor(x));
  const colour = new THREE.Color(stops[k]).lerp(new THREE.Color(stops[k + 1]), x - k);
  return colour.convertSRGBToLinear();
}

/** @type {(material: any, power: number, least: number, colour: string) => void} transparent where the surface faces the eye, bright at its edge */
export function rim(material, power, least, colour) {
  if (material.userData.rim) return;
  material.userData.rim = true;
  material.customProgramCacheKey = () => `rim ${power} ${least} ${colour}`;
  material.onBeforeCompile = (/** @type {any} */ shader) => {
    shader.fragmentShader = shader.fragmentShader.replace("#include <dithering_fragment>",
      `float edge = pow(1.0 - abs(dot(normalize(vViewPosition), normal)), ${power.toFixed(2)});
       gl_FragColor.a *= mix(${least.toFixed(2)}, 1.0, edge);
       gl_FragColor.rgb = mix(gl_FragColor.rgb, vec3(${colour}), edge * .6);
       #include <dithering_fragment>`);
  };
  material.needsUpdate = true;
}
