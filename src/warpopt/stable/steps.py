"""One frame of a stable window, in one compiled call."""

import functools
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jax.typing import ArrayLike
from jaxtyping import Array, Bool, Float, Int, UInt32

from .._numerics import power
from ..objective import Objective
from ..receivers.answers import footprint_of
from ..render.shadow_matrix import ClipSpace, to_clip
from ..solve.outcome import failed
from ..solve.scene import solve_scene
from ..theory.light_frame import LightFrame
from ..theory.warp import Warp
from ..views import SceneView
from .loss import degree, error_of
from .pencil import Corners, Pencil, Placed, Square, offset_for
from .state import WindowState
from .update import Action, Reason, Update

_MIN_ETA = 1e-4
_HORIZON = 8.0  # A at the end of a map over that at its pencil's: beyond, rows of texels are nearly the horizon's
_FAR_SHARE = 0.5  # of the way from the far end to the horizon that a margin may take
_LEAST_SLOPE = 0.2  # cosine between light and anchor plane's normal: a steeper plane shears too much
_LEAST_TURN = 0.25  # of that cosine when the light turns: texels off the plane are then four times as sheared
_DEPTH_MARGIN = 0.25  # of the depth range on either side, and of its fall below which a shorter one is taken
_LONGEST = 3.0  # the depth range over what is needed


class Settings(eqx.Module):
    """A `StableWindow`'s settings with its numbers as arrays, so that other values compile nothing anew."""

    margin: Float[Array, ""]
    tolerance: Float[Array, ""]
    padding: Int[Array, ""]
    ahead: Float[Array, ""]
    jump: Float[Array, ""]
    check_every: Int[Array, ""]
    forget_after: Int[Array, ""]
    plane: Float[Array, "4"]  # normal and offset in the world, if it is given
    checksum: UInt32[ArrayLike, ""]
    anchor: str = eqx.field(static=True)  # "fit", "light" or "given"
    scroll: bool = eqx.field(static=True)
    warp: bool = eqx.field(static=True)
    clip_space: ClipSpace = eqx.field(static=True)


class Fit(NamedTuple):
    """A new map, and what the old one's error is against it."""

    pencil: Pencil
    texels: Int[Array, "2"]
    plane: Float[Array, "4"]
    level: Float[Array, ""]
    needed: Float[Array, "2"]  # the depth range
    loss: Float[Array, ""]
    solved: Bool[Array, ""]


@functools.partial(jax.jit, static_argnames=("objective",))
def update_window(
    window: Settings,
    objective: Objective,
    state: WindowState,
    view: SceneView,
    casters: Float[Array, "N 3"] | None,
    may_refit: ArrayLike,
) -> tuple[Update, WindowState]:
    """See `StableWindow.update`."""
    camera, light = view.camera, view.light.direction
    dtype = camera.position.dtype
    light = light.astype(dtype)
    state = jax.tree.map(lambda v: v.astype(dtype) if jnp.issubdtype(v.dtype, jnp.floating) else v, state)
    near_enough = _anchored(state, light)
    pencil = _under(state.pencil, state, jnp.where(near_enough, light, state.fitted_light))
    frame, placed, corners, empty = _seen(view, pencil, state.texels)
    square = corners.within(placed)
    last = (1 - state.pencil.eta / _HORIZON) / _positive(state.pencil.one_minus_eta)
    last = jnp.where(state.pencil.one_minus_eta > 0, last, jnp.inf)
    place = functools.partial(offset_for, square, state.texels, state.offset, window.padding, window.ahead)
    offset, fits = place(last)
    _, fits_before = place(jnp.asarray(jnp.inf, dtype))
    can_move = fits
    if not window.scroll:
        fits = fits & (offset == state.offset).all()
    moved = jnp.sqrt(((camera.position - state.pencil.origin - state.eye) ** 2).sum())

    reason = jnp.asarray(Reason.FITS, jnp.int32)
    # The last that holds is the one that is told.
    for holds, which in (
        (~fits, Reason.RANGE),
        (~fits & can_move, Reason.LEFT),
        ((~can_move & fits_before) | jnp.isnan(square.s).any(), Reason.HORIZON),
        (~near_enough, Reason.TURNED),
        (moved > window.jump * pencil.mu, Reason.JUMP),
        (state.settings != window.checksum, Reason.SETTINGS),
        (~state.fitted, Reason.FIRST),
        (empty, Reason.EMPTY),
    ):
        reason = jnp.where(holds, which, reason)
    must = (reason != Reason.FITS) & ~empty
    due = ~empty & (state.unchecked + 1 >= window.check_every)
    beneath = light @ (camera.position - state.pencil.origin)  # l . (p - origin) of the eye
    above = None if casters is None else (casters - camera.position) @ light
    needed = corners.depth_range(placed, state.depth[0] - beneath, above)
    kept = Fit(
        state.pencil, state.texels, state.plane, state.depth[0], needed, state.loss, jnp.zeros((), bool)
    )  # fmt: skip
    fit = jax.lax.cond(must | due, lambda: _fitted(window, objective, view, frame, placed, above), lambda: kept)
    passed = due & (fit.loss > window.tolerance) & jnp.asarray(may_refit)
    reason = jnp.where(passed & ~must & fit.solved, Reason.LOSS, reason)
    refit = (must | passed) & fit.solved
    unsolved = must & ~fit.solved
    reason = jnp.where(unsolved, Reason.UNSOLVED, reason)
    lost = empty | unsolved
    loss = jnp.where(due & ~must & jnp.isfinite(fit.loss), fit.loss, state.loss)

    base, texels, plane, level, needed = (
        jax.tree.map(lambda new, old: jnp.where(refit, new, old), one, other)
        for one, other in zip(fit[:5], kept[:5], strict=True)
    )
    fitted_light = jnp.where(refit, light, state.fitted_light)
    now = jnp.where(refit | (near_enough & ~lost), light, state.light)
    offset = jnp.where(refit, 0, jnp.where(lost, state.offset, offset))
    scroll = jnp.where(refit, 0, offset - state.offset)
    depth = jnp.where(lost, state.depth, _depth(state.depth, level, needed, refit))
    turned, deeper = (now != state.light).any(), (depth != state.depth).any()
    scrolls = (scroll != 0).any()
    reason = jnp.where((reason == Reason.FITS) & scrolls, Reason.LEFT, reason)
    reason = jnp.where((reason == Reason.FITS) & turned, Reason.LIGHT, reason)
    reason = jnp.where((reason == Reason.FITS) & deeper, Reason.DEPTH, reason)
    action = jnp.where(scrolls | turned | deeper, Action.SCROLLED, Action.KEPT)
    action = jnp.where(refit, jnp.where(state.fitted, Action.REFITTED, Action.FIRST), action)
    action = jnp.where(lost, Action.EMPTY, action).astype(jnp.int32)

    there = (state.fitted | refit) & ~(empty & (state.missed >= window.forget_after))
    again = refit & state.fitted & (state.settings == window.checksum)
    made = WindowState(
        base, plane, fitted_light, now, offset, jnp.where(refit, 0, state.scrolled + scroll), texels, depth,
        jnp.where(empty, state.eye, camera.position - base.origin), jnp.where(refit, 1, loss), there,
        jnp.where(empty, state.missed + 1, 0), jnp.where((must | due) & ~empty, 0, state.unchecked + 1),
        state.frames + 1, state.refits + again, jnp.where(refit, window.checksum, state.settings),
    )  # fmt: skip
    made = _moved_on(made, camera.position)
    return _shown(window, made, view, state.fitted | refit, action, reason, scroll), made


def _seen(view: SceneView, pencil: Pencil, texels: Array) -> tuple[LightFrame, Placed, Corners, Array]:
    """(axes of a map, its place in them, the receivers' corners, whether there are none)."""
    camera = view.camera
    frame = LightFrame(camera, view.light, view.screen, texels.astype(camera.position.dtype))
    frame = pencil.frame(camera, frame)
    footprint = footprint_of(view.receivers, camera, frame, Objective())
    return frame, pencil.placed(camera, frame), Corners.of(footprint), footprint.empty


def _anchored(state: WindowState, light: Array) -> Array:
    """Whether the anchor plane carries the map under this light."""
    cosine, first = state.plane[:3] @ light, state.plane[:3] @ state.fitted_light
    return cosine / first > _LEAST_TURN


def _under(pencil: Pencil, state: WindowState, light: Array) -> Pencil:
    same = (light == state.fitted_light).all()
    turned = pencil.under(light, state.plane)
    return jax.tree.map(lambda a, b: jnp.where(same, a, b), pencil, turned)


def _fitted(
    window: Settings, objective: Objective, view: SceneView, frame: LightFrame, placed: Placed,
    above: Array | None,
) -> Fit:  # fmt: skip
    """A window over this frame's receivers, and the loss of the map that there is."""
    solution = solve_scene(view, objective, jnp.asarray(_MIN_ETA, view.camera.position.dtype))
    value, warp = solution.value, solution.warp
    if not window.warp:
        one = jnp.ones_like(warp.eta)
        warp, value = Warp(one, 0 * one, warp.start, warp.mu, warp.defined), solution.unwarped
    pencil = Pencil.fitted(view.camera, solution.frame, solution.footprint, warp)
    # With the margin on both sides; beyond the far end less where the horizon is near.
    half = window.margin / 2
    rest = jnp.where(warp.one_minus_eta > 0, warp.eta / _positive(warp.one_minus_eta), jnp.inf)
    beyond = jnp.minimum(half, _FAR_SHARE * rest)
    # A whole number of texels; as many in all, up to rounding.
    size = view.shadow_map
    assert size is not None  # a window has one
    across = jnp.round(size[0] * solution.shares[0])
    texels = jnp.where(solution.shares == 1, size, jnp.stack([across, jnp.round(size[0] * size[1] / across)]))
    pad_t, pad_s = window.padding / texels
    t = jnp.stack([-half - pad_t, 1 + half + pad_t])
    pencil = pencil.cropped(Square(t, jnp.stack([-half - pad_s, 1 + beyond + pad_s])))
    texels = texels.astype(jnp.int32)
    loss = error_of(view, frame, placed, objective) / (value * power(1 + window.margin, degree(objective)))
    finite = jnp.stack([jnp.isfinite(leaf).all() for leaf in jax.tree.leaves(pencil)]).all()
    _, own, corners, _ = _seen(view, pencil, texels)
    needed = corners.depth_range(own, corners.middle, above)
    return Fit(
        pencil, texels, _plane(window, view), corners.middle, needed, loss, ~failed(solution.result) & finite
    )  # fmt: skip


def _plane(window: Settings, view: SceneView) -> Array:
    """The anchor plane, relative to the eye."""
    camera, light = view.camera, view.light.direction
    if window.anchor == "given":
        normal, offset = window.plane[:3], window.plane[3]
        return jnp.append(normal, normal @ camera.position - offset)
    points, weights = view.receivers.places(camera)
    z = jnp.where(weights > 0, points[:, 2], 1)
    share = jnp.where(weights > 0, weights / (z * z), 0)
    share = share / _positive(share.sum())
    centre = share @ jnp.where((weights > 0)[:, None], points, 0)
    off = jnp.where((weights > 0)[:, None], points - centre, 0)
    normal = light
    if window.anchor == "fit":
        _, vectors = jnp.linalg.eigh((off * share[:, None]).T @ off)
        fitted = vectors[:, 0] @ camera.rotation
        fitted = fitted * jnp.where(fitted @ light < 0, -1, 1)
        normal = jnp.where(fitted @ light > _LEAST_SLOPE, fitted, light)
    return jnp.append(normal, -normal @ (centre @ camera.rotation))


def _depth(old: Array, level: Array, needed: Array, refit: Array) -> Array:
    """(level, least, largest): as they were, unless something lies outside or the range is far too long."""
    least, largest = needed
    span = largest - least
    span = jnp.where(span > 0, span, 1)  # receivers in one plane across the light
    _, low, high = old
    holds = (low <= least) & (largest <= high) & (high - low <= _LONGEST * (1 + 2 * _DEPTH_MARGIN) * span)
    new = jnp.stack([level, least - _DEPTH_MARGIN * span, largest + _DEPTH_MARGIN * span])
    return jnp.where(holds & ~refit, old, new)


def _moved_on(state: WindowState, eye: Array) -> WindowState:
    """The same map with rows relative to the eye, and its own square as the unit square, once it moved by a whole map:
    both lose digits with the way from where they began."""
    due = (jnp.abs(state.offset) > state.texels).any()
    shares = state.offset / state.texels.astype(eye.dtype)
    square = Square(*(jnp.stack([share, 1 + share]) for share in shares))
    pencil = state.pencil.cropped(square).about(eye)
    way = eye - state.pencil.origin
    plane = state.plane.at[3].add(state.plane[:3] @ way)
    smaller = state.pencil.blend_at(square.s[1])  # the new A
    depth = state.depth * jnp.stack([jnp.ones_like(smaller), smaller, smaller])
    depth = depth.at[0].add(-state.light @ way)
    moved = eqx.tree_at(
        lambda s: (s.pencil, s.plane, s.offset, s.depth, s.eye), state,
        (pencil, plane, 0 * state.offset, depth, 0 * state.eye),
    )  # fmt: skip
    return jax.tree.map(lambda new, old: jnp.where(due, new, old), moved, state)


def _shown(window: Settings, state: WindowState, view: SceneView, there: Array, action, reason, scroll) -> Update:
    pencil = _under(state.pencil, state, state.light)
    shares = state.offset / state.texels.astype(pencil.eta.dtype)
    blend, (level, low, high) = pencil.blend, state.depth
    rows = jnp.stack([
        pencil.across + (0.5 - shares[0]) * blend,
        (jnp.append(state.light, -level) - low * blend) / _positive(high - low),
        pencil.along - shares[1] * blend,
        blend,
    ])  # fmt: skip
    rows = jnp.where(there, jnp.asarray(to_clip(window.clip_space, rows.dtype)) @ rows, jnp.nan)
    world = rows.at[:, 3].add(-(rows[:, :3] @ pencil.origin))
    square = Square(*(jnp.stack([share, 1 + share]) for share in shares))
    cropped = pencil.cropped(square)
    frame = cropped.frame(
        view.camera, LightFrame(view.camera, view.light, view.screen, state.texels.astype(rows.dtype))
    )
    local, world = (m.T if window.clip_space.row_vectors else m for m in (rows, world))
    return Update(
        world, local, pencil.origin, cropped.placed(view.camera, frame).warp, cropped.along[:3] * cropped.mu,
        state.texels, action, reason, jnp.where(action == Action.SCROLLED, scroll, 0), state.loss,
        state.refits / state.frames,
    )  # fmt: skip


def _positive(value: Array) -> Array:
    return jnp.where(value > 0, value, 1)
