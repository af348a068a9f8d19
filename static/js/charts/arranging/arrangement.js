/**
 * Which of a view's parts are shown, in which order, how large and on which scale; kept in its address.
 *
 * createArrangement(address, name, usual, parts) -> Arrangement
 *     address: see ../../lib/address.js; name: in it.   usual: [{key, as}] from top to bottom
 *     parts: [{key, label, ways, factor, unit}]; ways: what `as` may be, "shown" the first, "hidden" the last; factor: of a scale in `unit`, null for none
 *   items        [{key, as, size, range: [low, high] | null}]; size: of SIZES, range: in the part's own unit
 *   shown(key) -> as      as it stands on the page: a part that must be seen is never hidden or reduced
 *   force(keys)           parts that must be seen: they exceed a limit
 *   change(key, {as, size, range}), move(key, by)
 *   subscribe(listener)   called after each change
 * shownText(keys)       these parts, shown as usual
 * unknownItems(text, keys) -> [text]    what an arrangement of these parts leaves out
 *
 * As text: the shown parts in order, as "Ny*2@-0.5:0.5,.beta": "." before a number in place of a strip.
 */

export const SIZES = [0.5, 1, 2, 3];
const ITEM = /^(\.?)([^*@,]+)(?:\*([\d.]+))?(?:@([^:]+):(.+))?$/;
const RESERVED = /[.*!'()~]/g;

export function createArrangement(address, name, usual, parts) {
  const listeners = new Set();
  const partOf = new Map(parts.map((part) => [part.key, part]));
  const plain = ({ key, as }) => ({ key, as, size: 1, range: null });
  const usualText = textOf(usual.map(plain));
  let forced = new Set();
  const own = {
    parts,
    items: [],
    shown: (key) => (forced.has(key) ? "shown" : own.items.find((item) => item.key === key).as),
    isForced: (key) => forced.has(key) && own.items.find((item) => item.key === key).as !== "shown",
    force: (keys) => {
      const now = keys.filter((key) => partOf.has(key));
      if (now.length === forced.size && now.every((key) => forced.has(key))) return;
      forced = new Set(now);
      changed();
    },
    change: (key, given) => {
      Object.assign(own.items.find((item) => item.key === key), given);
      keep();
    },
    move: (key, by) => {
      const from = own.items.findIndex((item) => item.key === key);
      const [item] = own.items.splice(from, 1);
      own.items.splice(Math.max(0, from + by), 0, item);
      keep();
    },
    subscribe: (listener) => listeners.add(listener),
  };
  address.follow(name, (text) => {
    read(text);
    changed();
  });
  read(address.get(name));
  return own;

  function read(text) {
    const wanted = text === null ? null : itemsOf(text).filter(({ key }) => partOf.has(key));
    if (wanted === null || (wanted.length === 0 && text !== "")) {
      own.items = usual.map(plain);
      return;
    }
    const first = new Map(wanted.map((item) => [item.key, item]));
    for (const item of first.values()) if (!partOf.get(item.key).ways.includes(item.as)) item.as = "shown";
    const rest = usual.filter(({ key }) => !first.has(key)).map(({ key }) => plain({ key, as: "hidden" }));
    own.items = [...first.values(), ...rest];
  }

  function keep() {
    const text = textOf(own.items);
    address.set(name, text === usualText ? null : text);
    changed();
  }

  function changed() {
    for (const listener of listeners) listener();
  }
}

export function unknownItems(text, keys) {
  const isKnown = (word) => itemsOf(word).some(({ key }) => keys.includes(key));
  return text.split(",").filter((word) => word !== "" && !isKnown(word)).map((word) => itemsOf(word)[0]?.key ?? word);
}

export const shownText = (keys) => textOf(keys.map((key) => ({ key, as: "shown", size: 1, range: null })));

function textOf(items) {
  return items.filter(({ as }) => as !== "hidden").map(({ key, as, size, range }) => [
    as === "number" ? "." : "",
    encodeURIComponent(key).replace(RESERVED, (sign) => `%${sign.charCodeAt(0).toString(16)}`),
    size === 1 ? "" : `*${size}`,
    range === null ? "" : `@${range.join(":")}`,
  ].join("")).join(",");
}

/** Those that can be read. */
function itemsOf(text) {
  return text.split(",").flatMap((word) => {
    const [, mark, code, size = "1", low, high] = ITEM.exec(word) ?? [];
    const range = low === undefined ? null : [Number(low), Number(high)];
    if (code === undefined || !SIZES.includes(Number(size)) || (range !== null && !(range[0] < range[1] && range.every(Number.isFinite)))) return [];
    try {
      return [{ key: decodeURIComponent(code), as: mark ? "number" : "shown", size: Number(size), range }];
    } catch {
      return [];
    }
  });
}
