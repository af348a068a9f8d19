"""The ring buffer behind the live strips, against brute force and over hours."""

from tests.browser.strips import Open, run


def test_extents_and_flags_equal_brute_force_after_wrapping(strips: Open) -> None:
    wrong = run(
        strips(),
        """
        const ring = h.createRingBuffer({ series: 2, capacity: 8192 });
        let seed = 7;
        const random = () => (seed = (seed * 16807) % 2147483647) / 2147483647;
        const kept = [];
        for (let i = 0; i < 21011; i++) {
          const row = [random() < 0.02 ? NaN : Math.fround(random() - 0.5), Math.fround(random())];
          const flags = random() < 0.001 ? 1 + Math.floor(4 * random()) : 0;
          ring.push(i / 50, row, flags);
          kept.push([row, flags]);
        }
        const out = new Float64Array(2);
        let wrong = 0;
        for (let trial = 0; trial < 400; trial++) {
          const first = ring.first();
          const from = first + Math.floor(random() * (ring.count() - first));
          const to = from + 1 + Math.floor(random() ** 3 * (ring.count() - from - 1));
          for (const s of [0, 1]) {
            const known = kept.slice(from, to).filter(([row]) => !Number.isNaN(row[s]));
            const values = known.map(([row]) => row[s]);
            const any = ring.extent(s, from, to, out);
            if (any !== values.length > 0) wrong += 1;
            if (any && out[0] !== Math.min(...values)) wrong += 1;
            if (any && out[1] !== Math.max(...values)) wrong += 1;
          }
          const flags = kept.slice(from, to).reduce((all, [, f]) => all | f, 0);
          if (ring.flags(from, to) !== flags) wrong += 1;
          const t = kept.length / 50 * random();
          let after = first;
          while (after < ring.count() && after / 50 < t) after += 1;
          if (ring.after(t) !== after) wrong += 1;
        }
        return [wrong, ring.first(), ring.count(), ring.capacity];
        """,
    )
    assert wrong == [0, 21011 - 8192, 21011, 8192]


def test_a_time_that_does_not_rise_is_not_stored(strips: Open) -> None:
    page = strips()
    assert run(page, "return h.feed(0, 1, 1000)") == 50
    assert run(page, "return h.feed(0, 1, 1000)") == 0
    assert run(page, "return h.chart.push({ ...h.frame(2), t: NaN }, 1000)") == 0
    assert run(page, "return h.chart.ring.count()") == 50


def test_one_missing_sample_in_an_hour_is_still_marked(strips: Open) -> None:
    page = strips("dt=0.1")
    count = "h.timeline.setWindow(0, 3000); h.draw(1000); return h.pixels('risk', 'band', 90)[0]"
    whole = run(page, "h.feed(0, 3000, 1000);" + count)
    broken = run(
        page, "h.chart.clear(); h.feed(0, 1500, 1000); h.feed(1500.2, 3000, 1000);" + count
    )
    assert broken > whole


def test_hours_of_samples_leave_memory_flat(strips: Open) -> None:
    """An hour is kept; one number more of each sample of another would take 0.5 MB."""
    page = strips("seconds=20&dt=0.05&history=72000")
    session = page.context.new_cdp_session(page)

    def heap_after(hour: int) -> float:
        run(
            page,
            f"""
            for (let t = 3600 * {hour}; t < 3600 * ({hour} + 1); t += 20) {{
              h.feed(t, t + 20, 1000 * t);
              h.draw(1000 * (t + 20));
            }}
            """,
        )
        session.send("HeapProfiler.collectGarbage")
        used = session.send("Runtime.getHeapUsage")
        return (used["usedSize"] + used["backingStorageSize"]) / 1e6

    sizes = [heap_after(hour) for hour in range(3)]
    session.detach()
    assert run(page, "return h.chart.ring.first()") > 120_000
    assert sizes[2] - sizes[1] < 0.3


def test_samples_put_in_later_make_the_ring_that_they_would_have_made_in_order(
    strips: Open,
) -> None:
    wrong = run(
        strips(),
        """
        let seed = 11;
        const random = () => (seed = (seed * 16807) % 2147483647) / 2147483647;
        const rows = Array.from({ length: 7000 }, (_, k) =>
          ({ t: k / 50, row: [Math.fround(random() - 0.5)], flags: random() < 0.01 ? 2 : 0 }));
        const put = (ring, from, to) => {
          for (const { t, row, flags } of rows.slice(from, to)) ring.push(t, row, flags);
        };
        const whole = h.createRingBuffer({ series: 1, capacity: 8192 });
        put(whole, 0, 7000);
        const ring = h.createRingBuffer({ series: 1, capacity: 8192 });
        put(ring, 2000, 4200); put(ring, 4500, 7000);
        const stored = [
          ring.insert(2200, rows.slice(4200, 4500), rows[4500].flags),
          ring.insert(0, rows.slice(0, 2000), rows[2000].flags),
        ];
        let wrong = ring.count() === 7000 ? 0 : 1;
        const [a, b] = [new Float64Array(2), new Float64Array(2)];
        for (let trial = 0; trial < 500; trial++) {
          const from = Math.floor(7000 * random());
          const to = from + 1 + Math.floor(random() * (6999 - from));
          ring.extent(0, from, to, a); whole.extent(0, from, to, b);
          if (a[0] !== b[0] || a[1] !== b[1] || ring.time(from) !== whole.time(from)) wrong += 1;
          if (ring.flags(from, to) !== whole.flags(from, to)) wrong += 1;
        }
        return [...stored, wrong];
        """,
    )
    assert wrong == [True, True, 0]
