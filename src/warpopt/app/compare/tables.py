"""The data files of a comparison: `compare.csv`, `ranking.csv`, `compare.json`."""

import math
from pathlib import Path
from typing import Any

import numpy as np

import warpopt
from warpopt.compare.comparison import Comparison

from ..common.record import finite_or_none, write_csv
from ..inputs.scene_files import SceneInput
from .settings import CompareConfig, SceneCompareConfig
from .solve import Compared
from .splits import SplitsCompared

_COLUMNS = (
    "theta_deg",
    "eta",
    "defined",
    "worse_than_no_warp",
    "value",
    "over_optimum",
    "over_limit",
    "optimum",
    "limit",
)
_OVER: dict[str, "warpopt.compare.comparison.Over"] = {
    "optimum": "optimum",
    "limit": "bound",
    "no_warp": "no_warp",
}  # name of the column: name in the library


def write_compare_table(compared: list[Compared], path: Path) -> None:
    """One row for each objective, rule and direction; empty if there is no number."""
    place = ("camera", "light") if compared and compared[0].camera is not None else ()
    rows = []
    for c in compared:
        r = c.result
        many = {"eta": r.eta, "defined": r.defined, "worse_than_no_warp": r.worse, "value": r.values}
        many |= {"over_optimum": r.ratio, "over_limit": r.over_bound}
        each = {"theta_deg": np.rad2deg(r.theta), "optimum": np.asarray(r.solution.value), "limit": r.bound}
        for i, name in enumerate(r.names):
            columns = [_column(many[n], i) if n in many else _column(each[n], None) for n in _COLUMNS]
            for k in range(len(r.theta)):
                where = (c.camera, k) if place else ()
                rows.append([c.metric, c.norm, *where, name, *("" if v is None else v[k] for v in columns)])
    write_csv(path, ["metric", "norm", *place, "rule", *_COLUMNS], rows)


def write_ranking(compared: list[Compared], path: Path) -> None:
    """One row for each objective and rule, in the ranking's order; "inf" if unbounded, empty if there is no number."""
    scene = bool(compared) and compared[0].camera is not None
    heads = ["metric", "norm", *(["camera"] if scene else []), "place", "rule", "mean_over_optimum"]
    for over in _OVER:
        heads += [f"worst_over_{over}", f"at_theta_deg_over_{over}", *([f"at_light_over_{over}"] if scene else [])]
    rows = []
    for c in compared:
        ranking = c.result.ranking()
        for place, name in enumerate(c.result.order(), 1):
            row = [place if name in ranking else "", name, _cell(c.result.mean(name))]
            for over in _OVER:
                ratio, theta, nearest = c.result.worst(name, _OVER[over])
                row += [_cell(ratio), _cell(np.rad2deg(theta)), *([nearest if nearest >= 0 else ""] if scene else [])]
            rows.append([c.metric, c.norm, *([c.camera] if scene else []), *row])
    write_csv(path, heads, rows)


def write_split_table(splits: list[SplitsCompared], path: Path) -> None:
    """One row for each objective, way of splitting and direction."""
    rows = []
    for c in splits:
        place = () if c.camera is None else (c.camera,)
        theta = np.rad2deg(c.theta).tolist()
        for (name, over, warped), values, ratio in zip(c.keys, c.values, c.ratio, strict=True):
            for k, angle in enumerate(theta):
                light = () if c.camera is None else (k,)
                cells = finite_or_none(values[k]), finite_or_none(ratio[k])
                rows.append([c.metric, c.norm, *place, *light, name, over, warped, angle, *cells])
    scene = ["camera", "light"] if splits[0].camera is not None else []
    heads = ["metric", "norm", *scene, "splits", "over", "warped", "theta_deg", "value", "over_best"]
    write_csv(path, heads, rows)


def _cell(value: float) -> float | str:
    return "" if math.isnan(value) else float(value)


def _column(values: np.ndarray | None, i: int | None) -> list | None:
    if values is None:
        return None
    row = values if i is None else values[i]
    return row.tolist() if row.dtype == bool else [v if math.isfinite(v) else "" for v in row.tolist()]


def compare_record(
    config: CompareConfig | SceneCompareConfig, compared: list[Compared], splits: list[SplitsCompared],
    scene: SceneInput | None,
) -> dict[str, Any]:  # fmt: skip
    """All results, as strict JSON."""
    lights = {} if scene is None else {"lights": [list(direction) for direction in scene.lights]}
    measure = {"measure": config.objective.measure} if isinstance(config, CompareConfig) else {}
    told = {"objectives": [measure | _objective(c) for c in compared]}
    return lights | told | ({"cascades": [_splits(c) for c in splits]} if splits else {})


def _splits(c: SplitsCompared) -> dict[str, Any]:
    each = [
        {"splits": name, "over": over, "warped": warped, "value": _numbers(values), "over_best": _numbers(ratio)}
        for (name, over, warped), values, ratio in zip(c.keys, c.values, c.ratio, strict=True)
    ]
    place = {"metric": c.metric, "norm": c.norm, "camera": c.camera}
    return place | {"theta_deg": np.rad2deg(c.theta).tolist(), "ways": each}


def _objective(c: Compared) -> dict[str, Any]:
    r = c.result
    solution = r.solution
    return {
        "metric": c.metric,
        "norm": c.norm,
        "camera": c.camera,
        "theta_deg": np.rad2deg(r.theta).tolist(),
        "optimum": {
            "eta": _numbers(solution.warp.eta),
            "value": _numbers(solution.value),
            "outcome": [warpopt.Outcome(int(v)).name for v in np.asarray(solution.result)],
        },
        "limit": None if r.bound is None else _numbers(r.bound),
        "no_limit_because": r.no_bound_because,
        "undefined_because": r.undefined_because,
        "no_warp": _numbers(r.unwarped),
        "ranking": r.ranking(),
        "rules": {name: _rule(r, i, name) for i, name in enumerate(r.names)},
    }


def _rule(r: Comparison, i: int, name: str) -> dict[str, Any]:
    regions = r.regions or {}
    return {
        "eta": _numbers(r.eta[i]),
        "defined": r.defined[i].tolist(),
        "value": _numbers(r.values[i]),
        "over_optimum": _numbers(r.ratio[i]),
        "over_limit": None if r.over_bound is None else _numbers(r.over_bound[i]),
        "worse_than_no_warp": r.worse[i].tolist(),
        "mean_over_optimum": finite_or_none(r.mean(name)),
        **{f"worst_over_{over}": _worst(r, name, over) for over in _OVER},
        "regions_deg": {kind: np.rad2deg(np.array(of[name])).tolist() for kind, of in regions.items()} or None,
    }


def _worst(r: Comparison, name: str, over: str) -> dict[str, Any] | None:
    worst = r.worst(name, _OVER[over])
    if worst.nearest < 0:
        return None
    place = {"theta_deg": float(np.rad2deg(worst.theta)), "nearest": worst.nearest}
    return {"ratio": finite_or_none(worst.ratio), "unbounded": math.isinf(worst.ratio), **place}


def _numbers(values: Any) -> list[float | None]:
    return [finite_or_none(v) for v in np.asarray(values).tolist()]
