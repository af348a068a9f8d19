"""Columns of the ring buffer that are kept between frames: the same as read again."""

from tests.browser.strips import Open

CODE = """async () => {
  const { createRingBuffer } = await import("/static/js/charts/live/ring_buffer.js");
  const { createColumns } = await import("/static/js/charts/live/columns.js");
  const ring = createRingBuffer({ series: 2, capacity: 4096 });
  const columns = createColumns(ring, 2);
  let seed = 1;
  const random = () => (seed = (seed * 16807) % 2147483647) / 2147483647;
  const row = () => [random() < 0.05 ? NaN : random() - 0.5, random()];
  const [kept, anew] = [new Float64Array(2), new Float64Array(2)];
  let [t, compared, reads] = [0, 0, 0];
  const { extent } = ring;
  ring.extent = (...given) => { reads += 1; return extent(...given); };
  const wrong = [];
  const counts = [];
  for (let frame = 0; frame < 400; frame++) {
    const n = Math.floor(random() * 40);
    for (let k = 0; k < n; k++) ring.push((t += random() < 0.02 ? 3 : 0.02), row());
    if (frame === 150) {
      const between = ring.time(ring.count() - 31) + 0.001;
      ring.insert(ring.count() - 30, [{ t: between, row: [9, 9], flags: 0 }], 0);
    }
    if (frame === 250) {
      ring.clear();
      t = 0;
      for (let k = 0; k < 900; k++) ring.push((t += 0.02), row());
    }
    const step = (frame < 200 ? 0.11 : 0.07) * (1 + 1e-14 * frame);
    const last = Math.round(t / step) + 2 - (frame % 90 === 80 ? 300 : 0);
    const first = last - 120;
    columns.read(first, last, step);
    reads = 0;
    const read = [0, 1].map((s) => (frame % 3 === 1 && s === 1 ? null : columns.extents(s)));
    counts.push(reads);
    for (let k = first; k < last; k++) {
      const [from, to] = [Math.max(ring.first(), columns.from(k)), columns.to(k)];
      const edges = [k, k + 1].map((edge) => ring.after(edge * step));
      read.forEach((series, s) => {
        if (series === null || to <= from) return;
        const found = series(k, kept);
        const known = extent(s, from, to, anew);
        compared += 1;
        const isSame = found === known && (!known || (kept[0] === anew[0] && kept[1] === anew[1]));
        if (!isSame || Math.abs(from - edges[0]) > 1 || Math.abs(to - edges[1]) > 1)
          wrong.push([frame, s, k, from, to, edges, [...kept], [...anew]]);
      });
    }
  }
  counts.sort((a, b) => a - b);
  return [wrong.slice(0, 3), compared, counts[counts.length >> 1]];
}"""


def test_columns_kept_between_frames_are_those_read_anew_and_few_are_read(strips: Open) -> None:
    wrong, compared, usual = strips().evaluate(CODE)
    assert wrong == []
    assert compared > 20_000
    assert usual < 30  # of 240
