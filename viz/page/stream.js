// Where a page's scene comes from: the server's socket, or the page itself when it was exported.
"use strict";
let socket = null, wait = 300;

// Connect, and again whenever the connection is lost; the scene goes to the viewer, documents to `received`.
function connect(stage, opened, received) {
  socket = new WebSocket(withToken("stream").replace(/^http/, "ws"));
  socket.binaryType = "arraybuffer";
  socket.onopen = () => { wait = 300; opened(); };
  socket.onclose = async () => {
    byId("state").textContent = "connection lost, trying again";
    const answer = await fetch(withToken("style.css")).catch(() => null);
    if (answer && answer.status === 403) { byId("state").textContent = "connection lost"; say(await answer.text()); return; }  // of another session
    setTimeout(() => connect(stage, opened, received), wait);
    wait = Math.min(2 * wait, 5000);
  };
  socket.onmessage = message => {
    if (message.data instanceof ArrayBuffer) { stage.viewer.handle_command_message(message); stage.viewer.set_dirty(); }
    else received(JSON.parse(message.data));
  };
}

// Begin a page: from its server, or with what an exported page carries: documents in the order of `order`, once `before`
// is done.
async function start(stage, opened, received, order, before = async () => {}) {
  if (QUALITY === "low" || QUALITY === "none") stage.setQuality(0);
  const own = window.EXPORTED;
  if (!own) { hideToken(); connect(stage, opened, received); return; }
  document.body.classList.add("exported");
  await unpack(stage, own.scene);
  await before();
  for (const name of order) if (own[name]) received(own[name]);
}

// The cookie has the token from now on, so the address can be seen by others; a page without one keeps it.
function hideToken() {
  if (KEYED) return;
  const address = new URL(location.href);
  address.searchParams.delete("token");
  history.replaceState(history.state, "", address);
}

// The scene of an exported page: messages behind their lengths, as base64 of gzip.
async function unpack(stage, text) {
  const whole = await inflated(text), view = new DataView(whole);
  for (let at = 0; at < whole.byteLength;) {
    const size = view.getUint32(at, true);
    stage.viewer.handle_command_bytearray(new Uint8Array(whole.slice(at + 4, at + 4 + size)));
    at += 4 + size;
  }
}

// What base64 of gzip holds.
async function inflated(text) {
  const packed = Uint8Array.from(atob(text), c => c.charCodeAt(0));
  return new Response(new Blob([packed]).stream().pipeThrough(new DecompressionStream("gzip"))).arrayBuffer();
}
