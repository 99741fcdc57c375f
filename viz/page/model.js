// A model from the server, or the same one from its file as it was saved again.
import { askAnew } from "./ask.js";
import { buildControls } from "./controls.js";
import { refuseSent } from "./corrections.js";
import { byId } from "./dom.js";
import { forgetFit, showFit } from "./fit.js";
import { recall } from "./keep.js";
import { forgetReport } from "./made.js";
import { openTask } from "./panels.js";
import { stage } from "./picture.js";
import { forgetRivals } from "./rivals.js";
import { complain } from "./server.js";
import { bench, page, state } from "./store.js";
import { on } from "./stream.js";
import { forgetSteps } from "./values.js";

on("model", model => {
  const before = page.model, other = before !== null && model.name !== before.name && !model.same;
  let offered = before === null || other;
  Object.assign(page, { model, motion: null, broken: model.error });  // the motion is of another model
  if (model.draft !== undefined) bench.draft = model.draft;
  stage.setModel(model);
  if (before === null) {
    Object.assign(state, model.settings, model.look);
    offered = !recall();
    if (offered && model.fit.branches) openTask("fit");
  } else if (other) {  // values of the same name are not its own
    Object.assign(state, { values: {}, delay_s: 0 });
    Object.assign(bench, { free: {}, bounds: {} });
    forgetSteps();
    forgetFit();
    forgetRivals();
  }
  if (before !== null && model.adopt) Object.assign(state, { frequency: model.settings.frequency, added_mass: model.settings.added_mass });
  const names = model.parameters.map(p => p.name);
  state.values = Object.fromEntries(Object.entries(state.values).filter(([name]) => names.includes(name)));
  buildControls(offered);
  showFit(model.fit);
  askAnew();
});
on("broken", ({ text }) => { page.broken = text; });  // the model's file: told until it is mended

// A sentence in place of what was asked for.
on("complaint", ({ text, of }) => {
  if (of === "report" || !of) forgetReport();
  if (of === "correct") { refuseSent(text); return; }
  if (of === "save") byId("editor_state").textContent = "not saved";
  complain(text);
});
