"""The page of a campaign: one file that needs no network, with tables that sort and the figures of runs as dots."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from html import escape
from importlib.resources import files
from pathlib import Path
from statistics import median
from typing import Final

from soter.campaign.comparison import PairedDifference
from soter.campaign.conditions import Judged, figure
from soter.campaign.report.cells import HEAD, cells, disengagements, required
from soter.campaign.store import RunRow, Store
from soter.campaign.summary import Group, groups
from soter.report.page.html import frame
from soter.sdk import RULES

DOTS: Final = {
    **{f"min_margin.{rule}": f"least margin: {rule}" for rule in RULES}, "ac_share": "AC share",
    "longest_stall_s": "longest stall, s",
}  # fmt: skip
"""Figures of single runs that are shown as dots, with their labels."""

_ROW: Final = 26.0
_MOST_DOTS: Final = 2000


def make_page(store: Store, judged: Mapping[str, Sequence[Judged]], recordings: Path) -> str:
    """Return the page of a campaign.

    `recordings` is the folder of pages of single runs, `ID.html`; existing ones are linked.
    """
    rows = [*store.rows()]
    found = groups(rows)
    about = store.about()
    asked = [each for some in judged.values() for each in some]
    hours = sum(row.robot_hours for row in rows)
    verdict = verdict_of(asked, f"{len(rows)} runs, {hours:.4g} robot-hours")
    parts = [
        verdict,
        card("What is required", table(*required(judged, "holds", "does not hold"))),
        card("Settings", table(HEAD, map(cells, found))),
        card("Disengagements per robot-hour, by module", table(*disengagements(found))),
        *(card(f"Runs: {words}", _dots(found, name)) for name, words in DOTS.items()),
        card("Runs", _runs(rows, recordings)),
    ]  # fmt: skip
    return page_of(
        about.get("title", ""), f"{about['path']}, sources {about['sources']}", [each for each in parts if each]
    )


def comparison_page(subtitle: str, differences: Sequence[PairedDifference]) -> str:
    """Return the page of a comparison."""
    rows = map(difference_cells, differences)
    return page_of("Comparison", subtitle, [card("Paired by seed", table(DIFFERENCE_HEAD, rows))])


DIFFERENCE_HEAD: Final = (
    "figure",
    "pairs",
    "left, mean",
    "right, mean",
    "right - left, median",
    "interval at 95 %",
    "",
)


def difference_cells(found: PairedDifference) -> list[str]:
    """Return the table's line for a difference."""
    if found.middle is None:
        enclosed = ["-", "needs 6 pairs", ""]
    else:
        enclosed = [
            f"{found.middle:.4g}",
            f"{found.low:.4g} to {found.high:.4g}",
            "differs" if found.shown else "not shown",
        ]
    return [found.figure, str(found.pairs), f"{found.left:.4g}", f"{found.right:.4g}", *enclosed]


# --- parts of pages ------------------------------------------------------------------------------------------------


def page_of(title: str, subtitle: str, parts: Iterable[str]) -> str:
    """Return a page of parts in HTML, in the style of the pages of runs."""
    own = files("soter.campaign.report").joinpath("assets")
    style = files("soter.report.page").joinpath("assets", "page.css").read_text(encoding="utf-8")
    return frame(
        title, subtitle, "<main>\n{}\n</main>".format("\n".join(parts)),
        style=style + own.joinpath("page.css").read_text(encoding="utf-8"),
        programs=[own.joinpath("page.js").read_text(encoding="utf-8")],
    )  # fmt: skip


def verdict_of(asked: Sequence[Judged], words: str) -> str:
    """Return the verdict at the top of a page."""
    kind, strong = "good", "All that is required holds"
    if not all(each.holds for each in asked if each.ran):
        kind, strong = "bad", "Something required does not hold"
    elif not all(each.ran for each in asked):
        kind, strong = "unknown", "What was run holds; not all that is required was run"
    return f'<section class="verdict {kind}"><strong>{strong}</strong><span>{escape(words)}</span></section>'


def card(heading: str, inner: str) -> str:
    """Return a card; empty if its content is."""
    return f'<section class="card"><h2>{escape(heading)}</h2>{inner}</section>' if inner else ""


def table(head: Sequence[str], rows: Iterable[Sequence[str]], links: Sequence[str] = ()) -> str:
    """Return a table that sorts by a clicked column.

    `links` are the links of the first cells, empty for none.
    """
    heads = "".join(f'<th scope="col"><button type="button">{escape(each)}</button></th>' for each in head)
    lines = []
    for index, row in enumerate(rows):
        first, *others = (escape(each) for each in row)
        if links and links[index]:
            first = f'<a href="{escape(links[index])}">{first}</a>'
        lines.append(f"<tr><td>{first}</td>{''.join(f'<td>{each}</td>' for each in others)}</tr>")
    body = "\n".join(lines)
    return (
        f'<div class="wide"><table><thead><tr>{heads}</tr></thead><tbody>{body}</tbody></table></div>' if lines else ""
    )


def _dots(found: Sequence[Group], name: str) -> str:
    """Return a strip of dots for each group, one for each run, with a mark at the median."""
    known = [
        (group, [(row, value) for row in group.rows if (value := figure(row, name)) is not None]) for group in found
    ]
    known = [(group, values) for group, values in known if values]
    every = [value for _, values in known for _, value in values]
    if not every:
        return ""
    low, high = min(0.0, *every), max(*every, 0.0)
    span = (high - low) or 1.0

    def x(value: float) -> str:
        # In parts of the width, so that rows stay as high as their labels on pages of any width.
        return f"{1.0 + (value - low) / span * 98.0:.2f}%"

    height = _ROW * len(known) + 18.0
    marks = [f'<line class="zero" x1="{x(0.0)}" x2="{x(0.0)}" y1="0" y2="{height - 16.0:.0f}"/>']
    labels = []
    for index, (group, values) in enumerate(known):
        y = _ROW * (index + 0.5)
        step = max(1, len(values) // _MOST_DOTS)
        ordered = sorted(values, key=lambda each: each[1])
        # The extremes are never thinned out.
        for row, value in [*ordered[:-1:step], ordered[-1]]:
            broken = ' class="broken"' if value < 0.0 else ""
            marks.append(
                f'<circle{broken} cx="{x(value)}" cy="{y:.1f}" r="3"><title>{row.id}: {value:.5g}</title></circle>'
            )
        middle = x(median(value for _, value in values))
        marks.append(f'<line class="middle" x1="{middle}" x2="{middle}" y1="{y - 9:.1f}" y2="{y + 9:.1f}"/>')
        # The setting first: cut off, labels of one part are still told apart by it.
        label = escape(group.part if group.name == "-" else f"{group.name} · {group.part}")
        labels.append(f'<li title="{label}">{label}</li>')
    ends = f'<text x="1%" y="{height - 3:.0f}">{low:.3g}</text>'
    ends += f'<text x="99%" y="{height - 3:.0f}" text-anchor="end">{high:.3g}</text>'
    picture = f'<svg height="{height:.0f}" role="img">{"".join(marks)}{ends}</svg>'
    return f'<div class="dots"><ul>{"".join(labels)}</ul>{picture}</div>'


def _runs(rows: Sequence[RunRow], recordings: Path) -> str:
    head = ["run", "part", "setting", "seed", "status", "violations", "least margin", "AC share", "trace", "why not"]
    lines, links = [], []
    for row in rows:
        page = recordings / f"{row.id}.html"
        links.append(f"{recordings.name}/{page.name}" if page.exists() else "")
        margin, share = figure(row, "min_margin"), figure(row, "ac_share")
        lines.append([
            row.id, row.part, Group(row.part, row.axes, ()).name, str(row.seed), row.status,
            "unknown" if row.violations is None else str(sum(row.violations.values())),
            "-" if margin is None else f"{margin:.4f}", "-" if share is None else f"{share:.1%}",
            row.trace_sha256[:12], row.failure or ", ".join(row.findings),
        ])  # fmt: skip
    return table(head, lines, links)
