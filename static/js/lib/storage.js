/**
 * Choices that the browser remembers, where it allows that.
 *
 * Exports
 *   remembered(key) -> string | null
 *   remember(key, value)     where storage is forbidden, the choice lasts until the page closes
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
