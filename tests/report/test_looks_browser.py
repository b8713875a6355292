"""How the page of a recording looks: themes, sizes, paper, names; and what it says first. See `test_browser.py`."""

from __future__ import annotations

from json import dumps
from pathlib import Path
from typing import Any

import pytest

from soter.record.reader import Recording
from soter.report.page.html import make_page
from tests.record.helpers import recorded
from tests.report.chromium import NEEDED, looks_wrong, moment, opened, until
from tests.report.pages import DURATION_S, NARROW_PHONE, PHONE, SIZES, Made, distance, pixel, rgb

pytestmark = NEEDED


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_it_has_both_themes(browser: Any, made: Made, scheme: str) -> None:
    def brightness(page: Any) -> float:
        text = page.evaluate("getComputedStyle(document.body).backgroundColor")
        return sum(int(each) for each in text[4:-1].split(",")) / 3.0

    with opened(browser, made.path, color_scheme=scheme) as page:
        before = brightness(page)
        assert (before < 60.0) == (scheme == "dark")
        on_plan = pixel(page, 4.0, 4.0)
        page.click("#theme")
        assert (brightness(page) < 60.0) != (before < 60.0)
        assert distance(pixel(page, 4.0, 4.0), on_plan) > 100.0


def test_the_system_decides_about_the_theme_until_somebody_has(browser: Any, made: Made) -> None:
    with opened(browser, made.path, color_scheme="light") as page:
        page.emulate_media(color_scheme="dark")
        until(page, "soter.page.style.dark")
        page.keyboard.press("t")
        assert not page.evaluate("soter.page.style.dark")
        page.emulate_media(color_scheme="light")
        page.emulate_media(color_scheme="dark")
        page.wait_for_timeout(50)
        assert not page.evaluate("soter.page.style.dark")


def test_it_fits_a_phone_and_scrubs_by_touch(browser: Any, made: Made) -> None:
    with opened(browser, made.path, viewport=PHONE, has_touch=True, is_mobile=True) as page:
        assert page.evaluate("document.documentElement.scrollWidth") <= PHONE["width"]
        box = page.locator("#scrub").bounding_box()
        page.touchscreen.tap(box["x"] + box["width"] * 0.5, box["y"] + box["height"] / 2)
        assert moment(page)["timeS"] == pytest.approx(DURATION_S / 2, abs=0.05 * DURATION_S)


def test_nothing_leaves_its_place_on_a_narrow_phone(browser: Any, made: Made) -> None:
    beyond = """() => {
        const beyond = (holder, inner, side) => [...document.querySelectorAll(inner)]
            .filter((each) => each.getBoundingClientRect().width && each.getBoundingClientRect()[side] > holder)
            .map((each) => each.outerHTML.slice(0, 80));
        const edge = (name, side, padding) => {
            const holder = document.querySelector(name);
            return holder.getBoundingClientRect()[side] - parseFloat(getComputedStyle(holder)[padding]);
        };
        return [
            ...beyond(edge(".transport", "right", "paddingRight") + 0.5, ".transport *", "right"),
            ...beyond(edge(".table-card", "bottom", "paddingBottom") + 0.5, "#table-scroll", "bottom"),
        ];
    }"""
    with opened(browser, made.path, f"#t={DURATION_S}", viewport=NARROW_PHONE, has_touch=True, is_mobile=True) as page:
        assert moment(page)["timeS"] > DURATION_S - 1.0
        assert page.evaluate(beyond) == []


def test_paper_is_light_and_shows_all_rows(browser: Any, made: Made) -> None:
    with opened(browser, made.path, color_scheme="dark") as page:
        on_screen = pixel(page, 4.0, 4.0)
        page.emulate_media(media="print")
        until(page, "!soter.page.style.dark")
        assert distance(pixel(page, 4.0, 4.0), on_screen) > 100.0
        assert page.evaluate(
            """() => [...document.querySelectorAll("#table-scroll, #robots")]
                .every((each) => each.scrollHeight <= each.clientHeight + 1 && each.clientHeight > 0)"""
        )
        assert len(page.pdf(format="A4")) > 50_000
        page.emulate_media(media="screen")
        until(page, "soter.page.style.dark")
        assert pixel(page, 4.0, 4.0) == on_screen


def test_targets_outside_of_the_fence_are_on_the_plan(browser: Any, hostile: Made) -> None:
    with opened(browser, hostile.path) as page:
        places = page.evaluate(
            """() => soter.run.robots.flatMap((robot) => robot.targets)
                .map(({ xM, yM }) => [...soter.page.plan.at(xM, yM), soter.page.plan.width, soter.page.plan.height])"""
        )
        outside = page.evaluate(
            """() => {
                const [west, south, east, north] = soter.run.workspace.bounds;
                return soter.run.robots.flatMap((robot) => robot.targets)
                    .filter(({ xM, yM }) => xM < west || yM < south || xM > east || yM > north).length;
            }"""
        )
        assert outside > 0
        assert all(0.0 < right < width and 0.0 < down < height for right, down, width, height in places)


def test_everything_that_can_be_used_has_a_name(browser: Any, made: Made) -> None:
    with opened(browser, made.path) as page:
        nameless = page.evaluate(
            """() => [...document.querySelectorAll("button, select, input, canvas:not([aria-hidden])")]
                .filter((each) => !each.getAttribute("aria-label"))
                .filter((each) => each.tagName !== "BUTTON" || !each.textContent.trim())
                .filter((each) => ![...(each.labels || [])].some((label) => label.textContent.trim()))
                .map((each) => each.outerHTML.slice(0, 80))"""
        )
        assert nameless == []
        page.keyboard.press("Tab")
        page.keyboard.press("Tab")
        assert page.evaluate("getComputedStyle(document.activeElement).outlineStyle") != "none"


def test_a_moment_can_be_linked_to(browser: Any, made: Made) -> None:
    with opened(browser, made.path, "#t=123.4") as page:
        assert moment(page)["timeS"] == pytest.approx(123.4)
        page.keyboard.press("ArrowRight")
        until(page, "location.hash === '#t=124.4'")
        page.evaluate("location.hash = '#t=10'")
        until(page, "soter.player.timeS === 10")
        page.context.grant_permissions(["clipboard-read", "clipboard-write"])
        page.click("#copy-link")
        until(page, "document.getElementById('copied').textContent")
        assert page.inner_text("#copied") in {"link copied", page.url}
        assert page.url.endswith("run.html#t=10")


@pytest.mark.parametrize("width", SIZES)
def test_nothing_overlaps_at_any_size(browser: Any, hostile: Made, width: int) -> None:
    size = {"width": width, "height": SIZES[width]}
    with opened(browser, hostile.path, "#t=60", viewport=size) as page:
        for scheme in ("light", "dark"):
            page.emulate_media(color_scheme=scheme)
            until(page, f"soter.page.style.dark === {str(scheme == 'dark').lower()}")
            assert page.evaluate("document.documentElement.scrollWidth") <= width
            plan, player = (page.locator(name).bounding_box() for name in ("#plan", "#transport"))
            assert plan["height"] >= 200.0
            assert plan["y"] + plan["height"] <= player["y"]
            assert looks_wrong(page) == []


def test_a_long_cause_can_be_read_whole_at_any_size(browser: Any, tmp_path: Path) -> None:
    recorded(tmp_path / "run.mcap", duration_s=90.0, battery__initial={"1": 0.12, "2": 0.12})
    recording = Recording(tmp_path / "run.mcap")
    (tmp_path / "run.html").write_text(make_page(recording), encoding="utf-8")
    switch = max(recording.content().disengagements, key=lambda each: len(each.cause))
    assert len(switch.cause) > 90
    for width, height in SIZES.items():
        size = {"width": width, "height": height}
        with opened(browser, tmp_path / "run.html", f"#t={switch.time_s}", viewport=size) as page:
            why = page.locator(".robot .why").nth(switch.robot_id - 1)
            shown = f"document.querySelectorAll('.robot .why')[{switch.robot_id - 1}].innerText"
            until(page, f"{shown}.includes({dumps(switch.cause)})")
            assert why.evaluate("each => each.scrollHeight - each.clientHeight") <= 0
            assert looks_wrong(page) == []


def test_violations_are_the_first_thing_that_one_sees(browser: Any, hostile: Made) -> None:
    violations = hostile.content.violations
    assert violations
    with opened(browser, hostile.path) as page:
        verdict = page.locator("#verdict")
        assert f"{len(violations)} violation" in verdict.inner_text()
        assert "bad" in verdict.get_attribute("class")
        # However many there are, they go on downwards, where a cut line shows that there are more.
        sideways_px, cut_px = page.evaluate(
            """() => {
                const list = document.querySelector(".violations");
                const one = list.children[0];
                for (let more = 0; more < 40; more += 1) list.append(one.cloneNode(true));
                return [list.scrollWidth - list.clientWidth, list.clientHeight % one.offsetHeight];
            }"""
        )
        assert sideways_px <= 0
        assert cut_px >= 6
        verdict.locator("button").first.click()
        shown = moment(page)
        assert shown["timeS"] == pytest.approx(violations[0].start_s)
        broken = [robot for robot in shown["robots"] if robot["breaks"]]
        assert [robot["id"] for robot in broken] == list(violations[0].robots)
        assert f"breaks {violations[0].rule}" in page.locator("#robots").inner_text()
        # They are on the slider, and keys lead from one to the next.
        red = rgb(page.evaluate("soter.page.style.colours.alarm"))
        found = page.evaluate(
            """(times) => {
                const band = document.getElementById("overview");
                const { firstS, lastS } = soter.run;
                const pixels = band.getContext("2d").getImageData(0, 1, band.width, 1).data;
                const at = (timeS) => 4 * (Math.floor(((timeS - firstS) / (lastS - firstS)) * band.width) + 1);
                return times.map((timeS) => [...pixels.slice(at(timeS), at(timeS) + 3)]);
            }""",
            [each.start_s for each in violations],
        )
        assert all(distance(tuple(each), red) < 10.0 for each in found)
        page.keyboard.press("Home")
        for start_s in sorted({each.start_s for each in violations})[:3]:
            page.keyboard.press("n")
            assert moment(page)["timeS"] == pytest.approx(start_s)


def test_a_recording_that_was_cut_off_says_so(browser: Any, made: Made, tmp_path: Path) -> None:
    whole = made.path.with_name("run.mcap").read_bytes()
    (tmp_path / "cut.mcap").write_bytes(whole[: len(whole) // 3])
    path = tmp_path / "cut.html"
    path.write_text(make_page(Recording(tmp_path / "cut.mcap")), encoding="utf-8")
    with opened(browser, path) as page:
        assert "not known" in page.inner_text("#verdict")
        assert "was cut off" in page.inner_text("#notices")
        assert 0.0 < page.evaluate("soter.run.lastS") < DURATION_S / 2.0


def test_a_page_whose_data_are_damaged_says_so(browser: Any, made: Made, tmp_path: Path) -> None:
    text = made.path.read_text(encoding="utf-8")
    at = text.index('id="recording">') + 5000
    broken = tmp_path / "broken.html"
    broken.write_text(text[:at] + text[at + 400 :], encoding="utf-8")
    page = browser.new_page()
    page.goto(broken.as_uri())
    until(page, "document.getElementById('loading').textContent.startsWith('This page cannot be shown')")
    page.close()
