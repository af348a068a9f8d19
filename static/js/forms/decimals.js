/**
 * Numbers as people type them: a comma is a decimal mark too.
 *
 * Exports
 *   decimal(text) -> number       NaN where it is none
 *   decimals(text) -> [text]      of several, apart by spaces, semicolons or commas, as Number
 *                                 reads them: "0,05 0.1" is two
 */

const COMMA = /^[+−-]?\d*,\d+$/;

export function decimal(text) {
  const [only, ...more] = decimals(text);
  return only === undefined || more.length ? NaN : Number(only.replace("−", "-"));
}

export function decimals(text) {
  return text
    .split(/[\s;]+/)
    .flatMap((word) => (COMMA.test(word) ? [word.replace(",", ".")] : word.split(",")))
    .filter(Boolean);
}
