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
  const label = labelNow();  // also where no button is there yet
  for (const b of document.querySelectorAll("button.theme")) b.textContent = label;
});

function labelNow() { return isLight() ? "Dark page" : "Light page"; }

/** @param {HTMLElement} parent */
export function themeButton(parent) {
  const b = button(parent, labelNow(), () => {
    theme.chosen = isLight() ? "dark" : "light";
    try { localStorage.setItem("fasbody_theme", theme.chosen); } catch { /* not allowed */ }
  }, "light or dark colours; at first those of the system");
  b.className = "theme";
}
