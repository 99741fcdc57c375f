// What a page gives away: a picture, a film, the scene, and its plots for print. All of it is made in the page.
import { busyWith, button, byId, download, element, rowIn } from "./dom.js";
import { sceneGlb } from "./gltf.js";
import { clock, play } from "./playback.js";
import { Plot } from "./plots.js";
import { plotsCsv, plotsPng, plotsSvg } from "./print.js";

// A film repeats a period until it lasts LEAST seconds, and lasts MOST at the most.
const LEAST = 4, MOST = 30;
export const KEYS = 24;

/**
 * The section's buttons. Args: the stage; name of the files; what the page is able to.
 * @typedef {{ seconds: number, repeats: number, drawAt: (share: number) => void }} Reel
 * @type {(stage: import("./stage.js").Stage, name: () => string, able: { page?: (() => void) | null | false, film: () => Reel, scene: () => any }) => void}
 */
export function takeAwaySection(stage, name, { page = null, film, scene }) {
  const box = byId("taking");
  for (const old of box.querySelectorAll(".row")) old.remove();
  const offer = (/** @type {string} */ about, /** @type {Record<string, (b: any) => void>} */ actions, heading = "") => {
    const row = rowIn(box);
    row.append(heading);
    for (const [label, action] of Object.entries(actions)) button(row, label, action);
    row.append(element("small", about));
  };
  const wait = (/** @type {string} */ text, /** @type {(done: (share: number) => void) => any} */ work) => async (/** @type {any} */ b) => {
    const { playing, time } = clock;
    b.disabled = true;
    busyWith(text);
    try { busyWith((await work(share => busyWith(text, share))) || "", 1); } catch (error) { busyWith(/** @type {Error} */ (error).message, 1); }
    b.disabled = false;
    Object.assign(clock, { time, fresh: true });
    play(playing);
  };
  if (page) offer("one file that works without a network; its sliders still move the foot", { "Offline page": page });
  if (!stage.blind) offer("what is drawn, as PNG", { Picture: () => stage.save(`${name()}.png`) });
  if (!stage.blind) offer("the motion, recorded as it plays", { Film: wait("recording the film", done => recordFilm(stage, name(), film(), done)) });
  offer("the motion as glTF, for Blender and other viewers", { "3-D scene": wait("writing", () => download(`${name()}.glb`, sceneGlb(stage, scene()))) });
  if (Plot.all.length) offer("the visible plots for print, or their numbers", {
    SVG: wait("", () => download("plots.svg", plotsSvg().text, "image/svg+xml")), PNG: wait("drawing", async () => download("plots.png", await plotsPng())), CSV: wait("", () => download("plots.csv", plotsCsv())),
  }, "Plots ");
}

/**
 * Record the canvas while drawAt(share) goes through the motion in `seconds`, as often as `repeats`; `done` gets the share.
 * @type {(stage: import("./stage.js").Stage, name: string, reel: Reel, done: (share: number) => void) => Promise<string>}
 */
async function recordFilm(stage, name, { seconds, repeats, drawAt }, done) {
  const kinds = ["video/webm;codecs=vp9", "video/webm;codecs=vp8", "video/webm", "video/mp4"], type = window.MediaRecorder && kinds.find(kind => MediaRecorder.isTypeSupported(kind));
  if (!type) return "this browser records no films; --export foot.mp4 of the command does";
  const /** @type {Blob[]} */ parts = [], stream = stage.renderer.domElement.captureStream(30), recorder = new MediaRecorder(stream, { mimeType: type, videoBitsPerSecond: 8e6 });
  recorder.ondataavailable = event => { if (event.data.size) parts.push(event.data); };
  const ended = new Promise(stopped => { recorder.onstop = stopped; });
  drawAt(0);
  await new Promise(began => { recorder.onstart = began; recorder.start(); });
  let last = performance.now(), passed = 0;
  await new Promise(drawn => {
    const step = (/** @type {number} */ now) => {
      passed += Math.min(500, Math.max(0, now - last));  // a computer that stood still leaves no hole in the motion
      last = Math.max(last, now);
      const share = passed / (1000 * seconds);
      if (share >= repeats) { drawn(null); return; }
      done(share / repeats);
      drawAt(share % 1);
      requestAnimationFrame(step);
    };
    requestAnimationFrame(step);
  });
  recorder.stop();
  await ended;
  for (const track of stream.getTracks()) track.stop();
  download(`${name}.${type.includes("mp4") ? "mp4" : "webm"}`, new Blob(parts, { type }));
  return "";
}

/** @type {(seconds: number, periodic: boolean) => { seconds: number, repeats: number }} how a film goes through a motion of so many seconds on the screen: whole periods, a transient once */
export function filmPlan(seconds, periodic) {
  if (seconds >= LEAST || !periodic) return { seconds: Math.min(MOST, seconds), repeats: 1 };
  return { seconds, repeats: Math.min(Math.ceil(LEAST / seconds), Math.floor(MOST / seconds)) };
}
