/**
 * Parts dragged to another place by a handle, with mouse, pen or finger; the layout editor's buttons do the same by key.
 *
 * dragInOrder(container, handle, keyOf, arrangement)     handle: selector, in a child of the container
 *     keyOf(child) -> key of arrangement.js, null for a child that stays
 */

export function dragInOrder(container, handle, keyOf, arrangement) {
  let key = null;
  const placeOf = (wanted) => arrangement.items.findIndex((item) => item.key === wanted);
  const middleOf = (part) => (part.getBoundingClientRect().top + part.getBoundingClientRect().bottom) / 2;

  container.addEventListener("pointerdown", (event) => {
    const held = event.button === 0 ? event.target.closest(handle) : null;
    if (held === null) return;
    key = keyOf([...container.children].find((part) => part.contains(held)));
    container.setPointerCapture(event.pointerId);
  });

  container.addEventListener("pointermove", ({ clientY }) => {
    if (key === null) return;
    const keys = [...container.children].filter((part) => keyOf(part) !== null && part.checkVisibility());
    const above = keys.filter((part) => keyOf(part) !== key && middleOf(part) < clientY).length;
    const target = keyOf(keys[above]);
    if (target !== key) arrangement.move(key, placeOf(target) - placeOf(key));
  });

  for (const end of ["pointerup", "pointercancel"])
    container.addEventListener(end, () => {
      key = null;
    });
}
