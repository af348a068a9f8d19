/**
 * What was typed and not sent outlives the view that it was typed in, as when it is drawn in other units.
 *
 * Exports
 *   keepDraft(input, key) -> clear()     key: what it is about; clear() once it was sent
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
