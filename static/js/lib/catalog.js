/** The server's catalog, fetched once a page, and the names in it. */

import { isLimited, limitsOf, limitText, withLimits } from "./limits.js";
import { figure, magnitudeIn, shownIn } from "./numbers.js";

let catalog = null;

export function loadCatalog(api) {
  catalog ??= api.get("/catalog").catch((error) => {
    catalog = null;
    throw error;
  });
  return catalog;
}

export function methodOf({ methods }, { predictor, score }) {
  return methods.find((method) => method.predictor.kind === predictor.kind && method.score.kind === score.kind);
}

export function methodWords(catalog, recipe) {
  const parts = ["predictor", "score"].map((part) => kindName(catalog, part, recipe[part]));
  return methodOf(catalog, recipe)?.label ?? parts.join(", ");
}

function aircraftName(catalog, part) {
  if (part?.base) return `${aircraftName(catalog, part.base)}, identified`;
  const { aircraft, nonlinear_aircraft: nonlinear, jsbsim_aircraft: jsbsim } = catalog.families;
  if (part?.kind in jsbsim.entries) return `JSBSim ${part.model}`;
  const entry = aircraft.entries[part?.kind] ?? nonlinear.entries[part?.kind];
  // an aircraft's description begins with its name: "F-104A, Mach 0.8, sea level, ...; source"
  return entry ? entry.description.split(/[,;]/)[0] : (part?.kind ?? "not recorded");
}

/** The name of the catalog's recipe of a simulated test: that of its aircraft. */
export function testModel({ families }, test = null) {
  const isOf = (family) => test?.aircraft?.kind in families[family].entries;
  if (isOf("jsbsim_aircraft")) return "jsbsim";
  return isOf("nonlinear_aircraft") ? "nonlinear" : "dataset";
}

export const testRecipe = (catalog, test) => catalog.recipes[testModel(catalog, test)];

function kindName(catalog, family, part) {
  return catalog.families[family].entries[part?.kind]?.label ?? part?.kind ?? "not recorded";
}

/** Whether the test of a monitor or a dataset can be simulated here; else it is of own or flown rollouts. */
export function isSimulated({ dataset_recipe, recipe = {} }) {
  const test = dataset_recipe ?? recipe;
  return Boolean(test.aircraft) && !test.flown;
}

/** Aircraft and manoeuvre of a monitor or a dataset. */
export function testNames(catalog, entry) {
  const { aircraft, maneuver, pilot, simulator, flown } = entry.dataset_recipe ?? entry.recipe ?? {};
  const added = flown ? " with flown flights" : "";
  if (!aircraft) return [(simulator ? `own simulator ${simulator}` : "own rollouts") + added, "not recorded"];
  const inLoop = pilot && pilot.kind !== "open_loop" ? ", pilot in the loop" : "";
  return [aircraftName(catalog, aircraft) + added, kindName(catalog, "maneuver", maneuver) + inLoop];
}

const ALTITUDE = { key: "altitude", symbol: "h", unit: "m", label: "altitude" };

const MODELS = { nonlinear: "nonlinear, six degrees of freedom", jsbsim: "JSBSim, with the flight controls of the aircraft" };

/** Facts of the model and the trim condition of a test in six degrees of freedom; none for others. */
export function modelFacts(catalog, { condition, ...test }) {
  const model = MODELS[testModel(catalog, test)];
  if (!model) return [];
  const { altitude_m: altitude, mach, load_factor: load, path_deg: path } = condition;
  const words = [`Mach ${figure(mach)}`, magnitudeIn(ALTITUDE, altitude), load > 1 ? `turn at ${figure(load)} g` : "straight flight"];
  if (path !== 0) words.push(`path ${figure(path)} deg`);
  return [["Model", model], ["Condition", words.join(", ")]];
}

export function testWords(catalog, entry) {
  const names = testNames(catalog, entry);
  return isSimulated(entry) ? names.join(", ") : names[0];
}

/** The channels of a monitor or a dataset. */
export function channelsOf(catalog, { dictionary }) {
  return dictionary?.channels ?? catalog.channels;
}

export const channelName = ({ symbol, label }) => (label === symbol ? symbol : `${symbol} ${label}`);

/** By channel; of a monitor or a dataset that was not simulated, too. Null where failures are known by label only. */
export function ownLimits({ limits, dataset_recipe, recipe = dataset_recipe }) {
  if (typeof limits === "string") return null;
  return limits ?? recipe?.limits ?? null;
}

export function limitWords({ channels }, limits) {
  const words = withLimits(channels, limits).filter(isLimited).map((channel) => {
    const [low, high] = limitsOf(channel);
    return low === -high ? `|${channel.symbol}| < ${magnitudeIn(channel, high)}` : `${channel.symbol} ${limitText(channel, [low, high])}`;
  });
  return words.join(", ") || "not recorded";
}

/** The limits of a monitor or a dataset in words, or that it has none. */
export function limitsOfMonitor(catalog, monitor) {
  if (typeof monitor.limits === "string") return `none: failures are known by label only (${monitor.limits})`;
  return limitWords({ channels: channelsOf(catalog, monitor) }, ownLimits(monitor));
}

export function plainWords(description) {
  return description.replaceAll("`", "").replaceAll("+-", "±");
}

/** Name and flight condition of an aircraft: the start of its description, before the source. */
export function aircraftCondition(entry) {
  return entry.description.split(";")[0].split(", ").slice(0, 4).join(", ");
}

export function choiceName(schema, value) {
  return schema["x-labels"]?.[schema.enum.indexOf(value)] ?? String(value);
}

/** The channel whose value a parameter has; undefined for none. */
export function channelOf(key, schema, catalog) {
  return catalog.known_channels.find((known) => known.key === key && known.unit === schema["x-unit"]);
}

export function labelOf(key, schema, catalog) {
  const channel = channelOf(key, schema, catalog);
  if (channel) return { text: channel.label, symbol: channel.symbol, unit: shownIn(channel).unit };
  return { text: schema.title, symbol: "", unit: schema["x-unit"] ?? "" };
}
