/**
 * An example recording: the demonstration's flight as a recorder would have written it, after 5 s in trim.
 *
 * Exports
 *   scoreExample(api, recording, monitor) -> Promise<hash>    where its scoring is shown; that of the
 *       recording where no monitor is given.   recording: of the demonstration
 */

const NAME = "example-flight.csv";
const TRIM = 5; // s
const DEGREES = 180 / Math.PI;
const COLUMNS = ["t_s", "beta_deg", "p_degps", "r_degps", "ay_g", "da_deg", "dr_deg"];
const FACTORS = [DEGREES, DEGREES, DEGREES, 1, DEGREES, DEGREES];

export async function scoreExample(api, recording, monitor) {
  const id = await uploaded(api, recording);
  const path = `/recordings/${id}`;
  if (monitor === undefined) return `#${path}`;
  const { mapping, ready } = await api.get(path);
  if (!ready) await api.put(`${path}/mapping`, { mapping });
  const scorings = await api.get(`${path}/scorings`);
  const scoring = scorings.find((one) => one.monitor === monitor.id) ?? (await api.post(`${path}/scorings`, { monitor: monitor.id }));
  return `#${path}?scoring=${scoring.id}`;
}

async function uploaded(api, recording) {
  const known = (await api.get("/recordings")).find(({ name }) => name === NAME);
  if (known !== undefined) return known.id;
  const file = new Blob([csvOf(recording)]);
  return (await api.upload(`/recordings?${new URLSearchParams({ name: NAME })}`, file)).id;
}

function csvOf({ hello: { dt }, frames: { whole: { y } } }) {
  const trim = Array.from({ length: Math.round(TRIM / dt) }, () => FACTORS.map(() => 0));
  const rows = [...trim, ...y].map((sample, k) => [k * dt, ...sample.map((value, c) => value * FACTORS[c])]);
  return [COLUMNS, ...rows.map((row) => row.map((value) => Number(value.toPrecision(8))))].map((row) => `${row.join(",")}\n`).join("");
}
