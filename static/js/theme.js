/**
 * Dark for the control room, light for bright rooms and paper; remembered where the browser allows.
 *
 * Exports  bindThemeButton(button)
 */

const KEY = "forewarn.theme";
const NAMES = { dark: "Dark", light: "Light" };

export function bindThemeButton(button) {
  let theme = read() === "light" ? "light" : "dark";
  const show = () => {
    document.documentElement.dataset.theme = theme;
    button.textContent = `Theme: ${NAMES[theme].toLowerCase()}`;
    button.setAttribute("aria-pressed", String(theme === "light"));
    button.setAttribute("aria-label", `Theme: ${NAMES[theme].toLowerCase()}. Press to change.`);
  };
  button.addEventListener("click", () => {
    theme = theme === "dark" ? "light" : "dark";
    write(theme);
    show();
  });
  show();
}

function read() {
  try {
    return localStorage.getItem(KEY);
  } catch {
    return null;
  }
}

function write(theme) {
  try {
    localStorage.setItem(KEY, theme);
  } catch {
    // the choice then lasts as long as the page
  }
}
