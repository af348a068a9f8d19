/**
 * The view in the page's address, behind the question mark: a link to it shows the same view in another browser.
 *
 * createAddress() -> Address     of the view that is open
 *   get(name) -> text | null, set(name, text | null)     null leaves it out.   write()     at once, not after a rest
 *   follow(name, apply)    apply(text | null) when put({name: text | null}), the browser's back, or a link changes it
 *   step(), back(), forward()    step: the browser's back returns to the view as it was so far.   back, forward: between steps only
 * keepWindow(address, time)    restores window and cursors of a TimeWindow (../charts/time_window.js), then keeps them
 */

const REST = 250; // ms without a change before it is written: browsers refuse hundreds of changes in a row
const PLACES = 4; // of times [s]
const WINDOW = ["from", "to", "width", "at", "a", "b"];
const partsOf = (hash) => [hash.split("?")[0] || "#", new URLSearchParams(hash.split("?")[1])];
const stepNow = () => history.state?.step ?? 0;
const changes = new Map();
const followers = new Map();
let [path, shown] = partsOf(location.hash); // of the view that is open
let opened = 0; // counts views
let reached = stepNow(); // newest step of the view
let timer = 0;

for (const event of ["click", "pagehide"])
  addEventListener(event, write, { capture: true }); // what opens a view reads the address

addEventListener("popstate", isFollowed); // also between steps of the same address, of which the last is not written yet
addEventListener("hashchange", (event) => {
  if (isFollowed()) return event.stopImmediatePropagation();
  [path, shown] = partsOf(location.hash);
  opened += 1;
  followers.clear();
  reached = stepNow();
}, { capture: true }); // before the next view opens

/** Whether only what the open view follows has changed; it has then. */
function isFollowed() {
  clearTimeout(timer);
  changes.clear();
  const [to, query] = partsOf(location.hash);
  const names = [...new Set([...shown.keys(), ...query.keys()])].filter((name) => shown.get(name) !== query.get(name));
  if (to !== path || !names.every((name) => followers.has(name))) return false;
  shown = query;
  tell(names);
  return true;
}

function tell(names) {
  const first = new Map(names.map((name) => [followers.get(name), name]));
  for (const [apply, name] of first) apply?.(shown.get(name));
}

function write() {
  clearTimeout(timer);
  const [now, query] = partsOf(location.hash);
  if (changes.size === 0 || now !== path) return;
  for (const [name, text] of changes) text === null ? query.delete(name) : query.set(name, text);
  changes.clear();
  const text = query.toString().replaceAll("%3A", ":").replaceAll("%2C", ",").replaceAll("%40", "@").replace(/=(?=&|$)/g, "");
  history.replaceState(history.state, "", text ? `${path}?${text}` : path);
}

export function createAddress() {
  write();
  [path, shown] = partsOf(location.hash);
  const mine = opened;

  function set(name, text) {
    if (mine !== opened || shown.get(name) === text) return; // or another view is open
    if (text === null) shown.delete(name);
    else shown.set(name, text);
    changes.set(name, text);
    clearTimeout(timer);
    timer = setTimeout(write, REST);
  }

  function put(values) {
    const changed = Object.entries(values).filter(([name, text]) => shown.get(name) !== text);
    for (const [name, text] of changed) set(name, text);
    write();
    tell(changed.map(([name]) => name));
  }

  function step() {
    if (mine !== opened) return;
    write();
    reached = stepNow() + 1;
    history.pushState({ step: reached }, "");
  }

  function move(by) {
    write();
    if (stepNow() + by >= 0 && stepNow() + by <= reached) history.go(by);
  }

  return { get: (name) => shown.get(name), set, write, put, follow: (name, apply) => followers.set(name, apply), step, back: () => move(-1), forward: () => move(1) };
}

export function keepWindow(address, time) {
  const numberOf = (name) => Number.parseFloat(address.get(name) ?? "");
  const textOf = (t) => (Number.isFinite(t) ? String(Number(t.toFixed(PLACES))) : null);
  const first = time.held;
  let steps = 0;
  restore();
  for (const name of WINDOW) address.follow(name, restore);
  return time.subscribe(() => {
    const isStep = time.steps > steps;
    if (isStep) address.step();
    steps = Math.max(steps, time.steps);
    const { start, width: wide } = time.held;
    address.set("from", textOf(start));
    address.set("to", textOf(start + wide));
    address.set("width", Number.isFinite(start) || wide === time.usual ? null : textOf(wide));
    address.set("at", textOf(time.pinned));
    for (const name of ["a", "b"]) address.set(name, textOf(time.marks[name]));
    if (isStep) address.write();
  });

  function restore() {
    const [from, to, width, at, a, b] = WINDOW.map(numberOf);
    steps = Infinity; // what is restored is no step
    if (from < to) time.setWindow(from, to);
    else if (width > 0) time.setWidth(width);
    else if (Number.isFinite(first.start)) time.setWindow(first.start, first.start + first.width);
    else time.goLive();
    time.setCursor(at);
    time.setMark("a", a);
    time.setMark("b", b);
    steps = time.steps;
  }
}
