export { EditorState, Compartment } from "@codemirror/state";
export { EditorView, keymap, lineNumbers, highlightActiveLine, drawSelection } from "@codemirror/view";
export { defaultKeymap, history, historyKeymap, indentWithTab } from "@codemirror/commands";
export { syntaxHighlighting, HighlightStyle, bracketMatching, foldGutter } from "@codemirror/language";
export { xml } from "@codemirror/lang-xml";
export { setDiagnostics, lintGutter } from "@codemirror/lint";
export { searchKeymap, search } from "@codemirror/search";
export { tags } from "@lezer/highlight";
