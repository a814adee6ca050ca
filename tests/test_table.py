"""Tables: the promise, the look-up and the files. The code made from them: test_export.py."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import warpopt
from warpopt import LambdaTable, build_table
from warpopt.table.files import TableFileError
from warpopt.table.polyline import fewest_knots

FRUSTUM = warpopt.ViewFrustum(1.0, 100.0, np.pi / 6)


@pytest.fixture(scope="module")
def table():
    return build_table(FRUSTUM, max_regret=1e-3)


def test_the_promise_is_kept_with_few_knots(table):
    """E_p L-inf, f/n = 100, 30 degrees, 0.1 %: at most 14 entries; judged anew at directions that no builder saw."""
    assert len(table.theta) <= 14
    theta = np.random.default_rng(99).uniform(0, np.pi / 2, 50_000)
    theta = np.concatenate([theta, np.asarray(table.theta, float), [np.pi / 6, np.nextafter(np.pi / 6, 0)]])
    theta = np.clip(theta, 0, np.pi / 2)
    warp = warpopt.Warp.from_eta(table.eta_numpy(theta), 1.0)
    regret = warpopt.error_norm(FRUSTUM, theta, warp) / warpopt.optimal_warp(FRUSTUM, theta).value - 1
    assert regret.max() <= 1e-3
    assert 0.5e-3 < table.achieved <= 1e-3  # nothing is wasted
    assert regret.max() <= table.achieved * (1 + 1e-9)


def test_fewest_knots_is_brute_forces_fewest():
    """A zigzag tube that needs every knot, and a straight one that needs two; each polyline stays inside."""
    x = np.linspace(0, 1, 41)
    for centre, width, fewest in (
        (0 * x, 0.1, 2), (np.abs(x - 0.5), 0.01, 3), (np.abs(np.abs(x - 0.5) - 0.25), 0.005, 5), (x**2, 0.02, 4)
    ):  # fmt: skip
        places, heights = fewest_knots(x, centre - width, centre + width)
        assert len(places) == fewest
        assert (np.abs(np.interp(x, x[places], heights) - centre) <= width * (1 + 1e-12)).all()
    with pytest.raises(ValueError, match="empty or not finite"):
        fewest_knots(x, x, x - 1)


def test_look_up_in_jax_and_numpy_agree_and_differentiate(table):
    theta = np.random.default_rng(1).uniform(0, np.pi, 5000)
    for dtype in (np.float64, np.float32):
        by_numpy, by_jax = (
            table.eta_numpy(theta.astype(dtype)),
            jax.jit(lambda t: table.eta(t))(jnp.asarray(theta, dtype)),
        )
        assert by_numpy.dtype == by_jax.dtype == dtype
        np.testing.assert_allclose(by_jax, by_numpy, rtol=4 * np.finfo(dtype).eps)  # exp's own rounding
    np.testing.assert_allclose(table.eta_numpy(np.pi - theta), table.eta_numpy(theta), rtol=1e-13)
    inner = np.radians([10.0, 40.0, 80.0])
    slope = jax.vmap(jax.grad(table.eta))(jnp.asarray(inner))
    step = 1e-6
    difference = (table.eta_numpy(inner + step) - table.eta_numpy(inner - step)) / (2 * step)
    np.testing.assert_allclose(slope, difference, rtol=1e-6)
    warp = table.warp(warpopt.ViewFrustum(2.0, 200.0, np.pi / 6), 0.9)
    np.testing.assert_allclose(warp.eta, table.eta_numpy(0.9), rtol=1e-14)
    with pytest.raises(ValueError, match=r"far/near: got 50\.0, expected the table's 100"):
        table.warp(warpopt.ViewFrustum(2.0, 100.0, np.pi / 6), 0.9)


def test_outside_is_clamped_or_refused_as_asked(table):
    part = build_table(FRUSTUM, max_regret=1e-2, theta_range=(0.3, 1.2))
    for theta in (-1.0, 0.1):
        assert part.eta_numpy(theta) == part.eta_numpy(part.theta[0])
        with pytest.raises(ValueError, match="theta: got"):
            part.eta_numpy(theta, outside="error")
    assert part.eta(1.5) == part.eta(float(part.theta[-1]))
    assert part.eta(float("nan")) == 1
    with pytest.raises(ValueError, match="theta: got nan"):
        part.eta(float("nan"), outside="error")
    with pytest.raises(ValueError, match="outside: got 'wrap'"):
        part.eta(1.0, outside="wrap")


@pytest.mark.parametrize("ending", ["npz", "csv", "json"])
def test_files_come_back_and_flaws_are_named(table, tmp_path, ending):
    path = tmp_path / f"table.{ending}"
    table.save(path)
    first = path.read_bytes()
    again = LambdaTable.load(path)
    for name in ("theta", "log_eta"):
        np.testing.assert_array_equal(getattr(again, name), getattr(table, name))
    assert (again.metric, again.achieved, again.version) == (table.metric, table.achieved, table.version)
    again.save(path)
    assert path.read_bytes() == first  # byte for byte
    assert list(tmp_path.iterdir()) == [path]
    code = "utf-32-le" if ending == "npz" else "ascii"
    later = first.replace("LambdaTable 1".encode(code), "LambdaTable 2".encode(code))
    assert later != first
    for broken in (first[: len(first) // 2], b"", later, b"hello\n"):
        path.write_bytes(broken)
        with pytest.raises(TableFileError, match=str(path)):
            LambdaTable.load(path)
    with pytest.raises(TableFileError, match="No such file"):
        LambdaTable.load(tmp_path / f"none.{ending}")
    with pytest.raises(ValueError, match="expected an ending of"):
        table.save(tmp_path / "table.xls")


def test_edited_tables_are_refused(table, tmp_path):
    path = tmp_path / "table.json"
    table.save(path)
    text = path.read_text()
    for old, new, words in (
        ('"metric": "p"', '"metrik": "p"', "got fields"), ('"promised": 0.001', '"promised": "x"', "no number"),
        ('"depth_ratio": 100', '"depth_ratio": -100', "negative or not finite"),
        ('"theta": [', '"theta": [\n  9.0,', "do not increase"),
    ):  # fmt: skip
        assert old in text
        path.write_text(text.replace(old, new))
        with pytest.raises(TableFileError, match=words):
            LambdaTable.load(path)


def test_bad_builds_are_refused():
    for options, words in (
        ({"max_regret": 0.0}, "max_regret: got 0.0"), ({"theta_range": (1.0, 2.0)}, "theta_range"),
        ({"metric": warpopt.Metric(1, 0)}, "metric: got"), ({"norm": 0.5}, "norm: got 0.5"),
    ):  # fmt: skip
        with pytest.raises(ValueError, match=words):
            build_table(FRUSTUM, **options)
    with pytest.raises(ValueError, match=r"frustum: got shape \(2,\)"):
        build_table(warpopt.ViewFrustum(1.0, np.array([2.0, 3.0]), 0.5))
