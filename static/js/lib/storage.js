/**
 * What the browser remembers of a choice, where it allows that.
 *
 * Exports
 *   remembered(key) -> string | null
 *   remember(key, value)     where it is forbidden the choice lasts as long as the page
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
