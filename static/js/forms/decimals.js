/**
 * Numbers as people type them: a comma is a decimal mark too.
 *
 * decimal(text) -> number, NaN where it is none.   decimals("0,05 0.1") -> ["0.05", "0.1"], as Number reads them
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
