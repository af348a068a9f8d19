/**
 * The value axis of one strip: a round range that follows the data without jumping.
 *
 * It widens as soon as a value does not fit. It narrows only after the values have needed much less
 * for some seconds. Limits are always in view.
 *
 * createValueAxis({limits, factor, leastHeight, narrowAfter, spare, isAbsolute}) -> Axis     limits: [low, high] | null
 *     factor: multiplies the numbers shown.   narrowAfter: [ms] before a range that is too wide narrows
 *     spare: share of the range that the values must need, else it is too wide; 1: the range is theirs alone, however it came about
 *     isAbsolute: zero need not be in the first range
 * createRiskAxis() -> the same for risk, 0..1, by its square root: small risks stay legible
 * roundStep(least) -> number, of 1, 2, 5, 10, ...;   roundTicks(low, high, step) -> [its multiples]
 *
 * Axis  {low, high, step, roomy}    roomy: the range is too wide
 *   fix([low, high] | null)    this range, with the limits, whatever the values are; null: follow them again
 *   beyond       whether a visible value lies outside of a fixed range
 *   fit(low, high, wall)   the least and greatest visible value (low > high: none), wall clock [ms]
 *   share(value) -> 0 at the bottom .. 1 at the top; outside the range beyond
 */

const ROOMY = 0.45; // share of the range that the values must need
const LEAST_SHARE = 0.01; // of the values, as height

export function createValueAxis({
  limits = null,
  factor = 1,
  leastHeight = 0.02,
  narrowAfter = 4000,
  spare = ROOMY,
  isAbsolute = false,
}) {
  let roomySince = null;
  let isUnset = isAbsolute && limits === null;
  let fixed = null;
  const axis = {
    ...range(...(limits ?? [0, 0]).map((limit) => (Number.isFinite(limit) ? limit : 0))),
    factor,
    get roomy() {
      return roomySince !== null;
    },
    beyond: false,
    fit,
    fix,
    share,
    setLimits: (given) => {
      limits = given;
      Object.assign(axis, range(...(fixed ?? [axis.low, axis.high])));
    },
  };

  function range(low, high) {
    const [least, greatest] = (limits ?? [-Infinity, Infinity]).map((limit, side) => {
      if (!Number.isFinite(limit)) return side === 0 ? Infinity : -Infinity;
      return limit + (side === 0 ? -1 : 1) * spareBeyond(limit);
    });
    [low, high] = [Math.min(low, least), Math.max(high, greatest)];
    const height = Math.max(leastHeight, LEAST_SHARE * Math.max(Math.abs(low), Math.abs(high)));
    if (high - low < height) [low, high] = [(low + high - height) / 2, (low + high + height) / 2];
    const step = roundStep((factor * (high - low)) / 3) / factor;
    return {
      low: low === least ? low : Math.floor(low / step + 1e-6) * step,
      high: high === greatest ? high : Math.ceil(high / step - 1e-6) * step,
      step,
    };
  }

  function spareBeyond(limit) {
    const width = limits[1] - limits[0];
    return Number.isFinite(width) ? 0.075 * width : 0.15 * Math.abs(limit) || leastHeight;
  }

  function fix(given) {
    if (String(given) === String(fixed)) return;
    fixed = given;
    roomySince = null;
    isUnset = fixed === null;
    if (fixed !== null) Object.assign(axis, range(...fixed));
  }

  function fit(low, high, wall) {
    axis.beyond = fixed !== null && (low < axis.low || high > axis.high);
    if (!(low <= high) || fixed !== null) return;
    const margin = 0.05 * (high - low);
    if (isUnset) Object.assign(axis, range(low - margin, high + margin));
    isUnset = false;
    if (low < axis.low || high > axis.high) {
      Object.assign(axis, range(Math.min(low - margin, axis.low), Math.max(high + margin, axis.high)));
      roomySince = null;
      return;
    }
    const tight = range(low - margin, high + margin);
    const isRoomy = tight.high - tight.low < (1 - 1e-9) * spare * (axis.high - axis.low);
    roomySince = isRoomy ? (roomySince ?? wall) : null;
    if (!isRoomy || wall - roomySince <= narrowAfter) return;
    Object.assign(axis, tight);
    roomySince = null;
  }

  function share(value) {
    return (value - axis.low) / (axis.high - axis.low);
  }

  return axis;
}

export function createRiskAxis() {
  const share = (value) => Math.sqrt(Math.max(0, value));
  return { low: 0, high: 1, step: 0.5, roomy: false, beyond: false, fit: () => {}, fix: () => {}, share };
}

export const axisTicks = ({ low, high, step }) => roundTicks(low, high, step);

export function roundTicks(low, high, step) {
  const [first, last] = [Math.ceil(low / step - 1e-6), Math.floor(high / step + 1e-6)];
  return Array.from({ length: Math.max(0, last - first + 1) }, (_, k) => (first + k) * step);
}

/** Least of 1, 2, 5, 10, ... that is not below `least`. */
export function roundStep(least) {
  const power = 10 ** Math.floor(Math.log10(least));
  const digit = [1, 2, 5, 10].find((candidate) => candidate * power >= least * (1 - 1e-9));
  return (digit ?? 10) * power;
}
