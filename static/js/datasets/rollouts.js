/**
 * Rollouts of a stored dataset.
 *
 * Exports
 *   sampleRollouts(api, id) -> Promise<[rollout]>     the first MOST of each outcome, to draw
 */

const MOST = 40;

export async function sampleRollouts(api, id) {
  const outcomes = ["unsafe", "safe"].map((outcome) =>
    api.get(`/datasets/${id}/rollouts?outcome=${outcome}&count=${MOST}`),
  );
  return (await Promise.all(outcomes)).flat();
}
