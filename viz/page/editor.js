// The model: a chooser, and its MJCF in an editor that is checked while it is typed.
"use strict";
const editor = { view: null, file: "", text: "", timer: 0, asked: "" };

function listModels({ names, now, file, text }) {
  const select = byId("model_choice"), known = [...names];
  if (!known.includes(now)) known.push(now);
  select.replaceChildren(...known.map(name => element("option", name.split("/").pop(), { value: name })));
  select.value = now;
  editor.file = file;
  byId("save_model").title = file ? `to ${file}` : "to my_foot.xml, a copy in the folder that the command was started in";
  if (text !== editor.text) {
    editor.text = text;
    if (editor.view && editor.view.state.doc.toString() !== text) editor.view.dispatch({ changes: { from: 0, to: editor.view.state.doc.length, insert: text } });
  }
}

function openEditor() {
  const pane = byId("editor"), shown = pane.hidden;
  pane.hidden = !shown;
  byId("edit_model").setAttribute("aria-pressed", shown);
  if (!shown || editor.view) return;
  const tint = CM.HighlightStyle.define([
    { tag: CM.tags.tagName, color: "#6cb6ff" }, { tag: CM.tags.attributeName, color: "#7ee0a1" }, { tag: CM.tags.attributeValue, color: "#ffb454" },
    { tag: CM.tags.comment, color: "#93a3b3" }, { tag: CM.tags.angleBracket, color: "#93a3b3" },
  ]);
  editor.view = new CM.EditorView({
    parent: byId("mjcf"),
    state: CM.EditorState.create({
      doc: editor.text,
      extensions: [
        CM.lineNumbers(), CM.history(), CM.drawSelection(), CM.bracketMatching(), CM.highlightActiveLine(), CM.xml(), CM.syntaxHighlighting(tint), CM.lintGutter(), CM.search({ top: true }),
        CM.keymap.of([{ key: "Mod-s", preventDefault: true, run: () => { saveModel(); return true; } }, ...CM.defaultKeymap, ...CM.historyKeymap, ...CM.searchKeymap]),
        CM.EditorView.updateListener.of(update => { if (update.docChanged) typed(); }),
        CM.EditorView.contentAttributes.of({ "aria-label": "the model's MJCF" }),
        CM.EditorView.theme({}, { dark: true }),
      ],
    }),
  });
  editor.view.scrollDOM.tabIndex = 0;
}

// A pause in the typing: the server compiles it; a sound model moves at once, and nothing is saved.
function typed() {
  clearTimeout(editor.timer);
  editor.timer = setTimeout(() => {
    const text = editor.view.state.doc.toString();
    byId("editor_state").textContent = "checking";
    tellServer("check", { text });
  }, 250);
}

function checked({ text, line }) {
  if (!editor.view) return;
  const doc = editor.view.state.doc, at = line && line <= doc.lines ? doc.line(line) : null;
  const changed = doc.toString() !== editor.text;
  byId("editor_state").textContent = text || (changed ? "sound; not saved yet" : "");
  byId("editor_state").classList.toggle("wrong", Boolean(text));
  const marks = text ? [{ from: at ? at.from : 0, to: at ? at.to : 0, severity: "error", message: text }] : [];
  editor.view.dispatch(CM.setDiagnostics(editor.view.state, marks));
}

function saveModel() {
  editor.text = editor.view.state.doc.toString();
  tellServer("save", { text: editor.text });
  byId("editor_state").textContent = "saved";
}

byId("model_choice").onchange = event => tellServer("choose", { name: event.target.value });
byId("edit_model").onclick = openEditor;
byId("save_model").onclick = saveModel;
