// What is asked of the server beside motions.
import { KEY } from "./address.js";
import { busyWith, say } from "./dom.js";
import { effect } from "./reactive.js";
import { page } from "./store.js";
import { connection, isConnected, send } from "./stream.js";

export const OTHER_SESSION = "This page belongs to an earlier session: open the address that the command printed.";
export const STARTED_AGAIN = "The command was restarted: earlier recordings, ticks and fits are gone.";

/** @type {(type: string, more?: object, working?: string) => void} `working` says what is done until the answer comes */
export function tellServer(type, more = {}, working = "") {
  if (!["open", "check"].includes(type)) complain("");
  if (!isConnected()) return;
  send({ type, key: KEY, ...more });
  if (working) busyWith(working);
}

/** @param {string} text in place of what was asked for; nothing waits for that any longer */
export function complain(text) { Object.assign(page, { complaint: text, problem: "" }); busyWith(""); }
effect(() => say([connection.lost, page.broken, page.problem, page.complaint].filter(Boolean).join("\n")));
