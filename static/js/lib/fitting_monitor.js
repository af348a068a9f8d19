/**
 * Which monitor a page begins with: the newest that can do what is asked for, one without warnings first.
 *
 * Exports
 *   canFly(monitor) -> boolean       its planned test can be simulated here
 *   fittingMonitor(monitors, fits = canFly) -> monitor | undefined     of the server's list, newest first
 */

export function canFly({ dataset_recipe: test }) {
  return Boolean(test?.aircraft);
}

export function fittingMonitor(monitors, fits = canFly) {
  const fitting = monitors.filter(fits);
  return fitting.find(({ warnings }) => warnings.length === 0) ?? fitting[0] ?? monitors[0];
}
