// What an exported page carries; null where a server answers.
const box = document.getElementById("exported");
export const EXPORTED = box && JSON.parse(box.textContent || "null");
