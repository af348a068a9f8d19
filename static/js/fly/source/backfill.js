/**
 * Samples of a flight that the server has and this page does not: read from the flight's record and
 * drawn where they belong.
 *
 * createBackfill({api, path, insert}) -> Backfill
 *     path: of the flight.   insert(frames, complete): draws them; complete: the samples after them are on the page
 *   need(first, last)    samples first..last are missing; the newest MOST of them are read
 *   skipped              samples that could not be read
 *   clear(); hold(), release()    forget what is missing; read and draw nothing meanwhile
 */

const PAGE = 5_000; // samples a request
const MOST = 100_000;
const WAIT = 300; // ms before a request: the page that missed samples was busy

export function createBackfill({ api, path, insert }) {
  let missing = []; // [first, last], the newest range at the end
  let skipped = 0;
  let held = false;
  let turn = 0;
  let timer = 0;
  let reading = false;

  function need(first, last) {
    if (first > last) return;
    missing.push([Math.max(first, last - MOST + 1), last]);
    later();
  }

  function later() {
    clearTimeout(timer);
    if (!held && !reading && missing.length > 0) timer = setTimeout(read, WAIT);
  }

  async function read() {
    const mine = turn;
    const [first, last] = missing.pop();
    const stop = Math.min(last, first + PAGE - 1);
    reading = true;
    const frames = await ask(first, stop);
    reading = false;
    if (mine === turn) {
      if (held) missing.push([first, last]);
      else take(frames, stop, last, last - first + 1);
    }
    later();
  }

  async function ask(first, last) {
    try {
      return (await api.get(`${path}/assessments?first=${first}&last=${last}`)).frames;
    } catch {
      return [];
    }
  }

  function take(frames, stop, last, n) {
    if (frames.length === 0) {
      skipped += n;
      return;
    }
    const end = frames.at(-1).seq;
    insert(frames, end === last);
    if (end < stop) skipped += last - end;
    else if (end < last) missing.push([end + 1, last]);
  }

  function clear() {
    turn += 1;
    missing = [];
    clearTimeout(timer);
  }

  return {
    need,
    clear,
    get skipped() {
      return skipped;
    },
    hold: () => {
      held = true;
      clearTimeout(timer);
    },
    release: () => {
      held = false;
      later();
    },
  };
}
