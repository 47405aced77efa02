"""Robust statistics."""

# Standard deviation of a normal distribution in units of its median absolute deviation.
MEDIAN_TO_DEVIATION = 1.4826
