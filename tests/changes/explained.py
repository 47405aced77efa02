"""Explanations and rejected candidates, made by hand."""

import dataclasses

import numpy as np

from gmmjax.changes import Box, Contribution, Explanation, RejectedCandidate

CONTRIBUTIONS = (
    Contribution("free_share", 0.92, 3.14, "92 % of it lies where the other survey looked through"),
    Contribution("continued_share", 0.4, -1.26, "40 % of it continues planes of the other cloud"),
    Contribution("contact", 0.1, 0.04, "10 % of it touches unchanged surfaces"),
)


def explanation(changed=0.9, unchanged=0.08, contributions=CONTRIBUTIONS):
    return Explanation(changed, unchanged, max(0.0, 1 - changed - unchanged), contributions)


def rejected(kind="disappeared", reason="unchanged", changed=0.2, unchanged=0.7):
    points = np.random.default_rng(0).normal(size=(40, 3))
    own = explanation(changed, unchanged)
    return RejectedCandidate(kind, reason, own.changed, 40, points.mean(axis=0), Box.around(points), own)


def displaced(share, point_count, reason="unchanged"):
    """A rejected candidate of which this share lies surely off the other scan's surface."""
    fact = Contribution("displaced", share, 0.8, f"{share:.0%} of it lies surely off the other scan's surface")
    own = rejected(reason=reason)
    return dataclasses.replace(own, point_count=point_count, explanation=explanation(0.2, 0.7, (fact,)))
