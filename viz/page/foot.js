// The foot's page: everything is there, and it begins.
import "./advice.js";
import "./files.js";
import "./history.js";
import "./matrix.js";
import "./model.js";
import "./recordings.js";
import "./session.js";
import "./table.js";
import { ask, forget } from "./ask.js";
import { showSkin } from "./controls.js";
import { VIEWS } from "./feet.js";
import { unpackGrid } from "./live.js";
import { frame, plots } from "./motion_plots.js";
import { showAt, stage, tick } from "./picture.js";
import { clock, keys, play } from "./playback.js";
import { cameras } from "./stage.js";
import { bench, page, state, stats } from "./store.js";
import { start } from "./stream.js";

const LOWEST = 1, HIGHEST = 60;  // of the frequency [Hz]
cameras(stage);
keys(() => page.motion, key => {
  const change = { ArrowRight: 0.5, ArrowLeft: -0.5, ArrowUp: 5, ArrowDown: -5 }[key], views = Object.keys(VIEWS);
  if (key === "k") showSkin(!stage.skinShown);
  else if (+key >= 1 && +key <= views.length) stage.view(views[+key - 1]);
  else if (change && page.sliders.frequency) {
    state.frequency = Math.min(HIGHEST, Math.max(LOWEST, state.frequency + change));
    ask();
  } else return false;
  return true;
});

// The page's one name in the window: what drives it from outside, for films, pictures, measurements and tests.
window.fasbody = { stage, stats, state, bench, page, clock, plots, showAt, play, ask, frame };
requestAnimationFrame(tick);
start(stage, forget, ["model", "fitted", "motion"], unpackGrid);
