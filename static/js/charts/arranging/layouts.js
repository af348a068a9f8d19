/**
 * Layouts: what a view shows and how, as the parts of its address that say so. Presets, those saved by name in this
 * browser for the channels of a dictionary, and files are all such parts.
 *
 * presetsOf(strips, panels, pairs) -> {word: layout}
 * layoutNow(address) -> {name: text}, applyLayout(address, layout)     a part that is left out is the usual one
 * savedLayouts(keys) -> {name: layout}, saveLayout(keys, name, layout | null)     keys: of the channels; null deletes it
 * unknownParts(layout, {strips, panels, channels}) -> [text]     what this view does not have, or what cannot be read
 * layoutFile(keys, name, layout) -> text, layoutOf(text) -> {name, layout}     throws an Error: why it is none
 */

import { remember, remembered } from "../../lib/storage.js";
import { crossedIn } from "../cross/cross_panel.js";
import { MARGIN } from "../strips.js";
import { shownText, unknownItems } from "./arrangement.js";

const KEY = "forewarn.layouts";
const FORMAT = "forewarn_layout";
const VERSION = 1;
const PARTS = ["strips", "panels", "cross", "trail", "band", "wall"];

/** strips: of ../strips.js.   panels: Arrangement of those beside them.   pairs: of channels that are usually crossed */
export function presetsOf(strips, panels, pairs) {
  const has = (name) => panels.parts.some(({ key }) => key === name);
  const limited = strips.filter(({ risk, limits, key }) => risk || (limits !== null && key !== MARGIN));
  const analysis = { strips: shownText(strips.map(({ key }) => key)), panels: shownText(panels.parts.map(({ key }) => key).filter((key) => key !== "scene")), cross: pairs.map((pair) => pair.join(":")).join(",") };
  const minimal = { strips: shownText(limited.map(({ key }) => key)), panels: has("gauge") ? "gauge" : "" };
  return { Desk: {}, ...(has("gauge") && { Wall: { wall: "" } }), Analysis: analysis, Minimal: minimal };
}

export function layoutNow(address) {
  return Object.fromEntries(PARTS.map((name) => [name, address.get(name)]).filter(([, text]) => text !== null));
}

export function applyLayout(address, layout) {
  address.put(Object.fromEntries(PARTS.map((name) => [name, layout[name] ?? null])));
}

function all() {
  try {
    return JSON.parse(remembered(KEY) ?? "{}");
  } catch {
    return {};
  }
}

export const savedLayouts = (keys) => all()[keys.join(" ")] ?? {};

export function saveLayout(keys, name, layout) {
  const { [name]: _, ...others } = savedLayouts(keys);
  const mine = layout === null ? others : { ...others, [name]: layout };
  remember(KEY, JSON.stringify({ ...all(), [keys.join(" ")]: mine }));
}

export function layoutFile(keys, name, layout) {
  return `${JSON.stringify({ [FORMAT]: VERSION, name, channels: keys, layout }, null, 2)}\n`;
}

export function unknownParts({ strips = "", panels = "", cross = "" }, known) {
  const crossed = crossedIn(cross).flatMap(({ pair, word }) => pair?.filter((key) => !known.channels.includes(key)) ?? [word]);
  return [...new Set([...unknownItems(strips, known.strips), ...unknownItems(panels, known.panels), ...crossed])];
}

export function layoutOf(text) {
  const { [FORMAT]: version, name, layout } = plainOf(text);
  if (version !== VERSION || typeof name !== "string" || layout?.constructor !== Object) throw new Error("no layout of Forewarn: choose a file that Save as file made");
  const strange = Object.entries(layout).find(([part, value]) => !PARTS.includes(part) || typeof value !== "string");
  if (strange !== undefined) throw new Error(`its ${strange[0]} cannot be read: save it again`);
  return { name, layout };
}

function plainOf(text) {
  try {
    return JSON.parse(text) ?? {};
  } catch {
    throw new Error("no JSON: choose a file that Save as file made");
  }
}
