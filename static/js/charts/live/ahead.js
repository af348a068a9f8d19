/**
 * The forecast for the rest of a test card, in a strip: the band that holds 90 % of the samples to come.
 *
 * Exports
 *   createAheadBand(face, key) -> {draw(frame), extent(ahead) -> [low, high] | null}     face: of the strip's frame
 *   aheadOf(known, frames, newest) -> ahead | null    of the newest frame that has one, or the known one while it is current
 *     newest: the last frame
 *   isCurrent(ahead, t) -> whether it was made by the sample at t [s] or shortly before
 *
 * ahead   {made, t: [s], channels: {key: {low, high, predicted, possible}}, peak, why}     made: time of the sample it was made by [s];
 *         peak: {mean, low, high}, shares of the limit, of monitors that forecast only the peak, without t and channels;
 *         why: reason without a forecast
 */

const WORDS = "90 % forecast to the end of the card";
const OLDEST = 0.25; // s of flight that a forecast is shown for

export function aheadOf(known, frames, newest) {
  const frame = frames.findLast(({ ahead }) => ahead);
  const ahead = frame ? { made: frame.t, ...frame.ahead } : known;
  if (newest === undefined || newest.state !== "ok") return null;
  return isCurrent(ahead, newest.t) ? ahead : null;
}

export function isCurrent(ahead, t) {
  const age = ahead === null ? NaN : t - ahead.made;
  return age >= -1e-6 && age <= OLDEST + 1e-6;
}

export function createAheadBand(face, key) {
  const { pen, y, word } = face;

  function draw({ ahead, x, now, width }) {
    const band = ahead?.channels[key];
    if (!band) return;
    const { t } = ahead;
    const end = Math.min(x(t.at(-1)), width);
    pen.beginPath();
    for (let k = 0; k < t.length; k++) pen.lineTo(x(t[k]), y(band.high[k]));
    for (let k = t.length - 1; k >= 0; k--) pen.lineTo(x(t[k]), y(band.low[k]));
    pen.closePath();
    pen.globalAlpha = 0.28;
    pen.fillStyle = face.palette.forecast;
    pen.fill();
    pen.globalAlpha = 1;
    pen.strokeStyle = face.palette.forecast;
    pen.lineWidth = 1.2;
    pen.stroke();
    if (band.predicted !== null) face.line(x(band.predicted), face.palette.alert, [4, 3], 2);
    if (end - x(now) > face.wide(WORDS)) word(WORDS, (x(now) + end) / 2, 0.7 * face.height, face.palette.forecast);
  }

  return {
    draw,
    extent: (ahead) => {
      const band = ahead?.channels[key];
      return band ? [Math.min(...band.low), Math.max(...band.high)] : null;
    },
  };
}
