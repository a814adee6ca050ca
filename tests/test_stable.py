"""Stable windows: what stays where it is, when a map moves or is fitted anew, and what is refused."""

import json

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import warpopt
from warpopt.receivers import ConvexBody, PointReceivers
from warpopt.stable import Action, Reason, StableWindow, WindowState
from warpopt.stable.pencil import Pencil, Square, offset_for

N = 512
STORAGE = warpopt.Objective("storage")
rng = np.random.default_rng(5)
POINTS = np.stack([rng.uniform(-60, 60, 64), rng.uniform(0, 2, 64), rng.uniform(-200, 60, 64)], 1)
LIGHT = warpopt.DirectionalLight((0.2, -1, -0.3))
BOX = ConvexBody.box((-500, -1, -500), (500, 3, 500))


def window_of(**settings) -> StableWindow:
    return StableWindow(**{
        "objective": STORAGE, "warp_direction": "view", "shadow_map": (N, N), "screen": (640, 400), "tolerance": 1.5,
        "hold": 1,
    } | settings)  # fmt: skip


def camera_at(x=0.0, z=0.0, turn=0.0, at=(0.0, 0.0, 0.0), dtype=float) -> warpopt.Camera:
    position = np.array([x, 2.0, z]) + at
    forward = np.array([np.sin(turn), -0.1, -np.cos(turn)])
    values = [np.asarray(v, dtype) for v in (position, forward, (0, 1, 0), 0.5, 40.0, 0.5, 1.6)]
    return warpopt.Camera(*values)


def seen(camera: warpopt.Camera, points: np.ndarray) -> np.ndarray:
    x, y, z = np.asarray(camera.to_eye(points)).T
    left, right, bottom, top = np.asarray(camera.window)
    inside = (z >= float(camera.near)) & (z <= float(camera.far)) & (x >= left * z) & (x <= right * z)
    return inside & (y >= bottom * z) & (y <= top * z)


def texels(matrix, points: np.ndarray, size=(N, N)) -> np.ndarray:
    """(u, v) in texels and the depth in [-1, 1], through the matrix alone."""
    x, y, z, w = (np.c_[points, np.ones(len(points))] @ np.asarray(matrix, points.dtype).T).T
    assert (w > 0).all()
    return np.stack([(x / w + 1) / 2 * size[0], (y / w + 1) / 2 * size[1], z / w], -1)


def walk(window, frames, receivers=None, light=LIGHT, state=None, step=0.05, turn=0.0, **more):
    """(camera, update) of each frame of a walk."""
    state = window.start() if state is None else state
    for k in range(frames):
        camera = camera_at(x=step * k, z=-step * k, turn=turn * k)
        update, state = window.update(state, camera, light, receivers or PointReceivers(POINTS), **more)
        yield camera, update, state


@pytest.mark.parametrize("settings", [{}, {"warp": False}, {"warp_direction": (1.0, 0, -0.6), "lateral": "free"}])
@pytest.mark.thorough("settings2")
def test_texels_stay_and_receivers_are_in_the_map(settings):
    """The property that the whole is for, through the matrices alone: a world point's texel moves by exactly (i, j)."""
    before, actions = None, []
    for camera, update, _ in walk(window_of(**settings), 60, BOX, turn=0.003):
        lower = np.array([-60.0, -1, -60])
        cloud = lower + np.random.default_rng(1).random((20_000, 3)) * [120, 4, 120]
        cloud = cloud[seen(camera, cloud)]
        found = texels(update.matrix, cloud)
        size = np.array([N, N])
        assert ((found[:, :2] >= 1 - 1e-6) & (found[:, :2] <= size - 1 + 1e-6)).all()  # with a texel to spare
        assert (np.abs(found[:, 2]) <= 1 + 1e-9).all()
        if int(update.action) in (Action.KEPT, Action.SCROLLED):
            old = texels(before, cloud) if (np.c_[cloud, np.ones(len(cloud))] @ before[3] > 0).all() else None
            assert old is not None
            shift = np.asarray(update.scroll)
            np.testing.assert_allclose(found[:, :2] + shift, old[:, :2], atol=1e-7)
            assert (np.floor(found[:, :2]) + shift == np.floor(old[:, :2])).all()
        if int(update.action) == Action.KEPT:
            np.testing.assert_array_equal(update.matrix, before)
        before = np.asarray(update.matrix)
        actions.append(Action(int(update.action)))
    assert {Action.FIRST, Action.KEPT, Action.SCROLLED} <= set(actions), actions


@pytest.mark.parametrize("dtype", [np.float64, np.float32])
def test_a_million_points_keep_their_texels_in_scrolls(dtype):
    """Random warps and offsets, points at all depths: no texel changes but by (i, j), in single precision only where
    rounding decides."""
    random, changed, close, count = np.random.default_rng(3), 0, 0, 20
    for _ in range(count):
        eta = float(np.exp(random.uniform(np.log(0.02), 0)))
        axes = np.linalg.qr(random.normal(size=(3, 3)))[0]
        mu, width, lean = [*random.uniform(1, 50, 2).tolist(), random.normal()]
        along, across = axes[0] / mu, axes[1] / width + lean * axes[0] / mu
        rows = [np.append(row, random.uniform(-0.2, 0.2)).astype(dtype) for row in (along, across)]
        pencil = Pencil(np.zeros(3, dtype), *map(jnp.asarray, rows), jnp.asarray(eta, dtype),
                        jnp.asarray(1 - eta, dtype))  # fmt: skip
        limit = min(400, int(N * 0.9 * eta / (1 - eta))) if eta < 1 else 400
        shift = random.integers(-400, [400, limit + 1])
        # The square's own map, cropped out of the pencil: another way to the same texels than the matrix's.
        share = shift / N
        moved = pencil.cropped(Square(*(jnp.asarray([v, 1 + v], dtype) for v in share)))
        blend = random.uniform(min(1, eta), 1.5, 50_000)
        delta = (blend - eta) / (1 - eta) if eta < 1 else random.random(50_000)
        local = np.stack([(delta - rows[0][3]) * mu, random.uniform(-1, 1, 50_000) * width,
                          random.uniform(-1e3, 1e3, 50_000)], 1)  # fmt: skip
        points = (local @ axes).astype(dtype)

        def found(p: Pencil, points=points) -> np.ndarray:
            delta, u = (points @ np.asarray(row[:3]) + np.asarray(row[3]) for row in (p.along, p.across))
            blend = np.asarray(p.eta) + np.asarray(p.one_minus_eta) * delta
            return np.stack([(u / blend + 0.5) * N, delta / blend * N], 1)

        before, after = found(pencil), found(moved)
        differs = np.floor(before) != np.floor(after) + shift
        changed += differs.any(1).sum()
        # Products of a thousand lengths and 1/eta: what single precision leaves of a texel's place.
        slack = 4000 * np.finfo(dtype).eps * N / eta
        off = np.abs(before - np.round(before))
        close += (differs & (off > slack)).any(1).sum()
    assert close == 0
    if dtype == np.float64:
        assert changed == 0
    assert count * 50_000 == 1_000_000


@pytest.mark.parametrize(("ahead", "right", "left"), [(0.0, 91, -31), (0.5, 111, -51), (1.0, 131, -71)])
def test_free_texels_lie_where_they_are_asked_for(ahead, right, left):
    """Receivers over 470 of 512 texels leave 40 beside a texel of padding: none, half or all on the side moved to."""

    def moved(least, last=np.inf, old=0):
        square = Square(jnp.array([0.1, 0.9]), jnp.array([least, least + 470.0]) / 512)
        both = offset_for(square, jnp.array([512, 512]), jnp.array([0, old]), jnp.array(1), jnp.array(ahead),
                          jnp.asarray(last))  # fmt: skip
        return int(both[0][1]), bool(both[1])

    assert moved(132) == (right, True)
    assert moved(-30) == (left, True)
    assert moved(20) == (0, True)
    assert moved(132, old=100) == (100, True)
    assert moved(132, last=1 + 95 / 512) == (91 + round(ahead * 4), True)  # the horizon leaves four
    assert moved(132, last=1 + 90 / 512)[1] is False


@pytest.mark.thorough
def test_margins_cost_what_they_are():
    """A window's errors are (1 + margin) times a tight map's along both axes, by differences through the matrices."""
    camera = camera_at()
    view = warpopt.SceneView(camera, LIGHT, PointReceivers(POINTS), screen=(640, 400), shadow_map=(N, N))
    solution = warpopt.optimal_warp(view, STORAGE)
    tight = warpopt.shadow_matrix(view, solution)
    update, _state = window_of(margin=0.4, padding=0).update(window_of().start(), camera, LIGHT, PointReceivers(POINTS))
    points = POINTS[seen(camera, POINTS)]

    def areas(matrix):
        step = 1e-4 * np.stack([np.asarray(solution.direction), np.cross(solution.direction, LIGHT.direction)])
        edges = [(texels(matrix, points + d) - texels(matrix, points - d))[:, :2] for d in step]
        return np.abs(edges[0][:, 0] * edges[1][:, 1] - edges[0][:, 1] * edges[1][:, 0])

    np.testing.assert_allclose(areas(tight) / areas(update.matrix), 1.4**2, rtol=1e-6)
    assert int(update.action) == Action.FIRST
    assert float(update.loss) == 1


@pytest.mark.parametrize("name", ["p", "storage", "edge", "band"])
@pytest.mark.thorough("band")
def test_the_loss_is_the_objective_of_the_map_as_it_lies(name):
    """Texels' edges by differences through the matrix alone, on the very receivers, against a fresh window's."""
    objective = warpopt.Objective(name, "l2" if name == "p" else None)
    window = window_of(objective=objective, tolerance=1e6, padding=0)
    weights = np.random.default_rng(2).random(64)
    state = window.start()
    receivers = PointReceivers(POINTS, None if name == "storage" else weights)  # without, as elsewhere: one program
    for k in range(2):
        camera = camera_at(x=1.5 * k, z=-0.5 * k)
        update, state = window.update(state, camera, LIGHT, receivers)
    assert int(update.action) in (Action.KEPT, Action.SCROLLED)
    chosen = seen(camera, POINTS)
    values = []
    for map_of in (update, window.update(window.start(), camera, LIGHT, receivers)[0]):
        frame = warpopt.theory.LightFrame(camera, LIGHT, (640, 400), (N, N))
        frame = frame.towards(camera.rotation @ map_of.direction)
        values.append(_norm_by_differences(map_of.matrix, camera, frame, POINTS[chosen], weights[chosen], name))
    assert float(update.loss) == pytest.approx(values[0] / values[1], rel=2e-6)
    assert abs(float(update.loss) - 1) > 1e-3  # or nothing would be tested


def _norm_by_differences(matrix, camera, frame, points, weights, name):
    z_axis, x_axis = (np.asarray(v @ camera.rotation) for v in (frame.z_axis, frame.x_axis))
    step = 1e-4
    along, across = (
        (texels(matrix, points + step * d)[:, :2] - texels(matrix, points - step * d)[:, :2]) / (2 * step * N)
        for d in (z_axis, x_axis)
    )
    # d(d, x)/d(t, s) from d(t, s)/d(d, x)
    inverse = np.linalg.inv(np.stack([along, across], -1))  # rows d, x; columns t, s
    z = np.asarray(camera.to_eye(points))[:, 2]
    p, q, ratio = (float(v) for v in (frame.density_p, frame.density_q, frame.pixel_ratio))
    height, side, row = np.abs(inverse[:, 0, 1]), inverse[:, 1, 1], np.abs(inverse[:, 1, 0])
    e_p, e_q, sigma = p * height / z, q * row / z, np.abs(side / height) * ratio
    if name == "storage":
        return e_p.max() * e_q.max()
    if name in ("edge", "band"):
        size = warpopt.theory.KERNELS[name](*map(jnp.asarray, (e_p, sigma, e_q)))
        return float((weights * size).sum() / weights.sum())
    return np.sqrt((weights * e_p**2).sum() / weights.sum())


def test_a_light_that_turns_moves_no_texel_on_the_anchor_plane():
    window, state = window_of(anchor=(0, 1, 0, -0.5), tolerance=10), None
    plane = np.stack([rng.uniform(-4, 4, 500), np.full(500, 0.5), rng.uniform(-20, -8, 500)], 1)
    before = None
    for k in range(5):
        light = warpopt.DirectionalLight((0.2 + 0.01 * k, -1, -0.3))
        update, state = window.update(state or window.start(), camera_at(), light, PointReceivers(POINTS))
        found = texels(update.matrix, plane)
        if k:
            assert int(update.action) == Action.SCROLLED
            np.testing.assert_allclose(found[:, :2] + np.asarray(update.scroll), before[:, :2], atol=1e-8)
        # A caster shares its receiver's texel.
        above = texels(update.matrix, plane - 3 * np.asarray(light.direction))
        np.testing.assert_allclose(above[:, :2], found[:, :2], atol=1e-8)
        before = found
    update, _ = window.update(state, camera_at(), warpopt.DirectionalLight((1, 0.05, -0.3)), PointReceivers(POINTS))
    assert (int(update.action), int(update.reason)) == (Action.REFITTED, Reason.TURNED)


FRAMES = 200
# Without a warp, and nothing but an extent makes it fit anew.
SCROLLING = window_of(warp=False, tolerance=1e6, jump=100.0)
SINGLE_LIGHT = warpopt.DirectionalLight(np.asarray((0.2, -1, -0.3), np.float32))


@jax.jit
def two_hundred_frames(state, camera, body, eastings):
    """(the last state, each frame's action, scroll, map and origin) of a camera that moves along x.

    One scan that two tests share, in single precision: its program takes seconds to compile.
    """

    def step(state, x):
        moved = eqx.tree_at(lambda c: c.position, camera, camera.position.at[0].set(x))
        update, state = SCROLLING.update(state, moved, SINGLE_LIGHT, body)
        return state, (update.action, update.scroll, update.local, update.origin)

    return jax.lax.scan(step, state, eastings)


def single_box(at, reach) -> ConvexBody:
    corners = (np.array([sign * reach, height, sign * reach]) for sign, height in ((-1, -1), (1, 3)))
    return ConvexBody.box(*(np.asarray(at + corner, np.float32) for corner in corners))


@pytest.mark.thorough
def test_single_precision_holds_far_from_the_origin():
    """A million metres off, relative to the window's origin, and after many scrolls."""
    far = np.array([1e6, 0, -1e6])
    eastings = (far[0] + 2.0 * np.arange(FRAMES)).astype(np.float32)
    camera = camera_at(at=far, dtype=np.float32)
    _, found = two_hundred_frames(SCROLLING.start(np.float32), camera, single_box(far, 2e3), eastings)
    actions, scrolls, local, origins = jax.tree.map(np.asarray, found)
    fixed = (far + np.array([[3.0, 0, -20], [-4.0, 1, -10]])).astype(np.float32)
    assert actions[0] == Action.FIRST
    assert set(actions[1:].tolist()) <= {Action.KEPT, Action.SCROLLED}
    assert local.dtype == np.float32
    first = texels(local[0], fixed - origins[0])
    for k in range(1, FRAMES):
        # A point near the camera, relative to the origin in single precision.
        near = fixed + np.float32(2.0 * k) * np.array([1, 0, 0], np.float32)
        assert np.abs(texels(local[k], near - origins[k])[:, :2]).max() < 4 * N
    total = scrolls[1:].sum(0)
    assert (actions == Action.SCROLLED).sum() > 50
    assert np.abs(np.cumsum(scrolls[1:], 0)).max() > 3 * N
    # The texels of a point where the walk began: 400 m and some thousand texels away now.
    last = texels(local[-1].astype(np.float64), fixed.astype(float) - origins[-1].astype(float))
    np.testing.assert_allclose(last[:, :2] + total, first[:, :2], atol=0.05)


@pytest.mark.thorough
def test_thousands_of_scrolls_in_single_precision():
    """To and fro without a warp: what is added up is the way, to a hundredth of a texel."""
    camera, body = camera_at(dtype=np.float32), single_box(0, 2e4)
    # At most 4 m a frame, and 1 km in the end.
    frames = np.arange(15 * FRAMES)
    ways = (50 * np.sin(frames / 15) + frames / 3).astype(np.float32)
    state, found = SCROLLING.start(np.float32), []
    for eastings in ways.reshape(15, FRAMES):
        state, part = two_hundred_frames(state, camera, body, eastings)
        found.append(jax.tree.map(np.asarray, part))
    actions, scrolls, local, origins = (np.concatenate(parts) for parts in zip(*found, strict=True))
    assert set(actions[1:].tolist()) <= {Action.KEPT, Action.SCROLLED}
    assert np.abs(scrolls).sum() > 20_000
    # The world's texels: at the end the window's own point lies where the scrolls say.
    fixed = np.array([[3.0, 0, -20]], np.float32)
    where = [texels(local[k].astype(np.float64), fixed - origins[k].astype(float))[0, :2] for k in (0, -1)]
    np.testing.assert_allclose(where[1] + scrolls.sum(0), where[0], atol=0.05)


def test_states_go_through_json_scan_and_vmap():
    window = window_of()
    receivers = PointReceivers(POINTS)
    *_, (_, one, state) = walk(window, 12)
    text = state.to_json()
    assert len(text) < 1024
    assert sum(leaf.nbytes for leaf in jax.tree.leaves(state)) < 1024
    back = WindowState.from_json(text)
    jax.tree.map(np.testing.assert_array_equal, back, state)
    # Two windows at once, of which the second walks backwards: one program scans over their frames.
    cameras = [camera_at(x=0.05 * k, z=-0.05 * k) for k in range(12)]
    pairs = [jax.tree.map(lambda *v: np.stack(v), *both) for both in zip(cameras, cameras[::-1], strict=True)]
    stacked = jax.tree.map(lambda *v: np.stack(v), *pairs)
    both = jax.tree.map(lambda v: np.stack([v, v]), window.start())

    def step(states, pair):
        update, states = jax.vmap(lambda s, c: window.update(s, c, LIGHT, receivers))(states, pair)
        return states, (update.action, update.matrix)

    scanned, (actions, matrices) = jax.lax.scan(step, both, stacked)
    np.testing.assert_allclose(matrices[-1, 0], one.matrix, rtol=1e-9, atol=1e-12)
    assert np.abs(matrices[-1, 1] - one.matrix).max() > 1e-3
    assert int(scanned.refits[0]) == int(state.refits)
    assert (np.asarray(actions[0]) == Action.FIRST).all()
    with pytest.raises(ValueError, match="expected one"):
        both.to_json()


BROKEN = {
    "a list": "[]", "not JSON": "{", "NaN": None, "version": None, "shape": None, "kind": None, "missing": None,
    "deep": "[" * 100_000, "huge": None, "true": None, "eta": None,
}  # fmt: skip


@pytest.mark.parametrize("how", BROKEN)
def test_broken_states_are_refused(how):
    record = json.loads(window_of().start().to_json())
    if how == "NaN":
        text = json.dumps(record).replace("1.0", "NaN", 1)
    elif how == "version":
        text = json.dumps(record | {"warpopt.WindowState": 99})
    elif how == "true":
        text = json.dumps(record | {"warpopt.WindowState": True})
    elif how in ("huge", "eta"):
        values = record["values"]
        values[3] = 10**400 if how == "huge" else -5.0
        text = json.dumps(record | {"values": values})
    elif how in ("shape", "kind", "missing"):
        values = record["values"]
        if how == "missing":
            values.pop()
        else:
            values[1] = values[1][:3] if how == "shape" else "four"
        text = json.dumps(record | {"values": values})
    else:
        text = BROKEN[how]
    with pytest.raises(ValueError, match="state: got"):
        WindowState.from_json(text)


def test_no_receivers_keep_the_map_for_a_while():
    window = window_of(forget_after=2)
    (_, first, state), nothing = next(walk(window, 1)), PointReceivers(POINTS + np.array([0, 0, 1e4]))
    for _ in range(2):
        update, state = window.update(state, camera_at(), LIGHT, nothing)
        assert (int(update.action), int(update.reason)) == (Action.EMPTY, Reason.EMPTY)
        np.testing.assert_array_equal(update.matrix, first.matrix)
    kept, _ = window.update(state, camera_at(), LIGHT, PointReceivers(POINTS))
    assert int(kept.action) == Action.KEPT
    update, state = window.update(state, camera_at(), LIGHT, nothing)
    update, state = window.update(state, camera_at(), LIGHT, PointReceivers(POINTS))
    assert int(update.action) == Action.FIRST
    update, _ = window.update(window.start(), camera_at(), LIGHT, nothing)
    assert int(update.action) == Action.EMPTY
    assert np.isnan(update.matrix).all()


def test_what_makes_a_window_refit():
    def second(camera, first=None, then=None, **more):
        first = first or window_of()
        _, _, state = next(walk(first, 1))
        update, _ = (then or first).update(state, camera, LIGHT, PointReceivers(POINTS), **more)
        return Action(int(update.action)), Reason(int(update.reason)), update

    assert second(camera_at())[:2] == (Action.KEPT, Reason.FITS)
    assert second(camera_at(x=30.0))[:2] == (Action.REFITTED, Reason.JUMP)
    assert second(camera_at(), then=window_of(margin=0.2))[:2] == (Action.REFITTED, Reason.SETTINGS)
    assert second(camera_at(turn=1.0))[0] == Action.REFITTED
    strict = window_of(tolerance=1.0)
    action, reason, update = second(camera_at(x=0.4), first=strict)
    assert (action, reason) == (Action.REFITTED, Reason.LOSS)
    assert float(update.refit_rate) == 0.5
    kept = Action.KEPT, Action.SCROLLED
    assert second(camera_at(x=0.4), first=strict, may_refit=False)[0] in kept
    assert second(camera_at(x=0.4), first=window_of(tolerance=1.0, hold=2))[0] in kept
    still = window_of(scroll=False, tolerance=10)
    reasons = [Reason(int(update.reason)) for _, update, _ in walk(still, 40, BOX, turn=0.003)]
    assert Reason.LEFT in reasons
    assert set(reasons) <= {Reason.FIRST, Reason.FITS, Reason.LEFT}


@pytest.mark.parametrize("padding", [0, 1, 20, 150])
@pytest.mark.parametrize("margin", [0.01, 0.3])
def test_a_still_scene_is_kept_for_ever(padding, margin):
    """Whatever the padding, the margin and the aspect, with no tolerance at all: nothing changes, so nothing may."""
    for aspect in (1.0, 0.25):
        window = window_of(padding=padding, margin=margin, tolerance=1.0, map_aspect=aspect)
        state = window.start()
        for k in range(4):
            update, state = window.update(state, camera_at(), LIGHT, PointReceivers(POINTS))
            assert int(update.action) == (Action.KEPT if k else Action.FIRST), update.words
            assert float(update.loss) == 1
        free = texels(update.matrix, POINTS[seen(camera_at(), POINTS)], np.asarray(update.texels))[:, :2]
        assert (free >= padding - 1e-6).all()
        assert (free <= np.asarray(update.texels) - padding + 1e-6).all()


def test_a_walk_towards_a_wall_is_no_jump():
    """A wall that faces the viewer is thin along the warp: steps of 5 cm are not jumps."""
    wall = np.stack([np.tile(np.linspace(-5, 5, 8), 8), np.repeat(np.linspace(0, 4, 8), 8), np.full(64, -20.0)], 1)
    window, state = window_of(jump=0.5), None
    for k in range(6):
        update, state = window.update(
            state or window.start(),
            camera_at(x=0.05 * k),
            warpopt.DirectionalLight((0, -1, -0.01)),
            PointReceivers(wall),
        )
        assert int(update.reason) != Reason.JUMP


def test_other_casters_and_settings_compile_nothing(caplog):
    """Numbers of casters, truth as Python's, NumPy's or JAX's: one program for all."""
    window, state = window_of(), window_of().start()
    with jax.log_compiles(), caplog.at_level("WARNING", logger="jax"):
        window.update(state, camera_at(), LIGHT, PointReceivers(POINTS))
        caplog.clear()
        for casters, may in ((None, True), (POINTS[:3], np.True_), (POINTS[:5], jnp.array(False)), (POINTS[:0], False)):
            window_of(margin=0.3).update(
                state, camera_at(), LIGHT, PointReceivers(POINTS), casters=casters, may_refit=may
            )
        assert not [record for record in caplog.records if "update_window" in record.getMessage()]


def test_a_grazed_anchor_is_not_used():
    """A light in the given plane: the map is across the light, and stays while nothing moves."""
    window, state = window_of(anchor=(0, 1, 0, 0)), None
    for _ in range(3):
        update, state = window.update(
            state or window.start(), camera_at(), warpopt.DirectionalLight((1, 0, 0)), PointReceivers(POINTS)
        )
    assert int(update.action) == Action.KEPT


def test_margins_grow_where_receivers_outgrow_maps():
    """Every frame sees more: margins double, up to eight times, and are the window's own again once it is quiet."""
    window, receivers = window_of(scroll=False, tolerance=1e6, warp=False), PointReceivers(POINTS)
    state, margins = window.start(), []
    for far in (10.0, 20.0, 40.0, 80.0, 120.0, 200.0):
        camera = warpopt.Camera((0, 2, 0), (0, -0.1, -1), (0, 1, 0), near=0.5, far=far, half_fov=0.5, aspect=1.6)
        update, state = window.update(state, camera, LIGHT, receivers)
        margins.append(float(state.margin) if int(update.action) in (Action.FIRST, Action.REFITTED) else None)
    grown = [m for m in margins if m is not None]
    np.testing.assert_allclose(grown[:4], [0.1, 0.2, 0.4, 0.8][: len(grown)])
    assert len(grown) >= 3
    assert max(grown) <= 0.8 + 1e-12
    for _ in range(31):
        update, state = window.update(state, camera, LIGHT, receivers)
    # Now it is measured against the window's own margin.
    assert float(update.loss) == pytest.approx(((1 + grown[-1]) / 1.1) ** 2, rel=1e-9)


def test_casters_change_the_depth_alone():
    window = window_of()
    (_, first, state) = next(walk(window, 1))
    tower = np.array([[0.0, 80, -20]]) - 0.0
    update, state = window.update(state, camera_at(), LIGHT, PointReceivers(POINTS), casters=tower)
    assert (Action(int(update.action)), Reason(int(update.reason))) == (Action.SCROLLED, Reason.DEPTH)
    points = POINTS[seen(camera_at(), POINTS)]
    np.testing.assert_array_equal(update.scroll, 0)
    np.testing.assert_allclose(texels(update.matrix, points)[:, :2], texels(first.matrix, points)[:, :2], atol=1e-9)
    assert texels(update.matrix, tower)[0, 2] > -1
    again, _ = window.update(state, camera_at(), LIGHT, PointReceivers(POINTS), casters=tower)
    assert int(again.action) == Action.KEPT


def test_one_of_several_windows_refits_at_a_time():
    window = window_of()
    states = jax.tree.map(lambda v: jnp.stack([v] * 3), window.start())
    states = eqx.tree_at(lambda s: s.loss, states, jnp.array([1.2, 1.4, 1.0]))
    assert not np.asarray(window.stagger(states)).any()  # nothing is fitted yet
    states = eqx.tree_at(lambda s: s.fitted, states, jnp.array([True, True, True]))
    np.testing.assert_array_equal(window.stagger(states), [False, True, False])
    states = eqx.tree_at(lambda s: s.missed, states, jnp.array([0, 3, 0]))
    np.testing.assert_array_equal(window.stagger(states), [True, False, False])  # the second sees nothing
    with pytest.raises(ValueError, match="states: got"):
        window.stagger(window.start())


@pytest.mark.thorough
def test_what_is_minimised_follows_from_what_is_known():
    """Edges: the objective "edge" over their weights; receivers with weights: "band"; bodies: storage."""
    weights = np.random.default_rng(2).random(64)

    def first(objective, receivers, *edges):
        window = window_of(objective=objective, tolerance=1e6, padding=0)
        return window.update(window.start(), camera_at(), LIGHT, receivers, *edges)[0]

    edged = first(None, PointReceivers(POINTS), weights)
    explicit = first(warpopt.Objective("edge"), PointReceivers(POINTS, weights))
    np.testing.assert_array_equal(edged.matrix, explicit.matrix)
    weighed = first(None, PointReceivers(POINTS, weights))
    np.testing.assert_array_equal(
        weighed.matrix, first(warpopt.Objective("band"), PointReceivers(POINTS, weights)).matrix
    )
    assert float(edged.warp.eta) != float(weighed.warp.eta)
    np.testing.assert_array_equal(first(None, BOX).matrix, first(STORAGE, BOX).matrix)
    with pytest.raises(ValueError, match="edges: got"):
        first(None, BOX, weights)


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        ({"margin": 0}, "margin: got 0"), ({"margin": np.nan}, "margin"), ({"tolerance": 0.9}, "tolerance: got 0.9"),
        ({"padding": -1}, "padding"), ({"padding": 256}, "padding"), ({"check_every": 0}, "check_every"),
        ({"shadow_map": (0, 4)}, "shadow_map"), ({"shadow_map": (4.5, 4)}, "shadow_map"), ({"screen": 3}, "screen"),
        ({"objective": "p"}, "objective"), ({"warp_direction": "up"}, "warp_direction"), ({"anchor": "x"}, "anchor"),
        ({"anchor": (0, 0, 0, 1)}, "anchor"), ({"map_aspect": 0}, "map_aspect"), ({"lateral": "x"}, "lateral"),
        ({"scroll": 1}, "scroll"), ({"ahead": 2}, "ahead"), ({"clip_space": "gl"}, "clip_space"),
        ({"warp_direction": (0, 1)}, "warp_direction"), ({"jump": 0}, "jump"), ({"hold": 0}, "hold"),
        ({"forget_after": -1}, "forget_after"),
    ],
)  # fmt: skip
def test_settings_out_of_range_are_refused(settings, words):
    with pytest.raises(ValueError, match=words):
        window_of(**settings)


def test_other_arguments_are_refused():
    window, receivers = window_of(), PointReceivers(POINTS)
    with pytest.raises(ValueError, match="state: got"):
        window.update(None, camera_at(), LIGHT, receivers)
    with pytest.raises(ValueError, match="camera: got"):
        window.update(window.start(), None, LIGHT, receivers)
    with pytest.raises(ValueError, match="casters: got"):
        window.update(window.start(), camera_at(), LIGHT, receivers, casters=[[np.nan, 0, 0]])
    with pytest.raises(ValueError, match="warp_direction: got 'best'"):
        window_of(objective=warpopt.Objective("p"), warp_direction="best")
    with pytest.raises(ValueError, match="lateral: got 'free'"):
        window_of(objective=warpopt.Objective("edge"), lateral="free")
    with pytest.raises(ValueError, match="state: got"):
        window.update(jax.tree.map(lambda v: v[None], window.start()), camera_at(), LIGHT, receivers)
    with pytest.raises(ValueError, match="may_refit: got 'yes'"):
        window.update(window.start(), camera_at(), LIGHT, receivers, may_refit="yes")
    for dtype in ("int32", "foo"):
        with pytest.raises(ValueError, match="dtype: got"):
            window.start(dtype)
