"""The command line: `gmmjax detect`, `fit`, `simulate gaussians`, `demo`."""

from gmmjax.cli.application import main as main
