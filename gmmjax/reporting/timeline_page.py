"""The time line of a series: when each object came, moved and went, and where, as one HTML page."""

import itertools
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from html import escape
from typing import NamedTuple, get_args
from urllib.parse import quote

from gmmjax.batch import EpochTree, EventKind, ObjectEvent, ObjectHistory, epoch_trees
from gmmjax.errors import check_choice
from gmmjax.pair import Pair
from gmmjax.reporting.page_parts import asset, page_head
from gmmjax.reporting.plan_view import plan_svg
from gmmjax.reporting.summary import percent, place_text

SIGNS: Mapping[EventKind, str] = {"came": "+", "moved": "→", "went": "×"}
HEADINGS = ("Object", "Event", "When", "Probability", "Moved by", "Points", "Centre", "Size", "Shown by")


# Epochs without a comparison that are named in the heading; the others are counted.
MOST_NAMES = 5


class Stretch(NamedTuple):
    """A piece of an object's bar.

    Attributes:
        start: in columns: 0 is the left edge of the first one, 0.5 its middle.
        end: likewise.
        known: whether the object is known to have been there.
    """

    start: float
    end: float
    known: bool


def timeline_html(
    title: str,
    epochs: Sequence[str],
    histories: Sequence[ObjectHistory],
    *,
    against: str,
    pair_names: Mapping[tuple[int, int], str],
) -> str:
    """The time line of a series as one page, which loads nothing.

    It stands in the folder of the run, beside `objects.csv`; the reports of the pairs are in `pairs/NAME/`.

    Args:
        title: of the series.
        epochs: names of the epochs, in the order of time.
        histories: of the objects that came, moved or went.
        against: what each epoch was compared with: "previous" or "first".
        pair_names: by the indices of the two epochs, the name of each pair that is done.

    Returns:
        HTML. Names are text in it, whatever they hold.

    Raises:
        InputError: an unknown `against`, or pairs that are not of these epochs.
    """
    from gmmjax import __version__

    check_choice("against", against, ("previous", "first"))
    trees = epoch_trees(epochs, [Pair(*pair) for pair in pair_names])
    body = _no_objects(epochs, trees)
    if histories:
        body = _objects(epochs, histories, trees, pair_names)
    return f"""{page_head(title, asset("timeline.css"))}<body>
<main>
<header>
<p class="title">{escape(title)}</p><h1>{escape(series_answer(epochs, histories))}</h1>
<p class="files">{_compared(epochs, against)}</p>
{_gaps(epochs, trees)}{_legend(histories)}</header>
{body}
<footer>gmmjax {escape(__version__)}</footer>
</main>
<script>{asset("timeline.js")}</script>
</body>
</html>
"""


def series_answer(epochs: Sequence[str], histories: Sequence[ObjectHistory]) -> str:
    """The answer in a sentence: "12 epochs, 5 objects: 3 came, 1 moved twice, 2 went". Counted are objects."""
    counted = _counted(len(epochs), "epoch")
    if not histories:
        return f"{counted}: no object came, moved or went"
    events = [Counter(event.kind for event in history.events) for history in histories]
    times = {kind: [own[kind] for own in events if own[kind]] for kind in get_args(EventKind)}
    parts = ", ".join(f"{len(own):,} {kind}{_often(own)}" for kind, own in times.items() if own)
    return f"{counted}, {_counted(len(histories), 'object')}: {parts}"


def _often(times: Sequence[int]) -> str:
    """How often, where it was not once each."""
    if set(times) == {1}:
        return ""
    if len(set(times)) == 1:
        return " twice" if times[0] == 2 else f" {times[0]} times"
    return f" ({sum(times):,} times in all)"


def _counted(number: int, thing: str) -> str:
    return f"{number:,} {thing}{'s' * (number != 1)}"


def _compared(epochs: Sequence[str], against: str) -> str:
    other = "the one before"
    if against == "first" and epochs:
        other = f"the first one, <b>{escape(epochs[0])}</b>"
    return (
        f"Each epoch is compared with {other}. Lengths are in the unit of the clouds. "
        'Table: <a href="objects.csv">objects.csv</a>, a row for each event'
    )


def _gaps(epochs: Sequence[str], trees: Sequence[EpochTree]) -> str:
    """What is not known, in sentences."""
    missing = [tree.root for tree in trees if len(tree.epochs) == 1]
    notes = []
    if missing and len(epochs) > 1:
        names = ", ".join(f"<b>{escape(epochs[epoch])}</b>" for epoch in missing[:MOST_NAMES])
        more = f" and {len(missing) - MOST_NAMES:,} more" if len(missing) > MOST_NAMES else ""
        notes.append(f"Compared with no other epoch: {names}{more}. What was there then is not known.")
    connected = [tree for tree in trees if len(tree.epochs) > 1]
    for before, after in itertools.pairwise(connected):
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


def _no_objects(epochs: Sequence[str], trees: Sequence[EpochTree]) -> str:
    if all(len(tree.epochs) == 1 for tree in trees):
        return '<p class="none">No two epochs were compared.</p>'
    return f'<p class="none">No change was found between the {len(epochs):,} epochs.</p>'


def _objects(
    epochs: Sequence[str],
    histories: Sequence[ObjectHistory],
    trees: Sequence[EpochTree],
    pair_names: Mapping[tuple[int, int], str],
) -> str:
    plans = "".join(_plan(epochs, tree, histories) for tree in trees)
    return f"""<div class="series">
{_timeline(epochs, histories, trees, pair_names)}
<div class="plans">{plans}</div>
</div>
{_table(epochs, histories, pair_names)}"""


def _timeline(
    epochs: Sequence[str],
    histories: Sequence[ObjectHistory],
    trees: Sequence[EpochTree],
    pair_names: Mapping[tuple[int, int], str],
) -> str:
    missing = {tree.root for tree in trees if len(tree.epochs) == 1}
    begins = {tree.root for tree in trees if len(tree.epochs) > 1 and tree.root}
    heads = "".join(_head(number, name, number in missing) for number, name in enumerate(epochs))
    gaps = "".join(f'<span class="gap" style="--at:{epoch}"></span>' for epoch in sorted(missing))
    gaps += "".join(f'<span class="begin" style="--at:{epoch}"></span>' for epoch in sorted(begins))
    rows = "".join(_row(epochs, history, pair_names) for history in histories)
    # Pixels: the columns leave the plan its place in a window of 1,400, and none is narrower than the mark of an event.
    column = max(22, min(110, 800 // max(len(epochs), 1)))
    # A letter is 7 pixels wide; beside the marks there is room for numbers from 64 on.
    upright = " upright" if 7 * max(map(len, epochs)) > column else ""
    labelled = " labelled" if column >= 64 else ""
    sizes = f"--widest:{column}px;--count:{len(epochs)};--rows:{len(histories)}"
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


def _row(epochs: Sequence[str], history: ObjectHistory, pair_names: Mapping[tuple[int, int], str]) -> str:
    bars = "".join(
        f'<span class="bar{"" if stretch.known else " unknown"}" style="--at:{stretch.start:g};'
        f'--length:{stretch.end - stretch.start:g}"></span>'
        for stretch in stretches(history)
    )
    marks = "".join(_mark(epochs, history, event, pair_names) for event in history.events)
    return (
        f'<li data-object="{history.number}"><button type="button" aria-pressed="false" '
        f'aria-label="Object {history.number}: show it in the plan">{history.number}</button>'
        f'<div class="lane">{bars}{marks}</div></li>\n'
    )


def stretches(history: ObjectHistory) -> list[Stretch]:
    """The pieces of an object's bar: from where it came, or the edge, to where it went, or the edge."""
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
    """Without those of no length, and as few as will do."""
    joined: list[Stretch] = []
    for piece in pieces:
        if joined and joined[-1].known == piece.known and joined[-1].end == piece.start:
            joined[-1] = joined[-1]._replace(end=piece.end)
        elif piece.end > piece.start:
            joined.append(piece)
    return joined


def _mark(
    epochs: Sequence[str], history: ObjectHistory, event: ObjectEvent, pair_names: Mapping[tuple[int, int], str]
) -> str:
    said = escape(f"Object {history.number} {_sentence(epochs, event)}")
    moved = f"{event.distance:.2g} · " if event.distance is not None else ""
    label = f"<small>{moved}{percent(event.probability)}</small>"
    sign = SIGNS[event.kind]
    link = _link(event, pair_names)
    start, end = ("<span", "</span>") if link is None else (f'<a href="{link}"', "</a>")
    return (
        f'{start} class="mark {event.kind}" style="--at:{event.epoch}" title="{said}" aria-label="{said}">'
        f"{sign}{label}{end}"
    )


def _link(event: ObjectEvent, pair_names: Mapping[tuple[int, int], str]) -> str | None:
    """The address of the report of the comparison that shows an event; None where it has no name."""
    name = pair_names.get((event.comparison.before, event.comparison.after))
    return None if name is None else f"pairs/{quote(name, safe='')}/report.html"


def _sentence(epochs: Sequence[str], event: ObjectEvent) -> str:
    """What happened, after the name of the object."""
    did = f"{event.kind}{' back' if event.returned else ''}"
    if event.distance is not None:
        did += f" by {event.distance:.3g}"
    facts = [f"probability {percent(event.probability)}"]
    if event.moved_probability is not None:
        facts.append(f"the same object {percent(event.moved_probability)}")
    if event.change is None:
        facts.append(f"it no longer differs from {epochs[event.comparison.before]}")
    return f"{did} {_when(epochs, event)}: {', '.join(facts)}"


def _when(epochs: Sequence[str], event: ObjectEvent) -> str:
    if event.previous == event.epoch - 1:
        return f"in {epochs[event.epoch]}"
    return f"between {epochs[event.previous]} and {epochs[event.epoch]}"


def _plan(epochs: Sequence[str], tree: EpochTree, histories: Sequence[ObjectHistory]) -> str:
    """The plan of the objects in the frame of a tree; none where it has no object."""
    own = [history for history in histories if history.frame == tree.root]
    if not own:
        return ""
    name = escape(epochs[tree.root])
    return f"<figure><figcaption><b>Plan</b><span>along z, frame of {name}</span></figcaption>{plan_svg(own)}</figure>"


def _table(epochs: Sequence[str], histories: Sequence[ObjectHistory], pair_names: Mapping[tuple[int, int], str]) -> str:
    head = "".join(f'<th scope="col">{heading}</th>' for heading in HEADINGS)
    rows = "".join(_table_row(epochs, own, event, pair_names) for own in histories for event in own.events)
    count = sum(len(own.events) for own in histories)
    return f"""<details class="events"><summary>{_counted(count, "event")} as a table</summary>
<section class="scroll"><table><thead><tr>{head}</tr></thead>
<tbody>{rows}</tbody></table></section></details>"""


def _table_row(
    epochs: Sequence[str], history: ObjectHistory, event: ObjectEvent, pair_names: Mapping[tuple[int, int], str]
) -> str:
    kind = f'<i class="dot {event.kind}"></i>{event.kind}{" back" if event.returned else ""}'
    centre, size = place_text(event.box.centre, event.box.extent)
    before, after = (epochs[epoch] for epoch in event.comparison)
    shown, link = f"{escape(before)} → {escape(after)}", _link(event, pair_names)
    moved = "" if event.distance is None else f"{event.distance:.3g}"
    cells = (
        escape(_when(epochs, event)),
        percent(event.probability),
        moved,
        f"{event.point_count:,}",
        centre,
        size,
        shown if link is None else f'<a href="{link}">{shown}</a>',
    )
    return (
        f"<tr><td><b>{history.number}</b></td><td>{kind}</td>" + "".join(f"<td>{cell}</td>" for cell in cells) + "</tr>"
    )
