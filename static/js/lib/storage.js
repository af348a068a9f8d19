/**
 * What the browser remembers: choices, where it allows that, else until the page closes; the theme.
 *
 * followTheme(show)    sets the theme and calls show(theme) now and at each change: the machine's until the user chooses
 */

export function remembered(key) {
  try {
    return localStorage.getItem(key);
  } catch {
    return null;
  }
}

export function remember(key, value) {
  try {
    localStorage.setItem(key, value);
  } catch {
    // forbidden
  }
}

const THEME_KEY = "forewarn.theme";
const machine = matchMedia("(prefers-color-scheme: light)");
let chosen = remembered(THEME_KEY);
let showTheme = (_theme) => {};

export function currentTheme() {
  return ["light", "dark"].includes(chosen) ? chosen : machine.matches ? "light" : "dark";
}

export function chooseTheme(theme) {
  chosen = theme;
  remember(THEME_KEY, theme);
  applyTheme();
}

export function followTheme(show = (_theme) => {}) {
  showTheme = show;
  machine.addEventListener("change", applyTheme);
  applyTheme();
}

function applyTheme() {
  document.documentElement.dataset.theme = currentTheme();
  showTheme(currentTheme());
}
