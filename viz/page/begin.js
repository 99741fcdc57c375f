// Everything is there: the page begins.
"use strict";
requestAnimationFrame(tick);
start(stage, forget, receive, ["model", "fitted", "motion"], unpackGrid);
