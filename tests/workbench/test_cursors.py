"""The page in a real browser: what one looks at is chosen everywhere at once, and reached by the keyboard."""

import re

import pytest

from workbench.person import number

pytestmark = pytest.mark.slow
CHARTS = ("training-responses", "validation-responses", "training-lines", "validation-lines")
"""Over frequency."""


def test_a_cell_of_the_matrix_chooses_channel_excitation_and_band_everywhere(ranked):
    page = ranked.page
    cell = page.locator(".matrix button[data-channel='i_c.A_zeta'][data-input='i_e.A_zeta']").nth(1)
    low, high = (float(cell.get_attribute(f"data-{end}")) for end in ("low", "high"))
    cell.click()
    ranked.settled()
    assert (page.input_value("#channel"), page.input_value("#input")) == ("i_c.A_zeta", "i_e.A_zeta")
    assert cell.get_attribute("aria-pressed") == "true"
    assert page.locator(".map button[data-channel='i_c.A_zeta'][aria-pressed='true']").count() > 0
    for chart in CHARTS:
        assert "i_c.A_zeta" in page.inner_text(f"#{chart}-title")
        assert page.evaluate(BAND, chart) == [low, high]
    page.locator(".map button[data-channel='y.A_zeta']").nth(3).click()
    ranked.settled()
    assert page.input_value("#input") == "i_e.A_zeta"  # a cell of the map has none of its own
    assert page.evaluate(BAND, CHARTS[0]) != [low, high]
    assert page.inner_text("#training-responses-title").endswith("y.A_zeta by i_e.A_zeta")
    assert ranked.wrong == []


BAND = """(id) => document.getElementById(id).layout.shapes.filter((own) => own.type === "rect")
    .map((own) => [own.x0, own.x1])[0]"""


def test_one_cursor_stands_at_the_same_frequency_in_all_charts(ranked):
    page = ranked.page
    page.focus("#cursor")
    for _ in range(20):
        page.keyboard.press("ArrowRight")
    output = page.get_attribute("#cursor", "aria-valuetext")
    assert output == page.inner_text("#read-out")
    assert [line.partition(",")[0] for line in output.splitlines()] == ["training", "validation"]
    at = page.evaluate(CURSORS, CHARTS)
    assert page.locator(".cursor:visible").count() == len(CHARTS)
    assert max(at) == pytest.approx(min(at), rel=1e-3)
    assert at[0] == pytest.approx(number(re.search(r"([\d.]+) Hz", output)[1]), rel=1e-3)
    page.locator("#validation-lines .nsewdrag").hover()
    page.wait_for_function("told => document.getElementById('read-out').textContent !== told", arg=output)
    moved = page.evaluate(CURSORS, CHARTS)
    assert max(moved) == pytest.approx(min(moved), rel=1e-3)
    assert moved[0] != pytest.approx(at[0], rel=1e-2)
    assert ranked.wrong == []


CURSORS = """(ids) => ids.map((id) => {
    const chart = document.getElementById(id), axis = chart._fullLayout.xaxis;
    return axis.p2d(parseFloat(chart.querySelector(".cursor").style.left) - axis._offset);
})"""


def test_a_cursor_in_time_tells_the_values_of_its_record(ranked):
    page = ranked.page
    page.focus("#training-cursor")
    for _ in range(7):
        page.keyboard.press("ArrowRight")
    output = page.get_attribute("#training-cursor", "aria-valuetext")
    assert output == page.inner_text("#training-read-out")
    x, *shown = page.evaluate("""() => {
        const drawn = document.getElementById("training-overlay").data;
        const at = (name) => drawn.find((own) => own.name === name);
        return [at("measured").x, at("measured").y, at("simulated").y, at("residual").y].map((all) => all[7]);
    }""")
    numbers = [float(own) for own in re.findall(r"-?[\d.]+(?:e[-+]\d+)?(?= )", output)]
    assert numbers == pytest.approx([x, *shown], rel=5e-3)
    assert page.evaluate(CURSORS, ["training-overlay"])[0] == pytest.approx(x, rel=1e-3)
    assert not page.locator("#validation-overlay .cursor").is_visible()
    page.locator("#validation-overlay .nsewdrag").first.hover()
    page.wait_for_function("document.getElementById('validation-read-out').textContent !== ''")
    assert ranked.wrong == []


def test_pointing_at_a_candidate_shows_what_it_would_leave(ranked):
    page = ranked.page
    rows = page.locator("tr[data-effect]")
    first, second = (rows.nth(k).get_attribute("data-effect") for k in range(2))
    title = "name => document.getElementById('foreseen-title').textContent.includes(name)"
    page.wait_for_function(title, arg=first)  # the best stands there before anybody points
    rows.nth(1).hover()
    page.wait_for_function(title, arg=second)
    rows.nth(0).locator("summary").focus()
    page.wait_for_function(title, arg=first)
    assert page.inner_text("#foreseen-told").startswith(f"{first}: misfit")
    now, then = page.evaluate("document.getElementById('foreseen-chart').data.map((own) => [...own.y])")
    assert len(now) == len(then)
    assert sum(then) < sum(now)
    assert page.locator("#steps tbody tr").count() == 2  # nothing was done
    assert ranked.wrong == []


def test_before_and_after_an_effect_differ_without_colour(ranked):
    page = ranked.page
    page.click("button[aria-label='add loop_delay']")
    ranked.steps(3)
    drawn = page.evaluate(
        """() => document.getElementById("training-responses").data.filter((own) => own.showlegend !== false)
            .map((own) => [own.name, `${own.mode} ${own.line?.dash} ${own.marker?.symbol} ${own.fill}`])"""
    )
    names, looks = zip(*drawn, strict=True)
    assert {"measured", "now (+ loop_delay)", "before (fit)"} <= set(names)
    assert len(set(looks)) == len(looks)
    for cell in page.locator(".map button").all():
        assert cell.inner_text()  # its number says what its darkness says
    assert ranked.wrong == []


def test_a_question_that_a_step_overtakes_is_dropped(ranked):
    page = ranked.page
    held = []
    page.route("**/predicted?*", lambda route: held.append(route), times=1)
    page.locator("tr[data-effect]").nth(1).hover()
    page.wait_for_selector("#foreseen.stale")
    page.click("button[aria-label='add loop_delay']")
    page.wait_for_selector("#steps tbody tr:nth-child(3)")
    with page.expect_response("**/predicted?*") as late:
        held[0].continue_()
    assert late.value.status == 204
    ranked.steps(3)
    assert ranked.wrong == []


def test_tab_reaches_every_part_of_the_page(ranked):
    page = ranked.page
    page.evaluate("document.activeElement.blur()")
    reached, parts = set(), "own => own?.closest('[id]:not(button):not(select)')?.id ?? ''"
    for _ in range(150):
        page.keyboard.press("Tab")
        reached.add(page.evaluate(f"({parts})(document.activeElement)"))
    expected = {"maps", "matrices", "candidates", "cursor", "parameters", "overlays"}
    assert expected <= reached, reached
    nameless = page.locator("button:visible, input:visible, select:visible, summary:visible").evaluate_all(
        "all => all.filter((own) => !(own.ariaLabel || own.labels?.length || own.textContent.trim())).length"
    )
    assert nameless == 0
    assert ranked.wrong == []
