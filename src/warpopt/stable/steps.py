"""One frame of a stable window, in one compiled call."""

import functools
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jax.typing import ArrayLike
from jaxtyping import Array, Bool, Float, Int, UInt32

from .._numerics import positive
from ..objective import Objective
from ..receivers.answers import footprint_of
from ..render.shadow_matrix import ClipSpace, to_clip
from ..solve.outcome import failed
from ..solve.scene import solve_scene
from ..theory.light_frame import LightFrame
from ..theory.warp import Warp
from ..views import SceneView
from .loss import error_of
from .pencil import Corners, Pencil, Placed, Square, offset_for
from .state import WindowState
from .update import Action, Reason, Update

_HORIZON = 8.0  # A at the end of a map over that at its pencil's: beyond, rows of texels are nearly the horizon's
_FAR_SHARE = 0.5  # of the way from the far end to the horizon that a margin may take
_LEAST_SLOPE = 0.2  # cosine between light and anchor plane's normal: a steeper plane shears too much
_LEAST_TURN = 0.25  # of that cosine when the light turns: texels off the plane are then four times as sheared
_DEPTH_MARGIN = 0.25  # of the depth range on either side, and of its fall below which a shorter one is taken
_LONGEST = 3.0  # the depth range over what is needed
_SOON = 8  # frames: receivers that outgrow a map sooner than this get a margin twice as large,
_LARGEST_MARGIN = 8.0  # up to this many times the window's,
_SETTLED = 30  # and are held to the window's own margin again after as many
_URGENT = 2.0  # times the tolerance: a loss that is not put off


class Settings(eqx.Module):
    """A `StableWindow`'s settings with its numbers as arrays, so that other values compile nothing anew."""

    margin: Float[Array, ""]
    tolerance: Float[Array, ""]
    padding: Int[Array, ""]
    ahead: Float[Array, ""]
    jump: Float[Array, ""]
    hold: Int[Array, ""]
    check_every: Int[Array, ""]
    forget_after: Int[Array, ""]
    plane: Float[Array, "4"]  # normal and offset in the world; a normal of 0 if none is given
    across_light: Bool[Array, ""]  # whether the anchor plane is the light's
    scroll: Bool[Array, ""]
    warp: Bool[Array, ""]
    checksum: UInt32[ArrayLike, ""]
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
    above: Float[Array, ""],
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
    last = (1 - state.pencil.eta / state.reach) / positive(state.pencil.one_minus_eta)
    last = jnp.where(state.pencil.one_minus_eta > 0, last, jnp.inf)
    place = functools.partial(offset_for, square, state.texels, state.offset, window.padding, window.ahead)
    offset, fits = place(last)
    _, fits_before = place(jnp.asarray(jnp.inf, dtype))
    can_move = fits
    fits = fits & (window.scroll | (offset == state.offset).all())
    moved = jnp.sqrt(((camera.position - state.pencil.origin - state.eye) ** 2).sum())

    reason = jnp.asarray(Reason.FITS, jnp.int32)
    # The last that holds is the one that is told.
    for holds, which in (
        (~fits, Reason.RANGE),
        (~fits & can_move, Reason.LEFT),
        ((~can_move & fits_before) | jnp.isnan(square.s).any(), Reason.HORIZON),
        (~near_enough, Reason.TURNED),
        (moved > window.jump * pencil.size, Reason.JUMP),
        (state.settings != window.checksum, Reason.SETTINGS),
        (~state.fitted, Reason.FIRST),
        (empty, Reason.EMPTY),
    ):
        reason = jnp.where(holds, which, reason)
    must = (reason != Reason.FITS) & ~empty
    due = ~empty & (state.unchecked + 1 >= window.check_every)
    beneath = light @ (camera.position - state.pencil.origin)  # l . (p - origin) of the eye
    needed = corners.depth_range(placed, state.depth[0] - beneath, above)
    kept = Fit(
        state.pencil, state.texels, state.plane, state.depth[0], needed, state.loss, jnp.zeros((), bool)
    )  # fmt: skip
    outgrown = (reason == Reason.RANGE) | (reason == Reason.LEFT) | (reason == Reason.HORIZON)
    larger = jnp.minimum(2 * state.margin, _LARGEST_MARGIN * window.margin)
    margin = jnp.where(outgrown & (state.age < _SOON), jnp.maximum(larger, window.margin), window.margin)
    allowed = jnp.where(state.age < _SETTLED, state.margin, window.margin)
    fit = jax.lax.cond(
        must | due, lambda: _fitted(window, objective, view, frame, placed, above, margin, allowed), lambda: kept
    )  # fmt: skip
    # What comes and goes in view would have a map fitted for it each time.
    waits = (state.age + 1 < window.hold) & (fit.loss <= _URGENT * window.tolerance)
    passed = due & (fit.loss > window.tolerance) & jnp.asarray(may_refit) & ~waits
    reason = jnp.where(passed & ~must & fit.solved, Reason.LOSS, reason)
    refit = (must | passed) & fit.solved
    put_off = due & ~must & ~refit & (fit.loss > window.tolerance)
    reason = jnp.where((reason == Reason.FITS) & put_off, Reason.WAITS, reason)
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
    fine = (reason == Reason.FITS) | (reason == Reason.WAITS)
    for holds, which in ((deeper, Reason.DEPTH), (turned, Reason.LIGHT), (scrolls, Reason.LEFT)):
        reason = jnp.where(fine & holds, which, reason)
    action = jnp.where(scrolls | turned | deeper, Action.SCROLLED, Action.KEPT)
    action = jnp.where(refit, jnp.where(state.fitted, Action.REFITTED, Action.FIRST), action)
    action = jnp.where(lost, Action.EMPTY, action).astype(jnp.int32)

    there = (state.fitted | refit) & ~(empty & (state.missed >= window.forget_after))
    again = refit & state.fitted & (state.settings == window.checksum)
    checked = (must | due) & ~empty & ~put_off
    made = WindowState(
        pencil=base, plane=plane, fitted_light=fitted_light, light=now, offset=offset, texels=texels, depth=depth,
        reach=jnp.where(refit, _HORIZON, state.reach), scrolled=jnp.where(refit, 0, state.scrolled + scroll),
        eye=jnp.where(empty, state.eye, camera.position - base.origin), loss=jnp.where(refit | ~there, 1, loss),
        fitted=there, missed=jnp.where(empty, state.missed + 1, 0),
        unchecked=jnp.where(checked, 0, state.unchecked + 1), margin=jnp.where(refit, margin, state.margin),
        age=jnp.where(refit, 0, state.age + 1), frames=state.frames + 1, refits=state.refits + again,
        settings=jnp.where(refit, window.checksum, state.settings),
    )  # fmt: skip
    made = _moved_on(made, camera.position)
    return _shown(window, made, view, state.fitted | refit, action, reason, scroll), made


def _seen(view: SceneView, pencil: Pencil, texels: Array) -> tuple[LightFrame, Placed, Corners, Array]:
    """(axes of a map, its place in them, the receivers' corners, whether there are none)."""
    camera = view.camera
    frame = _frame_of(view, pencil, texels)
    footprint = footprint_of(view.receivers, camera, frame, Objective())
    return frame, pencil.placed(camera, frame), Corners.of(footprint), footprint.empty


def _frame_of(view: SceneView, pencil: Pencil, texels: Array) -> LightFrame:
    """The axes of a map of so many texels."""
    frame = LightFrame(view.camera, view.light, view.screen, texels.astype(view.camera.position.dtype))
    return pencil.frame(view.camera, frame)


def _anchored(state: WindowState, light: Array) -> Array:
    """Whether the anchor plane carries the map under this light."""
    cosine, first = state.plane[:3] @ light, state.plane[:3] @ state.fitted_light
    return (cosine > _LEAST_TURN * first) | (light == state.fitted_light).all()


def _under(pencil: Pencil, state: WindowState, light: Array) -> Pencil:
    same = (light == state.fitted_light).all()
    turned = pencil.under(light, state.plane)
    return jax.tree.map(lambda a, b: jnp.where(same, a, b), pencil, turned)


def _fitted(
    window: Settings, objective: Objective, view: SceneView, frame: LightFrame, placed: Placed,
    above: Array, margin: Array, allowed: Array,
) -> Fit:  # fmt: skip
    """A window over this frame's receivers, and the loss of the map that there is against one of the allowed margin."""
    solution = solve_scene(view, objective)
    warp = solution.warp
    warp = jax.tree.map(lambda own, none: jnp.where(window.warp, own, none), warp, warp.unwarped)
    # A whole number of texels, some of them beside the padding; as many in all, up to rounding.
    size = view.shadow_map
    assert size is not None  # a window has one
    least = 2.0 * window.padding + 1
    across = jnp.clip(jnp.round(size[0] * solution.shares[0]), least, jnp.floor(size[0] * size[1] / least))
    texels = jnp.where(solution.shares == 1, size, jnp.stack([across, jnp.round(size[0] * size[1] / across)]))
    edges = window.padding / (texels - 2 * window.padding)  # over the length between them

    def beyond(margin: Array) -> Array:
        """The margin at the far end: less where the horizon is near."""
        rest = jnp.where(warp.one_minus_eta > 0, warp.eta / positive(warp.one_minus_eta), jnp.inf)
        return jnp.minimum(margin / 2, _FAR_SHARE * rest)

    # A warp whose horizon would lie in the padding is too strong for it.
    last = 1 + beyond(margin) + edges[1] * (1 + margin / 2 + beyond(margin))
    eta = jnp.maximum(warp.eta, (1 + 1e-3) * _HORIZON * (last - 1) / (_HORIZON * last - 1))
    eta = jnp.where(edges[1] > 0, jnp.minimum(eta, 1), warp.eta)
    rest = jnp.where(eta > warp.eta, 1 - eta, warp.one_minus_eta)
    pencil = Pencil.fitted(
        view.camera, solution.frame, solution.footprint, Warp(eta, rest, warp.start, warp.mu, warp.defined)
    )

    def with_margin(margin: Array) -> Pencil:
        both = []
        for edge, far in zip(edges, (margin / 2, beyond(margin)), strict=True):
            length = edge * (1 + margin / 2 + far)
            both.append(jnp.stack([-margin / 2 - length, 1 + far + length]))
        return pencil.cropped(Square(*both))

    # Over the receivers themselves, as the old map's error is: what cells lose would otherwise look like a loss.
    allowed_map = with_margin(allowed)
    axes = _frame_of(view, allowed_map, texels)
    fresh = error_of(view, axes, allowed_map.placed(view.camera, axes), objective)
    loss = error_of(view, frame, placed, objective) / jnp.where(fresh > 0, fresh, jnp.nan)
    pencil, texels = with_margin(margin), texels.astype(jnp.int32)
    finite = jnp.stack([jnp.isfinite(leaf).all() for leaf in jax.tree.leaves(pencil)]).all()
    _, own, corners, _ = _seen(view, pencil, texels)
    needed = corners.depth_range(own, corners.middle, above)
    return Fit(
        pencil, texels, _plane(window, view), corners.middle, needed, loss, ~failed(solution.result) & finite
    )  # fmt: skip


def _plane(window: Settings, view: SceneView) -> Array:
    """The anchor plane, relative to the eye."""
    camera, light = view.camera, view.light.direction
    points, weights = view.receivers.places(camera)
    z = camera.screen_depth(jnp.where(weights > 0, points[:, 2], 1))
    share = jnp.where(weights > 0, weights / (z * z), 0)
    share = share / positive(share.sum())
    centre = share @ jnp.where((weights > 0)[:, None], points, 0)
    off = jnp.where((weights > 0)[:, None], points - centre, 0)
    _, vectors = jnp.linalg.eigh((off * share[:, None]).T @ off)
    fitted = vectors[:, 0] @ camera.rotation
    fitted = fitted * jnp.where(fitted @ light < 0, -1, 1)
    normal = jnp.where((fitted @ light > _LEAST_SLOPE) & ~window.across_light, fitted, light)
    own = jnp.append(normal, -normal @ (centre @ camera.rotation))
    given = window.plane.at[3].set(window.plane[:3] @ camera.position + window.plane[3])
    given = given * jnp.where(given[:3] @ light < 0, -1, 1)
    # A plane that the light grazes would shear the map beyond use.
    return jnp.where((window.plane[:3] != 0).any() & (given[:3] @ light > _LEAST_SLOPE), given, own)


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
        lambda s: (s.pencil, s.plane, s.offset, s.depth, s.eye, s.reach), state,
        (pencil, plane, 0 * state.offset, depth, 0 * state.eye, state.reach / smaller),
    )  # fmt: skip
    return jax.tree.map(lambda new, old: jnp.where(due, new, old), moved, state)


def _shown(window: Settings, state: WindowState, view: SceneView, there: Array, action, reason, scroll) -> Update:
    pencil = _under(state.pencil, state, state.light)
    shares = state.offset / state.texels.astype(pencil.eta.dtype)
    blend, (level, low, high) = pencil.blend, state.depth
    rows = jnp.stack([
        pencil.across + (0.5 - shares[0]) * blend,
        (jnp.append(state.light, -level) - low * blend) / positive(high - low),
        pencil.along - shares[1] * blend,
        blend,
    ])  # fmt: skip
    rows = jnp.where(there, jnp.asarray(to_clip(window.clip_space, rows.dtype)) @ rows, jnp.nan)
    world = rows.at[:, 3].add(-(rows[:, :3] @ pencil.origin))
    square = Square(*(jnp.stack([share, 1 + share]) for share in shares))
    cropped = pencil.cropped(square)
    frame = _frame_of(view, cropped, state.texels)
    local, world = (m.T if window.clip_space.row_vectors else m for m in (rows, world))
    return Update(
        world, local, pencil.origin, cropped.placed(view.camera, frame).warp, cropped.along[:3] * cropped.mu,
        state.texels, action, reason, jnp.where(action == Action.SCROLLED, scroll, 0), state.loss,
        state.refits.astype(rows.dtype) / state.frames,
    )  # fmt: skip
