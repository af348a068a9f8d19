/**
 * The samples of a ring buffer by pixel column: only columns that are new since the last frame are read.
 *
 * createColumns(ring, series) -> Columns     columns are numbered from time zero
 *   read(first, last, step)      finds the samples of columns first..last-1;   step: seconds a column
 *   whole()                      columns before this one do not change
 *   from(k), to(k)               samples from..to-1 of column k
 *   extents(s) -> (k, out) -> bool     least and greatest value of series s in column k; false where all are missing
 */

const SAME = 1e-9; // share by which rounding changes a step

export function createColumns(ring, series) {
  let mask = -1; // columns lie in arrays of a power of two
  let begins = new Int32Array(0);
  let ends = begins;
  let extremes = []; // of each series {low, high, whole}: columns before `whole` are known and do not change
  let [first, whole, stop] = [0, 0, 0]; // columns read: first..stop-1; those before `whole` do not change
  let [step, revision] = [NaN, -1];

  function reset(at, n, wanted) {
    if (n > mask + 1) {
      mask = 2 ** Math.ceil(Math.log2(n)) - 1;
      begins = new Int32Array(mask + 1);
      ends = new Int32Array(mask + 1);
      extremes = Array.from({ length: series }, () => ({ low: new Float32Array(mask + 1), high: new Float32Array(mask + 1), whole: 0 }));
    }
    for (const each of extremes) each.whole = at;
    first = whole = at;
    [step, revision] = [wanted, ring.revision];
  }

  function read(from, to, wanted) {
    const isSame = Math.abs(wanted - step) < SAME * step && revision === ring.revision;
    if (!isSame || from < first || from >= whole || to - from > mask + 1) reset(from, to - from, wanted);
    first = from;
    stop = to;
    let i = whole > from ? Math.max(ring.first(), ends[(whole - 1) & mask]) : ring.after(from * step);
    let isWhole = true;
    for (let k = whole; k < to; k++) {
      begins[k & mask] = i;
      i = i < ring.count() ? ring.after((k + 1) * step, i) : i;
      ends[k & mask] = i;
      isWhole &&= i < ring.count();
      if (isWhole) whole = k + 1;
    }
  }

  function extents(s) {
    const each = extremes[s];
    const { low, high } = each;
    const out = new Float64Array(2);
    for (let k = Math.max(first, each.whole); k < stop; k++) {
      ring.extent(s, Math.max(begins[k & mask], ring.first()), ends[k & mask], out);
      [low[k & mask], high[k & mask]] = out;
    }
    each.whole = whole;
    return (k, found) => {
      found[0] = low[k & mask];
      found[1] = high[k & mask];
      return found[0] <= found[1];
    };
  }

  return { read, whole: () => whole, from: (k) => begins[k & mask], to: (k) => ends[k & mask], extents };
}
