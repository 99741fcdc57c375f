// Files in: what is dropped on the page, or chosen, goes to the server.
import { KEY, withToken } from "./address.js";
import { busyWith, byId } from "./dom.js";
import { EXPORTED } from "./exported.js";
import { OTHER_SESSION, complain, tellServer } from "./server.js";
import { page } from "./store.js";

/** @typedef {{ file: File, name: string }} Named */
/** @param {Named[]} files */
export async function upload(files) {
  complain("");
  const send = async (/** @type {Named} */ { file, name }) => {
    busyWith(`reading ${name}`);
    const answer = await fetch(withToken(`upload?name=${encodeURIComponent(name)}`), { method: "POST", headers: { "X-Key": KEY }, body: file }).catch(() => null);
    const known = answer && (answer.headers.get("Content-Type") || "").startsWith("application/json");
    const said = known ? await answer.json() : { text: answer && answer.status === 403 ? OTHER_SESSION : `${name} could not be sent; it may be larger than 64 MB.` };
    if (said.text) complain([page.complaint, said.text].filter(Boolean).join("\n"));
    return { names: said.names || [], session: said.session };
  };
  const answers = [], isZip = (/** @type {Named} */ { name }) => name.toLowerCase().endsWith(".zip");
  for (const zip of files.filter(isZip)) {  // one of them may be a session, which replaces all else
    const answer = await send(zip);
    if (answer.session) { tellServer("open_session", {}, "opening the session"); return; }
    answers.push(answer);
  }
  answers.push(...await Promise.all(files.filter(file => !isZip(file)).map(send)));
  const names = answers.flatMap(answer => answer.names);
  if (names.length) tellServer("open", { names }); else busyWith("");
}

/** @param {Iterable<any>} items what was dropped: files, and whole folders of them */
export async function dropped(items) {
  /** @type {Named[]} */
  const found = [];
  /** @type {(entry: any, path: string) => Promise<void>} */
  async function walk(entry, path) {
    if (entry.isFile) found.push({ name: path + entry.name, file: await new Promise((done, failed) => entry.file(done, failed)) });
    else {
      const reader = entry.createReader();
      for (;;) {
        const some = await new Promise((done, failed) => reader.readEntries(done, failed));
        if (!some.length) break;
        for (const one of some) await walk(one, `${path}${entry.name}/`);
      }
    }
  }
  const entries = [...items].map(item => (item.webkitGetAsEntry ? item.webkitGetAsEntry() : null));
  const plain = [...items].map(item => (item.getAsFile ? item.getAsFile() : null));
  for (const [k, entry] of entries.entries()) { if (entry) await walk(entry, ""); else if (plain[k]) found.push({ name: plain[k].name, file: plain[k] }); }
  await upload(found);
}

if (!EXPORTED) {
  addEventListener("dragover", event => { event.preventDefault(); document.body.classList.add("dropping"); });
  addEventListener("dragleave", event => { if (!event.relatedTarget) document.body.classList.remove("dropping"); });
  addEventListener("drop", event => { event.preventDefault(); document.body.classList.remove("dropping"); if (event.dataTransfer) dropped(event.dataTransfer.items); });
  for (const [id, picker] of [["choose_files", "files"], ["choose_folder", "folder"]]) {
    byId(id).onclick = () => byId(picker).click();
    byId(picker).onchange = (/** @type {any} */ event) => upload([...event.target.files].map(file => ({ file, name: file.webkitRelativePath || file.name })));
  }
}
