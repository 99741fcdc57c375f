// Documents and scene of a page: from the server's socket, or from the page itself when it was exported.
import { KEYED, withToken } from "./address.js";
import { byId } from "./dom.js";
import { EXPORTED } from "./exported.js";
import { batch, store } from "./reactive.js";
import { QUALITY } from "./stage.js";

/** @type {Record<string, (document_: any) => void>} */
const handlers = {};
/** @type {WebSocket | null} */
let socket = null;
let wait = 300;
// What to do about a connection that stays lost.
export const connection = store({ lost: "" });
const GONE = KEYED ? "If the kernel was restarted, run this cell again." : "If its command has ended, start it again.";

/**
 * What is done with the documents of one type.
 * @template {keyof Documents} K
 * @param {K} type
 * @param {(document_: Documents[K]) => void} handler
 */
export function on(type, handler) { handlers[type] = handler; }

/** @param {{ type: string }} document_ */
export function receive(document_) { batch(() => handlers[document_.type](document_)); }

export const isConnected = () => socket !== null && socket.readyState === WebSocket.OPEN;
/** @param {object} message */
export function send(message) { if (socket) socket.send(JSON.stringify(message)); }
// As when the network fails; it connects again.
export function disconnect() { if (socket) socket.close(); }

/**
 * Connect, and again whenever the connection is lost.
 * @param {import("./stage.js").Stage} stage
 * @param {() => void} opened
 */
function connect(stage, opened) {
  socket = new WebSocket(withToken("stream").replace(/^http/, "ws"));
  socket.binaryType = "arraybuffer";
  socket.onopen = opened;
  socket.onclose = async () => {
    byId("state").textContent = "connection lost, trying again";
    const answer = await fetch(withToken("style.css")).catch(() => null);
    if (answer && answer.status === 403) { byId("state").textContent = "connection lost"; connection.lost = await answer.text(); return; }  // of another session
    if (wait > 1000) connection.lost = `This page has lost its connection. ${GONE}`;
    setTimeout(() => connect(stage, opened), wait);
    wait = Math.min(2 * wait, 5000);
  };
  socket.onmessage = message => {
    connection.lost = "";
    wait = 300;  // not before: a notebook's proxy opens a socket to a server that has gone, and closes it
    if (message.data instanceof ArrayBuffer) { stage.viewer.handle_command_message(message); stage.viewer.set_dirty(); }
    else receive(JSON.parse(message.data));
  };
}

/**
 * Begin a page: from its server, or with what an exported page carries: documents in the order of `order`, once `before`
 * is done.
 * @param {import("./stage.js").Stage} stage
 * @param {() => void} opened
 * @param {string[]} order
 */
export async function start(stage, opened, order, before = async () => {}) {
  if (QUALITY === "low" || QUALITY === "none") stage.setQuality(0);
  if (!EXPORTED) { hideToken(); connect(stage, opened); return; }
  document.body.classList.add("exported");
  await unpack(stage, EXPORTED.scene);
  await before();
  for (const name of order) if (EXPORTED[name]) receive(EXPORTED[name]);
}

// The cookie has the token from now on, so the address can be seen by others; a page without one keeps it.
function hideToken() {
  if (KEYED) return;
  const address = new URL(location.href);
  address.searchParams.delete("token");
  history.replaceState(history.state, "", address);
}

/**
 * The scene of an exported page: messages behind their lengths, as base64 of gzip.
 * @param {import("./stage.js").Stage} stage
 * @param {string} text
 */
async function unpack(stage, text) {
  const whole = await inflated(text), view = new DataView(whole);
  for (let at = 0; at < whole.byteLength;) {
    const size = view.getUint32(at, true);
    stage.viewer.handle_command_bytearray(new Uint8Array(whole.slice(at + 4, at + 4 + size)));
    at += 4 + size;
  }
}

/** @param {string} text what base64 of gzip holds */
export async function inflated(text) {
  const packed = Uint8Array.from(atob(text), c => c.charCodeAt(0));
  return new Response(new Blob([packed]).stream().pipeThrough(new DecompressionStream("gzip"))).arrayBuffer();
}
