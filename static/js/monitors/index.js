/**
 * The Monitors page: the list; #/monitors/new trains one, #/monitors/compare compares the five
 * methods, #/monitors/{id} is one monitor.
 *
 * Exports  show(element, {id, query, api, navigate}) -> {close()}
 */

import { showComparison } from "./compare_methods.js";
import { showMonitors } from "./list.js";
import { showMonitor } from "./page.js";
import { showTraining } from "./train_form.js";

const VIEWS = { new: showTraining, compare: showComparison };

export function show(element, context) {
  const view = context.id ? (VIEWS[context.id] ?? showMonitor) : showMonitors;
  return view(element, { ...context, query: context.query ?? new URLSearchParams() });
}
