"""The time line of a series: when each object came, moved and went, and where, as one HTML page."""

import itertools
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from html import escape
from typing import NamedTuple, get_args
from urllib.parse import quote

from gmmjax.batch import EpochTree, EventKind, ObjectEvent, ObjectHistory, epoch_trees
from gmmjax.pair import Pair
from gmmjax.reporting.page_parts import page, script
from gmmjax.reporting.plan_view import plan_svg
from gmmjax.reporting.quantities import percent
from gmmjax.reporting.summary import place_text

SIGNS: Mapping[EventKind, str] = {"came": "+", "moved": "→", "went": "×"}
HEADINGS = ("Object", "Event", "When", "Probability", "Moved by", "Points", "Centre", "Size", "Shown by")
# Epochs without a comparison that are named in the heading; the others are counted.
MAX_NAMES = 5


class Stretch(NamedTuple):
    """A piece of an object's bar, in columns, 0.5 being the middle of the first; whether it is `known` to be there."""

    start: float
    end: float
    known: bool


class _Series(NamedTuple):
    """Content of the page: the arguments of `timeline_html`, and which epochs were compared with each other."""

    epochs: Sequence[str]
    histories: Sequence[ObjectHistory]
    pair_names: Mapping[tuple[int, int], str]
    trees: Sequence[EpochTree]

    @property
    def missing(self) -> list[int]:
        """The epochs that were compared with no other one."""
        return [tree.root for tree in self.trees if len(tree.epochs) == 1]

    @property
    def connected(self) -> list[EpochTree]:
        """The other epochs, by what they can be followed through."""
        return [tree for tree in self.trees if len(tree.epochs) > 1]

    def link(self, event: ObjectEvent) -> str | None:
        """Return the address of the report of the comparison that shows an event; None where it has no name."""
        name = self.pair_names.get((event.comparison.before, event.comparison.after))
        return None if name is None else f"pairs/{quote(name, safe='')}/report.html"

    def when(self, event: ObjectEvent) -> str:
        """Say when it happened."""
        if event.previous == event.epoch - 1:
            return f"in {self.epochs[event.epoch]}"
        return f"between {self.epochs[event.previous]} and {self.epochs[event.epoch]}"

    def sentence(self, event: ObjectEvent) -> str:
        """Say what happened, after the name of the object."""
        did = f"{event.kind}{' back' if event.returned else ''}"
        if event.distance is not None:
            did += f" by {event.distance:.3g}"
        facts = [f"probability {percent(event.probability)}"]
        if event.moved_probability is not None:
            facts.append(f"the same object {percent(event.moved_probability)}")
        if event.change is None:
            facts.append(f"it no longer differs from {self.epochs[event.comparison.before]}")
        return f"{did} {self.when(event)}: {', '.join(facts)}"


def timeline_html(
    title: str,
    epochs: Sequence[str],
    histories: Sequence[ObjectHistory],
    pair_names: Mapping[tuple[int, int], str],
) -> str:
    """Make the time line of a series, one page, which loads nothing.

    It stands in the folder of the run, beside `objects.csv`; the reports of the pairs are in `pairs/NAME/`.

    Args:
        title: of the series.
        epochs: names of the epochs, in the order of time.
        histories: of the objects that came, moved or went.
        pair_names: by the indices of the two epochs, the name of each pair that is done.

    Returns:
        HTML. Names are text in it, whatever they hold.

    Raises:
        InputError: pairs that are not of these epochs.
    """
    series = _Series(epochs, histories, pair_names, epoch_trees(epochs, [Pair(*pair) for pair in pair_names]))
    main = f"""<header>
<p class="title">{escape(title)}</p><h1>{escape(series_answer(epochs, histories))}</h1>
<p class="files">Each epoch is compared with the one before. Lengths are in the unit of the clouds. \
Table: <a href="objects.csv">objects.csv</a>, a row for each event</p>
{_gaps(series)}{_legend(histories)}</header>
{_objects(series) if histories else _no_objects(series)}"""
    return page(title, "timeline.css", main, script("timeline.js"))


def series_answer(epochs: Sequence[str], histories: Sequence[ObjectHistory]) -> str:
    """Give the answer in a sentence: "12 epochs, 5 objects: 3 came, 1 moved twice, 2 went". Counted are objects."""
    counted = _counted(len(epochs), "epoch")
    if not histories:
        return f"{counted}: no object came, moved or went"
    events = [Counter(event.kind for event in history.events) for history in histories]
    times = {kind: [own[kind] for own in events if own[kind]] for kind in get_args(EventKind)}
    parts = ", ".join(f"{len(own):,} {kind}{_often(own)}" for kind, own in times.items() if own)
    return f"{counted}, {_counted(len(histories), 'object')}: {parts}"


def _often(times: Sequence[int]) -> str:
    """Say how often, where it was not once each."""
    if set(times) == {1}:
        return ""
    if len(set(times)) == 1:
        return " twice" if times[0] == 2 else f" {times[0]} times"
    return f" ({sum(times):,} times in all)"


def _counted(number: int, thing: str) -> str:
    return f"{number:,} {thing}{'s' * (number != 1)}"


def _gaps(series: _Series) -> str:
    """Say what is not known."""
    epochs, missing, notes = series.epochs, series.missing, []
    if missing and len(epochs) > 1:
        names = ", ".join(f"<b>{escape(epochs[epoch])}</b>" for epoch in missing[:MAX_NAMES])
        more = f" and {len(missing) - MAX_NAMES:,} more" if len(missing) > MAX_NAMES else ""
        notes.append(f"Compared with no other epoch: {names}{more}. What was there then is not known.")
    for before, after in itertools.pairwise(series.connected):
        notes.append(
            f"No comparison connects <b>{escape(epochs[after.root])}</b> to the epochs before: objects are followed up "
            f"to <b>{escape(epochs[before.epochs[-1]])}</b>, and anew from <b>{escape(epochs[after.root])}</b> on."
        )
    return "".join(f'<p class="note">{note}</p>\n' for note in notes)


def _legend(histories: Sequence[ObjectHistory]) -> str:
    kinds = [kind for kind in get_args(EventKind) if any(e.kind == kind for h in histories for e in h.events)]
    marks = "".join(f'<li><i class="mark {kind}">{SIGNS[kind]}</i>{kind}</li>' for kind in kinds)
    states = '<li><i class="bar"></i>there</li><li><i class="bar unknown"></i>not known</li>'
    return f'<ul class="legend">{marks}{states if histories else ""}</ul>\n'


def _no_objects(series: _Series) -> str:
    if not series.connected:
        return '<p class="none">No two epochs were compared.</p>'
    return f'<p class="none">No change was found between the {len(series.epochs):,} epochs.</p>'


def _objects(series: _Series) -> str:
    plans = "".join(_plan(series, tree) for tree in series.trees)
    return f"""<div class="series">
{_timeline(series)}
<div class="plans">{plans}</div>
</div>
{_table(series)}"""


def _timeline(series: _Series) -> str:
    epochs, missing = series.epochs, series.missing
    heads = "".join(_head(number, name, number in missing) for number, name in enumerate(epochs))
    gaps = "".join(f'<span class="gap" style="--at:{epoch}"></span>' for epoch in sorted(missing))
    begins = sorted(tree.root for tree in series.connected if tree.root)
    gaps += "".join(f'<span class="begin" style="--at:{epoch}"></span>' for epoch in begins)
    rows = "".join(_row(series, history) for history in series.histories)
    # Pixels: the columns leave the plan its place in a window of 1,400, and none is narrower than the mark of an event.
    column = max(22, min(110, 800 // max(len(epochs), 1)))
    # A letter is 7 pixels wide; beside the marks there is room for numbers from 64 on.
    upright = " upright" if 7 * max(map(len, epochs)) > column else ""
    labelled = " labelled" if column >= 64 else ""
    sizes = f"--widest:{column}px;--count:{len(epochs)};--rows:{len(series.histories)}"
    return f"""<section class="timeline{upright}{labelled}" style="{sizes}" tabindex="0" aria-label="Time line">
<div class="epochs"><b>Object</b>{heads}</div>
<div class="columns" aria-hidden="true">{gaps}</div>
<ol>
{rows}</ol>
</section>"""


def _head(number: int, name: str, missing: bool) -> str:
    said = f"{name}: not compared" if missing else name
    style = ' class="missing"' if missing else ""
    return f'<span{style} style="--at:{number}" title="{escape(said)}">{escape(name)}</span>'


def _row(series: _Series, history: ObjectHistory) -> str:
    bars = "".join(
        f'<span class="bar{"" if stretch.known else " unknown"}" style="--at:{stretch.start:g};'
        f'--length:{stretch.end - stretch.start:g}"></span>'
        for stretch in stretches(history)
    )
    marks = "".join(_mark(series, history, event) for event in history.events)
    return (
        f'<li data-object="{history.number}"><button type="button" aria-pressed="false" '
        f'aria-label="Object {history.number}: show it in the plan">{history.number}</button>'
        f'<div class="lane">{bars}{marks}</div></li>\n'
    )


def stretches(history: ObjectHistory) -> list[Stretch]:
    """List the pieces of an object's bar: from where it came, or the edge, to where it went, or the edge."""
    return _joined(list(_pieces(history.presence)))


def _pieces(presence: Sequence[bool | None]) -> Iterator[Stretch]:
    known = [epoch for epoch, there in enumerate(presence) if there is not None]
    first, last = known[0], known[-1]
    if presence[first]:
        yield Stretch(0, first, False)
        yield Stretch(first, first + 0.5, True)
    for before, after in itertools.pairwise(known):
        adjacent = after == before + 1
        if presence[before] or (presence[after] and not adjacent):
            yield Stretch(before + 0.5, after + 0.5, adjacent)
    if presence[last]:
        yield Stretch(last + 0.5, last + 1, True)
        yield Stretch(last + 1, len(presence), False)


def _joined(pieces: Sequence[Stretch]) -> list[Stretch]:
    """Join pieces that continue each other, and leave out those of no length."""
    joined: list[Stretch] = []
    for piece in pieces:
        if joined and joined[-1].known == piece.known and joined[-1].end == piece.start:
            joined[-1] = joined[-1]._replace(end=piece.end)
        elif piece.end > piece.start:
            joined.append(piece)
    return joined


def _mark(series: _Series, history: ObjectHistory, event: ObjectEvent) -> str:
    said = escape(f"Object {history.number} {series.sentence(event)}")
    moved = f"{event.distance:.2g} · " if event.distance is not None else ""
    label = f"<small>{moved}{percent(event.probability)}</small>"
    link = series.link(event)
    start, end = ("<span", "</span>") if link is None else (f'<a href="{link}"', "</a>")
    return (
        f'{start} class="mark {event.kind}" style="--at:{event.epoch}" title="{said}" aria-label="{said}">'
        f"{SIGNS[event.kind]}{label}{end}"
    )


def _plan(series: _Series, tree: EpochTree) -> str:
    """Draw the plan of the objects in the frame of a tree; "" where it has no object."""
    own = [history for history in series.histories if history.frame == tree.root]
    if not own:
        return ""
    name = escape(series.epochs[tree.root])
    return f"<figure><figcaption><b>Plan</b><span>along z, frame of {name}</span></figcaption>{plan_svg(own)}</figure>"


def _table(series: _Series) -> str:
    head = "".join(f'<th scope="col">{heading}</th>' for heading in HEADINGS)
    rows = [_table_row(series, own, event) for own in series.histories for event in own.events]
    return f"""<details class="events"><summary>{_counted(len(rows), "event")} as a table</summary>
<section class="scroll"><table><thead><tr>{head}</tr></thead>
<tbody>{"".join(rows)}</tbody></table></section></details>"""


def _table_row(series: _Series, history: ObjectHistory, event: ObjectEvent) -> str:
    before, after = (series.epochs[epoch] for epoch in event.comparison)
    shown, link = f"{escape(before)} → {escape(after)}", series.link(event)
    cells = (
        f"<b>{history.number}</b>",
        f'<i class="dot {event.kind}"></i>{event.kind}{" back" if event.returned else ""}',
        escape(series.when(event)),
        percent(event.probability),
        "" if event.distance is None else f"{event.distance:.3g}",
        f"{event.point_count:,}",
        *place_text(event.box.centre, event.box.extent),
        shown if link is None else f'<a href="{link}">{shown}</a>',
    )
    return "<tr>" + "".join(f"<td>{cell}</td>" for cell in cells) + "</tr>"
