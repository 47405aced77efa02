"""Geometry of points and scanned surfaces: rigid transforms, ICP, local planes, clusters, depth images."""
