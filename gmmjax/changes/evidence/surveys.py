"""Both aligned clouds as surveys: with the views that go with them, in the frame of the before cloud."""

from gmmjax.changes.align.alignment import AlignedPair
from gmmjax.changes.evidence.free_space import FreeSpaceSettings, Survey
from gmmjax.changes.evidence.view_checks import ViewCheckSettings, usable_views
from gmmjax.changes.prepare.checking import NAMES
from gmmjax.clouds import SensorViews
from gmmjax.geometry import LocalSurface
from gmmjax.pair import Pair, each


def surveys_of(
    pair: AlignedPair,
    views: Pair[SensorViews | None],
    free_space: FreeSpaceSettings = FreeSpaceSettings(),
    view_checks: ViewCheckSettings = ViewCheckSettings(),
) -> Pair[Survey]:
    """Both clouds with their views, where these do not contradict them.

    Args:
        pair: both clouds, aligned.
        views: of the clouds as they were given; those of the after cloud move with it.
        free_space: what the points of a survey occlude.
        view_checks: from when on views contradict their cloud.

    Raises:
        InputError: views that see none of the points of their cloud.

    Warns:
        InputWarning: views that contradict their cloud.
    """
    if views.after is not None and pair.registration.applied:
        views = Pair(views.before, views.after.moved(pair.registration.transform))

    def survey(name: str, surface: LocalSurface, views: SensorViews | None) -> Survey:
        return usable_views(f"views_{name}", Survey(surface, views, free_space), view_checks)

    return each(survey, NAMES, pair.surfaces, views)
