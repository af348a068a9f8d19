/**
 * A drag that marks a stretch with the cursors A and B, in place of moving the window.
 *
 * Exports
 *   attachMarking(plots, timeWindow, {left() -> px, width() -> px}) -> {set(active)}
 */

export function attachMarking(plots, timeWindow, { left, width }) {
  let active = false;
  let from = NaN;

  const timeAt = (event) => {
    const share = (event.clientX - plots.getBoundingClientRect().left - left()) / width();
    const { start, end } = timeWindow.view();
    return share < 0 || share > 1.2 ? NaN : start + Math.min(1, share) * (end - start);
  };

  plots.addEventListener(
    "pointerdown",
    (event) => {
      const t = timeAt(event);
      if (!active || event.button !== 0 || Number.isNaN(t)) return;
      event.stopImmediatePropagation();
      plots.setPointerCapture(event.pointerId);
      from = t;
    },
    { capture: true },
  );
  plots.addEventListener("pointermove", (event) => {
    const t = timeAt(event);
    if (Number.isNaN(from) || Number.isNaN(t)) return;
    timeWindow.setMark("a", Math.min(from, t));
    timeWindow.setMark("b", Math.max(from, t));
  });
  for (const kind of ["pointerup", "pointercancel"])
    plots.addEventListener(kind, () => (from = NaN));

  return {
    set: (wanted) => {
      active = wanted;
      plots.toggleAttribute("data-marking", wanted);
    },
  };
}
