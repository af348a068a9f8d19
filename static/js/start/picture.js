/**
 * The recorded demonstration at a glance: the limited channel, its limit, the alert and the exceedance.
 *
 * drawPicture(recording) -> <figure>
 * storyOf(recording) -> {alert, exceeded, channel, limit, lead}    its alarms; the exceeded channel, limit and lead in words
 */

import { h, svg } from "../lib/dom.js";
import { magnitudeIn } from "../lib/numbers.js";

const [WIDTH, HEIGHT, PAD] = [640, 210, 8];
const UNTIL = 3; // s

export function storyOf({ hello, messages }) {
  const alarms = messages.map(({ message }) => message.alarm).filter(Boolean);
  const [alert, exceeded] = ["risk", "limit"].map((wanted) => alarms.find(({ kind }) => kind === wanted));
  const channel = hello.channels.find(({ key }) => key === exceeded.exceedance.channel);
  const limit = magnitudeIn(channel, channel.limit);
  return { alert, exceeded, channel, limit, lead: (exceeded.t - alert.t).toFixed(2) };
}

export function drawPicture(recording) {
  const { alert, exceeded, channel, limit, lead } = storyOf(recording);
  const index = recording.hello.channels.indexOf(channel);
  const { t, y } = recording.frames.whole;
  const values = y.map((sample) => sample[index]);
  const most = 1.25 * Math.max(channel.limit, ...values.map(Math.abs));
  const x = (time) => PAD + (time / UNTIL) * (WIDTH - 2 * PAD);
  const v = (value) => HEIGHT / 2 - (value / most) * (HEIGHT / 2 - PAD);
  const points = t.flatMap((time, k) => (time <= UNTIL ? [`${x(time).toFixed(1)} ${v(values[k]).toFixed(1)}`] : []));
  const line = (name, d) => svg("path", { class: name, d });
  const word = (name, time, height, text, anchor = "start") => svg("text", { class: name, x: x(time), y: height, "text-anchor": anchor }, text);
  const side = Math.sign(exceeded.exceedance.value);
  const drawing = svg("svg", { class: "picture", viewBox: `0 0 ${WIDTH} ${HEIGHT}`, "aria-hidden": true },
    svg("rect", { class: "picture-lead", x: x(alert.t), y: 0, width: x(exceeded.t) - x(alert.t), height: HEIGHT }),
    line("picture-limit", [1, -1].map((sign) => `M${PAD} ${v(sign * channel.limit)}H${WIDTH - PAD}`).join("")),
    line("picture-trace", `M${points.join("L")}`),
    line("picture-alert", `M${x(alert.t)} 0V${HEIGHT}`),
    svg("circle", { class: "picture-exceeded", cx: x(exceeded.t), cy: v(exceeded.exceedance.value), r: 6 }),
    word("picture-word-limit", 0.05, v(channel.limit) - 7, `limit ${limit}`),
    word("picture-word-alert", alert.t - 0.04, v(-0.72 * side * channel.limit), "▲ alert", "end"),
    word("picture-word-exceeded", exceeded.t + 0.1, v(exceeded.exceedance.value) + (side < 0 ? 20 : -12), "limit exceeded"),
  );
  const caption = `Warned ${lead} s before the limit: ${channel.label} of a simulated F-16 in a rudder doublet.`;
  return h("figure", { class: "picture-figure" }, drawing, h("figcaption", {}, caption));
}
