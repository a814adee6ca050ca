"""How many cascades are worth their price."""

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Float

from .._checks import Numbers, checked, float_arrays
from ..objective import Objective
from ..solve.scene import settled_scene
from ..theory.camera import Camera, DirectionalLight
from ..views import FrustumView, SceneView, refuse_other
from .over_scene import depth_range, solved_between
from .splits import MOST, even_in_the_logarithm, logarithmic, uniform_at

_TEXELS = Objective("storage")
_TOGETHER = 8  # pieces in one call: all 16 and all 136 are whole numbers of these, so one program solves them


def count(view: FrustumView | SceneView, price: Numbers = 0.0, *, warp: bool = True) -> tuple[int, Float[Array, " 16"]]:
    """(the cheapest number of maps, what 1 to 16 maps cost): texels and price together.

    Texels are those of maps of their own aspect with one texel a pixel everywhere (`Objective("storage")`), over
    logarithmic splits (equal ones for an orthographic camera), which are within 2.6 % of the fewest
    (docs/cascades.md: proved without a warp, measured with one). Rules of thumb fail: the best ratio of a cascade is
    1.4 to 3.5 by light and warp.

    Args:
        view: one frustum under one light, or a scene; over a scene its `screen` and `shadow_map` are the units: a
            multiple of the map's texels.
        price: of one more map, in the same units, >= 0.
        warp: whether maps are warped.

    Returns:
        The number, and (16,) what 1 to 16 maps cost: their texels plus `price` for each map.

    Raises:
        ValueError: several frusta or what is no view; a price that is negative, infinite or NaN; an endless range;
            receivers without a `depth_extent`.

    Example:
        >>> import warpopt
        >>> frustum = warpopt.ViewFrustum(near=1.0, far=1000.0, half_fov=0.5236)
        >>> best, cost = count(warpopt.FrustumView(frustum, 1.0472), price=10.0)
        >>> best, bool(cost[best - 1] == cost.min())
        (6, True)
    """
    refuse_other(view)
    (price,) = float_arrays(price=price)
    if price.shape:
        raise ValueError(f"price: got shape {price.shape}, expected one number")
    price = checked("price", price, lambda v: (v >= 0) & (v < jnp.inf), "a finite number >= 0")
    scene = in_world(view) if isinstance(view, FrustumView) else view
    settled_scene(scene, _TEXELS)  # refuses a ground that is seen to its horizon
    near, far = depth_range(scene)
    if not float(near) < float(far):  # at one depth, one map holds all receivers, whatever the number of maps
        _, solution = solved_between(scene, near[None], jnp.maximum(near, far)[None], _TEXELS)
        needed = solution.value if warp else solution.unwarped
        return 1, jnp.where(near <= far, needed, 0) + price * jnp.arange(1, MOST + 1)
    logarithmic(near, far, 1)  # refuses an endless range
    numbers = np.arange(1, MOST + 1)
    if isinstance(view, FrustumView):  # over a whole frustum all pieces need the same: the first, so many times
        of, first, times = numbers, np.zeros(MOST), numbers
    else:
        of, first, times = np.repeat(numbers, numbers), np.concatenate([np.arange(n) for n in numbers]), 1
    even = uniform_at if scene.camera.is_orthographic else even_in_the_logarithm
    starts, ends = (even(near, far, k / of) for k in (first, first + 1))
    needed = []
    for at in range(0, len(starts), _TOGETHER):
        _, solutions = solved_between(scene, starts[at : at + _TOGETHER], ends[at : at + _TOGETHER], _TEXELS)
        needed.append(solutions.value if warp else solutions.unwarped)
    made = _totals(needed, times, of, price)
    return int(np.argmin(np.asarray(made))) + 1, made


@jax.jit
def _totals(needed: list[Array], times: ArrayLike, of: ArrayLike, price: Array) -> Array:
    """Each number's maps together, and their price."""
    together = jax.ops.segment_sum(jnp.concatenate(needed), jnp.asarray(of) - 1, MOST)
    return jnp.asarray(times) * together + price * jnp.arange(1, MOST + 1)


def in_world(view: FrustumView) -> SceneView:
    """The same setting with a camera: looking along -z, with the light in its vertical plane.

    Raises:
        ValueError: several frusta.
    """
    if view.frustum.near.ndim or view.theta.ndim:
        raise ValueError(
            f"view: got shape {jnp.broadcast_shapes(view.frustum.near.shape, view.theta.shape)}, expected one"
        )
    frustum = view.frustum
    camera = Camera((0, 0, 0), (0, 0, -1), (0, 1, 0), frustum.near, frustum.far, frustum.half_fov)
    sine, cosine = jnp.sin(view.theta), jnp.cos(view.theta)
    return SceneView(camera, DirectionalLight(jnp.stack([0 * sine, -sine, -cosine])))
