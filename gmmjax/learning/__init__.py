"""What is learned from simulated scenes, and shipped as data files of the package."""
