"""The views of a report and their toolbar, as HTML; `assets/report.js` brings them to life."""

from collections.abc import Mapping
from html import escape
from typing import Any, NamedTuple

from gmmjax.changes import Changes
from gmmjax.pair import Pair
from gmmjax.reporting.pictures import data_uri

# What the keys do, for the list of keys; `assets/report.js` does it.
KEYS = (
    ("j  n  ↓", "next change"),
    ("k  p  ↑", "previous change"),
    ("Enter", "open the chosen row"),
    ("Esc", "back to everything"),
    ("1  2", "before, after"),
    ("3  4", "unchanged, not observed"),
    ("5  6  7  8", "boxes, Gaussians, rejected, stations"),
    ("c", "next colouring"),
    ("o", "opacity by probability"),
    ("b", "blink between before and after"),
    ("x", "clip to the surroundings of the change"),
    ("0", "reset the view"),
    ("t", "light or dark"),
    ("?", "this list"),
)


class Toggle(NamedTuple):
    """A button of the toolbar: the viewer's setting, its text, key and hint, and whether it is pressed at first."""

    name: str
    text: str
    key: str
    hint: str
    pressed: bool = False


SHOWN = (
    Toggle("before", "Before", "1", "Points of the before scan", True),
    Toggle("after", "After", "2", "Points of the after scan", True),
    Toggle("unchanged", "Unchanged", "3", "Points that belong to no change", True),
    Toggle("unobserved", "Not observed", "4", "Points whose place the other survey did not see", True),
    Toggle("boxes", "Boxes", "5", "A box around each change, an arrow where it moved", True),
    Toggle("gaussians", "Gaussians", "6", "The Gaussian of each change"),
    Toggle("rejected", "Rejected", "7", "What looked changed and was turned down"),
    Toggle("stations", "Stations", "8", "Where the scanner stood, as recognised by the density of the ground", True),
)
EFFECTS = (
    Toggle("opacityByProbability", "Fade", "o", "Opacity by the probability of a change"),
    Toggle("blink", "Blink", "b", "Before and after in turn"),
    Toggle("clip", "Clip", "x", "Draw only the surroundings of the chosen change, so that nothing hides it", True),
)
COLORINGS = {
    "kind": "Colour by kind",
    "scan": "Colours of the scan",
    "probability": "Colour by probability",
    "distance": "Colour by distance",
}


def viewer_section(scene: Mapping[str, Any], names: Pair[str], overview: Pair[bytes], changes: Changes) -> str:
    """Make the large view with its toolbar, the two small ones, and pictures for those who see none of them.

    Args:
        scene: what the viewer is given.
        names: of the two scans.
        overview: pictures of both scans as a whole.
        changes: what was found.
    """
    figures = "".join(_small_view(side, name, scene) for side, name in zip(("before", "after"), names, strict=True))
    pictures = "".join(
        f'<figure><img src="{data_uri(picture)}" alt="The {side} scan, changes in the colours of their kinds">'
        f"<figcaption>{side.capitalize()}</figcaption></figure>"
        for side, picture in zip(("before", "after"), overview, strict=True)
    )
    return f"""<section class="views" aria-label="Views in three dimensions">
{_toolbar(scene, changes)}
<div class="stage">
<figure class="view main" id="stage"><canvas id="view-main" tabindex="0" aria-label="Both scans with all changes. Drag \
to turn, scroll to zoom, right-drag to move."></canvas>
<p class="focus" id="focus" aria-live="polite"></p><div class="legend" id="legend"></div>
<p class="loading" id="loading">Drawing the points …</p></figure>
<div class="small">{figures}</div>
</div>
<div class="pictures" id="pictures"><p class="note" id="no-view" hidden></p>{pictures}</div>
<noscript><p class="note">The views need JavaScript; the pictures and the list of changes do not.</p></noscript>
</section>"""


def keys_dialog() -> str:
    """Make the list of keys."""
    rows = "".join(f"<dt>{_keys(keys)}</dt><dd>{escape(text)}</dd>" for keys, text in KEYS)
    return f"""<dialog id="keys" aria-labelledby="keys-title"><h2 id="keys-title">Keys</h2><dl>{rows}</dl>
<p>In a view: drag to turn, right-drag to move, scroll or pinch to zoom, click on a change to choose it.</p>
<form method="dialog"><button>Close</button></form></dialog>"""


def _keys(keys: str) -> str:
    return " ".join(f"<kbd>{escape(key)}</kbd>" for key in keys.split())


def _toolbar(scene: Mapping[str, Any], changes: Changes) -> str:
    missing = set() if scene["has"]["unobserved"] else {"unobserved"}
    missing |= set() if changes.rejected else {"rejected"}
    missing |= set() if scene["stations"] else {"stations"}
    missing |= set() if changes.items else {"boxes", "gaussians", "opacityByProbability"}
    missing |= set() if changes.items or changes.rejected else {"clip"}
    shown = "".join(_button(toggle) for toggle in SHOWN if toggle.name not in missing)
    effects = "".join(_button(toggle) for toggle in EFFECTS if toggle.name not in missing)
    # Where nothing changed, the distances say most.
    first = "distance" if scene["has"]["distance"] and not changes.items else "kind"
    colorings = "".join(
        f'<option value="{name}"{" selected" * (name == first)}>{text}</option>'
        for name, text in COLORINGS.items()
        if scene["has"].get(name, True)
    )
    return f"""<div class="toolbar" role="toolbar" aria-label="What the views show">
<div class="group" role="group" aria-label="Shown">{shown}</div>
<select id="color" aria-label="Colour of the points" title="Colour of the points (c)">{colorings}</select>
<div class="group" role="group" aria-label="Drawing">{effects}</div>
<div class="group end"><button type="button" id="reset" title="Look at everything again (0)">Reset</button></div>
</div>"""


def _button(toggle: Toggle) -> str:
    return (
        f'<button type="button" data-toggle="{toggle.name}" data-key="{toggle.key}" '
        f'aria-pressed="{str(toggle.pressed).lower()}" title="{escape(toggle.hint)} ({toggle.key})">'
        f"{toggle.text}</button>"
    )


def _small_view(side: str, name: str, scene: Mapping[str, Any]) -> str:
    count, drawn = scene[side]["count"], scene[side]["drawn"]
    # Points of the same place are drawn once; only what a reader would miss is said.
    thinned = f'<span class="count">{drawn:,} of {count:,} points</span>' if drawn < 0.95 * count else ""
    return (
        f'<figure class="view"><canvas id="view-{side}" tabindex="0" aria-label="The {side} scan, from the same '
        f'camera"></canvas><figcaption><b>{side.capitalize()}</b><span class="name" title="{escape(name)}"><bdi>'
        f"{escape(name)}</bdi></span>{thinned}</figcaption></figure>"
    )
