"""Compares rules for lambda with the optimum and the lower bound, for frusta and scenes."""

from .._checks import refuse_traced
from ..objective import Objective, objective_or_default
from ..solve.optimal_warp import checked_min_eta
from ..views import FrustumView, SceneView, refuse_other
from .comparison import Comparison
from .over_frustum import compare_over_frustum
from .over_scene import compare_over_scene
from .rule_set import Rules, rule_set


def compare_rules(
    view: FrustumView | SceneView,
    rules: Rules = None,
    objective: Objective | None = None,
    *,
    min_eta: float = 1e-4,
) -> Comparison:
    """Compare rules for lambda with the optimum and the lower bound, for several light directions.

    Over a scene, warpopt's rules are applied to the receivers as in their sources (`rules.Body`): n and f are the
    nearest and farthest eye depth (or the camera's near and far plane, where a source uses those), y_min and d the
    start and length of their extent along Z_w, half_fov that of the frustum with the camera's window along the warp.
    User rules, and `tsm_alternative`, whose focus region is a part of V, receive V as (frustum, theta), and their apex
    is kept (`Warp.over`); they are undefined where it is not before the receivers.

    Args:
        view: a `FrustumView` of one frustum and (T,) increasing angles; or a `SceneView` whose light has a leading
            axis, as `jax.vmap(DirectionalLight)` makes it from (T, 3): directions in any order. One angle, or one
            light, is T = 1.
        rules: a name in `warpopt.rules.PUBLISHED` or `ENGINES`, a callable (frustum, theta) -> Warp, a list of these,
            or a dict that names them; every published and engine rule if None. A callable receives theta of shape
            (T,), or, if that raises a TypeError or a ValueError, one angle at a time, which is slower.
        objective: E_p in L-inf if None.
        min_eta: as in `optimal_warp`.

    Returns:
        A `Comparison`, whose arrays are (R, T) for R rules and T directions.

    Raises:
        ValueError: bad arguments, a traced view; a rule that is unknown, raises, or returns no `Warp` of theta's shape
            with eta in (0, 1] (`RuleError`). `solution.result` reports failed solves.

    Rules are formulas of a perspective frustum: with an orthographic camera all but "ssm" are undefined
    (`undefined_because`).

    The bound is None where none is known (`no_bound_because`). For depth buffers and points it is over bins of depth,
    and a warp can be up to 8 % below it. Over a scene `regions` and `peaks` are None.

    Example:
        >>> import math, jax, warpopt
        >>> frustum = warpopt.ViewFrustum(near=1.0, far=100.0, half_fov=math.radians(30.0))
        >>> view = warpopt.FrustumView(frustum, [math.radians(degrees) for degrees in (1.0, 30.0, 60.0, 90.0)])
        >>> comparison = compare_rules(view, ["lispsm", "tsm"])
        >>> worst = comparison.worst("lispsm")
        >>> round(worst.ratio, 2), round(math.degrees(worst.theta), 1)
        (1.79, 30.0)
        >>> [[round(math.degrees(end), 2) for end in ends] for ends in comparison.regions["worse"]["lispsm"]]
        [[1.0, 7.13]]
        >>> camera = warpopt.Camera((0, 2, 0), (0, 0, -1), (0, 1, 0), near=0.1, far=1000.0, half_fov=0.5)
        >>> lights = jax.vmap(warpopt.DirectionalLight)(jax.numpy.array([[0.0, -1.0, 0.0]]))
        >>> box = warpopt.receivers.ConvexBody.box((-20, 0, -80), (20, 2, -5))   # seen from z = 5 to 80
        >>> compare_rules(warpopt.SceneView(camera, lights, box), ["ssm", "lispsm"]).ratio.round(3).tolist()
        [[4.0], [1.0]]
    """
    refuse_other(view)
    refuse_traced("compare_rules", view, min_eta)
    objective, found, least_eta = objective_or_default(objective), rule_set(rules), checked_min_eta(min_eta)
    if isinstance(view, FrustumView):
        return compare_over_frustum(view, found, objective)
    return compare_over_scene(view, found, objective, least_eta)
