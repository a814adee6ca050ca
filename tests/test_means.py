"""Means of a texel's size over weighted receivers: "edge", "band" and "max", against brute force from raw geometry."""

import functools

import jax
import jax.numpy as jnp
import mpmath
import numpy as np
import pytest

import warpopt
from warpopt import Camera, DirectionalLight, Objective, Outcome, SceneView, optimal_warp
from warpopt.receivers import ConvexBody, DepthBuffer, DepthHistogram, PointReceivers
from warpopt.receivers.weighted import cells
from warpopt.receivers.weighted.weights import Weights
from warpopt.solve.means.cell_bounds import corner_mean, covariance_loss, excess_of_cells
from warpopt.solve.means.sample_norm import Touch, _first_largest
from warpopt.solve.means.weak_convexity import least
from warpopt.solve.pieces import value_at
from warpopt.solve.scene_norm import log_norm_of
from warpopt.theory import edge_offset

CAMERA = Camera((0, 2, 0), (0, 0, -1), (0, 1, 0), near=0.1, far=500.0, half_fov=0.4, aspect=1.6)
SCREEN, MAP = (1280, 800), (1024, 1024)
RESOLUTIONS = {"screen": SCREEN, "shadow_map": MAP}
BINS = 24
# Each kernel, and an order above 1; every program takes seconds to compile.
OBJECTIVES = [Objective("edge"), Objective("band"), Objective("max", "l2")]
ETAS = np.geomspace(1e-4, 1, 300)  # steps of 3 %: no basin of a mean over 24 receivers is as narrow
NAMES = [o.title for o in OBJECTIVES]


def points_of(rng, count=64, seen=24):
    """Points in the view, of which about a third have weight 0; all but `seen` repeat the first without weight."""
    z = np.exp(rng.uniform(0, 5, seen))
    points = np.stack([rng.uniform(-0.4, 0.4, seen) * z, 2 + rng.uniform(-0.35, 0.35, seen) * z, -z], 1)
    weights = rng.exponential(size=seen) * (rng.random(seen) < 0.7)
    weights[0] = 1.0
    rest = count - seen
    return np.concatenate([points, np.repeat(points[:1], rest, 0)]), np.concatenate([weights, np.zeros(rest)])


_edge_offset = jax.jit(edge_offset)


def kernel(metric, e_p, sigma, e_q):
    if metric == "max":
        return np.maximum(e_p, e_q)
    if metric == "p":
        return e_p
    if metric == "edge":
        return np.maximum(np.hypot(e_p, sigma * e_p), e_q)
    return np.asarray(_edge_offset(e_p, sigma, e_q))  # itself held against quadrature below


def brute(points, weights, light, objective, etas, screen=SCREEN, shadow_map=MAP, normals=None, rounded=None):
    """The mean for every eta, from world points: axes, extents and errors are computed anew.

    With normals, of edges with these on the screen, of which `rounded` may change the components in a texel's axes.
    """
    eye = (points - np.array([0.0, 2.0, 0.0])) * np.array([1.0, 1.0, -1.0])
    towards = np.asarray(light) * np.array([1.0, 1.0, -1.0])
    towards = towards / np.linalg.norm(towards)
    axis = np.array([0.0, 0.0, 1.0]) - towards * towards[2]
    axis /= np.linalg.norm(axis)
    d, x, z = eye @ axis, eye @ np.cross(axis, towards), eye[:, 2]
    x = x - np.clip(0, x.min(), x.max())
    mu = np.ptp(d)
    delta = (d - d.min()) / mu
    # Pixels to a unit of slope along X_w's image on the screen, and across it: their product is a pixel's area.
    per_slope = np.array(screen) / (2 * np.tan(0.4) * np.array([1.6, 1]))
    right, up = np.cross(axis, towards)[:2]
    across = np.hypot(right * per_slope[0], up * per_slope[1]) / np.hypot(right, up)
    along = per_slope.prod() / across
    counted = slice(None) if len(weights) == 24 else weights > 0  # few: one shape, compiled once
    eta = np.atleast_1d(etas)[:, None]
    blend = (1 - delta) * eta + delta
    width = ((x / blend).max(1) - (x / blend).min(1))[:, None]
    e_p = along / shadow_map[1] * mu * blend**2 / (eta * z)
    e_q = across / shadow_map[0] * width * blend / z
    sigma = np.abs(x) * (1 - eta) / (blend * mu) * across / along
    if normals is None:
        size = kernel(objective.name, *(v[:, counted] for v in (e_p, sigma, e_q)))
    else:
        # A texel's edges on the screen: on lit surfaces depth grows against the light.
        column, row = np.array([-up, right]) * per_slope, np.array([right, up]) * per_slope
        c, s = (normals * column / along).sum(1), (normals * row / across).sum(1)
        s = s * np.where(x < 0, -1, 1)
        c, s = (c, s) if rounded is None else rounded(c, s)
        a, b = np.abs(e_p * (c + sigma * s))[:, counted], np.abs(e_q * s)[:, counted]
        size = np.maximum(a, b) / 4 + np.minimum(a, b) ** 2 / (12 * np.maximum(a, b))
    return (size**objective.order @ weights[counted] / weights.sum()) ** (1 / objective.order)


def view_of(points, weights, light, **resolutions):
    resolutions = resolutions or {"screen": SCREEN, "shadow_map": MAP}
    return SceneView(CAMERA, DirectionalLight(light), PointReceivers(points, weights), **resolutions)


@functools.cache
def sets():
    rng = np.random.default_rng(5)
    drawn = [(*points_of(rng), rng.normal(size=3)) for _ in range(300)]
    return [np.stack(v) for v in zip(*drawn, strict=True)]


@pytest.mark.parametrize("objective", OBJECTIVES, ids=NAMES)
@pytest.mark.thorough("band, norm l1")
def test_the_optimum_is_brute_force_s(objective):
    """300 sets each. The grid's least value is above the optimum by its spacing; the value must be exact at eta."""
    points, weights, lights = sets()
    solve = jax.jit(jax.vmap(lambda p, w, light: optimal_warp(view_of(p, w, light), objective, throw=False)))
    found = jax.tree.map(np.asarray, solve(points, weights, lights))
    for i, value in enumerate(found.value):
        args = points[i, :24], weights[i, :24], lights[i], objective  # the others repeat the first
        np.testing.assert_allclose(value, brute(*args, float(found.warp.eta[i]))[0], rtol=1e-12)
        assert value <= brute(*args, ETAS).min() * (1 + 1e-9)
        assert 0 <= found.gap[i] <= 1e-6
    assert not found.excess.any()


def test_an_edges_offset_is_the_mean_distance_over_a_texel():
    """By a midpoint rule: 600 squared points leave 1e-6."""
    rng = np.random.default_rng(1)
    u = (np.arange(600) + 0.5) / 600 - 0.5
    for _ in range(20):
        e_p, e_q = np.exp(rng.normal(0, 2, 2))
        sigma = rng.normal() * 2
        mean = np.hypot(u[:, None] * e_p, u[:, None] * e_p * sigma + u * e_q).mean() * 2 / np.pi
        np.testing.assert_allclose(edge_offset(*map(jnp.asarray, (e_p, sigma, e_q))), mean, rtol=2e-6)


def test_an_edges_offset_and_its_derivatives_are_those_of_many_digits():
    """T53's integrals from the texel's sides, to 60 digits, and their differences; bounds in the dtype's eps.

    8 for a dozen roundings; 200 for derivatives (170 is the worst of 9,000 draws): g is rounded over T^2 >= 1/16.
    """
    rng = np.random.default_rng(2)
    e_p, e_q = np.exp(rng.normal(0, 5, (2, 60)))
    sigma = rng.normal(size=60) * np.exp(rng.normal(0, 3, 60))
    sigma[:6] = 0, 0, 1e-9, e_q[3] / e_p[3], -1e6, 1e6

    def exact(p, sigma, q):
        s = p * abs(sigma)
        R, a = (mpmath.hypot(p, s + q) + mpmath.hypot(p, s - q)) / 2, mpmath.hypot(p, s)
        sides = [(q, s, p / 2), (a, q * s / a, q * p / (2 * a))]
        to_sides = (R / 4 + b**2 / (4 * R) + h**2 * mpmath.atanh(length / R) / length for length, b, h in sides)
        return 2 / (3 * mpmath.pi) * sum(to_sides)

    for dtype, unit in ((np.float64, 2.0**-52), (np.float32, 2.0**-23)):
        inputs = np.stack([e_p, sigma, e_q], 1).astype(dtype)
        found = jax.jit(jax.vmap(jax.value_and_grad(lambda v: edge_offset(*v))))(inputs)
        for row, value, slopes in zip(inputs.astype(float), *(np.asarray(v, float) for v in found), strict=True):
            with mpmath.workdps(60):
                args = [mpmath.mpf(float(v)) for v in row]
                assert abs(value / exact(*args) - 1) < 8 * unit, row
                for k, got in enumerate(slopes):
                    step = mpmath.mpf(10) ** -20 * (abs(args[k]) or 1)
                    low, high = (exact(*(v + by * (i == k) for i, v in enumerate(args))) for by in (-step, step))
                    wanted = (high - low) / (2 * step)
                    assert abs(got - wanted) <= 200 * unit * abs(wanted) + step, (row, k)


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
@pytest.mark.parametrize(
    "lengths", [(0, 0, 0), (1, 0, 0), (0, 0, 1), (0, 3, 1), (1, 1e-9, 1e-9), (1e-30, 1, 1e-30), (1e-200, 1, 1)]
)
def test_an_edges_offset_has_finite_derivatives_at_every_edge(lengths, dtype):
    lengths = np.array(lengths, dtype)
    gradient = jax.jit(jax.grad(lambda v: edge_offset(*v)))(lengths)
    assert np.isfinite(gradient).all()
    assert (gradient >= -1e-300).all()  # it falls in none of the lengths
    curvature = jax.jit(jax.jacfwd(jax.grad(lambda v: edge_offset(*v))))(lengths)
    assert np.isfinite(curvature).all()


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_an_edges_offset_is_in_range_where_the_texel_is(dtype):
    """Of lengths near both ends of the numbers, and of a shear whose product with E_p is beyond them."""
    most, least = float(np.finfo(dtype).max), float(np.finfo(dtype).tiny)
    one = float(edge_offset(*(jnp.asarray(v, float) for v in (1.0, 0.5, 1.0))))
    sheared = float(edge_offset(*(jnp.asarray(v, float) for v in (1.0, 2.0, 0.0))))
    cases = ((most, 0.5, most), most * one), ((least, 0.5, least), least * one), ((most, 2.0, 1.0), most * sheared)
    for lengths, expected in cases:
        found = jax.jit(edge_offset)(*(jnp.asarray(v, dtype) for v in lengths))
        assert found.dtype == dtype
        slopes = jax.jit(jax.grad(lambda p, s, q: edge_offset(p, s, q), (0, 2)))(
            *(jnp.asarray(v, dtype) for v in lengths)
        )
        plain = jax.grad(lambda p, q, s=lengths[1]: edge_offset(p, s, q), (0, 1))(1.0, lengths[2] / lengths[0])
        np.testing.assert_allclose(slopes, plain, rtol=32 * np.finfo(dtype).eps, atol=32 * np.finfo(dtype).eps)
        # An offset below the normal numbers is 0.
        np.testing.assert_allclose(float(found), expected if expected > least else 0, rtol=32 * np.finfo(dtype).eps)


def test_an_edges_offset_takes_integers_and_mixed_dtypes():
    exact = edge_offset(*(jnp.asarray(v, float) for v in (2.0, 1.0, 3.0)))
    assert edge_offset(2, 1, 3) == exact
    np.testing.assert_array_equal(edge_offset(jnp.array([2, 2]), 1.0, np.array([3, 3])), jnp.stack([exact, exact]))
    slope = jax.grad(lambda e_p: edge_offset(e_p, 1, np.array([3, 3])).sum())(2.0)
    np.testing.assert_allclose(slope, 2 * jax.grad(lambda e_p: edge_offset(e_p, 1.0, 3.0))(2.0), rtol=1e-14)
    mixed = edge_offset(jnp.float32(2), 1, jnp.float64(3))
    assert (mixed.dtype, edge_offset(jnp.float32(2), 1, 3).dtype) == (exact.dtype, jnp.float32)


@pytest.mark.parametrize("count", [1, 5, 1023, 1152, 5000])
def test_the_first_of_the_largest_is_found_as_by_an_argmax(count):
    """Of one, of rows that fill their lanes and that do not, of ties; of those that are the largest up to rounding."""
    rng = np.random.default_rng(count)
    tied = rng.integers(0, 7, count).astype(float)
    close = np.where(rng.random(count) < 0.5, 1, 1 - 2.0**-52)
    for values in (rng.random(count), tied, np.zeros(count)):
        assert jax.jit(_first_largest)(values) == np.argmax(values)
    assert jax.jit(_first_largest)(close) == 0
    assert jax.jit(_first_largest)(np.full(count, np.nan)) == count - 1  # an index, which may be taken


@pytest.mark.parametrize("deep", [1e-4, 1e-2, 1.0])
def test_powers_of_sizes_are_in_range_over_receivers_of_nearly_one_depth(deep):
    """In single precision, whose sixth powers leave it where sizes are a million: the map is wide over its depth."""
    one, rng = np.float32, np.random.default_rng(0)
    points = np.c_[rng.uniform(-2, 2, 20), np.zeros(20), -5 - deep * rng.uniform(0, 1, 20)].astype(one)
    axes = np.array((0, 0, -1), one), np.array((0, 1, 0), one)
    camera = Camera(np.zeros(3, one), *axes, near=one(0.1), far=one(500), half_fov=one(0.4))
    view = SceneView(camera, DirectionalLight(np.array((0, -1, 0), one)), PointReceivers(points))
    found = optimal_warp(view, Objective("edge", 6.0))
    assert Outcome(int(found.result)) in (Outcome.stationary, Outcome.no_warp, Outcome.flat)
    assert 0 <= found.gap <= 1e-5


@pytest.mark.parametrize(
    "objective", [Objective("band"), Objective("q"), Objective("pxq", "l2")], ids=lambda o: o.title
)
def test_an_optimum_has_no_unit_of_length(objective):
    """In single precision, over scenes whose lengths are near both ends of the numbers.

    eta is the same but for its rounding. With a least eta below the root of the least normal number the curves of a
    mean prove nothing, and it is said.
    """
    z = np.exp(np.random.default_rng(3).uniform(0, 5, 24))
    points = np.c_[np.sin(9 * z) * 0.4 * z, np.cos(7 * z) * 0.3 * z, -z]

    @jax.jit
    def solve(points, size, min_eta):
        one = np.float32
        axes = np.array((0, 0, -1), one), np.array((0, 1, 0), one)
        camera = Camera(jnp.zeros(3, one), *axes, near=size * one(0.1), far=size * one(500), half_fov=one(0.4))
        light = DirectionalLight(np.array((0.3, -1, -0.5), one))
        view = SceneView(camera, light, PointReceivers(size * points, "depth"), screen=SCREEN, shadow_map=MAP)
        found = optimal_warp(view, objective, min_eta=min_eta, throw=False)
        return found.warp.eta, found.result, found.value

    points = points.astype(np.float32)
    eta, result, value = solve(points, np.float32(1), np.float32(1e-4))
    assert 0.001 < eta < 0.99
    for size in (1e-33, 1e-20, 1e20, 4e35):
        other, same, norm = solve(points, np.float32(size), np.float32(1e-4))
        np.testing.assert_allclose(other, eta, rtol=1e-4)  # rounding over eta, or over the root of the curvature
        assert same == result, size
        np.testing.assert_allclose(norm, value, rtol=1e-4)  # logarithms of the unit, of up to 80, are rounded
    wall = np.where([False, False, True], np.float32(-5), points)  # across the light: at one depth
    flat = [solve(wall, np.float32(size), np.float32(1e-4)) for size in (1, 1e-30, 4e35)]
    np.testing.assert_allclose([norm for *_, norm in flat], flat[0][2], rtol=1e-4)
    for floor in (1e-30, 1e-37) if objective.kernel else ():
        other, result, _ = solve(points, np.float32(1), np.float32(floor))
        np.testing.assert_allclose(other, eta, rtol=1e-3)  # the best node's
        assert int(result) == Outcome.inaccurate


@functools.partial(jax.jit, static_argnums=1)
def norm_of(view, objective):
    return log_norm_of(view.footprint(objective), view.frame(), objective)


@jax.jit
def touches(norm, etas):
    return jax.vmap(norm.touch)(etas)


@jax.jit
def values(norm, logs):
    return jax.vmap(lambda u: value_at(norm, u))(logs)


@pytest.mark.parametrize("objective", OBJECTIVES, ids=NAMES)
def test_a_parabola_lies_below_the_mean(objective):
    """J(e) >= J(m) + J'(m) (e - m) - C(m) (e - m)^2 for all pairs of 40 eta: what the certificate rests on."""
    points, weights, lights = (v[3] for v in sets())
    eta, norm = np.geomspace(1e-3, 1, 40), norm_of(view_of(points, weights, lights), objective)
    value, slope, bend, _ = map(np.asarray, touches(norm, eta))
    # J' by differences: rounding over their step, and a curvature that is at most some values over eta^2.
    above, below = (np.asarray(touches(norm, eta * (1 + step)).value) for step in (1e-6, -1e-6))
    np.testing.assert_allclose(slope * eta / value, (above - below) / 2e-6 / value, rtol=0, atol=1e-8)
    step = eta - eta[:, None]
    below = value[:, None] + slope[:, None] * step - bend[:, None] * step**2
    assert (below <= value * (1 + 1e-12)).all()
    np.testing.assert_allclose(np.diagonal(below), value, rtol=1e-15)
    # Touching from below is not trivial: between neighbours the parabola is within a few percent.
    assert (np.diagonal(below, 1) > 0.9 * value[1:]).any()


@pytest.mark.parametrize("objective", [o for o in OBJECTIVES if o.order == 1], ids=lambda o: o.title)
def test_a_parabola_lies_below_where_the_mean_bends_down(objective):
    """Near receivers count, and others that do not are wide: E_q = eta (1 + x/(0.1 eta + 0.9)) takes all of C."""
    z = np.concatenate([np.full(40, 1.0), [9.1, 9.1], np.full(22, 10.0)])
    x = np.concatenate([np.zeros(40), [-5.0, 5.0], np.zeros(22)])
    points = np.stack([x, np.full(64, 2.0), -z], 1)
    view = view_of(points, (z == 1.0).astype(float), (0, -1, 0), screen=SCREEN, shadow_map=(1, 100_000))
    eta = np.linspace(0.1, 1, 40)
    value, slope, bend, _ = map(np.asarray, touches(norm_of(view, objective), eta))
    step = eta - eta[:, None]
    below = value[:, None] + slope[:, None] * step - bend[:, None] * step**2
    assert (below <= value * (1 + 1e-12)).all()
    assert (below + 0.2 * bend[:, None] * step**2 > value)[0, 1:].all()  # C is at most a fifth too large


@pytest.mark.parametrize("objective", OBJECTIVES, ids=NAMES)
def test_a_plateau_is_certified(objective):
    """E_q counts alone, of receivers at the depth that spans the map: it is the same for all eta, or almost."""
    random = np.random.default_rng(0)
    across = np.concatenate([[0.0, 0.0, -10, 10], random.uniform(-10, 10, 60)])
    z = np.stack([np.concatenate([[5.0, 50.0], 20 * (1 + jitter * random.random(62))]) for jitter in (0.0, 1e-4)])
    points = np.stack([np.broadcast_to(across, z.shape), np.full(z.shape, 2.0), -z], -1)
    counted = (np.arange(64) > 1).astype(float)

    @jax.jit
    @jax.vmap
    def searched(points):
        view = view_of(points, counted, (0, -1, 0), screen=SCREEN, shadow_map=(4, 2**20))
        return least(norm_of(view, objective).touch, jnp.asarray(1e-4))

    found = searched(points)
    assert (found.value <= found.bounds.min(1) * (1 + 1e-6)).all()


def test_pixels_need_not_be_square():
    """A screen of twice as many columns: densities along and across differ, and so does the shear on the screen."""
    screen = (2560, 800)
    for i in range(4):
        points, weights, light = (v[i] for v in sets())
        for objective in OBJECTIVES[:2]:
            norm = norm_of(view_of(points, weights, light, screen=screen, shadow_map=MAP), objective)
            etas = np.array([0.01, 0.3])
            np.testing.assert_allclose(
                values(norm, np.log(etas)), brute(points, weights, light, objective, etas, screen=screen), rtol=1e-12
            )


def two_minima():
    """Receivers over which "edge" in L2 has two local minima, 10 % deep, by depth along Z_w, x and z; from a search."""
    delta = np.array([0.0, 1.0, 0.0026, 1e-4, 5.9e-4])
    x = np.array([-0.92, 1.1165, -2.1935, -0.4782, 1.1003])
    z = np.array([2.492, 1.506, 5.213, 1.841, 5.841])
    weights = np.array([0.01346, 0.0, 0.0, 0.3817, 0.3684])
    # The light at 45 degrees to the view: d = (z + y)/sqrt(2).
    y = np.sqrt(2) * (1 + delta) - z
    camera = Camera((0, 0, 0), (0, 0, -1), (0, 1, 0), near=0.1, far=50.0, half_fov=1.3)
    light = DirectionalLight((0, -1, -1))
    return SceneView(
        camera, light, PointReceivers(np.stack([x, y, -z], 1), weights), screen=(1000, 1000), shadow_map=(1000, 180)
    )


def test_of_two_local_minima_the_global_one_is_found():
    view, objective = two_minima(), Objective("edge", "l2")
    eta = np.geomspace(1e-3, 1, 3000)
    values = np.asarray(warpopt.error_norm(view, warpopt.Warp.from_eta(eta, view.footprint()), objective))
    local = [i for i in range(1, 2999) if values[i] < values[i - 1] and values[i] < values[i + 1]]
    assert len(local) == 2
    assert values[local[0] : local[1]].max() > 1.04 * values[local].max()
    solution = optimal_warp(view, objective)
    np.testing.assert_allclose(solution.warp.eta, eta[np.argmin(values)], rtol=3e-3)
    assert solution.value <= values.min()
    assert solution.gap <= 1e-6
    assert eta[local].max() / eta[local].min() > 20


def test_the_bound_of_a_node_is_not_the_best_value_alone():
    """With one step less than it needs the search must say so: the bound is computed, not assumed."""
    points, weights, lights = (v[7] for v in sets())
    norm = norm_of(view_of(points, weights, lights), Objective("edge"))
    exact, loose = (
        jax.jit(lambda norm, t=t: least(norm.touch, jnp.asarray(1e-4), tolerance=t))(norm) for t in (1e-6, 0.5)
    )
    assert loose.bounds.min() < exact.bounds.min() < exact.value
    assert exact.value / exact.bounds.min() - 1 <= 1e-6 < loose.value / loose.bounds.min() - 1


def test_bounds_between_nodes_hold_and_meet():
    """For waves, whose parabolas are as steep as they must be."""

    def touch(eta):
        bend = 200.0 * jnp.ones_like(eta)
        return Touch(3 + jnp.cos(20 * eta) + eta, 1 - 20 * jnp.sin(20 * eta), bend, jnp.zeros_like(eta))

    grid = np.linspace(1e-3, 1, 20_001)
    values = np.asarray(touch(grid).value)
    for tolerance in (0.9, 1e-2, 1e-6):
        found = least(touch, jnp.asarray(1e-3), tolerance=tolerance)
        starts = np.asarray(found.starts)[np.isfinite(found.bounds)]
        bounds = np.asarray(found.bounds)[: len(starts)]
        which = np.searchsorted(starts, grid, side="right") - 1
        assert (bounds[which] <= values + 1e-12).all()
        assert found.value <= bounds.min() * (1 + tolerance) or tolerance == 0.9
        assert found.below < found.eta < found.above
    np.testing.assert_allclose(found.value, values.min(), rtol=1e-6)


@pytest.mark.parametrize("metric", ["max"])
def test_the_mean_of_the_larger_error_has_one_minimum(metric):
    """Theorem in docs/theory.md: in L1 the mean of max(E_p, E_q) is quasi-convex."""
    points, weights, lights = sets()
    for i in range(0, 60, 4):
        values = brute(points[i], weights[i], lights[i], Objective(metric, "l1"), np.geomspace(1e-4, 1, 600))
        signs = np.sign(np.diff(values)[np.abs(np.diff(values)) > 1e-12 * values[1:]])
        assert (np.diff(signs) >= 0).all()


HEIGHT, WIDTH = 90, 144


def hills(seed):
    """(depths, mask of the light) of a floor with posts, with many silhouettes."""
    rng = np.random.default_rng(seed)
    rows, columns = np.mgrid[0:HEIGHT, 0:WIDTH]
    up = (1 - (rows + 0.5) / HEIGHT * 2) * np.tan(0.4)
    across = ((columns + 0.5) / WIDTH * 2 - 1) * np.tan(0.4) * 1.6
    depth = np.where(up < -0.01, 2 / np.maximum(-up, 1e-9), np.inf)
    for _ in range(20):
        z = np.exp(rng.uniform(1, 5))
        post = (np.abs(across - rng.uniform(-0.6, 0.6)) < 1 / z) & (up < rng.uniform(0, 6) / z) & (up > -2 / z)
        depth = np.where(post & (z < depth), z, depth)
    depth = np.where(depth < 400, depth, 0.0)
    return depth, (np.sin(0.7 * depth * across) + np.cos(0.3 * depth) > 0) & (depth > 0)


def pixels_of(depth, weights):
    rows, columns = np.mgrid[0:HEIGHT, 0:WIDTH]
    up = (1 - (rows + 0.5) / HEIGHT * 2) * np.tan(0.4)
    across = ((columns + 0.5) / WIDTH * 2 - 1) * np.tan(0.4) * 1.6
    seen = depth > 0
    points = np.stack([across * depth, up * depth + 2, -depth], -1)[seen]
    return points, np.asarray(weights, float)[seen]


# The band over cells is test_edge_directions'.
OVER_CELLS = [o for o in OBJECTIVES if o.name != "band"]


@pytest.mark.parametrize("seed", [0, 1])
@pytest.mark.parametrize("objective", OVER_CELLS, ids=lambda o: o.title)
@pytest.mark.thorough("E_max, norm l2-0")
def test_cells_of_a_buffer_are_its_pixels_within_the_bound(objective, seed):
    depth, lit = hills(seed)
    rng = np.random.default_rng(seed)
    light = np.array([rng.normal(), -1.0, rng.normal()])
    edges = warpopt.edge_weights(lit, DepthBuffer(depth), CAMERA)
    buffer = DepthBuffer(depth, weights=edges.weights)  # without the edges' directions
    view = SceneView(CAMERA, DirectionalLight(light), buffer, screen=SCREEN, shadow_map=MAP)
    solution = optimal_warp(view, objective)
    points, weights = pixels_of(depth, edges.weights)
    true = brute(points, weights, light, objective, [float(solution.warp.eta), *np.geomspace(1e-3, 1, 100)])
    assert solution.excess <= 1e-3
    assert true[0] <= true[1:].min() * (1 + solution.excess)
    np.testing.assert_allclose(solution.value, true[0], rtol=float(solution.excess))
    assert abs(float(solution.value) / true[0] - 1) > 1e-9  # it is an approximation: the bound has work to do
    # The excess is a bound and no guess: a value from the cells' far corners would be outside of it.
    assert solution.excess > 0


@pytest.mark.parametrize("objective", OVER_CELLS, ids=lambda o: o.title)
@pytest.mark.thorough
def test_cells_of_ground_and_of_noise_lose_little(objective):
    """A thousandth at most in L1, where all pixels count; the true mean is within it."""
    up = (1 - (np.arange(HEIGHT) + 0.5) / HEIGHT * 2)[:, None] * np.tan(0.4)
    ground = np.where(up < -0.005, 2 / np.maximum(-up, 1e-9), 0.0) + np.zeros(WIDTH)
    noise = np.exp(np.random.default_rng(0).uniform(0, 5, (HEIGHT, WIDTH)))
    for depth in (ground, noise):
        points, ones = pixels_of(depth, depth > 0)
        for light in np.array([(-0.27, -0.36, -0.89), (0.32, -0.27, -0.91), (-0.85, -0.5, -0.14)]):
            buffer = DepthBuffer(depth, weights=(depth > 0).astype(float))
            solution = optimal_warp(
                SceneView(CAMERA, DirectionalLight(light), buffer, screen=SCREEN, shadow_map=MAP), objective
            )
            assert solution.excess <= (1e-3 if objective.order == 1 else 2e-3)
            true = brute(points, ones, light, objective, float(solution.warp.eta))[0]
            np.testing.assert_allclose(solution.value, true, rtol=float(solution.excess))


@pytest.mark.parametrize("first", [0, 100])
def test_the_map_of_cells_holds_every_pixel(first):
    """At any eta, and is a thousandth too wide at most; also where all is to one side of the eye."""
    depth, _ = hills(1)
    depth[:, :first] = 0
    view = SceneView(CAMERA, DirectionalLight((0.02, -1, -0.4)), DepthBuffer(depth), screen=SCREEN, shadow_map=MAP)
    footprint = view.footprint(Objective("edge"))
    points, _ = pixels_of(depth, depth)
    places, x, _ = footprint.coordinates(view.frame(), CAMERA.to_eye(points))
    assert (np.abs(footprint.axis) > 0.1) == (first > 0)
    for eta in np.geomspace(1e-4, 1, 9):
        blend = np.asarray(places.blend(eta))
        for width, side in zip(footprint.half_widths(eta), (-np.asarray(x), np.asarray(x)), strict=True):
            needed = max((side / blend).max(), 0)
            assert needed * (1 - 1e-9) <= width <= needed * (1 + 1.1e-3) + 1e-12


def test_a_depth_is_in_its_bin():
    """At the bins' edges too, where single precision rounds up or down."""
    edges = cells._edges(cells._LEAST_KEY, cells._SIDES, cells._FINE_BITS, float)
    shifted = edges[1:-1] + cells._OFFSET
    delta = np.concatenate([shifted * (1 + k * 2.0**-26) - cells._OFFSET for k in range(-9, 10)])
    key = np.asarray(cells._key(jnp.asarray(delta))) - cells._LEAST_KEY
    assert (edges[key] <= delta).all()
    assert (delta <= edges[key + 1] * (1 + 1e-6) + 1e-9).all()


@pytest.mark.parametrize("objective", [Objective("edge"), Objective("edge", "l2")], ids=["l1", "l2"])
def test_a_centroid_is_its_cells_receivers_within_the_excess(objective):
    """Two places in opposite corners of a cell: with the nearer one farther out, their mean is below the centroid's."""
    camera = Camera((0, 0, 0), (0, 0, -1), (0, 1, 0), near=0.1, far=500.0, half_fov=1.55)
    floor = jnp.asarray(1e-4)
    for spread in (0.007, -0.007):
        # Depths along the light plane 0 and 1, a wide one, and the two places.
        delta = np.array([0.0, 1.0, 0.5, 0.501, 0.5075])
        x = np.array([0.0, 0.0, 2295.0, 334 * (1 + spread), 334 * (1 - spread)])

        def norm(repeated, delta=delta, x=x):
            which = np.concatenate([[0, 1, 2], np.repeat([3, 4], repeated)])
            z = 1 + 100 * delta[which]
            points = np.stack([x[which], np.zeros_like(z), -z], 1)
            weights = (which > 2) * z**objective.order  # without the factor 1/z
            # The first place's size is eta: its weight puts the optimum near 0.01, where the shear is large.
            weights[0] = 3e4**objective.order * repeated
            receivers = PointReceivers(points, weights)
            view = SceneView(camera, DirectionalLight((0, -1, 0)), receivers, screen=SCREEN, shadow_map=(10**6, 10))
            return norm_of(view, objective)

        few, many = norm(1), norm(2500)
        assert few.samples.corners is None
        assert (np.asarray(many.samples.weight) > 0).sum() == 2
        eta, two, centroid, loss, most, excess = map(float, of_two_and_centroid(few, many, floor))
        assert 1e-3 < eta < 0.1
        assert (two < centroid) == (spread > 0)
        assert abs(two / centroid - 1) > 2e-6
        assert centroid - loss <= two <= most * (1 + 1e-9)
        assert abs(np.log(two / centroid)) / objective.order <= np.log1p(excess) + 1e-6


@jax.jit
def of_two_and_centroid(few, many, floor):
    """(the centroid's best eta, J of the two there, of the centroid, its loss, its corners' mean, its excess)."""
    search = least(many.touch, floor)
    eta = search.eta
    return (
        eta, few.touch(eta).value, many.touch(eta).value, covariance_loss(many, eta, eta), corner_mean(many, eta),
        excess_of_cells(many, many, search, jnp.log(eta), search.value, floor),
    )  # fmt: skip


def test_what_is_weighed_zero_must_still_fit():
    near = np.array([[0.0, 1.5, -2.0], [0.3, 1.5, -3.0]])
    far = np.array([[30.0, 0.0, -100.0], [-30.0, 2.0, -100.0]])
    light = (0.2, -1, -0.3)
    weights = [1.0, 1.0, 0.0, 0.0]
    both, only = (view_of(np.concatenate([near, other]), weights, light) for other in (far, near))
    solution, alone = (optimal_warp(each, Objective("p", "l2")) for each in (both, only))
    assert solution.warp.mu > 50 * alone.warp.mu
    # Norms inf are over all receivers, whatever their weight.
    plain = optimal_warp(view_of(np.concatenate([near, far]), None, light))
    np.testing.assert_array_equal(optimal_warp(both).value, plain.value)


@pytest.mark.thorough
def test_weights_by_depth_are_the_depths():
    depth, lit = hills(4)
    objective = Objective("p", "l1")  # weights are made before any objective is known: the one that compiles fastest
    for mask in (None, lit):
        counted = (depth > 0) if mask is None else (depth > 0) & mask
        named, given = DepthBuffer(depth, weights="depth", lit=mask), DepthBuffer(depth, weights=depth * counted)
        views = [SceneView(CAMERA, DirectionalLight((0.3, -1, 0.2)), buffer) for buffer in (named, given)]
        warp = warpopt.Warp.from_eta([0.03, 0.4, 1.0], views[0].footprint())
        one, other = (warpopt.error_norm(view, warp, objective) for view in views)
        np.testing.assert_allclose(one, other, rtol=1e-13)


def test_the_mean_of_e_p_by_depth_has_a_closed_form():
    """theory.md section 5: eta = sqrt(B_2 / B_0), two sums; with weights z the sums are over delta alone."""
    depth, _ = hills(2)
    light = np.array([0.3, -1, -0.4])
    buffer = DepthBuffer(depth, weights="depth")
    solution = optimal_warp(SceneView(CAMERA, DirectionalLight(light), buffer), Objective("p", "l1"))
    points, _ = pixels_of(depth, depth)
    eye = (points - [0, 2, 0]) * [1, 1, -1]
    towards = light * [1, 1, -1] / np.linalg.norm(light)
    axis = np.array([0, 0, 1]) - towards * towards[2]
    delta = eye @ axis
    delta = (delta - delta.min()) / np.ptp(delta)
    np.testing.assert_allclose(solution.warp.eta, np.sqrt((delta**2).sum() / ((1 - delta) ** 2).sum()), rtol=1e-12)


KINDS = {
    "points": lambda w: PointReceivers(np.array([[0.0, 0.0, -5.0], [1, 1, -9], [2, 0, -60]]), w),
    "buffer": lambda w: DepthBuffer(np.array([[5.0, 9.0, 60.0]]), weights=None if w is None else [w]),
    "histogram": lambda w: DepthHistogram([4.0, 8, 20, 70], [1.0, 2, 1], w),
}


@pytest.mark.parametrize(("kind", "metric"), [("points", "edge"), ("buffer", "p"), ("histogram", "p")])
def test_without_any_weight_depths_are_taken_and_it_is_said(kind, metric):
    objective = Objective(metric, "l1")
    none, some, by_depth = (
        SceneView(CAMERA, DirectionalLight((0.1, -1, -0.2)), receivers)
        for receivers in (KINDS[kind]([0.0, 0.0, 0.0]), KINDS[kind]([0.0, 1.0, 0.0]), _by_depth(kind))
    )
    found = optimal_warp(none, objective)
    assert Outcome(int(found.result)) is Outcome.depth_weighted
    assert Outcome(int(optimal_warp(some, objective).result)) is not Outcome.depth_weighted
    np.testing.assert_allclose(warpopt.error_norm(by_depth, found, objective), found.value, rtol=1e-14)


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_weights_may_be_as_large_as_numbers_go(dtype):
    """Only their ratios count; the reciprocal of the largest float is below the normal numbers, which are flushed."""
    ratios = np.array([0.125, 1.0, 0.0], dtype)
    of = jax.jit(lambda weights, z, seen: Weights(weights, None, (3,)).of(z, seen))
    for size in (np.finfo(dtype).max, dtype(1), 8 * np.finfo(dtype).tiny):
        weights, by_depth = of(ratios * size, np.ones(3, dtype), np.ones(3, bool))
        np.testing.assert_array_equal(weights, ratios)
        assert not by_depth


def test_the_fallback_keeps_to_the_light():
    z, nothing = jnp.array([1.0, 2.0, 3.0]), jnp.zeros(3, bool)
    for lit, expected in (([True, False, True], [1, 0, 0]), ([False] * 3, [1, 2, 0]), (None, [1, 2, 0])):
        weights, by_depth = Weights(np.zeros(3), lit, (3,)).of(z, jnp.array([True, True, False]))
        np.testing.assert_array_equal(weights, expected)
        assert by_depth
        assert not Weights(np.zeros(3), lit, (3,)).of(z, nothing)[0].any()


def _by_depth(kind):
    plain = KINDS[kind](None)
    if kind == "points":
        return PointReceivers(plain.points, "depth")
    if kind == "buffer":
        return DepthBuffer(plain.depth, weights="depth")
    return DepthHistogram(plain.edges, plain.counts, "depth")


@pytest.mark.thorough
def test_a_histogram_is_the_points_it_stands_for():
    """Against a dense sample; the extents of a slab are its corners', so that no bin is taken wider than it is."""
    # The last bins are empty: as many as in the next test, whose programs these are.
    edges, counts, weights = (
        np.array([1.0, 3.0, 10.0, *np.geomspace(100, 400, BINS - 2)]), np.array([5.0, 0, 1] + [0] * (BINS - 3)),
        np.array([0.5, 1, 2] + [1] * (BINS - 3)),
    )  # fmt: skip
    points, mass = [], []
    for near, far, count, weight in zip(edges, edges[1:], counts, weights, strict=False):
        grid = (np.arange(24) + 0.5) / 24 * 2 - 1
        z, x, y = np.meshgrid(near + (far - near) * (np.arange(60) + 0.5) / 60, grid, grid, indexing="ij")
        corners = np.stack(np.meshgrid((near, far), (-1, 1), (-1, 1), indexing="ij"), -1).reshape(-1, 3)
        z, x, y = (np.concatenate([v.ravel(), corners[:, i]]) for i, v in enumerate((z, x, y)))
        if count:
            points.append(np.stack([x * z * np.tan(0.4) * 1.6, 2 + y * z * np.tan(0.4), -z], 1))
            mass.append(np.concatenate([np.full(len(z) - 8, count * weight), np.zeros(8)]))
    light, eta = (0.3, -1, -0.4), [0.01, 0.1, 1.0]
    view = SceneView(CAMERA, DirectionalLight(light), DepthHistogram(edges, counts, weights), **RESOLUTIONS)
    warp = warpopt.Warp.from_eta(eta, view.footprint())
    for objective in (Objective("edge"), Objective("p", "l2")):
        exact = brute(np.concatenate(points), np.concatenate(mass), light, objective, eta)
        # the sample's, second order in 1/24
        np.testing.assert_allclose(warpopt.error_norm(view, warp, objective), exact, rtol=5e-4)
    assert optimal_warp(view, Objective("edge")).excess <= 1e-3


@pytest.mark.thorough
def test_gradients_are_those_of_differences():
    """In the camera's height and a weight: through the optimum, implicitly."""
    objective = Objective("edge")
    points, weights, light = (v[11] for v in sets())

    def solved(v):
        camera = Camera((0, 2 + v[0], 0), (0, 0, -1), (0, 1, 0), 0.1, 500.0, 0.4, 1.6)
        receivers = PointReceivers(points, jnp.asarray(weights) + v[1] * (jnp.arange(64) == 3))
        view = SceneView(camera, DirectionalLight(light), receivers, screen=SCREEN, shadow_map=MAP)
        solution = optimal_warp(view, objective, throw=False)
        found = jnp.stack([solution.warp.eta, solution.value])
        return found, found

    @jax.jit
    def both_ways(v):
        (forwards, found), (backwards, _) = (way(solved, has_aux=True)(v) for way in (jax.jacfwd, jax.jacrev))
        return forwards, backwards, found

    at = np.array([0.05, 0.2])
    jacobian, backwards, _ = both_ways(at)
    for k, step in enumerate(np.eye(2) * 1e-5):
        slope = (both_ways(at + step)[2] - both_ways(at - step)[2]) / 2e-5
        np.testing.assert_allclose(jacobian[:, k], slope, rtol=2e-5, atol=2e-7)
    np.testing.assert_allclose(backwards, jacobian, rtol=1e-9)


@pytest.mark.thorough
def test_gradients_reach_the_pixels():
    depth, lit = hills(1)
    light = DirectionalLight((0.3, -1, -0.4))

    def value(scale):
        buffer = DepthBuffer(depth * scale, weights=jnp.asarray(lit, float))
        return optimal_warp(SceneView(CAMERA, light, buffer), Objective("edge"), throw=False).value

    solved = jax.jit(jax.value_and_grad(value))
    slope = (solved(1 + 1e-6)[0] - solved(1 - 1e-6)[0]) / 2e-6
    np.testing.assert_allclose(solved(1.0)[1], slope, rtol=1e-3, atol=1e-6)


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_what_is_not_proved_is_no_optimum(dtype):
    """With a least eta whose square is 0 in the dtype: without a bound, the gap was 0 and the warp any."""
    points, weights, light = (v[21].astype(dtype) for v in sets())
    camera = jax.tree.map(lambda v: v.astype(dtype), CAMERA)
    view = SceneView(camera, DirectionalLight(light), PointReceivers(points, weights), screen=SCREEN, shadow_map=MAP)
    usual, far, beyond = (
        optimal_warp(view, Objective("edge"), min_eta=eta, throw=False)
        for eta in (1e-4, *((1e-100, 1e-160) if dtype is np.float64 else (1e-12, 1e-25)))
    )
    assert far.result == usual.result == Outcome.stationary
    np.testing.assert_allclose(far.warp.eta, usual.warp.eta, rtol=64 * float(np.finfo(dtype).eps) ** 0.5)
    assert far.gap <= 1e-5
    assert beyond.result == Outcome.inaccurate
    assert np.isinf(beyond.gap)
    with pytest.raises(RuntimeError, match="the lower bound of a mean is no number"):
        optimal_warp(view, Objective("edge"), min_eta=float(1e-160 if dtype is np.float64 else 1e-25))


def test_sizes_whose_powers_underflow_are_not_no_error():
    """In single precision and order 8, of receivers from 1e-3 to 1e5: the value was 13 % too small."""
    rng = np.random.default_rng(0)
    z = np.exp(rng.uniform(np.log(1e-3), np.log(1e5), 64))
    points = np.stack([rng.uniform(-0.4, 0.4, 64) * z, rng.uniform(-0.35, 0.35, 64) * z, -z], 1)
    camera = Camera((0, 0, 0), (0, 0, -1), (0, 1, 0), 1e-4, 1e6, 0.4, 1.6)
    view = SceneView(camera, DirectionalLight((0.3, -1, -0.2)), PointReceivers(points, np.ones(64)))
    exact = optimal_warp(view, Objective("max", 8.0))
    single = jax.tree.map(lambda v: v.astype(np.float32), view)
    for min_eta in (1e-4, 1e-8):
        found = optimal_warp(single, Objective("max", 8.0), min_eta=min_eta, throw=False)
        assert not Outcome(int(found.result)).succeeded
    np.testing.assert_allclose(optimal_warp(single, Objective("max", 2.0)).warp.eta, 1e-4, rtol=1e-6)  # has numbers
    assert exact.result == Outcome.stationary


def test_single_precision_agrees():
    objective = Objective("edge")
    points, weights, light = (v[21].astype(np.float32) for v in sets())
    camera = jax.tree.map(lambda v: v.astype(jnp.float32), CAMERA)
    view = SceneView(camera, DirectionalLight(light), PointReceivers(points, weights), screen=SCREEN, shadow_map=MAP)
    single = optimal_warp(view, objective)
    assert single.value.dtype == single.gap.dtype == jnp.float32
    double = optimal_warp(view_of(points.astype(float), weights.astype(float), light.astype(float)), objective)
    np.testing.assert_allclose(single.value, double.value, rtol=1e-5)
    assert single.gap <= 1e-5


def test_pointwise_sizes_average_to_the_norm():
    points, weights, light = (v[13] for v in sets())
    view = view_of(points, weights, light)
    solution = optimal_warp(view, Objective("edge"))
    for metric in ("edge", "band", "max"):
        size = solution.aliasing_error(CAMERA.to_eye(points), metric)
        norm = warpopt.error_norm(view, solution, Objective(metric, "l1"))
        np.testing.assert_allclose((weights * size).sum() / weights.sum(), norm, rtol=1e-12)
    np.testing.assert_allclose(warpopt.error_norm(view, solution, Objective("edge")), solution.value, rtol=1e-12)


def test_without_resolutions_pixels_are_square():
    """A square map under square pixels: for every eta the norm with resolutions of that aspect, in other units."""
    points, weights, light = (v[17] for v in sets())
    resolutions = {"screen": (1600, 1000), "shadow_map": (512, 512)}
    with_them = norm_of(view_of(points, weights, light, **resolutions), Objective("edge"))
    view = SceneView(CAMERA, DirectionalLight(light), PointReceivers(points, weights))
    without = norm_of(view, Objective("edge"))
    logs = np.log([1e-3, 0.02, 0.3, 1.0])
    np.testing.assert_allclose(values(with_them, logs), values(without, logs) * 1000 / 2 / 512, rtol=1e-12)


ONES, BOX, SUN = np.ones((2, 2)), ConvexBody.box((-1, 0, -9), (1, 2, -5)), DirectionalLight((0, -1, 0))
BAD = {
    "negative": (lambda: PointReceivers(np.ones((2, 3)), [1.0, -1.0]), "weights: got -1.0, expected finite numbers >="),
    "NaN": (lambda: DepthBuffer(ONES, weights=[[1.0, np.nan], [0, 0]]), "weights: got nan"),
    "shape": (lambda: DepthBuffer(ONES, weights=np.ones(4)), r"weights: got shape \(4,\), expected \(2, 2\)"),
    "word": (lambda: DepthBuffer(ONES, weights="z"), "weights: got 'z', expected 'uniform', 'depth' or an array"),
    "mask": (lambda: DepthBuffer(ONES, lit=[[0.5, 1], [0, 0]]), "lit: got 0.5, expected true or false"),
    "mask's shape": (lambda: PointReceivers(np.ones((2, 3)), lit=[True]), r"lit: got shape \(1,\), expected \(2,\)"),
    "histogram": (lambda: DepthHistogram([1.0, 2.0], [1.0], [1.0, 2.0]), r"weights: got shape \(2,\), expected \(1,\)"),
    "L-inf": (lambda: Objective("edge", "inf"), "norm: got 'inf', expected 'l1', 'l2'"),
    "body": (
        lambda: optimal_warp(SceneView(CAMERA, SUN, BOX), Objective("band")),
        "metric: got 'band' in norm l1 with ConvexBody, expected points",
    ),
    "frustum": (
        lambda: optimal_warp(warpopt.FrustumView(warpopt.ViewFrustum(1.0, 9.0, 0.4), 1.0), Objective("edge")),
        "metric: got 'edge', expected one product",
    ),
    "bound": (
        lambda: warpopt.lower_bound(view_of(*(v[0] for v in sets())), Objective("edge")),
        "No lower bound is known for a mean",
    ),
    "pointwise": (
        lambda: warpopt.theory.aggregate("edge", jnp.ones(1), jnp.ones(1)), "metric: got 'edge', which also depends on"
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", BAD)
def test_bad_input_is_refused_in_one_sentence(name):
    make, words = BAD[name]
    with pytest.raises(ValueError, match=words):
        make()


def test_a_wide_bin_is_its_parts():
    """One bin with a z ratio of 3600, beside empty ones, against 24 bins of the same distribution."""
    ends, ones = np.geomspace(0.11, 400, BINS + 1), np.ones(BINS)
    whole = DepthHistogram([0.11, *np.geomspace(400, 499, BINS)], np.eye(BINS)[0], ones)
    parts = DepthHistogram(ends, np.diff(ends), ones)
    for objective in (Objective("edge"), Objective("p", "l2")):
        one, other = (
            warpopt.error_norm(view, warpopt.Warp.from_eta([3e-3, 0.05, 1.0], view.footprint()), objective)
            for view in (SceneView(CAMERA, SUN, each, **RESOLUTIONS) for each in (whole, parts))
        )
        np.testing.assert_allclose(one, other, rtol=1e-3)


@pytest.mark.parametrize("scale", [1e36, 1e-30])
def test_the_scale_of_weights_does_not_matter(scale):
    """Not even near the ends of single precision."""
    points, weights, light = (v[5].astype(np.float32) for v in sets())
    camera = jax.tree.map(lambda v: v.astype(jnp.float32), CAMERA)
    for objective in (Objective("edge"), Objective("p", "l2")):
        views = [
            SceneView(camera, DirectionalLight(light), PointReceivers(points, each), screen=SCREEN, shadow_map=MAP)
            for each in (weights, weights * np.float32(scale))
        ]
        warp = warpopt.Warp.from_eta(jnp.float32(0.1), views[0].footprint())
        one, other = (warpopt.error_norm(view, warp, objective) for view in views)
        np.testing.assert_allclose(one, other, rtol=1e-5)
