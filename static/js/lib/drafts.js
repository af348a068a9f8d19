/**
 * Text that was typed and not sent survives a redraw of its view, as after a change of units.
 *
 * Exports
 *   keepDraft(input, key) -> clear()     key: of the subject; clear() after sending
 */

const drafts = new Map();

export function keepDraft(input, key) {
  input.value = drafts.get(key) ?? "";
  input.addEventListener("input", () => drafts.set(key, input.value));
  return () => {
    drafts.delete(key);
    input.value = "";
  };
}
