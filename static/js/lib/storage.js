/** What the browser remembers: choices, where it allows that, else until the page closes; and drafts of text. */

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

const drafts = new Map();

export function keepDraft(input, key) {
  input.value = drafts.get(key) ?? "";
  input.addEventListener("input", () => drafts.set(key, input.value));
  return () => {
    drafts.delete(key);
    input.value = "";
  };
}
