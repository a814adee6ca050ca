"""The aliasing errors three ways, the texture coordinates, and the light space, against raw geometry."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import scenes
import twin
from twin import mpf

import warpopt

EPS = np.finfo(np.float64).eps
FRUSTUM, THETA = scenes.batch()
VIEW = warpopt.FrustumView(FRUSTUM, THETA)
LAM_OVER_MU = (1e-4, 0.03, 0.6, 40.0)
U, DEPTH_FRACTION = (0.0, 0.3, 0.5, 0.9, 1.0), (0.0, 0.2, 0.7, 1.0)


def random_views(count: int, seed: int):
    """Scenes for the paper's own form: theta in [0.05, pi/2 - 0.05], f/n up to 1e4, lambda >= n a, points inside V."""
    rng = np.random.default_rng(seed)
    near = 10 ** rng.uniform(-3, 3, count)
    far = near * (1 + 10 ** rng.uniform(-1, np.log10(9999), count))
    half_fov, theta = rng.uniform(0.05, 1.3, count), rng.uniform(0.05, np.pi / 2 - 0.05, count)
    a = np.sin(theta) - np.tan(half_fov) * np.cos(theta)
    b = np.sin(theta) + np.tan(half_fov) * np.cos(theta)
    mu = np.where(a > 0, far * b - near * a, 2 * far * np.tan(half_fov) * np.cos(theta))
    lam = near * np.maximum(a, 0) + mu * 10 ** rng.uniform(-4, 2, count)
    z = near * (far / near) ** rng.uniform(0, 1, count)
    x, y = (z * np.tan(half_fov) * rng.uniform(-1, 0.98, count) for _ in range(2))  # not on the upper plane itself
    return near, far, half_fov, theta, lam, mu, x, y, z


def paper_form(scene: "twin.Scene", phi, theta, lam, y, z):
    """AT09's F and G with three corrections: sin^3 in F_p above phi, a cosine in F_p below, F_q's corner kept.

    In 60 digits, because z + G cancels near the upper plane.
    """
    n, f, T, s, c = scene.near, scene.far, scene.tan_phi, scene.sin, scene.cos
    t = T * c / s
    span = f - n + (f + n) * t
    if theta >= phi:
        g = lam / s - n + n * t - y * c / s
        f_p = s**3 * span / (T * lam * (lam + span * s))
        f_q = 2 * f * s / (lam + (f - n) * (1 - t) * s)
    else:
        g = lam / s - f + f * t - y * c / s
        f_p = 2 * f * s**2 * c / (lam * (lam + 2 * f * T * c))
        f_q = 2 * f * s / lam
    return f_p * (z + g) ** 2 / z, f_q * (z + g) / z


def test_errors_equal_the_papers_corrected_form():
    """Points not on the upper plane itself (there, (y, z) costs eps / eta), to 1e-12."""
    n, f, phi, theta, _, mu, _, y, z = random_views(200, 2)
    eta = np.random.default_rng(3).uniform(0.05, 0.99, 200)
    a = np.maximum(np.sin(theta) - np.tan(phi) * np.cos(theta), 0)
    eta = np.maximum(eta, 1.01 * n * a / (n * a + mu))  # lambda >= n a, where the paper's F_q contains V
    frustum = warpopt.ViewFrustum(n, f, phi)
    warp = warpopt.Warp.from_eta(eta, warpopt.FrustumView(frustum, theta))
    got = [np.asarray(warpopt.theory.aliasing_error(frustum, theta, warp, y, z, metric)) for metric in ("p", "q")]
    for i in range(200):
        scene = twin.Scene(n[i], f[i], phi[i], theta[i])
        lam = scene.lam(mpf(float(eta[i])))
        expected = paper_form(scene, phi[i], theta[i], lam, mpf(float(y[i])), mpf(float(z[i])))
        for value, exact in zip(got, expected, strict=True):
            assert abs(float(value[i] / exact - 1)) < 1e-12


@pytest.mark.parametrize("name", ["p", "q", "pxq"])
def test_errors_equal_raw_geometry_everywhere(name):
    """Against the twin, on every side plane and at every end, to 40 eps (twenty roundings, exponents up to 3)."""
    alpha, beta = {"p": (1, 0), "q": (0, 1), "pxq": (1, 1)}[name]
    u, fraction, ratio = (v.ravel() for v in np.meshgrid(U, DEPTH_FRACTION, LAM_OVER_MU, indexing="ij"))
    u, fraction, ratio = u[:, None], fraction[:, None], ratio[:, None]
    z = FRUSTUM.near * (1 - fraction) + FRUSTUM.far * fraction
    warp = warpopt.Warp.from_range_ratio(jnp.asarray(1 / ratio), VIEW)
    got = np.asarray(warpopt.theory.aliasing_error_uz(FRUSTUM, THETA, warp, u, z, name))
    for j, (scene, theta) in enumerate(zip(scenes.twins(), THETA, strict=True)):
        side = 1 if theta <= np.pi / 2 else -1
        for i in range(len(u)):
            exact_z = mpf(float(z[i, j]))
            y = side * (1 - 2 * mpf(float(u[i, 0]))) * exact_z * scene.tan_phi
            lam = scene.lam(mpf(float(warp.eta[i, 0])))
            assert abs(float(got[i, j] / scene.error(alpha, beta, lam, y, exact_z) - 1)) < 40 * EPS, scenes.TAGS[j]


def test_no_warp_is_the_limit_of_large_lambda():
    warp = warpopt.rules.ssm(FRUSTUM, THETA)
    z = 0.3 * FRUSTUM.near + 0.7 * FRUSTUM.far
    for name, exponents in {"p": (1, 0), "q": (0, 1), "pxq": (1, 1)}.items():
        got = warpopt.theory.aliasing_error(FRUSTUM, THETA, warp, 0.1 * z * np.tan(FRUSTUM.half_fov), z, name)
        exact = [s.no_warp_error(*exponents, mpf(float(at))) for s, at in zip(scenes.twins(), z, strict=True)]
        np.testing.assert_allclose(got, [float(e) for e in exact], rtol=16 * EPS)


def test_the_errors_are_derivatives_along_lines():
    """The definition: |dq/dt| and |dp/ds| along x = kx z - bx, y = ky z - by, by autodiff, are E^pers E^proj."""
    n, f, phi, theta, lam, mu, x, y, z = random_views(300, 4)
    rng = np.random.default_rng(5)
    kx, ky = rng.uniform(-3, 3, (2, 300))
    frustum = warpopt.ViewFrustum(n, f, phi)
    warp = warpopt.Warp.from_lam(lam, warpopt.FrustumView(frustum, theta))

    def along(depth):
        at_x, at_y = kx * (depth - z) + x, ky * (depth - z) + y
        return (
            warpopt.theory.screen_coordinates(frustum, at_x, at_y, depth),
            warpopt.theory.texture_coordinates(frustum, theta, warp, at_x, at_y, depth),
        )

    _, ((dq, dp), (dt, ds)) = jax.jvp(along, (jnp.asarray(z),), (jnp.ones(300),))
    proj_q, proj_p = warpopt.theory.projection_factors(frustum, theta, warp, x, y, z, kx, ky)
    e_q, e_p = (warpopt.theory.aliasing_error(frustum, theta, warp, y, z, metric) for metric in ("q", "p"))
    # Where a numerator or denominator is itself a difference (the line nearly through the eye, or along the light),
    # autodiff and formula round it differently: leave those out, they are few.
    s, c = np.sin(theta), np.cos(theta)
    rate = s - ky * c
    z_w = (
        mu
        / np.asarray(warp.one_minus_eta)
        * np.asarray(warpopt.theory.LightSpace(frustum, jnp.asarray(theta)).depth_yz(y, z).blend(warp.eta))
    )
    steady = (np.abs(kx - x / z) > 0.05) & (np.abs(ky - y / z) > 0.05) & (np.abs(rate) > 0.05)
    steady &= np.abs(kx - x / z_w * rate) > 0.05 * (np.abs(kx) + np.abs(x / z_w * rate))
    steady &= z_w > 1e-2 * lam
    assert steady.mean() > 0.6
    # A at (y, z) near a side plane is a difference: its error is up to eps/eta, whatever the formula (`depth_yz`).
    rounding = 1e-12 + 8 * EPS / np.asarray(warp.eta)[steady]
    for got, exact in ((dq / dt, e_q * proj_q), (dp / ds, e_p * proj_p)):
        assert (np.abs(np.abs(got)[steady] / exact[steady] - 1) <= rounding).all()


def test_texture_coordinates_equal_raw_geometry_and_fill_the_map():
    """Every corner lands in [0, 1]^2, and each of t = 0, t = 1, s = 0, s = 1 is touched by one."""
    twins = scenes.twins()
    x, y, z = (np.array([[float(c[k]) for c in s.corners] for s in twins]).T for k in range(3))
    for ratio in LAM_OVER_MU:
        warp = warpopt.Warp.from_range_ratio(jnp.asarray(1 / ratio), VIEW)
        t, s = (np.asarray(v) for v in warpopt.theory.texture_coordinates(FRUSTUM, THETA, warp, x, y, z))
        for j, scene in enumerate(twins):
            lam = scene.lam(mpf(float(warp.eta)))
            exact = [scene.texture(lam, *map(mpf, map(float, (x[i, j], y[i, j], z[i, j])))) for i in range(8)]
            # depth_yz on the upper plane is a cancellation, with relative error up to eps / eta
            tolerance = 16 * EPS / float(warp.eta)
            np.testing.assert_allclose(t[:, j], [float(e[0]) for e in exact], atol=tolerance)
            np.testing.assert_allclose(s[:, j], [float(e[1]) for e in exact], atol=tolerance)
            for values in (t[:, j], s[:, j]):
                np.testing.assert_allclose([values.min(), values.max()], [0, 1], atol=tolerance)


def test_the_local_form_is_the_global_one_on_the_axis_under_an_overhead_light():
    """AT09 (8), (9) against (13), (14): also in lambda, as printed, by hand."""
    frustum = warpopt.ViewFrustum(2.0, 300.0, 0.6)
    z = jnp.linspace(2.0, 300.0, 40)
    for lam in (0.5, 2.0, 26.5, 1e3):
        warp = warpopt.Warp.from_lam(lam, warpopt.FrustumView(frustum, np.pi / 2))
        printed_p = 298 / ((298 + lam) * lam * np.tan(0.6)) * (z - 2 + lam) ** 2 / z
        printed_q = 2 * 300 / (298 + lam) * (z - 2 + lam) / z
        for metric, printed in {"p": printed_p, "q": printed_q, "pxq": printed_p * printed_q}.items():
            local = warpopt.theory.local_aliasing_error(frustum, warp, z, metric)
            np.testing.assert_allclose(local, printed, rtol=20 * EPS)
            if lam >= 2.0:  # below lambda = n a the near corners widen W, which the local form does not know
                on_axis = warpopt.theory.aliasing_error(frustum, np.pi / 2, warp, 0.0, z, metric)
                np.testing.assert_allclose(local, on_axis, rtol=40 * EPS)


def test_light_space_keeps_every_digit():
    """mu, d0 and both depths of every corner, relatively, where the naive forms lose up to all of them.

    Killed: pi - theta by a float's pi, which is 1e-16 off: all of a slope next to theta = pi - phi.
    """
    beside = [scenes.Case("beside pi - phi", 1.0, 100.0, phi, np.pi - phi + d) for phi in (scenes.PHI, 0.7)
              for d in (0.0, 1e-15, -1e-13)]  # fmt: skip
    cases = [*scenes.CASES, *beside]
    space = warpopt.theory.LightSpace(*scenes.batch(cases))
    edges = {u: space.edge(u) for u in (0.0, 1.0)}
    for j, (scene, theta) in enumerate(zip(scenes.twins(cases), [case.theta for case in cases], strict=True)):
        # The inputs' tan(phi) and sin(theta) are rounded: a few eps of each positive term.
        assert abs(float(float(space.mu[j]) / scene.mu - 1)) < 8 * EPS
        scale = scene.near if scene.d0 > 0 else scene.far
        assert abs(float(float(space.start[j]) - scene.d0)) < 8 * EPS * float(scale)
        side = 1 if theta <= np.pi / 2 else -1
        for u, ends in edges.items():
            for depth, z in zip(ends, (scene.near, scene.far), strict=True):
                exact = scene.depth(side * (1 - 2 * u) * z * scene.tan_phi, z) / scene.mu
                for value, truth in ((depth.delta[j], exact), (depth.one_minus_delta[j], 1 - exact)):
                    assert abs(float(float(value) - truth)) <= 16 * EPS * abs(float(truth)) + 1e-50, cases[j]


def test_mirror_of_the_light_is_the_mirror_of_the_scene():
    """theta -> pi - theta is y -> -y (exactly so in the twin; here to the rounding of pi - theta)."""
    theta = jnp.asarray([0.1, scenes.PHI, 1.0, 1.5])
    frustum = warpopt.ViewFrustum(1.0, 100.0, scenes.PHI)
    here, mirrored = (warpopt.Warp.from_eta(0.1, warpopt.FrustumView(frustum, t)) for t in (theta, np.pi - theta))
    there = warpopt.theory.aliasing_error(frustum, theta, here, 3.0, 20.0, "pxq")
    here = warpopt.theory.aliasing_error(frustum, np.pi - theta, mirrored, -3.0, 20.0, "pxq")
    np.testing.assert_allclose(here, there, rtol=64 * EPS)
