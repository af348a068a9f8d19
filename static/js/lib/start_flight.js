/**
 * Starting a flight; asks first where its monitor is of no use.
 *
 * Exports
 *   startFlight({api, navigate}, request) -> Promise    opens the flight's page; rejects with the
 *       server's sentence, also while the question is open
 */

import { askToConfirm } from "./view_states.js";

const USELESS = "urn:forewarn:useless-monitor";

export async function startFlight({ api, navigate }, request) {
  const start = async (order) => {
    const flight = await api.post("/flights", { wait_for_viewer: true, ...order });
    navigate(`#/fly/${flight.id}`);
  };
  try {
    await start(request);
  } catch (error) {
    if (error.kind === USELESS)
      askToConfirm(
        "Fly with a monitor that is of no use?",
        error.message,
        "Fly anyway",
        () => start({ ...request, accept_useless: true }),
      );
    throw error;
  }
}
