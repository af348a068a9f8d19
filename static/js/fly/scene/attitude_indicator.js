/**
 * The newest attitude, flat and in figures, over the scene.
 *
 * createAttitudeIndicator() -> {element, figures, show(frame, hello)}     frame: null for no sample
 *
 * Pitch and bank are needed for the horizon; without them the face says that the attitude is unknown. The ball moves
 * against the lateral acceleration, or without one with the sideslip: to the side of the pedal that centres it. An angle
 * that is integrated from rates is marked with ≈.
 */

import { h, put, svg } from "../../lib/dom.js";
import { reading, shownIn } from "../../lib/numbers.js";

const DEG = 180 / Math.PI;
const PER_DEGREE = 1.4; // of pitch, in units of the face, which has a radius of 50
const STEEPEST = 60; // degrees of pitch; beyond it the horizon leaves the face
const WIDEST_BALL = { Ny: 0.2, beta: 10 / DEG }; // g and rad at the end of the tube
const ANGLE = { unit: "rad", display_unit: "°", display_factor: DEG, display_decimals: 1 };
const FIGURES = { phi: "φ", theta: "θ", psi: "ψ", beta: "β", alpha: "α" };

export function createAttitudeIndicator() {
  const ladder = [-30, -20, -10, 10, 20, 30].map((at) => rung(at));
  const moving = svg("g", svg("rect.attitude-sky", { x: -200, y: -300, width: 400, height: 300 }), svg("rect.attitude-ground", { x: -200, y: 0, width: 400, height: 300 }), svg("path.attitude-line", { d: "M-200 0H200" }), ladder);
  const pointer = svg("path.attitude-pointer", { d: "M0 -44l-5 9h10z" });
  const scale = [-60, -45, -30, -20, -10, 0, 10, 20, 30, 45, 60].map((at) => svg("path.attitude-line", { d: `M0 -49v${at % 30 === 0 ? 7 : 4}`, transform: `rotate(${at})` }));
  const ball = svg("circle.attitude-ball", { r: 4.5, cy: 58 });
  const tube = svg("g", svg("rect.attitude-tube", { x: -26, y: 52, width: 52, height: 12, rx: 6 }), svg("path.attitude-line", { d: "M-6 52v12M6 52v12" }), ball);
  const craft = svg("path.attitude-craft", { d: "M-32 0h18l5 6M32 0h-18l-5 6M-2 0h4" });
  const unknown = svg("g", { hidden: true }, svg("circle.attitude-unknown", { r: 49 }), svg("text.attitude-words", { y: -3 }, "ATTITUDE"), svg("text.attitude-words", { y: 13 }, "UNKNOWN"));
  const clip = svg("clipPath", { id: "attitude-face" }, svg("circle", { r: 49 }));
  const face = svg("g", { "clip-path": "url(#attitude-face)" }, moving);
  const known = svg("g", face, scale, pointer, craft);
  const element = svg("svg.attitude", { viewBox: "-52 -52 104 120", preserveAspectRatio: "xMinYMin", role: "img" }, clip, known, unknown, tube);
  const values = Object.fromEntries(Object.entries(FIGURES).map(([key, symbol]) => [key, { symbol, value: h("b") }]));
  const items = Object.entries(values).map(([key, { symbol, value }]) => h("span", { "data-angle": key }, `${symbol} `, value));
  const plan = h("span.attitude-plan");
  const figures = h("div.attitude-figures", items, plan);
  show(null, null);
  return { element, figures, show };

  function rung(at) {
    const y = -at * PER_DEGREE;
    return svg("g", svg("path.attitude-line", { d: `M-14 ${y}H14` }), svg("text.attitude-rung", { x: 17, y: y + 3 }, String(Math.abs(at))));
  }

  function show(frame, hello) {
    const [phi, theta, psi] = frame?.attitude ?? [null, null, null];
    const isKnown = phi !== null && theta !== null;
    element.toggleAttribute("data-unknown", !isKnown);
    known.toggleAttribute("hidden", !isKnown);
    unknown.toggleAttribute("hidden", isKnown);
    if (isKnown) {
      const pitch = Math.max(-STEEPEST, Math.min(STEEPEST, theta * DEG));
      moving.setAttribute("transform", `rotate(${-phi * DEG}) translate(0 ${pitch * PER_DEGREE})`);
      pointer.setAttribute("transform", `rotate(${-phi * DEG})`);
    }
    moveBall(frame, hello);
    const mark = frame?.integrated ? "≈ " : "";
    write("phi", phi, ANGLE, mark);
    write("theta", theta, ANGLE, mark);
    write("psi", psi === null ? null : (psi + 2 * Math.PI) % (2 * Math.PI), ANGLE, mark);
    for (const key of ["beta", "alpha"]) writeChannel(key, frame, hello);
    element.setAttribute("aria-label", isKnown ? `Attitude indicator: bank ${degrees(phi)}, pitch ${degrees(theta)}` : "Attitude unknown");
    figures.title = mark ? "≈: integrated from the rates, not measured" : "";
    put(plan, hello === null ? "" : hello.no_plan ? "no plan shown" : "translucent: as planned");
    plan.title = hello?.no_plan ?? "";
  }

  function moveBall(frame, hello) {
    const of = (key) => valueOf(key, frame, hello);
    const slip = of("Ny") === null ? (of("beta") === null ? null : of("beta") / WIDEST_BALL.beta) : -of("Ny") / WIDEST_BALL.Ny;
    ball.toggleAttribute("hidden", slip === null);
    if (slip !== null) ball.setAttribute("cx", String(20 * Math.max(-1, Math.min(1, slip))));
  }

  function write(key, value, channel, mark = "") {
    const { unit } = shownIn(channel);
    const space = unit === "°" ? "" : " ";
    const sign = value > 0 && key !== "psi" ? "+" : "";
    put(values[key].value, value === null ? "unknown" : `${mark}${sign}${reading(channel, value)}${space}${unit}`);
  }

  function writeChannel(key, frame, hello) {
    const channel = hello?.channels.find((each) => each.key === key);
    values[key].value.parentElement.hidden = channel === undefined && key === "alpha";
    write(key, valueOf(key, frame, hello), channel === undefined ? ANGLE : { ...ANGLE, display_decimals: channel.display_decimals ?? 1 });
  }
}

function valueOf(key, frame, hello) {
  const at = hello?.channels.findIndex((each) => each.key === key) ?? -1;
  return frame?.y[at] ?? null;
}

const degrees = (angle) => `${(angle * DEG).toFixed(0)}°`;
