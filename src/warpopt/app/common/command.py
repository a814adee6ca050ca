"""Base classes of the commands. A command imports JAX, and code that needs it, only after its input is checked."""

import abc
import dataclasses
from pathlib import Path
from typing import Any

import tyro

from .output import check_replaceable
from .settings import ConfigError, read_config


class Failed(Exception):
    """A command failed although its input was valid; the message says why."""


@dataclasses.dataclass(frozen=True)
class Configured(abc.ABC):
    config: tyro.conf.Positional[Path]
    """TOML file; configs/ has examples. Any key can be overridden after it: --view.far 500 --light.theta_deg.count 31
    --objective.metrics '["p"]' --output.directory DIR. `warpopt schema --of COMMAND` lists the keys."""

    @staticmethod
    @abc.abstractmethod
    def model() -> Any:
        """The type of the configuration."""

    def read(self, overrides: list[str]) -> Any:
        """The configuration; checks that its output folder can be written."""
        config = read_config(self.config, overrides, self.model())
        check_replaceable(config.output.directory)
        return config

    @abc.abstractmethod
    def answer(self, overrides: list[str]) -> int:
        """Run the command; returns the exit code."""


class Plain(abc.ABC):
    """A command without a configuration, hence without overrides."""

    def answer(self, overrides: list[str]) -> int:
        if overrides:
            raise ConfigError(f"unknown argument(s): {' '.join(overrides)}")
        return self.run()

    @abc.abstractmethod
    def run(self) -> int:
        """Run the command; returns the exit code."""
