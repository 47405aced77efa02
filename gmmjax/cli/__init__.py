"""The command line, `gmmjax`: one module for each command of `application.COMMANDS`."""

from gmmjax.cli.application import main as main
