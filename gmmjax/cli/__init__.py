"""The command line: `gmmjax detect`, `fit`, `simulate gaussians`, `evaluate gaussians`, `demo`."""

from gmmjax.cli.application import main as main
