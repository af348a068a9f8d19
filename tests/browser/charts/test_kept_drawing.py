"""What a strip keeps between turns: its picture is the one drawn at once, and little is drawn."""

import pytest

from tests.browser.strips import Open, run

FLY = """
  const stateAt = (t) => (t % 16 > 12 ? 'invalid' : t % 30 < 1 ? 'not_assessed' : 'ok');
  const canvases = () => [...document.querySelectorAll('#strips .strip canvas')];
  const pixels = () => canvases().map((canvas) => {
    const copy = new OffscreenCanvas(canvas.width, canvas.height);
    const pen = copy.getContext('2d', { willReadFrequently: true });
    pen.drawImage(canvas, 0, 0);
    return pen.getImageData(0, 0, canvas.width, canvas.height).data;
  });
  const fly = (from, to, dt = 1 / 30) => {
    for (let t = from; t < to; t += dt) {
      const gap = t % 19 > 18.5;
      if (!gap) h.feed(t, t + dt, 1000 * t, { growth: 0.2, state: stateAt(t) });
      h.draw(1000 * t + 20);
    }
    return 1000 * to + 20;
  };
  // Pixels that are, by more than 70 of 255, unlike all of the same place and beside it in the
  // other picture: edges are smoothed piece by piece.
  const strange = (data, other, width) => {
    const rows = [0, 4, -4, 4 * width, -4 * width];
    const near = rows.flatMap((place) => [place, place + 4, place - 4]);
    const isFar = (value, at) => Math.abs(value - (other[at] ?? -1e9)) > 70;
    const [words, others] = [data, other].map(({ buffer }) => new Uint32Array(buffer));
    let n = 0;
    for (let k = 0; k < words.length; k++) {
      if (words[k] === others[k]) continue;
      for (let i = 4 * k; i < 4 * k + 4; i++) n += near.every((by) => isFar(data[i], i + by));
    }
    return n;
  };
  const unlike = (wall) => {
    h.draw(wall);
    const kept = pixels();
    h.chart.latch([]);
    h.draw(wall);
    const anew = pixels();
    const { width } = canvases()[0];
    const both = (data, k) => strange(data, anew[k], width) + strange(anew[k], data, width);
    return kept.reduce((n, data, k) => n + both(data, k), 0);
  };
"""


@pytest.mark.parametrize("size", [(1280, 720), (1920, 1080)])  # at the second, 1.2 px a unit
@pytest.mark.parametrize("seconds", [6, 25, 120])
def test_a_picture_drawn_bit_by_bit_is_the_one_drawn_at_once(
    strips: Open, seconds: int, size: tuple[int, int]
) -> None:
    page = strips(f"seconds={seconds}&lead=0.5")
    page.set_viewport_size({"width": size[0], "height": size[1]})
    unlike = run(
        page,
        f"{FLY} fly(24, 40, 0.25); const found = [];"
        "found.push(unlike(fly(40, 43)));"
        "h.timeline.setHover(0.5); found.push(unlike(43020));"
        "h.timeline.setHover(null); fly(43, 45); h.chart.flag({ key: 'p', t: 44, word: 'MARK' });"
        "found.push(unlike(fly(45, 47)));"
        "h.timeline.pan(-1, 47020); fly(47, 47.5);"
        "h.timeline.pan(0.7, 47520); found.push(unlike(fly(47.5, 48)));"
        "h.timeline.goLive(); found.push(unlike(fly(48, 49)));"
        "found.push(unlike(52000)); return found;",
    )
    assert unlike == [0] * 6


def test_a_turn_draws_what_is_new_whatever_is_in_view(strips: Open) -> None:
    page = strips("seconds=120")
    lines = run(
        page,
        f"""{FLY}
        fly(0, 130, 0.5);
        let drawn = 0;
        const pen = CanvasRenderingContext2D.prototype;
        const {{ lineTo }} = pen;
        pen.lineTo = function (...place) {{ drawn += 1; return lineTo.apply(this, place); }};
        const counts = [];
        for (let k = 0; k < 60; k++) {{
          drawn = 0;
          fly(130 + k / 30, 130 + (k + 1) / 30 - 1e-9);
          counts.push(drawn);
        }}
        h.chart.latch([]);
        drawn = 0;
        fly(132, 132 + 1 / 30 - 1e-9);
        return [...counts.sort((a, b) => a - b).slice(-6), drawn];
        """,
    )
    assert lines[-2] < 0.25 * lines[-1]
