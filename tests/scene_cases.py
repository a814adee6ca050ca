"""What the tests of `warpopt scene` share: configurations, a ground plane, a glTF file, and the command itself."""

import base64
import json
from pathlib import Path

import numpy as np
import pytest

from warpopt.app import cli
from warpopt.scene_files.scene_camera import SceneCamera, centred_window, orientation

CAMERA = (
    "position = [0, 2, 0]\nforward = [0, -0.1, -1]\nnear = 1.0\nfar = 100.0\nhalf_fov_deg = 25.0\naspect = 1.777778"
)


HEIGHT, WIDTH = 54, 96


BOX = "box = { lower = [-20, 0, -80], upper = [20, 8, -5] }"


def toml(receivers: str, light: str = "direction = [0.3, -1, -0.2]", camera: str = CAMERA, more: str = "") -> str:
    """A scene's configuration; E_p in L-inf if `more` names no objective: it compiles faster than the band."""
    more = more if "[objective]" in more or "[frames]" in more else "[objective]\nmetrics = 'p'\n" + more
    camera = camera and f"[camera]\n{camera}\n"
    return f"{camera}[light]\n{light}\n[receivers]\n{receivers}\n{more}\n[output]\ndirectory = 'out'\nfigures = false\n"


def ground(near=1.0, far=100.0) -> np.ndarray:
    """Eye depth of the plane y = 0 under the camera of the tests; 0 for the sky."""
    camera = SceneCamera(
        np.array([0, 2.0, 0]), orientation(np.array([0, -0.1, -1]), np.array([0, 1.0, 0]), "right"), near, far,
        centred_window(np.deg2rad(25), 16 / 9),
    )  # fmt: skip
    across, up = camera.slopes(HEIGHT, WIDTH)
    fall = -(camera.rotation[1, 1] * up[:, None] + camera.rotation[2, 1] + 0 * across)
    z = np.where(fall > 0, 2 / np.where(fall > 0, fall, 1), 0)
    return np.where(z < far, z, 0)


def invoke(*arguments: str) -> int:
    with pytest.raises(SystemExit) as exit_:
        cli.main(["scene", *arguments])
    return exit_.value.code


def run(text: str, *arguments: str) -> dict:
    """What scene.json says of a configuration, strictly read."""
    Path("scene.toml").write_text(text)
    assert invoke("scene.toml", *arguments) == 0
    return strict(Path("out/scene.json"))


def strict(path: Path) -> dict:
    def forbidden(constant):
        raise AssertionError(constant)

    return json.loads(path.read_text(), parse_constant=forbidden)


def gltf(extra_nodes: list | None = None, lens: dict | None = None, positions=None) -> dict:
    """A quad in y = 0 and a box, both below nodes that move them, and a camera on a boom."""
    quad = np.array([[-1, 0, -1], [-1, 0, 1], [1, 0, 1], [1, 0, -1]], "f4") if positions is None else positions
    faces = np.array([[0, 1, 2], [0, 2, 3]], "u2")
    blob = quad.tobytes() + faces.tobytes()
    lens = {"yfov": 0.8, "aspectRatio": 16 / 9, "znear": 0.5, "zfar": 200.0} if lens is None else lens
    half = float(np.sqrt(0.5))
    return {
        "asset": {"version": "2.0"},
        "scene": 0,
        "scenes": [{"nodes": [0, 2]}],
        "nodes": [
            {"name": "moved", "translation": [0, 1, -20], "children": [1]},
            {"name": "ground", "mesh": 0, "scale": [30, 1, 18]},
            {"name": "boom", "translation": [0, 5, 0], "rotation": [0, half, 0, half], "children": [3]},
            # 4 along the boom's x, which points to world -z; turned back, so that it looks along -z.
            {"name": "eye", "translation": [4, 0, 0], "rotation": [0, -half, 0, half], "camera": 0},
            *(extra_nodes or []),
        ],
        "cameras": [{"type": "perspective", "perspective": lens}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1}]}],
        "accessors": [
            {
                "bufferView": 0, "componentType": 5126, "count": len(quad), "type": "VEC3",
                "min": quad.min(0).tolist(), "max": quad.max(0).tolist(),
            },
            {"bufferView": 1, "componentType": 5123, "count": 6, "type": "SCALAR"},
        ],
        "bufferViews": [
            {"buffer": 0, "byteOffset": 0, "byteLength": quad.nbytes},
            {"buffer": 0, "byteOffset": quad.nbytes, "byteLength": faces.nbytes},
        ],
        "buffers": [{"byteLength": len(blob), "uri": f"data:;base64,{base64.b64encode(blob).decode()}"}],
    }  # fmt: skip
