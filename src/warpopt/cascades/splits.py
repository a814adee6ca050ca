"""Where cascades are split: published schemes and engines' defaults, as arrays of count + 1 depths from near to far."""

import functools
from collections.abc import Sequence

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Float

from .._checks import Numbers, checked, float_arrays
from .._words import whole_number

MOST = 16
"""The largest number of cascades."""
_DEPTHS = "finite, positive, non-decreasing depths"


def uniform(near: Numbers, far: Numbers, count: int) -> Float[Array, "... K1"]:
    """Equal lengths.

    Args:
        near, far, count: 0 < near < far < inf, of any shape; 1 to 16 cascades.

    Returns:
        (..., count + 1) depths from near to far.

    Raises:
        ValueError: arguments out of range.

    Example:
        >>> uniform(1.0, 9.0, 4).tolist()
        [1.0, 3.0, 5.0, 7.0, 9.0]
    """
    return uniform_at(*_checked(near, far, count))


# The formulas below are compiled as a whole: op by op each takes ten times as long at its first call.


@jax.jit
def uniform_at(near: Float[Array, "..."], far: Float[Array, "..."], shares: Numbers) -> Float[Array, "... K"]:
    """The depths at shares, (K,), of the way from near to far, in length."""
    near, far, shares = _along(near, far, shares)
    return jnp.where(shares == 1, far, near + (far - near) * shares)  # its very end, without rounding


def logarithmic(near: Numbers, far: Numbers, count: int) -> Float[Array, "... K1"]:
    """Equal ratios: optimal over a whole frustum in L-inf, for every light, metric and warp (docs/cascades.md).

    Args:
        near, far, count: 0 < near < far < inf, of any shape; 1 to 16 cascades.

    Returns:
        (..., count + 1) depths from near to far.

    Raises:
        ValueError: arguments out of range.

    Example:
        >>> [round(float(z), 9) for z in logarithmic(1.0, 16.0, 4)]
        [1.0, 2.0, 4.0, 8.0, 16.0]
    """
    return even_in_the_logarithm(*_checked(near, far, count))


@jax.jit
def even_in_the_logarithm(
    near: Float[Array, "..."], far: Float[Array, "..."], shares: Numbers
) -> Float[Array, "... K"]:
    """The depths at shares, (K,), of the way from near to far, in ratio."""
    near, far, shares = _along(near, far, shares)
    return jnp.where(shares == 1, far, near * jnp.exp(jnp.log1p((far - near) / near) * shares))


def _along(near: Array, far: Array, shares: Numbers) -> tuple[Array, Array, Array]:
    return near[..., None], far[..., None], jnp.asarray(shares, near.dtype)


def practical(near: Numbers, far: Numbers, count: int, weight: float = 0.5) -> Float[Array, "... K1"]:
    """`weight` times the logarithmic split plus the rest of the uniform one (Zhang and others 2006).

    Args:
        near, far, count: 0 < near < far < inf, of any shape; 1 to 16 cascades.
        weight: in [0, 1].

    Returns:
        (..., count + 1) depths from near to far.

    Raises:
        ValueError: arguments out of range.

    Example:
        >>> [round(float(z), 6) for z in practical(1.0, 9.0, 2)]
        [1.0, 4.0, 9.0]
    """
    (value,) = float_arrays(weight=weight)
    value = checked("weight", value, lambda v: (v >= 0) & (v <= 1), "a number in [0, 1]")
    return _practical(*_checked(near, far, count), value)


@jax.jit
def _practical(near: Array, far: Array, shares: ArrayLike, weight: ArrayLike) -> Array:
    return weight * even_in_the_logarithm(near, far, shares) + (1 - weight) * uniform_at(near, far, shares)


def fractions(near: Numbers, far: Numbers, shares: Sequence[float]) -> Float[Array, "... K1"]:
    """Fractions of the far distance, from the eye, where cascades end; the last one ends at far.

    Args:
        near, far: as for `uniform`.
        shares: increasing, in (0, 1).

    Returns:
        (..., len(shares) + 2) depths from near to far.

    Raises:
        ValueError: near or far out of range; shares not in (0, 1) or not increasing; a first end not beyond near.

    Example:
        >>> fractions(0.1, 100.0, (0.1, 0.2, 0.5)).tolist()
        [0.1, 10.0, 20.0, 50.0, 100.0]
    """
    near, far, _ = _checked(near, far, len(shares) + 1)
    (values,) = float_arrays(shares=list(shares))
    values = checked("shares", values, lambda v: (v > 0) & (v < 1), "numbers in (0, 1)")
    words = "fractions that increase, and a first end beyond near"
    return checked("shares", _of_far(near, far, values), lambda z: _rising(z, True), words)


@jax.jit
def _of_far(near: Array, far: Array, shares: Array) -> Array:
    near, far, shares = _along(near, far, shares)
    return jnp.concatenate([near, far * shares, far], -1)


def stepped(splits: Numbers, step: float = 1.1, previous: Numbers | None = None) -> Float[Array, "... K1"]:
    """Splits at powers of `step`, so that they move seldom: the first down, the last up, others to the nearest.

    Args:
        splits: (..., K + 1), non-decreasing.
        step: > 1.
        previous: the last frame's result. A split stays there until it is a whole step away, the first and the last
            until they no longer cover the range, or are two steps away: one at the border between two steps does not
            move to and fro.

    Returns:
        (..., K + 1) depths.

    Raises:
        ValueError: a step that is not above 1, splits that fall or are not positive, or another number of them before.

    Example:
        >>> [round(float(z), 3) for z in stepped([1.05, 9.8, 100.2], 2.0)]
        [1.0, 8.0, 128.0]
        >>> [round(float(z), 3) for z in stepped([1.05, 12.1, 63.0], 2.0, previous=[1.0, 8.0, 128.0])]
        [1.0, 8.0, 128.0]
    """
    splits, value = float_arrays(splits=splits, step=step)
    value = checked("step", value, lambda v: (v > 1) & (v < jnp.inf), "a number > 1")
    splits = checked("splits", splits, lambda z: (z > 0) & (z < jnp.inf) & _rising(z), _DEPTHS)
    if previous is None:
        return _stepped(splits, value, None)
    (before,) = float_arrays(previous=previous)
    if before.shape != splits.shape:
        raise ValueError(f"previous: got shape {before.shape}, expected {splits.shape}")
    return _stepped(splits, value, checked("previous", before, lambda z: (z > 0) & (z < jnp.inf), "positive depths"))


@jax.jit
def _stepped(splits: Array, step: Array, previous: Array | None) -> Array:
    place = jnp.log(splits) / jnp.log(step)
    slack = 1e-6  # a split at a power of the step stays there
    whole = jnp.round(place).at[..., 0].set(jnp.floor(place[..., 0] + slack))
    whole = whole.at[..., -1].set(jnp.ceil(place[..., -1] - slack))
    if previous is not None:
        before = jnp.round(jnp.log(previous) / jnp.log(step)).astype(place.dtype)
        off = place - before
        stays = (jnp.abs(off) < 1).at[..., 0].set((off[..., 0] > -slack) & (off[..., 0] < 2))
        stays = stays.at[..., -1].set((off[..., -1] < slack) & (off[..., -1] > -2))
        whole = jnp.where(stays, before, whole)
    return step**whole


def checked_splits(splits: Numbers, one: bool) -> Float[Array, "... K1"]:
    """The depths of any split; `one`: of a single chain, for a scene.

    Raises:
        ValueError: another shape, or depths that are not finite and positive, or that fall.
    """
    (made,) = float_arrays(splits=splits)
    if made.ndim < 1 or not 2 <= made.shape[-1] <= MOST + 1:
        raise ValueError(f"splits: got shape {made.shape}, expected (..., K + 1) with K from 1 to {MOST}")
    if one and made.ndim != 1:
        raise ValueError(f"splits: got shape {made.shape}, expected (K + 1,) over a scene: one call for each")
    return checked("splits", made, lambda z: (z > 0) & (z < jnp.inf) & _rising(z), _DEPTHS)


def godot(near: Numbers, far: Numbers, count: int = 4) -> Float[Array, "... K1"]:
    """Godot 4's defaults: 0.1, 0.2 and 0.5 of the way from near to far, with two cascades 0.1.

    `directional_shadow_split_1` to `_3` and their values: scene/3d/light_3d.cpp at commit 8ea4ec9531e3; that they are
    of the range between the camera's near plane and `directional_shadow_max_distance`:
    servers/rendering/renderer_scene_cull.cpp at 0001ea78a2d5.

    Args:
        near, far, count: 0 < near < far < inf, of any shape; 1, 2 or 4 cascades.

    Returns:
        (..., count + 1) depths from near to far.

    Raises:
        ValueError: arguments out of range.

    Example:
        >>> [round(float(z), 3) for z in godot(0.05, 100.0)]
        [0.05, 10.045, 20.04, 50.025, 100.0]
    """
    return _on_the_way(near, far, _menu("godot", count, {1: (), 2: (0.1,), 4: (0.1, 0.2, 0.5)}))


def unity(near: Numbers, far: Numbers, count: int = 4) -> Float[Array, "... K1"]:
    """Unity's universal pipeline: 0.067, 0.2 and 0.467 of the shadow distance; with three 0.1 and 0.3, with two 0.25.

    Values: Packages/com.unity.render-pipelines.universal/Runtime/Data/UniversalRenderPipelineAsset.cs at commit
    2aa675fe9472. What they are fractions of is decided in the engine, whose source is not public: by documentation
    (page QualitySettings.shadowCascade4Split) positions "with respect to zero", here fractions of far from the eye.

    Args:
        near, far, count: 0 < near < far < inf, of any shape; 1 to 4 cascades.

    Returns:
        (..., count + 1) depths from near to far.

    Raises:
        ValueError: arguments out of range.

    Example:
        >>> [round(float(z), 2) for z in unity(0.3, 150.0)]
        [0.3, 10.05, 30.0, 70.05, 150.0]
    """
    return fractions(near, far, _menu("unity", count, {1: (), 2: (0.25,), 3: (0.1, 0.3), 4: (0.067, 0.2, 0.467)}))


def unreal(near: Numbers, far: Numbers, count: int = 3, exponent: float = 3.0) -> Float[Array, "... K1"]:
    """Unreal's distribution exponent: lengths in geometric progression, each `exponent` times the one before.

    By repute: the source is not public, and the documentation (page UDirectionalLightComponent, member
    CascadeDistributionExponent) says only that a larger exponent brings cascades nearer to the camera.

    Args:
        near, far, count: 0 < near < far < inf, of any shape; 1 to 16 cascades.
        exponent: >= 1.

    Returns:
        (..., count + 1) depths from near to far.

    Raises:
        ValueError: arguments out of range.

    Example:
        >>> [round(float(z), 2) for z in unreal(0.1, 200.0)]
        [0.1, 15.48, 61.61, 200.0]
    """
    near, far, _ = _checked(near, far, count)
    (value,) = float_arrays(exponent=exponent)
    value = checked("exponent", value, lambda v: (v >= 1) & (v < jnp.inf), "a number >= 1")
    return _geometric(near, far, value, count)


@functools.partial(jax.jit, static_argnames="count")
def _geometric(near: Array, far: Array, exponent: Array, count: int) -> Array:
    lengths = exponent ** jnp.arange(count, dtype=near.dtype)
    ends = jnp.cumsum(lengths) / lengths.sum()
    return uniform_at(near, far, jnp.concatenate([jnp.zeros_like(ends[:1]), ends[:-1], jnp.ones_like(ends[:1])]))


def bevy(near: Numbers, far: Numbers, count: int = 4, first: float = 10.0) -> Float[Array, "... K1"]:
    """Bevy's: the first cascade ends at `first`, equal ratios beyond.

    crates/bevy_light/src/cascade.rs at commit 0876f40af54b. Its cascades overlap by a fifth of their near distance by
    default: `overlap` of `cascades.plan`.

    Args:
        near, far, count: 0 < near < far < inf, of any shape; 1 to 16 cascades.
        first: near < first < far; without effect with one cascade.

    Returns:
        (..., count + 1) depths from near to far.

    Raises:
        ValueError: arguments out of range.

    Example:
        >>> [round(float(z), 2) for z in bevy(0.1, 150.0)]
        [0.1, 10.0, 24.66, 60.82, 150.0]
    """
    near, far, shares = _checked(near, far, count)
    if count == 1:
        return uniform_at(near, far, shares)
    (end,) = float_arrays(first=first)
    end = checked(
        "first", jnp.broadcast_to(end, near.shape), lambda v, n, f: (v > n) & (v < f),
        "a number between near and far", near, far,
    )  # fmt: skip
    return _from_first(near, end, far, np.arange(count) / (count - 1))


@jax.jit
def _from_first(near: Array, first: Array, far: Array, shares: ArrayLike) -> Array:
    return jnp.concatenate([near[..., None], even_in_the_logarithm(first, far, shares)], -1)


def three(near: Numbers, far: Numbers, count: int = 3) -> Float[Array, "... K1"]:
    """three.js's CSM: the practical split z with 0.5, each map cut at z / far of the way from near to far.

    z and its division by far (`maxFar`, if that is nearer): examples/jsm/csm/CSM.js at commit 014d454ba21d; where maps
    are cut: CSMFrustum.js at 0255e15dd1d4. Its shader goes to the next map a near distance earlier, at z (1 - near/far)
    (CSMShader.js at 121f4071c053).

    Args:
        near, far, count: 0 < near < far < inf, of any shape; 1 to 16 cascades.

    Returns:
        (..., count + 1) depths from near to far.

    Raises:
        ValueError: arguments out of range.

    Example:
        >>> [round(float(z), 2) for z in three(0.1, 1000.0)]
        [0.1, 167.86, 356.62, 1000.0]
    """
    return _cut_on_the_way(*_checked(near, far, count))


@jax.jit
def _cut_on_the_way(near: Array, far: Array, shares: ArrayLike) -> Array:
    z = _practical(near, far, shares, 0.5)
    return z.at[..., 1:-1].add(near[..., None] * (1 - z[..., 1:-1] / far[..., None]))


def filament(near: Numbers, far: Numbers, count: int = 4) -> Float[Array, "... K1"]:
    """Filament's `cascadeSplitPositions`: 1/8, 1/4 and 1/2 of the way from near to far; with fewer the first of them.

    Values: LightManager.java of filament-android at commit c35a60808c9b (quarters before pull request 6130); what they
    are fractions of: filament/src/ShadowMapManager.cpp at cb91a23a03f6, where the range is that of what is seen, or
    with `stable` the camera's.

    Args:
        near, far, count: 0 < near < far < inf, of any shape; 1 to 4 cascades.

    Returns:
        (..., count + 1) depths from near to far.

    Raises:
        ValueError: arguments out of range.

    Example:
        >>> filament(1.0, 9.0).tolist()
        [1.0, 2.0, 3.0, 5.0, 9.0]
    """
    return _on_the_way(near, far, _menu("filament", count, {k + 1: (0.125, 0.25, 0.5)[:k] for k in range(4)}))


ENGINES = {"godot": godot, "unity": unity, "unreal": unreal, "bevy": bevy, "three": three, "filament": filament}
SCHEMES = {"uniform": uniform, "logarithmic": logarithmic, "practical": practical}


def _menu(name: str, count: int, menu: dict[int, tuple[float, ...]]) -> tuple[float, ...]:
    if count not in menu:
        raise ValueError(f"count: got {count!r} with {name}, expected {', '.join(map(str, menu))}")
    return menu[count]


def _on_the_way(near: Numbers, far: Numbers, shares: tuple[float, ...]) -> Array:
    """Shares of the way from near to far."""
    near, far, _ = _checked(near, far, len(shares) + 1)
    return uniform_at(near, far, np.array((0, *shares, 1)))


def _checked(near: Numbers, far: Numbers, count: int) -> tuple[Array, Array, np.ndarray]:
    """(near, far, equal shares of the way between them)."""
    whole_number("count", count, 1, MOST)
    near, far = float_arrays(near=near, far=far)
    if near.shape != far.shape:
        near, far = jnp.broadcast_arrays(near, far)
    near = checked("near", near, lambda v: (v > 0) & (v < jnp.inf), "a finite number > 0")
    far = checked(
        "far", far, lambda v, n: (v > n) & (v < jnp.inf),
        "a finite number > near: without a far plane split the receivers' range", near,
    )  # fmt: skip
    return near, far, np.arange(count + 1) / count


@functools.partial(jax.jit, static_argnames="strictly")
def _rising(z: Array, strictly: bool = False) -> Array:
    rises = z[..., 1:] > z[..., :-1] if strictly else z[..., 1:] >= z[..., :-1]
    return jnp.concatenate([jnp.ones_like(z[..., :1], bool), rises], -1)
