"""The axes of a map without a warp, under a light next to the view's direction."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import warpopt
from warpopt import Camera, DirectionalLight, Outcome, SceneView, Warp, error_norm, optimal_warp

CAMERA = Camera((0, 0, 0), (0, 0, -1), (0, 1, 0), 1.0, 100.0, np.pi / 6, 1.6)


def view_of(theta, phi=0.0, direction="steady"):
    """A light at theta to the view, that leans to the screen's right turned by phi."""
    light = np.array([np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), -np.cos(theta)])
    return SceneView(CAMERA, DirectionalLight(light), warp_direction=direction)


def test_the_error_does_not_jump_as_the_light_leaves_the_views_direction():
    """f tan(phi) 2/(n tan(phi)): 200 along the columns, 320 along the rows, whichever way the light leans."""
    before = None
    for theta in (0.0, 1e-9, 1e-6, 1e-4, 1e-3):
        for phi in (0.0, 0.7, np.pi / 2):
            solution = optimal_warp(view_of(theta, phi), previous=before)
            assert Outcome(int(solution.result)) == Outcome.no_warp
            assert float(solution.value) == pytest.approx(200, rel=0.1 * theta + 1e-9 + 2 * theta * 100)
            matrix = np.asarray(warpopt.shadow_matrix(view_of(theta, phi), solution))
            if before is not None:
                turned = np.abs(np.asarray(solution.direction) @ np.asarray(before.direction))
                assert turned > 1 - 1e-4
            assert np.isfinite(matrix).all()
            before = solution
    assert float(optimal_warp(view_of(1e-6, direction="view")).value) == pytest.approx(320, rel=1e-3)


def test_a_warp_is_used_as_soon_as_its_error_is_less():
    """The value is the smaller one of both, and continuous; along the view it is `optimal_warp`'s own."""
    values = []
    for theta in np.linspace(0.02, 0.55, 20):
        view = view_of(theta)
        solution = optimal_warp(view)
        own = optimal_warp(view_of(theta, direction="view"))
        assert float(solution.value) <= float(own.value) * (1 + 1e-12)
        assert float(solution.unturned) == pytest.approx(float(own.value), rel=1e-12)
        if float(solution.warp.eta) < 1:
            np.testing.assert_allclose(solution.direction, own.direction, atol=1e-12)
        turned = view.along(solution)
        warp = Warp.from_eta(solution.warp.eta, turned.footprint())
        assert float(error_norm(turned, warp)) == pytest.approx(float(solution.value), rel=1e-9)
        values.append(float(solution.value))
    assert np.abs(np.diff(np.log(values))).max() < 0.25
    assert float(solution.warp.eta) < 1


def test_the_frame_before_breaks_ties():
    """A square screen: rows and columns are as good; what was is kept, and derivatives are finite."""
    camera = Camera((0, 0, 0), (0, 0, -1), (0, 1, 0), 1.0, 100.0, np.pi / 6)
    light = DirectionalLight((1e-5, 3e-6, -1))
    view = SceneView(camera, light, warp_direction="steady")
    before = optimal_warp(view)
    for axis in ((0, -1, 0), (1, 0, 0)):
        before = eqx.tree_at(lambda s: s.direction, before, jnp.array(axis, float))
        kept = optimal_warp(view, previous=before)
        assert abs(float(kept.direction @ before.direction)) > 1 - 1e-9

    def value(direction):
        view = SceneView(camera, DirectionalLight(direction), warp_direction="steady")
        return optimal_warp(view, throw=False).value

    assert np.isfinite(jax.grad(value)(np.array([1e-5, 0.0, -1.0]))).all()
    for seen, bad in ((SceneView(camera, light), before), (view, 3)):
        with pytest.raises(ValueError, match="previous: got"):
            optimal_warp(seen, previous=bad)
    with pytest.raises(ValueError, match="warp_direction: got 'steady', which optimal_warp finds"):
        view.frame()
