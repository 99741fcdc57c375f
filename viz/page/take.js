// What a page gives away: a picture, a film, the scene, and its plots for print. All of it is made in the page.
import { busyWith, button, byId, download, rowIn } from "./dom.js";
import { sceneGlb } from "./gltf.js";
import { clock, play } from "./playback.js";
import { Plot } from "./plots.js";
import { plotsCsv, plotsPng, plotsSvg } from "./print.js";

// A film repeats a period until it lasts LEAST seconds, and lasts MOST at the most.
const LEAST = 4, MOST = 30;
export const KEYS = 24;

// The section's buttons. Args: the stage; name of the files; what the page is able to.
export function takeAwaySection(stage, name, { page = null, film, scene }) {
  const box = byId("taking");
  for (const old of box.querySelectorAll(".row")) old.remove();
  const row = rowIn(box), plots = rowIn(box);
  const wait = (text, work) => async b => {
    const { playing, time } = clock;
    b.disabled = true;
    busyWith(text);
    try { busyWith((await work(share => busyWith(text, share))) || "", 1); } catch (error) { busyWith(error.message, 1); }
    b.disabled = false;
    Object.assign(clock, { time, fresh: true });
    play(playing);
  };
  if (page) button(row, "Offline page", page, "one file for a colleague: opens without a network, and its sliders still move");
  if (!stage.blind) button(row, "Picture", () => stage.save(`${name()}.png`), "PNG of what is drawn");
  if (!stage.blind) button(row, "Film", wait("recording the film", done => recordFilm(stage, name(), film(), done)), "webm of the motion, recorded as it plays");
  button(row, "3-D scene", wait("writing", () => download(`${name()}.glb`, sceneGlb(stage, scene()))), "glTF (.glb) with the motion, for Blender and other viewers");
  if (!Plot.all.length) { plots.remove(); return; }
  plots.append("Plots ");
  button(plots, "SVG", wait("", () => download("plots.svg", plotsSvg().text, "image/svg+xml")), "the plots below as vectors, for print");
  button(plots, "PNG", wait("drawing", async () => download("plots.png", await plotsPng())), "the plots below, 300 dots an inch");
  button(plots, "CSV", wait("", () => download("plots.csv", plotsCsv())), "the numbers of the plots below");
}

// Record the canvas while drawAt(share) goes through the motion in `seconds`, as often as `repeats`; `done` gets the share.
async function recordFilm(stage, name, { seconds, repeats, drawAt }, done) {
  const kinds = ["video/webm;codecs=vp9", "video/webm;codecs=vp8", "video/webm", "video/mp4"], type = window.MediaRecorder && kinds.find(kind => MediaRecorder.isTypeSupported(kind));
  if (!type) return "this browser records no films; --export foot.mp4 of the command does";
  const parts = [], stream = stage.renderer.domElement.captureStream(30), recorder = new MediaRecorder(stream, { mimeType: type, videoBitsPerSecond: 8e6 });
  recorder.ondataavailable = event => { if (event.data.size) parts.push(event.data); };
  const ended = new Promise(stopped => { recorder.onstop = stopped; });
  drawAt(0);
  await new Promise(began => { recorder.onstart = began; recorder.start(); });
  let last = performance.now(), passed = 0;
  await new Promise(drawn => {
    const step = now => {
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

// How a film goes through a motion of so many seconds on the screen: whole periods, a transient once.
export function filmPlan(seconds, periodic) {
  if (seconds >= LEAST || !periodic) return { seconds: Math.min(MOST, seconds), repeats: 1 };
  return { seconds, repeats: Math.min(Math.ceil(LEAST / seconds), Math.floor(MOST / seconds)) };
}
