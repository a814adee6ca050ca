"""Finished frames on disk, so that a killed run resumes; each part is written whole and checked when read."""

import hashlib
import json
import os
import shutil
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np

import warpopt

from ..inputs.scene_files import SceneInput
from .settings import FramesConfig


class Parts:
    """The folder of finished frames next to the output folder; its name depends on the whole problem.

    Args:
        config, scene: the problem: settings, triangles, cameras and lights.
    """

    def __init__(self, config: FramesConfig, scene: SceneInput):
        assert scene.triangles is not None  # the settings ask for them
        told = config.model_dump(mode="json", exclude={"output": {"directory"}})
        digest = hashlib.sha256(json.dumps([told, warpopt.__version__], sort_keys=True).encode())
        digest.update(np.ascontiguousarray(scene.triangles).tobytes())
        digest.update(repr([camera.key for camera in scene.cameras]).encode())
        digest.update(repr(scene.lights).encode())
        directory = config.output.directory.absolute()
        self.folder = directory.parent / f".{directory.name}.{digest.hexdigest()[:16]}.parts"
        self.folder.mkdir(parents=True, exist_ok=True)

    def read(self, number: int) -> dict[str, Any] | None:
        """A frame's record, or None if it is missing, cut, or a picture of it has changed."""
        try:
            record = json.loads(self._path(number).read_text(encoding="utf-8"))
            digest = record.pop("digest")
            return record if digest == self._digest(record) else None
        except (OSError, ValueError, KeyError, TypeError, AttributeError):
            return None

    def write(self, number: int, record: dict[str, Any]) -> None:
        """A frame's record, after its pictures, which `record["files"]` names; under another name until whole."""
        path = self._path(number)
        temporary = path.with_name(f".{path.name}.{os.getpid()}")
        temporary.write_text(json.dumps(record | {"digest": self._digest(record)}), encoding="utf-8")
        temporary.rename(path)

    def move(self, names: Iterable[str], folder: Path) -> None:
        """Copy pictures to the result."""
        for name in names:
            shutil.copyfile(self.folder / name, folder / name)

    def delete(self) -> None:
        shutil.rmtree(self.folder, ignore_errors=True)

    def _path(self, number: int) -> Path:
        return self.folder / f"frame_{number:03d}.json"

    def _digest(self, record: dict[str, Any]) -> str:
        digest = hashlib.sha256(json.dumps(record, sort_keys=True).encode())
        for name in record["files"]:
            digest.update((self.folder / name).read_bytes())
        return digest.hexdigest()
