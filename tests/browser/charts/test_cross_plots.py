"""Cross plots: channels against each other, their limits, trail and simulated flights."""

import re

from playwright.sync_api import Page, expect

from tests.browser.strips import Open, run

FLIGHTS = """window.simulated = {
    facts: async () => ({ band: null, forecast: null, quantiles: [0.05, 0.95] }),
    flights: async () => ({
        reason: window.noFlights ?? "",
        safe: [{ x: [0, 0.1, 0.1], y: [0, 0.2, 0.1] }],
        unsafe: [{ x: [0, 0.2], y: [0, 0.9] }],
    }),
};"""


def opened(strips: Open, query: str = "seconds=20") -> Page:
    page = strips(query)
    run(page, "h.feed(0, 12, 1000, { growth: 0.5 }); h.draw(1000)")
    return page


def add(page: Page) -> None:
    page.get_by_text("View", exact=True).click()
    page.get_by_role("button", name="Add a cross plot").last.click()


def chosen(page: Page) -> list[list[str]]:
    """Channels of each plot: upwards, across."""
    return [
        [select.input_value() for select in plot.locator("select").all()]
        for plot in page.locator(".cross-plot").all()
    ]


def label(page: Page) -> str:
    return page.locator(".cross-canvas canvas").first.get_attribute("aria-label") or ""


def test_the_usual_pairs_come_first_and_each_can_be_changed_and_removed(strips: Open) -> None:
    page = opened(strips)
    add(page)
    page.get_by_role("button", name="Add a cross plot").first.click()
    assert chosen(page) == [["beta", "delta_r"], ["Ny", "beta"]]
    page.get_by_label("Channel across").first.select_option("p")
    assert chosen(page) == [["beta", "p"], ["Ny", "beta"]]
    page.get_by_role("button", name="Remove this cross plot").last.click()
    assert chosen(page) == [["beta", "p"]]


def test_the_cross_plots_are_kept_in_the_address(strips: Open) -> None:
    page = opened(strips)
    add(page)
    page.get_by_label("Length of the trail").select_option("5")
    expect(page).to_have_url(re.compile(r"cross=delta_r:beta.*trail=5$"))
    page.reload()
    page.locator(".cross-plot").wait_for()
    assert chosen(page) == [["beta", "delta_r"]]
    assert page.get_by_label("Length of the trail").input_value() == "5"


def test_a_plot_is_moved_and_magnified_by_the_keyboard(strips: Open) -> None:
    page = strips("seconds=20#?cross=delta_r:beta,beta:Ny")
    up = page.get_by_label("Move this cross plot up").last
    up.press("Enter")
    assert chosen(page) == [["Ny", "beta"], ["beta", "delta_r"]]
    expect(page).to_have_url(re.compile(r"cross=beta:Ny,delta_r:beta$"))
    plots = page.locator(".cross-canvas")
    before = plots.last.bounding_box()
    large = page.get_by_label("Large cross plot").last
    large.press("Enter")
    expect(large).to_be_focused()
    expect(page).to_have_url(re.compile(r"cross=beta:Ny,delta_r:beta\*2$"))
    page.reload()
    assert chosen(page) == [["Ny", "beta"], ["beta", "delta_r"]]
    after = plots.last.bounding_box()
    assert before is not None
    assert after is not None
    assert after["height"] > 1.5 * before["height"]


def test_the_trail_ends_at_the_newest_sample_or_at_the_cursor(strips: Open) -> None:
    page = opened(strips)
    add(page)
    run(page, "h.draw(3000)")
    newest, then = run(page, "return [11.98, 4].map((t) => h.chart.values(t).beta)")
    assert f"β {newest:.3f} rad".replace("-", "−") in label(page)
    run(page, "h.timeline.setCursor(4); h.draw(5000)")
    assert f"β {then:.3f} rad".replace("-", "−") in label(page)


def colours(page: Page, token: str) -> int:
    """Pixels of the first cross plot in about a colour."""
    return run(
        page,
        f"""
        const canvas = document.querySelector('.cross-canvas canvas');
        const pen = document.createElement('canvas')
            .getContext('2d', {{ willReadFrequently: true }});
        pen.canvas.width = canvas.width; pen.canvas.height = canvas.height;
        pen.fillStyle = getComputedStyle(canvas).getPropertyValue('--{token}').trim();
        pen.fillRect(0, 0, 1, 1);
        const wanted = [...pen.getImageData(0, 0, 1, 1).data];
        pen.drawImage(canvas, 0, 0);
        const {{ data }} = pen.getImageData(0, 0, canvas.width, canvas.height);
        let n = 0;
        for (let i = 0; i < data.length; i += 4)
            n += [0, 1, 2].every((c) => Math.abs(data[i + c] - wanted[c]) < 12);
        return n;
        """,
    )


def test_a_limit_of_either_channel_is_drawn(strips: Open) -> None:
    page = opened(strips)
    add(page)
    run(page, "h.draw(3000)")
    without = colours(page, "limit")
    page.get_by_label("Channel upwards").select_option("Ny")
    run(page, "h.draw(3100)")
    assert colours(page, "limit") > without + 300


def test_no_current_value_passes_for_one(strips: Open) -> None:
    page = opened(strips)
    add(page)
    run(page, "h.draw(1100)")
    assert colours(page, "caution") == 0
    run(page, "h.draw(9000)")  # no sample for 8 s
    assert colours(page, "caution") > 20


def test_the_trail_fades_and_is_cut_at_a_gap(strips: Open) -> None:
    page = opened(strips)
    add(page)
    run(page, "h.draw(1100)")
    whole = colours(page, "trace")
    run(page, "h.timeline.setCursor(6.2); h.draw(1200)")
    assert whole > 20  # the newest part is not faint
    moves = run(
        page,
        """
        const seen = [];
        h.feed(14, 15, 3000);
        h.chart.trail(['delta_r', 'beta'], 11.9, 14.1, (t, ...rest) => seen.push([t, rest[4]]));
        return seen.filter(([, isCut]) => isCut).map(([t]) => t);
        """,
    )
    assert moves == [14]


def test_simulated_flights_lie_behind_or_their_absence_is_explained(
    strips: Open, own_page: Page
) -> None:
    own_page.add_init_script(FLIGHTS)
    own_page.goto(strips().url.replace("?", "?more&"))
    own_page.locator(".strip").first.wait_for()
    run(own_page, "h.feed(0, 12, 1000); h.draw(1000)")
    add(own_page)
    own_page.wait_for_timeout(50)
    run(own_page, "h.draw(1100)")
    assert "1 safe and 1 unsafe simulated" in label(own_page)
    expect(own_page).to_have_url(re.compile("cross="))
    own_page.add_init_script("window.noFlights = 'its dataset is not on this server'")
    own_page.reload()
    note = own_page.locator(".cross-note")
    expect(note).to_have_text("No simulated flights: its dataset is not on this server.")
