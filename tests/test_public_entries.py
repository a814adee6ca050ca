"""Every public entry refuses what is not its own in one sentence; None and lists are taken where they are promised."""

import math
from typing import NamedTuple

import jax
import numpy as np
import pytest

import warpopt
from warpopt import (
    Camera,
    ClipSpace,
    DirectionalLight,
    FrustumView,
    Metric,
    Objective,
    SceneView,
    StableWindow,
    ViewFrustum,
    Warp,
    build_table,
    compare_rules,
    error_norm,
    lower_bound,
    lower_bound_map,
    optimal_warp,
    shadow_matrix,
)
from warpopt.receivers import ConvexBody, DepthBuffer, DepthHistogram, PointReceivers, WholeFrustum
from warpopt.theory import Extent

NAN = math.nan
FRUSTUM = ViewFrustum(1.0, 100.0, 0.5)
VIEW = FrustumView(FRUSTUM, 1.0)
CAMERA = Camera((0, 2, 0), (0, -0.1, -1), (0, 1, 0), 1.0, 100.0, 0.45)
LIGHT = DirectionalLight((0.3, -1, -0.2))
LIGHTS = jax.vmap(DirectionalLight)(np.array([[0.3, -1, -0.2], [0, -1, 0.1]]))
SCENE = SceneView(CAMERA, LIGHT)
SEVERAL = SceneView(CAMERA, LIGHTS)
REDUCED = jax.vmap(lambda light: SceneView(CAMERA, light).reduced())(LIGHTS)
WARP = Warp.from_eta(0.5, Extent(1.0, 99.0))
MANY = Warp.from_eta([0.5, 0.4], Extent(1.0, 99.0))
SOLUTION = optimal_warp(VIEW)
FOUND = optimal_warp(SCENE)


def moved(height):
    """The scene from another height, which may be traced."""
    return SceneView(Camera((0, height, 0), (0, -0.1, -1), (0, 1, 0), 1.0, 100.0, 0.45), LIGHT)


class Case(NamedTuple):
    entry: str
    call: object
    words: str  # how the sentence begins


VERBS = {
    "optimal_warp": optimal_warp,
    "error_norm": lambda view, objective=None: error_norm(view, WARP, objective),
    "lower_bound": lower_bound,
    "lower_bound_map": lower_bound_map,
    "compare_rules": lambda view, objective=None: compare_rules(view, "tsm", objective),
}
CASES = [
    # what is no view
    *(
        Case(f"{name}({type(v).__name__})", lambda verb=verb, v=v: verb(v), f"view: got {type(v).__name__}")
        for name, verb in VERBS.items()
        for v in (FRUSTUM, CAMERA, SOLUTION, WholeFrustum(), None, 1.0)
    ),
    # what is no objective
    *(
        Case(f"{name}(objective={value!r})", lambda verb=verb, value=value: verb(VIEW, value), "objective: got ")
        for name, verb in VERBS.items()
        for value in ("p", Metric(1, 0), math.inf)
    ),
    Case("footprint", lambda: SCENE.footprint("p"), "objective: got 'p'"),
    Case("reduced", lambda: SCENE.reduced("p"), "objective: got 'p'"),
    Case("build_table", lambda: build_table(FRUSTUM, "p"), "objective: got 'p'"),
    # views
    *(
        Case(f"FrustumView({type(v).__name__})", lambda v=v: FrustumView(v, 1.0), f"frustum: got {type(v).__name__}")
        for v in (CAMERA, SOLUTION, FOUND)
    ),
    Case("FrustumView(1.0)", lambda: FrustumView(1.0, 1.0), "frustum: got 1.0, expected a ViewFrustum"),
    Case("FrustumView nan", lambda: FrustumView(FRUSTUM, NAN), "theta: got nan"),
    Case("FrustumView list with nan", lambda: FrustumView(FRUSTUM, [1.0, NAN]), "theta: got nan"),
    Case("FrustumView text", lambda: FrustumView(FRUSTUM, "noon"), "theta: got 'noon'"),
    Case("FrustumView complex", lambda: FrustumView(FRUSTUM, 1j), "theta: got values of type complex"),
    Case("FrustumView shapes", lambda: FrustumView(ViewFrustum(1.0, [9, 9], 0.5), np.ones(3)), "shapes: got theta"),
    Case("SceneView camera", lambda: SceneView(FRUSTUM, LIGHT), "camera: got ViewFrustum"),
    Case("SceneView light", lambda: SceneView(CAMERA, CAMERA), "light: got Camera"),
    Case("SceneView light tuple", lambda: SceneView(CAMERA, (0, -1, 0)), "light: got (0, -1, 0)"),
    *(
        Case(f"receivers {type(v).__name__}", lambda v=v: SceneView(CAMERA, LIGHT, v), f"receivers: got {words}")
        for v, words in (
            (FOUND, "SceneSolution"), (FOUND.footprint, "Footprint"), (np.zeros((9, 3)), "ndarray"), (WARP, "Warp"),
            ("all", "'all'"), (ConvexBody, "<class 'warpopt"),
        )
    ),
    *(
        Case(f"{name}={value!r}", lambda s=s: SceneView(CAMERA, LIGHT, **s), f"{name}: got ")
        for name, other in (("screen", "shadow_map"), ("shadow_map", "screen"))
        for value in (5, (1, 2, 3), (0, 5), (-1, 5), (5, NAN), (math.inf, 5), "big", ("a", "b"), [[1, 2]])
        for s in ({name: value, other: (8, 8)},)
    ),
    Case("screen alone", lambda: SceneView(CAMERA, LIGHT, screen=(8, 8)), "shadow_map: got none with screen"),
    Case("map alone", lambda: SceneView(CAMERA, LIGHT, shadow_map=(8, 8)), "screen: got none with shadow_map"),
    # several of what there is one
    *(
        Case(f"several lights: {name}", call, "light: got shape (2,), expected one")
        for name, call in {
            "optimal_warp": lambda: optimal_warp(SEVERAL), "error_norm": lambda: error_norm(SEVERAL, WARP),
            "lower_bound": lambda: lower_bound(SEVERAL), "shadow_matrix": lambda: shadow_matrix(SEVERAL, WARP),
            "footprint": SEVERAL.footprint, "reduced": SEVERAL.reduced,
        }.items()
    ),
    Case("lights of two axes", lambda: compare_rules(jax.tree.map(lambda v: v[None], SEVERAL), "tsm"),
         "light: got direction of shape (1, 2, 3), expected (3,), or (T, 3)"),
    Case("several reduced views", lambda: compare_rules(REDUCED, "tsm"), "camera: got shape (2,), expected one; call"),
    Case("several reduced views: bound", lambda: lower_bound(REDUCED), "light: got shape (2,), expected one; call it"),
    # what is computed on the host
    *(
        Case(f"traced {name}", lambda call=call: jax.jit(call)(1.0), words)
        for name, call, words in (
            ("lower_bound", lambda v: lower_bound(moved(v)), "lower bound over a scene: got traced values"),
            ("lower_bound_map", lambda v: lower_bound_map(moved(v)).s, "lower bound over a scene: got traced values"),
            ("lower_bound_map over a frustum", lambda v: lower_bound_map(FrustumView(FRUSTUM, v)).s,
             "lower_bound_map: got traced values"),
            ("compare_rules", lambda v: compare_rules(moved(v), "tsm").values, "compare_rules: got traced values"),
            ("compare_rules over a frustum", lambda v: compare_rules(FrustumView(FRUSTUM, v), "tsm").values,
             "compare_rules: got traced values"),
            ("build_table", lambda v: build_table(ViewFrustum(v, 100.0, 0.5)).eta, "build_table: got traced values"),
        )
    ),
    Case("several frusta", lambda: compare_rules(FrustumView(ViewFrustum(1.0, [9, 9], 0.5), [1, 1.1])), "frustum: got"),
    Case("several warps", lambda: shadow_matrix(SCENE, MANY), "warp: got shape (2,), expected one"),
    Case("shapes", lambda: error_norm(FrustumView(FRUSTUM, np.ones(3)), MANY), "shapes: got frustum ()"),
    # warps
    *(
        Case(f"{name}(warp={type(value).__name__})", lambda f=f, v=value: f(v), f"warp: got {words}")
        for name, f in {
            "error_norm": lambda w: error_norm(VIEW, w), "error_norm over a scene": lambda w: error_norm(SCENE, w),
            "shadow_matrix": lambda w: shadow_matrix(SCENE, w),
        }.items()
        for value, words in ((0.5, "0.5"), (np.ones(2), "array([1., 1.])"), (VIEW, "FrustumView"), (None, "None"))
    ),
    *(
        Case(f"Warp.from_eta({eta})", lambda eta=eta: Warp.from_eta(eta, VIEW), "eta: got ")
        for eta in (0.0, -0.5, 1.0000001, NAN, math.inf, [0.5, NAN], "half", "float32", float, None)
    ),
    *(
        Case(f"Warp.from_lam({lam})", lambda lam=lam: Warp.from_lam(lam, VIEW), "lam: got ")
        for lam in (0.0, -1.0, NAN, [1.0, -1.0], "far")
    ),
    *(
        Case(f"body {type(body).__name__}", lambda body=body: Warp.from_eta(0.5, body), words)
        for body, words in (
            (1.0, "body: got float"), (FRUSTUM, "body: got ViewFrustum"), (CAMERA, "body: got Camera"),
            (SCENE, "body: got SceneView"), (None, "body: got NoneType"), (Extent(1.0, 0.0), "mu: got 0.0"),
            (Extent(1.0, NAN), "mu: got nan"), (Extent(NAN, 1.0), "start: got nan"),
        )
    ),
    *(
        Case(f"aliasing_error(eta={eta})", lambda eta=eta: FOUND.aliasing_error(np.ones(3), eta=eta), "eta: got ")
        for eta in (0.0, -1.0, 1.5, NAN)
    ),
    Case("aliasing_error of etas", lambda: FOUND.aliasing_error(np.ones(3), eta=[0.5, 1.0]), "eta: got shape (2,)"),
    *(
        Case(f"from_range_ratio({ratio})", lambda r=ratio: Warp.from_range_ratio(r, VIEW), "ratio: got ")
        for ratio in (-1.0, NAN, math.inf, [1.0, -1.0], "far", None)
    ),
    Case("from_range_ratio defined", lambda: Warp.from_range_ratio(1.0, VIEW, "x"), "defined: got 'x'"),
    *(
        Case(f"{name} of no body", call, "body: got float")
        for name, call in {
            "from_range_ratio": lambda: Warp.from_range_ratio(1.0, 1.0), "over": lambda: WARP.over(1.0),
        }.items()
    ),
    Case("strength", lambda: WARP.strength(1.0), "frustum: got 1.0"),
    Case("endless body", lambda: Warp.from_eta(0.5, Extent(1.0, math.inf)), "mu: got inf"),
    Case("aliasing_error metric", lambda: FOUND.aliasing_error(np.ones(3), "r"), "metric: got 'r'"),
    # options of the solver
    *(
        Case(f"min_eta={value}", lambda verb=verb, v=value: verb(v), "min_eta: got ")
        for verb in (
            lambda v: optimal_warp(SCENE, min_eta=v),
            lambda v: compare_rules(SEVERAL, "tsm", min_eta=v),
            lambda v: compare_rules(VIEW, "tsm", min_eta=v),
        )
        for value in (0.0, 1.0, -1.0, NAN, [0.1, 0.1], "small")
    ),
    Case("method over a scene", lambda: optimal_warp(SCENE, method="iterative"), "method, quadrature_nodes: got"),
    Case("nodes over a scene", lambda: error_norm(SCENE, WARP, quadrature_nodes=8), "quadrature_nodes: got 8"),
    *(
        Case(f"quadrature_nodes={v}", lambda v=v: optimal_warp(VIEW, quadrature_nodes=v), "quadrature_nodes: got")
        for v in (1, 2.5, True, "many")
    ),
    *(
        Case(f"bins={v} {type(view).__name__}", lambda view=view, v=v: lower_bound(view, bins=v), "bins: got")
        for view in (SCENE, VIEW)
        for v in (0, 1.5, True, "many", 10**400)
    ),
    *(
        Case(f"knots={v}", lambda v=v: lower_bound_map(SCENE, knots=v), "knots: got")
        for v in (0, 1.5, True, "many", 10**400, np.eye(2))
    ),
    *(
        Case(f"throw={v!r} {type(view).__name__}", lambda view=view, v=v: optimal_warp(view, throw=v), "throw: got ")
        for view in (SCENE, VIEW)
        for v in ("x", None, 1, np.eye(2))
    ),
    *(
        Case(f"{name} of what cannot be compared", call, f"{name}: got ndarray")
        for name, call in {
            "method": lambda: optimal_warp(VIEW, method=np.eye(2)),
            "handedness": lambda: Camera((0, 0, 0), (0, 0, 1), (0, 1, 0), 1.0, 2.0, 0.5, handedness=np.eye(2)),
            "looks_along": lambda: Camera.from_view_matrix(np.eye(4), 1.0, 2.0, 0.5, looks_along=np.eye(2)),
            "encoding": lambda: DepthBuffer([[1.0]], np.eye(2)), "measure": lambda: Objective("p", "l2", np.eye(2)),
            "language": lambda: warpopt.export_closed_form("p", np.eye(2)),
            "prefix": lambda: warpopt.export_closed_form("p", "c", np.eye(2)),
            "metric": lambda: warpopt.export_closed_form(np.eye(2), "c"),
            "outside": lambda: build_table(FRUSTUM, max_regret=0.05).eta(1.0, outside=np.eye(2)),
            "clip_space": lambda: shadow_matrix(SCENE, WARP, np.eye(2)),
        }.items()
    ),
    Case("max over a frustum", lambda: optimal_warp(VIEW, Objective("max")), "metric: got 'max'"),
    # rules
    *(
        Case(f"rules={rules!r:.20}", lambda view=view, rules=rules: compare_rules(view, rules), "rules: got ")
        for view in (FrustumView(FRUSTUM, [0.5, 1.0]), SEVERAL)
        for rules in (["lispsn"], [3], [], 3, {"mine": 3}, ["tsm", "tsm"], [SOLUTION])
    ),
    # rendering
    *(
        Case(f"padding={v!r}", lambda v=v: shadow_matrix(SCENE, WARP, padding=v), "padding: got ")
        for v in (0.1, (0.5, 0.0), (-0.1, 0.0), (0.1,), (0.1, 0.1, 0.1), (NAN, 0.0), "wide", ("a", "b"))
    ),
    *(
        Case(f"casters={v!r}", lambda v=v: shadow_matrix(SCENE, WARP, casters=v), "casters: got ")
        for v in ([1.0], np.ones((2, 4)), [[NAN, 0, 0]], "all")
    ),
    *(Case(f"clip_space={v!r}", lambda v=v: shadow_matrix(SCENE, WARP, v), "clip_space: got ") for v in ("gl", 3)),
    Case("shadow_matrix of a frustum", lambda: shadow_matrix(VIEW, WARP), "view: got FrustumView"),
    Case("shadow_matrix of a camera", lambda: shadow_matrix(CAMERA, WARP), "view: got Camera"),
    *(
        Case(f"StableWindow(shadow_map={v!r})", lambda v=v: StableWindow(shadow_map=v), "shadow_map: got ")
        for v in (5, (5,), (0, 5), (NAN, 5), "big", ("a", "b"))
    ),
    *(
        Case(f"ClipSpace({name}={v!r})", lambda name=name, v=v: ClipSpace(**{name: v}), f"{name}: got ")
        for name in ("z_zero_to_one", "y_down", "reversed_z", "row_vectors")
        for v in ("x", 1, None)
    ),
    # cameras and points
    *(
        Case(f"window={v!r}", lambda v=v: Camera.off_centre((0, 0, 0), (0, 0, 1), (0, 1, 0), 1.0, 2.0, v), "window: ")
        for v in (None, 1.0, (0, 1, 2), WARP)
    ),
    *(
        Case(f"{name}({v!r})", lambda call=call, v=v: call(v), f"{argument}: got ")
        for name, argument, call in (
            ("to_eye", "points", CAMERA.to_eye), ("aliasing_error", "eye_points", FOUND.aliasing_error),
            ("coordinates", "eye_points", FOUND.coordinates),
        )
        for v in (None, "x", 1j, 1.0, [], [[]], np.ones((2, 2)), 10**400)
    ),
    *(Case(f"integers {v.dtype}", lambda v=v: DepthBuffer(v), f"depth: got integers ({v.dtype}), expected them scaled")
      for v in (np.ones((2, 2), np.uint16), np.ones((2, 2), int), jax.numpy.ones((2, 2), int))),
    Case("integers in a list", lambda: DepthBuffer([[1, 2]]), "depth: got integers"),
    Case("huge near", lambda: ViewFrustum(10**400, 1.0, 0.5), "near: got a huge integer"),
    # objectives
    Case("order beyond all", lambda: Objective(Metric(1e4, 1), 1e305), "norm: got order 1e+305 with Metric"),
    Case("huge order", lambda: Objective("p", 10**400), "norm: got a huge integer"),
    Case("huge exponents", lambda: Metric(1e308, 1e308), "metric: got Metric(alpha=1e+308, beta=1e+308)"),
    Case("huge exponent", lambda: Metric(10**400, 0), "metric: got alpha = a huge integer"),
    *(Case(f"metric={v!r}", lambda v=v: Objective(v), "metric: got ") for v in ("r", 1.0, None, ["p"], Objective())),
    *(Case(f"norm={v!r}", lambda v=v: Objective("p", v), "norm: got ") for v in ("l3", 0.5, NAN, True, [2])),
    *(
        Case(f"measure={v!r}", lambda v=v: Objective("p", "l2", v), "measure: got ")
        for v in ("pixels", None, 2, ["screen"])
    ),
    # tables and sources
    Case("build_table of a camera", lambda: build_table(CAMERA), "frustum: got Camera"),
    Case("build_table of a view", lambda: build_table(VIEW), "frustum: got FrustumView"),
    *(
        Case(f"max_regret={v!r}", lambda v=v: build_table(FRUSTUM, max_regret=v), "max_regret: got ")
        for v in (0.0, -1.0, NAN, "few")
    ),
    *(
        Case(f"{name}={v!r}", lambda name=name, v=v: build_table(FRUSTUM, **{name: v}), f"{name}: got ")
        for name in ("theta_range", "depth_ratio_range", "half_fov_range")
        for v in ((1.0,), (1.3, 1.2), (NAN, 1.2), 1.0, "all")
    ),
    Case("export_source", lambda: warpopt.export_source(SOLUTION, "c"), "table: got Solution"),
    Case("export_closed_form", lambda: warpopt.export_closed_form("p", "cobol"), "language: got 'cobol'"),
    Case("export_closed_form metric", lambda: warpopt.export_closed_form("max", "c"), "metric: got 'max'"),
    # AT09's functions and rules, which take a frustum
    Case("aliasing_error", lambda: warpopt.theory.aliasing_error(CAMERA, 1.0, WARP, 0.0, 2.0), "frustum: got Camera"),
    Case("aliasing_error warp", lambda: warpopt.theory.aliasing_error(FRUSTUM, 1.0, 0.5, 0.0, 2.0), "warp: got 0.5"),
    Case("rules.tsm", lambda: warpopt.rules.tsm(None, 1.0), "frustum: got None"),
    Case("rules.tsm kappa", lambda: warpopt.rules.tsm(FRUSTUM, 1.0, "x"), "kappa: got 'x'"),
    Case("LightSpace", lambda: warpopt.theory.LightSpace(None, 1.0), "frustum: got None"),
    Case("LightFrame", lambda: warpopt.theory.LightFrame(FRUSTUM, LIGHT), "camera: got ViewFrustum"),
    Case("LightFrame light", lambda: warpopt.theory.LightFrame(CAMERA, CAMERA), "light: got Camera"),
    *(
        Case(name, call, words)
        for name, call, words in (
            ("aliasing_error y", lambda: warpopt.theory.aliasing_error(FRUSTUM, 1.0, WARP, "x", 2.0), "y: got 'x'"),
            ("local z", lambda: warpopt.theory.local_aliasing_error(FRUSTUM, WARP, "x"), "z: got 'x'"),
            ("local warp", lambda: warpopt.theory.local_aliasing_error(FRUSTUM, 0.5, 2.0), "warp: got 0.5"),
            ("screen", lambda: warpopt.theory.screen_coordinates(CAMERA, 0.0, 0.0, 1.0), "frustum: got Camera"),
            ("BoundMap", lambda: lower_bound_map(VIEW)("x"), "delta: got 'x'"),
            ("BoundMap.load", lambda: warpopt.BoundMap.load(5), "path: got 5"),
            ("LambdaTable.load", lambda: warpopt.LambdaTable.load(None), "path: got None"),
            ("BoundMap.save", lambda: lower_bound_map(VIEW).save(5), "path: got 5"),
        )
    ),
    Case("rules.lispsm", lambda: warpopt.rules.lispsm(CAMERA, 1.0), "frustum: got Camera"),
]  # fmt: skip


@pytest.mark.parametrize("case", CASES, ids=lambda case: case.entry)
def test_what_is_not_its_own_is_refused_in_one_sentence(case):
    """A ValueError that names the argument, what was got and what was expected, on one line that can be read.

    Killed: a check that is left out, an AttributeError or TypeError from within, a page of a pytree's fields.
    """
    with pytest.raises(ValueError) as error:  # noqa: PT011, the words are checked below
        case.call()
    words = str(error.value)
    assert words.startswith(case.words)
    assert "expected " in words
    assert "\n" not in words
    assert len(words) < 400


def test_one_light_or_angle_is_a_list_of_one():
    """Killed: a refusal, another number, a missing axis."""
    one = SceneView(CAMERA, jax.tree.map(lambda v: v[:1], LIGHTS))
    for single, listed in ((SCENE, one), (VIEW, FrustumView(FRUSTUM, [1.0]))):
        got, expected = (compare_rules(view, ["psm", "tsm"]) for view in (single, listed))
        assert got.values.shape == (2, 1)
        for name in ("theta", "values", "unwarped", "bound", "eta", "ratio"):
            np.testing.assert_array_equal(getattr(got, name), getattr(expected, name))


def test_an_overflow_of_the_norm_is_told_with_the_other_reasons():
    with pytest.raises(RuntimeError, match=r"an order so large that it overflows"):
        optimal_warp(VIEW, Objective(Metric(1e4, 1)))


def test_traced_numbers_may_stand_in_a_tuple():
    """Killed: `np.asarray` of what is traced, and a message that says it is no number."""
    got = jax.jit(lambda height: optimal_warp(moved(height), throw=False).value)(2.0)
    np.testing.assert_allclose(got, FOUND.value, rtol=1e-13)


def test_nothing_said_of_receivers_is_the_whole_frustum():
    views = [SceneView(CAMERA, LIGHT), SceneView(CAMERA, LIGHT, None), SceneView(CAMERA, LIGHT, WholeFrustum())]
    assert len({float(optimal_warp(view).value) for view in views}) == 1
    assert len({lower_bound(view) for view in views}) == 1
    several = [compare_rules(SceneView(CAMERA, LIGHTS, receivers), "psm") for receivers in (None, WholeFrustum())]
    np.testing.assert_array_equal(several[0].values, several[1].values)


def test_no_objective_is_e_p_in_l_inf():
    theta = np.array([0.4, 1.0])
    view = FrustumView(FRUSTUM, theta)
    for verb in (
        lambda o: optimal_warp(view, o).value,
        lambda o: error_norm(view, WARP, o),
        lambda o: lower_bound(view, o),
        lambda o: lower_bound_map(VIEW, o).s,
        lambda o: compare_rules(view, "psm", o).values,
        lambda o: optimal_warp(SCENE, o).value,
        lambda o: SCENE.footprint(o).start,
    ):
        np.testing.assert_array_equal(verb(None), verb(Objective("p", "inf", "screen")))


def test_a_solution_is_a_warp():
    np.testing.assert_array_equal(error_norm(VIEW, SOLUTION), error_norm(VIEW, SOLUTION.warp))
    np.testing.assert_array_equal(error_norm(SCENE, FOUND), error_norm(SCENE, FOUND.warp))
    np.testing.assert_array_equal(shadow_matrix(SCENE, FOUND), shadow_matrix(SCENE, FOUND.warp))


def test_lists_are_taken_where_tuples_are():
    """Killed: `isinstance(value, tuple)`, and options that a compiled program would have to hash."""
    assert optimal_warp(FrustumView(ViewFrustum([1.0], [100.0], [0.5]), [0.3, 1.0])).value.shape == (2,)
    camera = Camera([0, 2, 0], [0, -0.1, -1], [0, 1, 0], 1.0, 100.0, 0.45)
    np.testing.assert_array_equal(camera.rotation, CAMERA.rotation)
    window = np.asarray(CAMERA.window).tolist()
    off = Camera.off_centre([0, 2, 0], [0, -0.1, -1], [0, 1, 0], 1.0, 100.0, window)
    np.testing.assert_allclose(off.window, CAMERA.window, rtol=1e-15)
    light = DirectionalLight([0.3, -1, -0.2])
    listed = SceneView(camera, light, screen=[1920, 1080], shadow_map=[512, 256])
    as_tuples = SceneView(CAMERA, LIGHT, screen=(1920, 1080), shadow_map=(512, 256))
    np.testing.assert_array_equal(optimal_warp(listed).value, optimal_warp(as_tuples).value)
    casters = [[0.0, 9.0, -20.0]]
    one = shadow_matrix(listed, FOUND, casters=casters, padding=[0.01, 0.02])
    other = shadow_matrix(as_tuples, FOUND, casters=np.array(casters), padding=(0.01, 0.02))
    np.testing.assert_array_equal(one, other)
    box, same = ConvexBody.box([-1, -1, -9], [1, 1, -3]), ConvexBody.box((-1, -1, -9), (1, 1, -3))
    np.testing.assert_array_equal(box.planes, same.planes)
    assert PointReceivers([[0, 0, -5.0]], [1]).points.shape == (1, 3)
    assert DepthBuffer([[1.0, 2.0]]).depth.shape == (1, 2)
    assert DepthHistogram([1, 2, 3], [1, 0]).counts.shape == (2,)
    assert Warp.from_eta([0.5, 1.0], Extent(1.0, 9.0)).eta.shape == (2,)
    table = build_table(FRUSTUM, max_regret=0.05, theta_range=[0.8, 1.5])
    assert float(table.theta[0, 0, 0]) == pytest.approx(0.8)
    assert compare_rules(FrustumView(FRUSTUM, [0.5, 1.0]), ("psm", "tsm")).names == ("psm", "tsm")
