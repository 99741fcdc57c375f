// Light or dark: as the system has it, until the button says otherwise; the foot's own ground stays dark.
import { button } from "./dom.js";
import { effect, store } from "./reactive.js";
const system = matchMedia("(prefers-color-scheme: light)");
const theme = store({ chosen: "", light: system.matches });
try { theme.chosen = localStorage.getItem("fasbody_theme") || ""; } catch { /* not allowed */ }
system.onchange = () => { theme.light = system.matches; };

export const isLight = () => (theme.chosen ? theme.chosen === "light" : theme.light);
effect(() => {
  document.documentElement.style.colorScheme = theme.chosen;
  for (const b of document.querySelectorAll("button.theme")) label(b);
});

/** @param {Element} b */
function label(b) { b.textContent = isLight() ? "Dark page" : "Light page"; }

/** @param {HTMLElement} parent */
export function themeButton(parent) {
  const b = button(parent, "", () => {
    theme.chosen = isLight() ? "dark" : "light";
    try { localStorage.setItem("fasbody_theme", theme.chosen); } catch { /* not allowed */ }
  }, "light or dark colours; at first those of the system");
  b.className = "theme";
  label(b);
}
