/**
 * The Monitors page: #/monitors lists; #/monitors/new trains one, #/monitors/combine combines several,
 * #/monitors/compare compares five methods, #/monitors/sweep lead times; #/monitors/{id} is one monitor.
 *
 * Exports  show(element, {id, query, api, navigate}) -> {close()}
 */

import { showCombining } from "./combine_form.js";
import { showComparison } from "./compare_methods.js";
import { showSweep } from "./lead_sweep.js";
import { showMonitors } from "./list.js";
import { showMonitor } from "./page.js";
import { showTraining } from "./train_form.js";

const VIEWS = { new: showTraining, combine: showCombining, compare: showComparison, sweep: showSweep };

export function show(element, context) {
  const view = context.id ? (VIEWS[context.id] ?? showMonitor) : showMonitors;
  return view(element, { ...context, query: context.query ?? new URLSearchParams() });
}
