// Addresses of the page's server, below that of a notebook which brings it. There, and in a frame, no cookie opens them:
// each has the session's key.
export const KEY = /** @type {any} */ (document.querySelector("meta[name=key]") || {}).content || "";
export const KEYED = window !== window.top || location.pathname !== "/";

/** @param {string} path */
export function withToken(path) {
  const address = new URL(path, document.baseURI);
  if (KEYED && KEY) address.searchParams.set("token", KEY);
  return address.href;
}
