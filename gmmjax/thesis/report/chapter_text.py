"""The text of the page of chapter 4: the methods and measures, and the results of the thesis by figure."""

from collections.abc import Mapping

METHODS_TEXT = (
    "<b>joint</b> is the default of gmmjax, <b>transport</b> compares separate mixtures by partial transport, and "
    "<b>published</b> is the algorithm of the thesis: one fit of each cloud by annihilation, greedy removal by the "
    "earth mover's distance, for disappearances with the clouds exchanged. It is told which kinds of change to look "
    "for; the others are not. A detected segment of points is a true positive when more than half of it changed, and a "
    "change is found when half of its points lie in true positives. That is more than the thesis asks of a Gaussian, "
    "which is to overlap a change: <b>F1 by overlap</b> counts so, with a tenth in place of half. A true negative is a "
    "thing that did not change, a Gaussian, an object or a wall in either cloud, and that holds the largest part of no "
    "false segment. The thesis's recordings are not public: its numbers are of its own data, those here of simulated "
    "ones."
)

THESIS_TEXT: Mapping[str, str] = {
    "3.9": (
        "Of the models of three criteria, four types of covariance and 3 to 8 Gaussians the one with the lowest score "
        "is chosen. For the four Gaussians it was a diagonal one with four, by MDL; for the seven a diagonal one with "
        "three, by MDL."
    ),
    "4.1": (
        "Each of the four and of the seven Gaussians was found, with the same results nearly every time, and so were "
        "the three that appeared."
    ),
    "4.2": (
        "Clustering of the four Gaussians was consistently right, that of the seven was not: two examples have six "
        "and four. Diagonal covariances, BIC, 3 to 9 Gaussians."
    ),
    "4.6": (
        "With the voxel filter alone there is too much noise to detect any change rightly. With statistical outlier "
        "removal, walls that are misaligned are still reported."
    ),
    "4.9": (
        "F1 of about 0.80 in every condition with one kind of change, 0.52 where one Gaussian appears and another "
        "disappears."
    ),
    "4.10": (
        "Single frames have the highest recall, 1.0, with an F1 of 0.70; volumetric maps the highest precision, 0.81, "
        "with an F1 of 0.74. Localised maps are the worst; the text gives no number."
    ),
    "4.12": (
        "Disappearances reported where only appearances happened, and the reverse: an accuracy of 0.94 on single "
        "frames, 0.87 on volumetric and 0.82 on localised maps. 1 is no such report."
    ),
}
