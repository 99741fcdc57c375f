// Colours of curves, on the dark page, and as they are on paper and on a light page.
export const BASE = "#8fa3b8", ANKLE = "#ffb454", OTHER = "#6cb6ff", SEEN = "#7ee0a1";
// Of the loads, and paler ones for the mirror's dashes, which lie over them.
export const LOADS = ["#6cb6ff", "#ffb454", "#7ee0a1", "#e58fc4", "#f3e37c"], PALE = ["#cfe6ff", "#ffe6c4", "#d4f5df", "#f6d6ea", "#fbf5cf"];
/** @type {Record<string, string>} */
export const PRINT = { "#ffb454": "#b45f06", "#6cb6ff": "#1f6fb4", "#7ee0a1": "#1a7f45", "#e58fc4": "#a8327a", "#f3e37c": "#8a7a00", "#cfe6ff": "#3b72a6", "#ffe6c4": "#94642f", "#d4f5df": "#437d5a", "#f6d6ea": "#96567a", "#fbf5cf": "#75692a", "#8fa3b8": "#5a6b7c", "#ffffff": "#14202b" };
