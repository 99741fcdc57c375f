// The model: a chooser, and its MJCF in an editor that is checked while it is typed.
import { byId, element } from "./dom.js";
import { clock } from "./playback.js";
import { effect } from "./reactive.js";
import { tellServer } from "./server.js";
import { bench } from "./store.js";
import { on } from "./stream.js";
import { isLight } from "./theme.js";
import { CM } from "./vendor/codemirror.js";

/** @typedef {{ text: string, digest: string }} Theirs */
// What is opened: the model's name, its text and its digest as the file had it, and the file's later one where it has
// become another; unsaved text of other models.
/** @type {{ view: any, name: string, file: string, text: string, digest: string, theirs: Theirs | null, sent: string, quiet: boolean, timer: number, drafts: Map<string, Theirs> }} */
export const editor = { view: null, name: "", file: "", text: "", digest: "", theirs: null, sent: "", quiet: false, timer: 0, drafts: new Map() };
const MOST_TEXT = 900000;  // bytes of a model that the server takes from a page
export const typedText = () => (editor.view ? editor.view.state.doc.toString() : editor.text);

// What is shown was typed, here or in another page, and is in no file: its name says so.
effect(markDraft);
function markDraft() {
  const { draft } = bench;
  for (const option of byId("model_choice").options) option.textContent = option.value.split("/").pop() + (draft && option.selected ? " (draft, not saved)" : "");
  clock.fresh = true;
}

on("models", ({ names, now, file, copy, text, digest, draft: isDraft }) => {
  const select = byId("model_choice"), known = names.includes(now) ? names : [...names, now];
  select.replaceChildren(...known.map(name => element("option", name.split("/").pop(), { value: name, title: name })));
  select.value = now;
  bench.draft = isDraft;
  markDraft();
  byId("save_model").title = file ? `to ${file}` : `to ${copy}, a copy in the folder that the command was started in`;
  const mine = typedText(), unsaved = mine !== editor.text;
  if (now !== editor.name) {
    if (unsaved) editor.drafts.set(editor.name, { text: mine, digest: editor.digest });
    const draft = editor.drafts.get(now);
    editor.drafts.delete(now);
    Object.assign(editor, { name: now, file, text, digest });
    showConflict(draft && draft.digest !== digest ? { text, digest } : null);
    replaceText(draft ? draft.text : text);
    byId("editor_state").textContent = "";
    if (draft) checkSoon();
  } else if (digest !== editor.digest) {  // by another program, or another page
    if (unsaved && mine !== text) { showConflict({ text, digest }); return; }
    Object.assign(editor, { text, digest });
    showConflict(null);
    replaceText(text);
  }
});

/** @param {string} text in the editor, without a check of what the server has just sent */
function replaceText(text) {
  if (!editor.view || typedText() === text) return;
  editor.quiet = true;
  editor.view.dispatch({ changes: { from: 0, to: editor.view.state.doc.length, insert: text } });
  editor.view.dispatch(CM.setDiagnostics(editor.view.state, []));
  editor.quiet = false;
}

/** @param {Theirs | null} theirs another text than the one that was opened, where this page has one that is not saved: somebody must choose */
function showConflict(theirs) {
  editor.theirs = theirs;
  byId("conflict").hidden = !theirs;
  byId("save_model").disabled = Boolean(theirs);
  if (theirs) byId("conflict").firstChild.textContent = `${editor.name.split("/").pop()} was changed by another program, and this text is not saved.`;
}
/** @param {string} text */
function resolveConflict(text) {
  Object.assign(editor, editor.theirs);
  showConflict(null);
  replaceText(text);
  tellServer("check", { text });
}

export function openEditor() {
  const pane = byId("editor"), shown = pane.hidden;
  pane.hidden = !shown;
  byId("edit_model").setAttribute("aria-pressed", shown);
  if (!shown || editor.view) return;
  const tint = CM.HighlightStyle.define([
    { tag: CM.tags.tagName, color: "light-dark(#1f6fb4, #6cb6ff)" }, { tag: CM.tags.attributeName, color: "light-dark(#1a7f45, #7ee0a1)" }, { tag: CM.tags.attributeValue, color: "light-dark(#9a5200, #ffb454)" },
    { tag: CM.tags.comment, color: "light-dark(#4c5b69, #93a3b3)" }, { tag: CM.tags.angleBracket, color: "light-dark(#4c5b69, #93a3b3)" },
  ]);
  editor.view = new CM.EditorView({
    parent: byId("mjcf"),
    state: CM.EditorState.create({
      doc: editor.text,
      extensions: [
        CM.lineNumbers(), CM.history(), CM.drawSelection(), CM.bracketMatching(), CM.highlightActiveLine(), CM.xml(), CM.syntaxHighlighting(tint), CM.lintGutter(), CM.search({ top: true }),
        CM.keymap.of([{ key: "Mod-s", preventDefault: true, run: () => { saveModel(); return true; } }, ...CM.defaultKeymap, ...CM.historyKeymap, ...CM.searchKeymap]),
        CM.EditorView.updateListener.of((/** @type {any} */ update) => { if (update.docChanged && !editor.quiet) checkSoon(); }),
        CM.EditorView.contentAttributes.of({ "aria-label": "the model's MJCF" }),
        CM.EditorView.theme({ ".cm-cursor": { borderLeftColor: "var(--ink)" }, ".cm-activeLine": { background: "color-mix(in srgb, var(--ink) 4%, transparent)" } }, { dark: !isLight() }),
      ],
    }),
  });
  editor.view.scrollDOM.tabIndex = 0;
}

// A pause in the typing: the server compiles it; a sound model moves at once, and nothing is saved.
function checkSoon() {
  clearTimeout(editor.timer);
  editor.timer = setTimeout(() => {
    const text = typedText(), size = new Blob([JSON.stringify(text)]).size;
    if (size > MOST_TEXT) { showCheck({ text: `${(size / 1e6).toFixed(1)} MB are too large for this editor; use another one.`, line: null }); return; }
    byId("editor_state").textContent = "checking";
    tellServer("check", { text });
  }, 250);
}

on("checked", showCheck);
/** @param {Documents["checked"]} document_ */
function showCheck({ text, line }) {
  if (!editor.view) return;
  const doc = editor.view.state.doc, at = line && line <= doc.lines ? doc.line(line) : null;
  const changed = doc.toString() !== editor.text;
  byId("editor_state").textContent = text || (changed ? "valid; not saved yet" : "");
  byId("editor_state").classList.toggle("wrong", Boolean(text));
  const marks = text ? [{ from: at ? at.from : 0, to: at ? at.to : 0, severity: "error", message: text }] : [];
  editor.view.dispatch(CM.setDiagnostics(editor.view.state, marks));
}

export function saveModel() {
  if (editor.theirs) return;
  clearTimeout(editor.timer);
  editor.sent = typedText();
  byId("editor_state").textContent = "saving";
  tellServer("save", { text: editor.sent, digest: editor.digest });
}
on("saved", ({ file, text, digest }) => {
  byId("editor_state").textContent = text || `saved to ${file.split("/").pop()}`;
  byId("editor_state").classList.toggle("wrong", Boolean(text));
  if (file) Object.assign(editor, { name: file, file, text: editor.sent, digest });
});

byId("model_choice").onchange = (/** @type {any} */ event) => tellServer("choose", { name: event.target.value });
byId("edit_model").onclick = openEditor;
byId("save_model").onclick = saveModel;
byId("take_theirs").onclick = () => resolveConflict(/** @type {Theirs} */ (editor.theirs).text);
byId("keep_mine").onclick = () => resolveConflict(typedText());
