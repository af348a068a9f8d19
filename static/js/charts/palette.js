/**
 * The style sheet's colours for a canvas, and hatches that work without colour.
 *
 * readPalette(element) -> {font, token: colour}     of the element's theme
 * hatch(context, name, palette) -> CanvasPattern    name: "stale", "alert" or "warming"
 * watchTheme(element, changed) -> unwatch    changed() after a change of theme, and around printing, which uses the light one
 */

const TOKENS =
  "panel text dim grid trace forecast limit alert caution epsilon band cursor mark-a mark-b stale".split(" ");

export function readPalette(element) {
  const style = getComputedStyle(element);
  const palette = { font: style.fontFamily };
  for (const token of TOKENS)
    palette[token] = style.getPropertyValue(`--${token}`).trim() || "#888";
  return palette;
}

export function hatch(context, name, palette) {
  const tile = document.createElement("canvas");
  tile.width = tile.height = 8;
  const pen = tile.getContext("2d");
  pen.strokeStyle = pen.fillStyle = palette[name === "warming" ? "dim" : name];
  if (name === "warming") {
    pen.globalAlpha = 0.5;
    pen.fillRect(1, 1, 2, 2);
    pen.fillRect(5, 5, 2, 2);
  } else {
    pen.globalAlpha = name === "alert" ? 0.4 : 0.2; // an alert is seen before anything else
    pen.fillRect(0, 0, 8, 8);
    pen.globalAlpha = name === "alert" ? 0.9 : 0.8;
    pen.lineWidth = 1.6;
    pen.beginPath();
    for (const x of [-8, 0, 8]) {
      pen.moveTo(x - 1, name === "alert" ? 9 : -1);
      pen.lineTo(x + 9, name === "alert" ? -1 : 9);
    }
    pen.stroke();
  }
  return context.createPattern(tile, "repeat");
}

export function watchTheme(element, changed) {
  const print = matchMedia("print");
  const observer = new MutationObserver(changed);
  let before;
  const lighten = () => {
    before = element.dataset.theme;
    element.dataset.theme = "light";
    changed();
  };
  const restore = () => {
    if (before === undefined) delete element.dataset.theme;
    else element.dataset.theme = before;
    changed();
  };
  observer.observe(document.documentElement, { attributeFilter: ["data-theme"] });
  const life = new AbortController();
  print.addEventListener("change", changed, life);
  addEventListener("beforeprint", lighten, life);
  addEventListener("afterprint", restore, life);
  life.signal.addEventListener("abort", () => observer.disconnect());
  return () => life.abort();
}
