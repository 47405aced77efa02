"""Small scenes for the tests of the evaluation."""

import numpy as np

from gmmjax.evaluation import LabelledCloud, LabelledPair, PairSource


def floor(generator, spacing=0.02, size=1.0, height=0.0):
    """Points on a floor, 2 mm of noise."""
    count = int((size / spacing) ** 2)
    return np.column_stack([generator.uniform(0, size, (count, 2)), height + 0.002 * generator.standard_normal(count)])


def floor_with_box(seed=0):
    """A floor; then a floor with the top of a box on it, and its truth."""
    generator = np.random.default_rng(seed)
    before, after, box = floor(generator), floor(generator), floor(generator, size=0.4, height=0.3)
    return before, np.concatenate([after, box + np.array([0.3, 0.3, 0])]), np.repeat([-1, 0], [len(after), len(box)])


def box_pair(seed=0, name="box"):
    before, after, truth = floor_with_box(seed)
    return LabelledPair(name, LabelledCloud(before, np.full(len(before), -1)), LabelledCloud(after, truth))


def source(pair, condition="box", group="floors"):
    return PairSource(pair.name, group, condition, lambda: pair)
