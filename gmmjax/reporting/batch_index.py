"""The index of a batch run: one HTML file that lists all pairs, with thumbnails, changes and links to the reports."""

import re
from collections.abc import Sequence
from html import escape
from typing import Any

from gmmjax.batch import ChangeRow, PairRow
from gmmjax.reporting.page_parts import page, script, script_json
from gmmjax.reporting.palette import KIND_COLORS

# As that of other pages, and images of the same folder. The origin of a file is opaque: that 'self' allows the files
# beside it, as in Chromium, no standard promises, and `file:` does. A page from a server cannot load files in any case.
CONTENT_POLICY = (
    "default-src 'none'; script-src 'unsafe-inline'; style-src 'unsafe-inline'; img-src 'self' file:; "
    "base-uri 'none'; form-action 'none'"
)


def batch_index_html(
    title: str, pairs: Sequence[PairRow], changes: Sequence[ChangeRow], *, missing: Sequence[str] = ()
) -> str:
    """Make the index of a batch run, one page, which loads nothing but the thumbnails.

    It stands in the folder of the run, beside `pairs.csv` and `changes.csv`; thumbnails and reports are in
    `pairs/NAME/`, errors in `errors/`.

    Args:
        title: of the run.
        pairs: those that are done and those that failed, in any order.
        changes: those of these pairs.
        missing: names of the pairs of the run that are in neither state.

    Returns:
        HTML. Names, paths, warnings and errors are text in it, whatever they hold.
    """
    main = f"""<header>
<p class="title">{escape(title)}</p><h1>{escape(batch_answer(pairs, missing))}</h1>
<p class="files">Tables: <a href="pairs.csv">pairs.csv</a>, a row for each pair, and
<a href="changes.csv">changes.csv</a>, a row for each change</p>
</header>
<noscript><p class="note">The list needs JavaScript; pairs.csv has the same rows.</p></noscript>
<div id="index"></div>"""
    rest = f"{script_json('run', _content(pairs, changes, missing))}\n{script('batch_index.js')}"
    return page(title, "batch_index.css", main, rest, policy=CONTENT_POLICY)


def batch_answer(pairs: Sequence[PairRow], missing: Sequence[str] = ()) -> str:
    """Give the answer in a sentence: "187 of 200 pairs done, 3 failed, 10 missing; 61 with changes"."""
    total, done = len(pairs) + len(missing), sum(pair.status == "done" for pair in pairs)
    changed = sum(bool(pair.changes) for pair in pairs)
    of_total = f"{done:,} of {total:,}" if done < total else f"{total:,}"
    others = {"failed": len(pairs) - done, "missing": len(missing)}
    states = [f"{of_total} pair{'s' * (total != 1)} done"]
    states += [f"{count:,} {state}" for state, count in others.items() if count]
    found = f"{changed:,} with changes" if changed else "none with changes"
    return f"{', '.join(states)}; {found}" if done else ", ".join(states)


def _content(pairs: Sequence[PairRow], changes: Sequence[ChangeRow], missing: Sequence[str]) -> dict[str, Any]:
    """List the pairs, in the natural order of their names; texts that several share, as warnings are, stand once."""
    found: dict[str, list[ChangeRow]] = {}
    for change in sorted(changes, key=lambda row: row.change):
        found.setdefault(change.name, []).append(change)
    texts: dict[str, int] = {}
    values: dict[str, list[Any]] = {name: [name] for name in missing}
    for pair in sorted(pairs, key=lambda row: row.name):
        values[pair.name] = _pair_values(pair, found.get(pair.name, []), texts)
    return {
        "kinds": list(KIND_COLORS.items()),
        "pairs": [values[name] for name in sorted(values, key=_natural)],
        "texts": list(texts),
    }


def _pair_values(pair: PairRow, changes: Sequence[ChangeRow], texts: dict[str, int]) -> list[Any]:
    """List a pair's values in the order that the script reads them in; add to `texts` what is not yet in it."""
    lines = [texts.setdefault(line, len(texts)) for line in pair.warnings.splitlines() if line]
    return [
        pair.name,
        pair.status,
        texts.setdefault(pair.error, len(texts)) if pair.error else None,
        pair.before,
        pair.after,
        pair.points_before,
        pair.points_after,
        pair.changes,
        _probability(pair.highest_probability),
        _short(pair.standard_error),
        pair.restarts,
        pair.settled,
        pair.registration_applied,
        _short(pair.registration_residual),
        _short(pair.registration_overlap),
        _probability(pair.registration_confidence),
        _short(pair.seconds),
        lines,
        [_change_values(change) for change in changes if not _is_second_half(change)],
    ]


def _change_values(change: ChangeRow) -> list[Any]:
    extent = [_short(edge) for edge in (change.extent_1, change.extent_2, change.extent_3)]
    return [list(KIND_COLORS).index(change.kind), _probability(change.probability), *extent]


def _is_second_half(change: ChangeRow) -> bool:
    """Tell whether a moved object is listed already, by the half that comes first."""
    return change.partner is not None and change.partner < change.change


def _probability(value: float | None) -> float | None:
    """Round to four decimals; only certainty is 1."""
    return None if value is None else min(round(value, 4), 0.9999) if value < 1 else 1.0


def _short(value: float | None) -> float | None:
    return None if value is None else float(f"{value:.4g}")


def _natural(name: str) -> tuple[list[Any], str]:
    """Return a key that sorts "scan 9" before "scan 10", whatever the case."""
    parts = re.split(r"(\d+)", name.casefold())
    return [int(part) if part.isdecimal() else part for part in parts], name
