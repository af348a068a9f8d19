/** The guide follows the theme that was chosen on the page, else the machine's. */

import { remembered } from "../lib/storage.js";

const chosen = remembered("forewarn.theme");
const machine = matchMedia("(prefers-color-scheme: light)");
const show = () => {
  document.documentElement.dataset.theme = ["light", "dark"].includes(chosen) ? chosen : machine.matches ? "light" : "dark";
};
machine.addEventListener("change", show);
show();
