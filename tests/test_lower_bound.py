"""The limit of any map along Z_w: closed forms and quadratures against raw geometry, brute force and the warps."""

import json

import hypothesis.strategies as st
import jax
import jax.numpy as jnp
import numpy as np
import pytest
import scenes
import scipy.optimize
import twin
from hypothesis import given, settings
from twin import mp, mpf

import warpopt
from warpopt import FrustumView, Objective, SceneView, lower_bound, lower_bound_map
from warpopt.bound import BoundMap
from warpopt.receivers import ConvexBody, DepthBuffer, DepthHistogram, PointReceivers
from warpopt.receivers.profiles.slices import Solid, body_shares
from warpopt.theory import LightFrame

EPS = np.finfo(np.float64).eps
PAPER = warpopt.ViewFrustum(1.0, 100.0, scenes.PHI)
FRUSTUM, THETA = scenes.batch()
VIEW = FrustumView(FRUSTUM, THETA)
POINTS = PointReceivers(np.ones((2, 3)))
HISTOGRAM = DepthHistogram((1.0, 4.0, 30.0, 100.0), (2.0, 1.0, 1.0))  # all of PAPER
KINDS = [("inf", "screen"), ("l1", "screen"), ("l2", "volume"), ("l1", "axis"), (2.5, "ground")]


@jax.jit
def limits(frustum, theta):
    return [lower_bound(FrustumView(frustum, theta), Objective("p", norm, measure)) for norm, measure in KINDS]


def rows(s):
    """Of the section of V in the YZ plane: [(depth, least z, greatest z)] at the corners' depths, and between them.

    By cutting the four edges with the line of one depth: no formula of ours.
    """
    corners = [(j * z * s.tan_phi, z) for z in (s.near, s.far) for j in (1, -1)]
    edges = [(corners[i], corners[j]) for i, j in ((0, 1), (1, 3), (3, 2), (2, 0))]

    def row(depth):
        z = []
        for (y0, z0), (y1, z1) in edges:
            d0, d1 = s.depth(y0, z0), s.depth(y1, z1)
            along = (depth - d0) / (d1 - d0) if d0 != d1 else mpf(-1)
            if abs(along - mpf(1) / 2) <= mpf(1) / 2 + mpf(10) ** -25:  # a row at a corner must not fall between
                z.append(z0 + (z1 - z0) * along)
        return min(z), max(z)

    return sorted({s.depth(y, z) for y, z in corners}), row


def twin_limit(s, order, density):
    """The limit by its definition: the integrals over depth of max 1/z, or of W^(1/(P+1)), numerically."""
    breaks, row = rows(s)
    if order == mp.inf:
        return mp.quad(lambda d: 1 / row(d)[0], breaks) / s.tan_phi

    def w(d):  # dy = d(depth) / |cos|; the width in x is 2 z tan(phi)
        low, high = row(d)
        k = 2 - order - density
        inner = mp.log(high / low) if k == 0 else (high**k - low**k) / k
        return 2 * s.tan_phi * inner / abs(s.cos)

    mass = mp.quad(lambda z: (2 * z * s.tan_phi) ** 2 * z**-density, [s.near, s.far])
    total = mp.quad(lambda d: w(d) ** (1 / (order + 1)), breaks)
    return (total ** (order + 1) / mass) ** (1 / order) / s.tan_phi


@pytest.fixture(scope="module")
def values():
    return limits(FRUSTUM, THETA)


@pytest.mark.parametrize("tag", ["paper, 60 degrees", "below phi", "deep", "thin", "mirrored", "wide"])
def test_against_raw_geometry(values, tag):
    """30 digits: closed forms to 16 eps, quadratures to 1e-12."""
    i = scenes.TAGS.index(tag)
    with mp.workdps(30):
        s = scenes.twins()[i]
        s = twin.Scene(*scenes.CASES[i][1:])
        for (norm, measure), value in zip(KINDS, values, strict=True):
            if measure == "axis":
                continue
            order = mp.inf if norm == "inf" else mpf({"l1": 1, "l2": 2}.get(norm, norm))
            exact = twin_limit(s, order, twin.DENSITY[measure])
            tolerance = 16 * EPS if norm == "inf" else 1e-12
            assert abs(float(mpf(float(value[i])) / exact - 1)) < tolerance, (norm, measure)


def test_the_closed_form_and_the_papers_ratios():
    """((b + a-) ln(f/n) + 2 T) / tan(phi), and optimum / limit at 90, 30 and 10 degrees."""
    theta = np.deg2rad([90.0, 30.0, 10.0])
    view = FrustumView(PAPER, theta)
    ratio = warpopt.optimal_warp(view).value / lower_bound(view)
    np.testing.assert_allclose(ratio, [2.15, 1.96, 16.3], rtol=3e-3)
    s, T = np.sin(theta), np.tan(scenes.PHI) * np.cos(theta)
    exact = ((s + T + np.maximum(T - s, 0)) * np.log(100) + 2 * T) / np.tan(scenes.PHI)
    np.testing.assert_allclose(lower_bound(view), exact, rtol=16 * EPS)


def test_a_thin_frustum_keeps_its_digits():
    """f/n - 1 = 1e-9, light overhead: ln(f/n) / tan(phi), and what the right angle's rounding adds.

    Killed: the logarithm of a quotient, which is 1e-7 off.
    """
    near = np.linspace(1.1, 7.3, 16)
    far = near + 1e-9 * np.linspace(0.7, 3.1, 16)
    found = lower_bound(FrustumView(warpopt.ViewFrustum(near, far, 0.5), np.pi / 2))
    exact = np.log1p((far - near) / near) / np.tan(0.5) + 2 * np.cos(np.pi / 2)
    np.testing.assert_allclose(found, exact, rtol=1e-14)


def test_the_logarithmic_map_attains_it_under_an_overhead_light():
    """s = log(z/n) / log(f/n): E_p = mu / (z tan(phi) s') is constant and equals the limit; the table is that map."""
    z = np.linspace(1, 100, 40)
    slope = 99 / (z * np.log(100))  # ds / d delta
    e_p = 99 / (z * np.tan(scenes.PHI) * slope)
    np.testing.assert_allclose(e_p, float(lower_bound(FrustumView(PAPER, np.pi / 2))), rtol=16 * EPS)
    best = lower_bound_map(FrustumView(PAPER, np.pi / 2))
    np.testing.assert_allclose(best(best.delta), np.log1p(99 * best.delta) / np.log(100), atol=1e-13)


def test_a_light_overhead_is_the_limit_of_lights_near_it():
    """T = 0 divides nothing: values continuous, gradients finite and those of a centred difference."""
    theta = np.pi / 2 - np.resize([0.0, 1e-12, 1e-9], 16)
    frustum = warpopt.ViewFrustum(np.full(16, 1.0), 100.0, scenes.PHI)
    for value in limits(frustum, theta):
        np.testing.assert_allclose(value, value[0], rtol=1e-7)
    edges = np.resize([0.3, 1.0, 3.0, np.pi / 2, 0.0, 1e-8, scenes.PHI], 16)

    def total(near, far, phi, theta):
        return sum(limits(warpopt.ViewFrustum(near, far, phi), theta)[:4])

    arguments = [*(np.full(16, v) for v in (1.0, 100.0, scenes.PHI)), edges]
    slopes = jax.jit(jax.grad(lambda *a: total(*a).sum(), (0, 1, 2, 3)))(*arguments)
    assert all(bool(jnp.isfinite(slope).all()) for slope in slopes)
    step = np.where(np.arange(16) < 3, 1e-5, 0)  # the others are edges
    for k, slope in enumerate(slopes):
        ends = (total(*(v + sign * step * (i == k) for i, v in enumerate(arguments))) for sign in (1, -1))
        up, down = (np.asarray(v)[:3] for v in ends)
        np.testing.assert_allclose(slope[:3], (up - down) / 2e-5, rtol=1e-6, atol=1e-5)


def test_single_precision(values):
    frustum, theta = scenes.batch(dtype=np.float32)
    same = warpopt.ViewFrustum(*(np.asarray(v, np.float64) for v in jax.tree.leaves(frustum)))
    for half, whole in zip(limits(frustum, theta), limits(same, np.asarray(theta, float)), strict=True):
        assert half.dtype == np.float32
        np.testing.assert_allclose(half, whole, rtol=64 * np.finfo(np.float32).eps)


def test_beyond_the_tabulated_integrals_it_is_nan():
    """At theta = phi the longest row has the whole depth ratio."""
    deep = FrustumView(warpopt.ViewFrustum(1.0, np.array([1e13, 1e15]), 0.5), 0.5)
    found = lower_bound(deep, Objective("p", "l1"))
    assert np.isfinite(found).tolist() == [True, False]


numbers = st.lists(st.floats(0, 1), min_size=16, max_size=16).map(np.array)


@settings(deadline=None, max_examples=6)
@given(a=numbers, b=numbers, c=numbers, d=numbers, e=numbers)
def test_no_warp_beats_it(a, b, c, d, e):
    near = 10 ** (6 * a - 3)
    frustum = warpopt.ViewFrustum(near, near * 1.05 * 1e4**b, 0.02 + 1.4 * c)
    view = FrustumView(frustum, np.pi * d)
    warp = warpopt.Warp.from_eta(10 ** (-5 * e), view)
    for (norm, measure), least in zip(KINDS[:4], limits(frustum, view.theta), strict=False):
        value = warpopt.error_norm(view, warp, Objective("p", norm, measure))
        # overhead, volume, L2: no warp is the optimum and attains it, to rounding
        assert bool((value >= least * (1 - 1e-12)).all())
    objective = Objective("q", measure="axis")
    least = lower_bound(view, objective)
    assert bool((warpopt.error_norm(view, warp, objective) >= least * (1 - 1e-12)).all())


def test_the_optimal_warp_of_e_q_attains_it():
    """Over V: no choice of widths, row by row, is better than the optimal warp: 2 b/a or 2 f/n."""
    best = warpopt.optimal_warp(VIEW, Objective("q")).value
    np.testing.assert_allclose(best, lower_bound(VIEW, Objective("q")), rtol=64 * EPS)
    for s, value in zip(scenes.twins(), lower_bound(VIEW, Objective("q")), strict=True):
        breaks, row = rows(s)
        by_rows = max(2 * row(d)[1] / row(d)[0] for d in breaks)
        assert abs(float(mpf(float(value)) / by_rows - 1)) < 1e-7  # to the twin's own branch at theta = phi


@pytest.mark.parametrize("degrees", [70.0, 20.0])
def test_no_monotone_map_does_better(degrees):
    """Brute force: the best of all maps in 40 linear pieces, by a general convex minimiser and by a linear programme.

    Pieces bracket the limit: their best is above it, and by little; with the nearest receiver of each piece replaced by
    the farthest nearest one, below it.
    """
    s = twin.Scene(1.0, 20.0, 0.5, np.deg2rad(degrees))
    frustum = warpopt.ViewFrustum(1.0, 20.0, 0.5)
    breaks, row = rows(s)
    count = 40
    edges = np.linspace(float(breaks[0]), float(breaks[-1]), count + 1)
    fine = np.linspace(edges[0], edges[-1], 40 * 50 + 1)[:-1].reshape(count, 50) + (edges[1] - edges[0]) / 100
    ends = np.array([[[float(v) for v in row(mpf(d))] for d in line] for line in fine])
    width = np.diff(edges)
    # L-inf: least v with step_k >= width_k max(1/z) / (v tan(phi)), steps summing to 1
    at_limit = float(lower_bound(FrustumView(frustum, np.deg2rad(degrees))))
    found = []
    for nearest in (1 / ends[..., 0].min(1), 1 / ends[..., 0].max(1)):
        need = width * nearest / np.tan(0.5)
        # maximise c = 1/v
        programme = scipy.optimize.linprog(
            np.append(np.zeros(count), -1.0),
            A_ub=np.hstack([-np.eye(count), need[:, None]]), b_ub=np.zeros(count),
            A_eq=[np.append(np.ones(count), 0.0)], b_eq=[1.0], bounds=[(0, None)] * (count + 1),
        )  # fmt: skip
        found.append(1 / programme.x[-1])
    assert found[1] < at_limit < found[0] < 1.2 * at_limit
    # L1 and L2 over the screen measure
    for order, norm in ((1, "l1"), (2, "l2")):
        k = -float(order)
        inner = (ends[..., 1] ** k - ends[..., 0] ** k) / k
        W = (2 * np.tan(0.5) * inner / float(s.cos)).mean(1) * width  # of each piece
        mass = 4 * np.tan(0.5) ** 2 * 19.0

        def value(logits, order=order, W=W, mass=mass):
            share = np.exp(logits - logits.max())
            share = share / share.sum()
            density = W * (width / (share * np.tan(0.5))) ** order / mass
            total = density.sum()
            return total, order * (share - density / total) * total

        best = scipy.optimize.minimize(value, np.zeros(count), jac=True, method="BFGS", options={"gtol": 1e-9})
        least = float(lower_bound(FrustumView(frustum, np.deg2rad(degrees)), Objective("p", norm)))
        assert least * (1 - 1e-4) < best.fun ** (1 / order) < least * 1.02  # the pieces' own sums are to 1e-4


def table_norm(best, frustum, theta, order, measure):
    """The norm over V of the E_p that the table's straight pieces give, by midpoints."""
    n = 300
    u, z = np.meshgrid((np.arange(n) + 0.5) / n, np.exp((np.arange(n) + 0.5) / n * np.log(100)), indexing="ij")
    s = twin.Scene(1.0, 100.0, scenes.PHI, theta)
    depth = z * float(s.sin) - z * float(s.tan_phi) * (1 - 2 * u) * float(s.cos) - float(s.d0)
    piece = np.clip(np.searchsorted(best.delta, depth / float(s.mu)) - 1, 0, len(best.s) - 2)
    slope = (np.diff(best.s) / np.maximum(np.diff(best.delta), 1e-300))[piece]
    error = float(s.mu) / (z * float(s.tan_phi) * slope)
    weight = z ** (3 - twin.DENSITY[measure])
    return error.max() if np.isinf(order) else ((weight * error**order).sum() / weight.sum()) ** (1 / order)


@pytest.mark.parametrize(
    ("norm", "measure", "slack"), [("inf", "screen", 0.03), ("l1", "screen", 1e-3), ("l2", "volume", 1e-3)]
)
def test_the_table_attains_the_limit_and_is_written_whole(tmp_path, norm, measure, slack):
    for degrees in (90.0, 60.0, 10.0, 0.0):
        theta = np.deg2rad(degrees)
        best = lower_bound_map(FrustumView(PAPER, theta), Objective("p", norm, measure))
        assert best.delta[0] == best.s[0] == 0
        assert best.delta[-1] == best.s[-1] == 1
        assert (np.diff(best.delta) > 0).all()
        assert (np.diff(best.s) >= 0).all()
        order = {"inf": np.inf, "l1": 1.0, "l2": 2.0}[norm]
        got = table_norm(best, PAPER, theta, order, measure) / best.value
        assert 1 - 1e-3 < got < 1 + slack  # the midpoint sum is to 1e-3
    paths = [tmp_path / f"map{ending}" for ending in (".npz", ".csv", ".json")]
    for path in paths:
        best.save(path)
        first = path.read_bytes()
        best.save(path)
        assert path.read_bytes() == first
    read = json.loads(paths[2].read_text())
    assert read["format"] == "warpopt.LimitMap 2"
    np.testing.assert_array_equal(read["s"], best.s)
    with np.load(paths[0]) as file:
        np.testing.assert_array_equal(file["delta"], best.delta)
    for path in paths:
        back = BoundMap.load(path)
        back.save(path)
        assert path.read_bytes() == {p: p.read_bytes() for p in paths}[path]
        assert (back.value, back.order, back.measure, back.mu) == (best.value, best.order, measure, best.mu)
        np.testing.assert_array_equal(back.s, best.s)
    with pytest.raises(ValueError, match=r"expected an ending"):
        best.save(tmp_path / "map.txt")


@pytest.mark.parametrize(
    ("name", "change", "words"),
    [
        ("map.json", lambda b: b[: len(b) // 2], "not a whole json map"),
        ("map.csv", lambda b: b.replace(b"\n1.0,1.0", b""), "not a whole csv map"),
        ("map.npz", lambda b: b[:-9], "not a whole npz map"),
        ("map.json", lambda b: b.replace(b"LimitMap 2", b"LimitMap 3"), "got format 'warpopt.LimitMap 3'"),
        ("map.json", lambda b: b.replace(b'"value": 7', b'"value": 8'), "digest"),
        ("map.json", lambda b: b.replace(b'"mu"', b'"nu"'), "got fields"),
        ("map.json", lambda b: b.replace(b'"s": [\n  0.0', b'"s": [\n  2.0'), "do not run from 0 to 1"),
        ("map.json", lambda b: b.replace(b'"near": 1.0', b'"near": [1]'), "not a number"),
        ("map.txt", lambda b: b, "expected .npz, .csv or .json"),
        ("none.json", None, "cannot be read: No such file"),
    ],
)
def test_a_file_that_is_no_map_is_refused_in_words(tmp_path, name, change, words):
    path = tmp_path / name
    if change:
        original = lower_bound_map(FrustumView(PAPER, np.pi / 2)).encoded(path if name != "map.txt" else "map.csv")
        path.write_bytes(change(original))
        assert name == "map.txt" or path.read_bytes() != original
    with pytest.raises(ValueError, match=words):
        BoundMap.load(path)


def camera_and_light(degrees, seed=None):
    light = np.array([0.0, -np.sin(np.deg2rad(degrees)), -np.cos(np.deg2rad(degrees))])
    forward, up = np.array([0.0, 0, -1]), np.array([0.0, 1, 0])
    turn = np.eye(3) if seed is None else np.asarray(scenes.turned(seed)[0])
    camera = warpopt.Camera((0, 0, 0), turn @ forward, turn @ up, 1.0, 100.0, scenes.PHI)
    return camera, warpopt.DirectionalLight(turn @ light)


@pytest.mark.parametrize("degrees", [90.0, 30.0, 10.0])
def test_bodies_have_the_frustums_limit(degrees):
    """V as a body, turned anyhow, E_p and E_q; a box within it has one of its own that no warp beats."""
    camera, light = camera_and_light(degrees, seed=3)
    box = ConvexBody.box((-np.inf,) * 3, (np.inf,) * 3)
    plain = FrustumView(PAPER, np.deg2rad(degrees))
    exact = {metric: float(lower_bound(plain, Objective(metric))) for metric in ("p", "q")}
    for receivers in (None, box, HISTOGRAM):
        for metric, value in [*exact.items(), ("max", max(exact.values()))]:
            found = lower_bound(SceneView(camera, light, receivers), Objective(metric))
            assert found == pytest.approx(value, rel=1e-10)
    for norm in ("inf", "l2"):
        axis = Objective("p", norm, "axis")
        expected = float(lower_bound(plain, axis))
        assert lower_bound(SceneView(camera, light), axis) == pytest.approx(expected, rel=1e-10)
    camera, light = camera_and_light(degrees)
    x, y, z = (v.ravel() for v in np.meshgrid([-3.0, 3.0], [-2.0, 1.0], [5.0, 40.0]))  # in eye coordinates
    body = ConvexBody.box((-3, -2, -40), (3, 1, -5))
    inside = np.abs(y) <= z * np.tan(scenes.PHI)  # the frustum cuts one edge of the box off
    depth = z * np.sin(np.deg2rad(degrees)) + y * np.cos(np.deg2rad(degrees))
    depth, z, x = ((v - depth[inside].min() if v is depth else v)[inside] for v in (depth, z, x))
    eta = np.exp(np.linspace(-6, 0, 200))[:, None]
    blend = depth / depth.max() * (1 - eta) + eta
    e_p = depth.max() / np.tan(scenes.PHI) * (blend**2 / (eta * z)).max(1)
    e_q = 2 / np.tan(scenes.PHI) * (x / blend).max(1) * (blend / z).max(1)
    assert lower_bound(SceneView(camera, light, body), Objective("p")) <= e_p.min() * (1 + 1e-12)
    assert lower_bound(SceneView(camera, light, body), Objective("q")) <= e_q.min() * (1 + 1e-12)


BOX = ConvexBody.box((-3, -2, -40), (3, 1, -5))


@pytest.mark.parametrize("degrees", [90.0, 40.0, 3.0])
def test_a_body_by_brute_force(degrees):
    """The box cut by V, sampled: 4 million points sorted into 400 depths, of each the nearest, the width and the sum.

    Maps that are linear in each depth, whose best is above the limit, by less than 1 %.
    """
    camera, light = camera_and_light(degrees)
    tan, (s, c) = np.tan(scenes.PHI), (np.sin(np.deg2rad(degrees)), np.cos(np.deg2rad(degrees)))
    z, y = np.meshgrid(5 + 35 * (np.arange(2800) + 0.5) / 2800, -2 + 3 * (np.arange(1500) + 0.5) / 1500)
    z, y = (v[np.abs(y) < z * tan] for v in (z, y))
    x, d = np.minimum(3, z * tan), z * s + y * c
    count = 400
    step = (d.max() - d.min()) / count
    where = np.minimum(((d - d.min()) / step).astype(int), count - 1)
    nearest, widest = np.full(count, np.inf), np.zeros(count)
    np.minimum.at(nearest, where, z)
    np.maximum.at(widest, where, x)
    found = {
        ("p", "inf"): step * (1 / nearest).sum() / tan,
        ("q", "inf"): 2 * (widest / nearest).max() / tan,
    }
    for norm, order in (("l1", 1), ("l2", 2)):
        sums = np.bincount(where, 2 * x * z ** (-2.0 - order), count)
        slope = sums ** (1 / (order + 1))  # s' in proportion; E_p = step sum(slope) / (z tan slope)
        total = (sums / slope**order).sum() * (step * slope.sum()) ** order
        found["p", norm] = (total / (2 * x / z**2).sum()) ** (1 / order) / tan
    for (metric, norm), value in found.items():
        got = lower_bound(SceneView(camera, light, BOX), Objective(metric, norm))
        slack = 0.02 if metric == "q" else 0.01  # a depth's widest receiver is not its nearest
        assert (1 - slack) * value < got < 1.002 * value, (metric, norm)  # the sums are to 2e-3


@pytest.mark.parametrize("degrees", [90.0, 60.0, 10.0])
def test_bodies_have_the_frustums_limit_in_l_p(degrees):
    """V turned anyhow: its closed form and tabulated integrals; a histogram whose counts are even over z is V."""
    camera, light = camera_and_light(degrees, seed=3)
    everything = ConvexBody.box((-np.inf,) * 3, (np.inf,) * 3)
    even = DepthHistogram(HISTOGRAM.edges, jnp.diff(HISTOGRAM.edges))
    for receivers, tolerance in ((None, 1e-11), (everything, 1e-11), (even, 1e-8)):
        exact = float(lower_bound(FrustumView(PAPER, np.deg2rad(degrees)), Objective("p", "l2")))
        found = lower_bound(SceneView(camera, light, receivers), Objective("p", "l2"))
        assert found == pytest.approx(exact, rel=tolerance)


@pytest.mark.thorough
def test_a_bodys_limit_in_l_p_has_derivatives_in_both_dtypes():
    """Centred differences; at special directions finite; single precision to a few hundred eps; flat and empty: 0."""

    eye = warpopt.Camera((0, 0, 0), (0, 0, -1), (0, 1, 0), near=1.0, far=100.0, half_fov=0.5)

    def value(theta):
        camera = jax.tree.map(lambda v: v.astype(theta.dtype), eye)
        light = warpopt.DirectionalLight(jnp.stack([0 * theta, -jnp.sin(theta), -jnp.cos(theta)]))
        return body_shares(camera, LightFrame(camera, light), Solid.uniform(camera.planes(), 2.0), 2.0)[3]

    theta = jnp.array([1.2, 0.2, 0.0, np.pi / 2, 0.5])
    whole, slope = jax.jit(lambda theta: jax.lax.map(jax.value_and_grad(value), theta))(theta)
    assert np.isfinite(slope).all()
    values = jax.jit(lambda theta: jax.lax.map(value, theta))
    differences = (values(theta + 1e-5) - values(theta - 1e-5)) / 2e-5
    np.testing.assert_allclose(slope[:2], differences[:2], rtol=1e-7)
    half = values(theta.astype(jnp.float32))
    assert half.dtype == jnp.float32
    np.testing.assert_allclose(half, whole, rtol=2e-5)
    camera, light = camera_and_light(90.0)
    for body in (ConvexBody.box((-3, -2, -40), (3, 1, -40)), ConvexBody.box((0, 0, 5), (1, 1, 9))):
        assert lower_bound(SceneView(camera, light, body), Objective("p", "l2")) == 0


def test_the_map_of_a_body_attains_its_limit_in_l_p():
    """The norm of the straight pieces by midpoints over the box, L2 over the screen: within 1 % of the limit."""
    camera, light = camera_and_light(40.0)
    best = lower_bound_map(SceneView(camera, light, BOX), Objective("p", "l2"))
    assert (np.diff(best.delta) > 0).all()
    z, y = np.meshgrid(5 + 35 * (np.arange(700) + 0.5) / 700, -2 + 3 * (np.arange(400) + 0.5) / 400)
    z, y = (v[np.abs(y) < z * np.tan(scenes.PHI)] for v in (z, y))
    delta = (z * np.sin(np.deg2rad(40.0)) + y * np.cos(np.deg2rad(40.0)) - best.start) / best.mu
    piece = np.clip(np.searchsorted(best.delta, delta) - 1, 0, len(best.s) - 2)
    error = best.density * best.mu / (z * (np.diff(best.s) / np.diff(best.delta))[piece])
    weight = np.minimum(3, z * np.tan(scenes.PHI)) / z**2
    got = np.sqrt((weight * error**2).sum() / weight.sum()) / best.value
    assert 0.999 < got < 1.01


def test_a_gap_in_a_histogram_takes_no_texels():
    """A light overhead: the logarithm over the filled bins alone."""
    camera, light = camera_and_light(90.0)
    gap = DepthHistogram(HISTOGRAM.edges, (2.0, 0.0, 1.0))
    exact = (np.log(4) + np.log(100 / 30)) / np.tan(scenes.PHI)
    assert lower_bound(SceneView(camera, light, gap)) == pytest.approx(exact, rel=1e-12)
    best = lower_bound_map(SceneView(camera, light, gap))
    assert best(3 / 99) == pytest.approx(best(29 / 99), rel=1e-12)


def best_steps(delta, z, bins, norm):
    """The least norm of 1 / (z s') of maps that are linear within the bins, by a general convex minimiser."""
    edges = 1e-4 * np.expm1(np.linspace(0, np.log1p(1e4), bins + 1))
    which = np.clip(np.searchsorted(edges, delta, side="right") - 1, 0, bins - 1)
    filled = np.unique(which)
    width = np.diff(edges)[filled]
    if norm == "inf":  # maximise c = 1 / value
        need = width * [(1 / z[which == k]).max() for k in filled]
        found = scipy.optimize.linprog(
            np.append(np.zeros(len(width)), -1.0),
            A_ub=np.hstack([-np.eye(len(width)), need[:, None]]), b_ub=np.zeros(len(width)),
            A_eq=[np.append(np.ones(len(width)), 0.0)], b_eq=[1.0], bounds=[(0, None)] * (len(width) + 1),
        )  # fmt: skip
        return 1 / found.x[-1]
    sums = np.array([(z[which == k] ** -2.0).sum() for k in filled]) * width**2 / len(z)

    def value(logits):
        share = np.exp(logits - logits.max()) / np.exp(logits - logits.max()).sum()
        terms = sums / share**2
        return terms.sum(), 2 * (share * terms.sum() - terms)

    start = np.log(width)
    return np.sqrt(scipy.optimize.minimize(value, start, jac=True, method="BFGS", options={"gtol": 1e-12}).fun)


def test_points_and_buffers_approach_the_limit_of_what_they_sample():
    """Uniform over screen and depth, L1 and L2: V's own limit within the sampling's 2 %. None: 0."""
    rng = np.random.default_rng(5)
    q, p, z = rng.uniform(-1, 1, 200_000), rng.uniform(-1, 1, 200_000), rng.uniform(1, 100, 200_000)
    tan = np.tan(scenes.PHI)
    camera, light = camera_and_light(60.0)
    points = PointReceivers(np.stack([q * z * tan, p * z * tan, -z], 1))
    for norm in ("l1", "l2"):
        exact = float(lower_bound(FrustumView(PAPER, np.deg2rad(60.0)), Objective("p", norm)))
        got = lower_bound(SceneView(camera, light, points), Objective("p", norm))
        assert got == pytest.approx(exact, rel=0.02)
    for metric in ("p", "q"):
        at_most = float(lower_bound(FrustumView(PAPER, np.deg2rad(60.0)), Objective(metric)))
        found = lower_bound(SceneView(camera, light, points), Objective(metric))
        assert 0.8 * at_most < found < 1.05 * at_most, metric
    up = tan * (1 - (np.arange(54) + 0.5) / 27)  # y/z of the rows
    depth = np.where(up < 0, 2 / np.where(up < 0, -up, 1), 0)[:, None] * np.ones(96)  # the ground, 2 below the eye
    buffer = DepthBuffer(np.where(depth < 100, depth, 0))
    z = depth[(depth > 0) & (depth < 100)]
    d = z * np.sin(np.pi / 3) + 2 * np.cos(np.pi / 3)
    share = (d - d.min()) / (d.max() - d.min())
    eta = np.exp(np.linspace(-7, 0, 200))[:, None]
    error = (d.max() - d.min()) / tan * ((1 - share) * eta + share) ** 2 / (eta * z)
    for norm, values in (("inf", error.max(1)), ("l2", np.sqrt((error**2).mean(1)))):
        for bins in (8, 32):
            least = lower_bound(SceneView(camera, light, buffer), Objective("p", norm), bins=bins)
            assert least == pytest.approx(best_steps(share, z, bins, norm) * (d.max() - d.min()) / tan, rel=1e-6)
            assert least < values.min() * 1.08  # what a warp may gain within a bin
    assert lower_bound(SceneView(camera, light, PointReceivers(np.zeros((0, 3))))) == 0


def test_maps_over_receivers_attain_their_limits():
    """Over V it is the frustum's own map; over points no other map that is linear within the bins has a lesser norm."""
    camera, light = camera_and_light(60.0, seed=3)
    own = lower_bound_map(FrustumView(PAPER, np.deg2rad(60.0)))
    best = lower_bound_map(SceneView(camera, light))
    assert best.value == pytest.approx(own.value, rel=1e-12)
    assert (best.start, best.mu, best.density) == pytest.approx((own.start, own.mu, own.density), rel=1e-12)
    at = np.linspace(0, 1, 400)
    np.testing.assert_allclose(best(at), own(at), atol=2e-3)  # both are polylines
    rng = np.random.default_rng(8)
    camera, light = camera_and_light(40.0)
    z = rng.uniform(2, 60, 5000)
    y = rng.uniform(-0.5, 0.5, 5000) * z
    points = PointReceivers(np.stack([0 * z, y, -z], 1))
    d = z * np.sin(np.deg2rad(40.0)) + y * np.cos(np.deg2rad(40.0))
    for norm, order in (("inf", np.inf), ("l2", 2.0)):
        view, objective = SceneView(camera, light, points), Objective("p", norm)
        best = lower_bound_map(view, objective, bins=32)
        assert best.value == lower_bound(view, objective, bins=32)
        delta = (d - best.start) / best.mu
        piece = np.clip(np.searchsorted(best.delta, delta, side="right") - 1, 0, 31)
        values = []
        for k in range(20):
            steps = np.diff(best.s) * (1 if k == 0 else np.exp(0.1 * rng.normal(size=32)))
            slope = steps / steps.sum() / np.diff(best.delta)
            error = best.density * best.mu / (z * slope[piece])
            values.append(error.max() if norm == "inf" else np.mean(error**order) ** (1 / order))
        assert values[0] == pytest.approx(best.value, rel=1e-10)
        assert min(values[1:]) > best.value


@pytest.mark.wrong_types
@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda c, light: lower_bound_map(SceneView(c, light, POINTS)), "more than one"),
        (lambda c, light: lower_bound(FrustumView(PAPER, 1.0), Objective("pxq")), "product of E_p and E_q"),
        (lambda c, light: lower_bound(FrustumView(PAPER, 1.0), Objective("q", "l2")), "E_q in L_2"),
        (lambda c, light: lower_bound(FrustumView(PAPER, -1.0)), "theta"),
        (lambda c, light: lower_bound_map(FrustumView(PAPER, np.array([1.0, 2.0]))), "expected one frustum"),
        (lambda c, light: lower_bound_map(FrustumView(PAPER, 1.0), knots=1), "knots"),
        (lambda c, light: lower_bound_map(FrustumView(PAPER, 0.0), Objective(measure="axis")), "more than one depth"),
        (lambda c, light: lower_bound(SceneView(c, light, "all"), Objective("p", "l2")), "receivers: got"),
        (lambda c, light: lower_bound(SceneView(c, light, POINTS), Objective("q", "l2")), "E_q in L_2"),
        (lambda c, light: lower_bound(SceneView(c, light, "all")), "receivers: got"),
        (lambda c, light: lower_bound(SceneView(c, light, POINTS), Objective("max", "l2")), "No lower bound is known"),
        (lambda c, light: lower_bound(SceneView(c, light, None), Objective("pxq")), "product"),
        (lambda c, light: lower_bound(SceneView(c, light), bins=0), "bins"),
    ],
)  # fmt: skip
def test_what_is_not_known_is_refused(call, words):
    with pytest.raises(ValueError, match=words):
        call(*camera_and_light(45.0))


@pytest.mark.parametrize("theta", [0.2, 1.0])
def test_no_receiver_of_the_frustum_is_above_the_map_s_limit(theta):
    """E_p = mu / (z tan(phi) s') at points of V, s' of the stretch that each is in; below and above theta = phi.

    A stretch's slope is its mean: 3 % for 96 of them. Killed: lengths of one side taken for the other's.
    """
    view = FrustumView(PAPER, theta)
    best, limit = lower_bound_map(view), float(lower_bound(view))
    rng = np.random.default_rng(3)
    z, u = 100 ** rng.random(20_000), rng.random(20_000)
    z[:2000], u[2000:4000], u[4000:6000] = 1.0, 0.0, 1.0
    depth = z * np.sin(theta) - z * np.tan(scenes.PHI) * (1 - 2 * u) * np.cos(theta)
    start, mu = float(view.start), float(view.mu)
    delta, s = np.asarray(best.delta), np.asarray(best.s)
    place = np.clip(np.searchsorted(delta, (depth - start) / mu) - 1, 0, len(delta) - 2)
    slope = np.diff(s)[place] / np.diff(delta)[place]
    errors = mu / (z * np.tan(scenes.PHI) * slope)
    assert 0.95 * limit < errors.max() < 1.03 * limit
