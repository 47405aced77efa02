"""Families that the verdict was not learned from: what it finds there beside the thresholds before it and the peers."""
