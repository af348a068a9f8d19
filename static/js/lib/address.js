/**
 * The view in the page's address, behind the question mark: a link to it shows the same view in another browser.
 *
 * createAddress() -> Address     of the view that is open
 *   get(name) -> text | null, set(name, text | null)     null leaves it out.   write()     at once, not after a rest
 *   follow(name, apply)    apply(text | null) when put() changes it;   put({name: text | null})
 * keepWindow(address, time)    restores window and cursors of a TimeWindow (../charts/time_window.js), then keeps them
 */

const REST = 250; // ms without a change before it is written: browsers refuse hundreds of changes in a row
const PLACES = 4; // of times [s]
const partsNow = () => (location.hash || "#").split("?");
let pending = () => {};
let opened = 0; // counts views

for (const event of ["click", "pagehide"])
  addEventListener(event, () => pending(), { capture: true }); // what opens a view reads the address

addEventListener("hashchange", () => {
  opened += 1;
}, { capture: true }); // before the next view opens

export function createAddress() {
  pending();
  const [path, search = ""] = partsNow();
  const shown = new URLSearchParams(search);
  const changes = new Map();
  const followers = new Map();
  const mine = opened;
  let timer = 0;

  function write() {
    clearTimeout(timer);
    pending = () => {};
    if (mine !== opened) return; // another view is open
    const query = new URLSearchParams(partsNow()[1]);
    for (const [name, text] of changes) text === null ? query.delete(name) : query.set(name, text);
    changes.clear();
    const text = query.toString().replaceAll("%3A", ":").replaceAll("%2C", ",").replaceAll("%40", "@").replace(/=(?=&|$)/g, "");
    history.replaceState(history.state, "", text ? `${path}?${text}` : path);
  }

  function set(name, text) {
    if (shown.get(name) === text) return;
    if (text === null) shown.delete(name);
    else shown.set(name, text);
    changes.set(name, text);
    clearTimeout(timer);
    timer = setTimeout(write, REST);
    pending = write;
  }

  function put(values) {
    const changed = Object.entries(values).filter(([name, text]) => shown.get(name) !== text);
    for (const [name, text] of changed) set(name, text);
    write();
    for (const [name, text] of changed) followers.get(name)?.(text);
  }

  return { get: (name) => shown.get(name), set, write, put, follow: (name, apply) => followers.set(name, apply) };
}

export function keepWindow(address, time) {
  const numberOf = (name) => Number.parseFloat(address.get(name) ?? "");
  const textOf = (t) => (Number.isFinite(t) ? String(Number(t.toFixed(PLACES))) : null);
  const [from, to, width] = ["from", "to", "width"].map(numberOf);
  if (from < to) time.setWindow(from, to);
  else if (width > 0) time.setWidth(width);
  if (Number.isFinite(numberOf("at"))) time.setCursor(numberOf("at"));
  for (const name of ["a", "b"]) if (Number.isFinite(numberOf(name))) time.setMark(name, numberOf(name));
  return time.subscribe(() => {
    const { start, width: wide } = time.held;
    address.set("from", textOf(start));
    address.set("to", textOf(start + wide));
    address.set("width", Number.isFinite(start) || wide === time.usual ? null : textOf(wide));
    address.set("at", textOf(time.pinned));
    for (const name of ["a", "b"]) address.set(name, textOf(time.marks[name]));
  });
}
