"""Where the sources are wrong or contradict themselves: one test each, with numbers.

Sources: AT09 ("An Aliasing Theory of Shadow Mapping") and its extra note, VN. Each test states what is printed,
shows that it contradicts the definition (the twin's raw geometry, or the source itself), and that the package agrees
with the definition.
"""

import numpy as np
import pytest
import scenes
import twin
from twin import mpf

import warpopt

NEAR, FAR, PHI = 1.0, 100.0, scenes.PHI
FRUSTUM = warpopt.ViewFrustum(NEAR, FAR, PHI)
DEGREE = np.pi / 180
EPS = np.finfo(np.float64).eps


def scene_at(theta: float) -> twin.Scene:
    return twin.Scene(NEAR, FAR, PHI, theta)


def test_item_1_f_p_above_phi_needs_the_cube_of_sine():
    """AT09's F_p for theta >= phi prints sin^2(theta): too large by 1 / sin(theta), twice at 30 degrees."""
    for degrees in (30, 60, 89):
        theta = degrees * DEGREE
        s, lam, y, z = scene_at(theta), mpf(7), mpf(1), mpf(30)
        t = s.tan_phi * s.cos / s.sin
        span = s.far - s.near + (s.far + s.near) * t
        z_plus_g = z + lam / s.sin - s.near + (s.near * s.tan_phi - y) * s.cos / s.sin
        printed = s.sin**2 * span / (s.tan_phi * lam * (lam + span * s.sin)) * z_plus_g**2 / z
        exact = s.e_p(lam, y, z)
        if degrees > 30:  # at 30 = phi both branches apply, and rounding of theta decides d0's
            assert abs(printed * s.sin / exact - 1) < mpf(10) ** -40
        assert abs(printed * s.sin / exact - 1) < mpf(10) ** -12
        assert printed / exact > 1.0001
        warp = warpopt.Warp.from_lam(7.0, warpopt.FrustumView(FRUSTUM, theta))
        assert float(warpopt.theory.aliasing_error(FRUSTUM, theta, warp, 1.0, 30.0)) == pytest.approx(
            float(exact), rel=1e-13
        )


def test_item_2_f_p_below_phi_needs_a_cosine_and_no_second_tangent():
    """AT09's F_p for theta <= phi prints a 1 / tan(phi) where cos(theta) belongs, so that its branches don't meet."""
    theta = 20 * DEGREE
    s, lam, y, z = scene_at(theta), mpf(7), mpf(1), mpf(30)
    z_plus_g = z + lam / s.sin - s.far + (s.far * s.tan_phi - y) * s.cos / s.sin
    denominator = lam * (lam + 2 * s.far * s.tan_phi * s.cos)
    printed = 2 * s.far * s.sin**2 / (denominator * s.tan_phi) * z_plus_g**2 / z
    right = 2 * s.far * s.sin**2 * s.cos / denominator * z_plus_g**2 / z
    exact = s.e_p(lam, y, z)
    assert abs(right / exact - 1) < mpf(10) ** -40
    assert abs(printed / exact - 1 / (s.tan_phi * s.cos)) < mpf(10) ** -40
    assert printed / exact > 1.8
    warp = warpopt.Warp.from_lam(7.0, warpopt.FrustumView(FRUSTUM, theta))
    assert float(warpopt.theory.aliasing_error(FRUSTUM, theta, warp, 1.0, 30.0)) == pytest.approx(
        float(exact), rel=1e-13
    )


def test_item_3_the_two_widths_printed_contradict_each_other():
    """VN's tan(phi_w) = f tan(phi) / (mu + lambda) against F_q's f tan(phi) / (lambda + (f - n) a), theta >= phi.

    Equal at pi/2 only; the second is the one that contains V; the first jumps to f tan(phi) / lambda at theta = phi.
    """
    for degrees in (31, 45, 60, 85):
        s = scene_at(degrees * DEGREE)
        a = s.sin - s.tan_phi * s.cos
        lam = s.near * a + 3
        first = s.far * s.tan_phi / (s.mu + lam)
        second = s.far * s.tan_phi / (lam + (s.far - s.near) * a)
        assert abs(second / s.tan_phi_w(lam) - 1) < mpf(10) ** -40
        assert first < second * mpf("0.95")  # W misses the upper far corners
    overhead = scene_at(np.pi / 2)
    lam = mpf(3)
    printed = overhead.far * overhead.tan_phi / (overhead.mu + lam)
    assert abs(printed / overhead.tan_phi_w(lam) - 1) < 1e-14
    above, below = scene_at(PHI * (1 + 1e-12)), scene_at(PHI * (1 - 1e-12))
    jump = (below.far * below.tan_phi / lam) / (above.far * above.tan_phi / (above.mu + lam))
    assert jump > 30
    assert abs(below.tan_phi_w(lam) / above.tan_phi_w(lam) - 1) < 1e-9


def test_item_4_below_n_a_neither_width_contains_the_near_corners():
    """For lambda < n a the near corners are the widest; with lambda = n a the apex of W is at the eye."""
    for degrees in (45, 60, 90):
        theta = degrees * DEGREE
        s = scene_at(theta)
        a = s.sin - s.tan_phi * s.cos
        lam = s.near * a / 3
        for printed in (s.far * s.tan_phi / (s.mu + lam), s.far * s.tan_phi / (lam + (s.far - s.near) * a)):
            assert printed < s.tan_phi_w(lam) * mpf("0.9")
        # the package's map holds every corner there
        warp = warpopt.Warp.from_lam(float(lam), warpopt.FrustumView(FRUSTUM, theta))
        x, y, z = (np.array([float(c[k]) for c in s.corners]) for k in range(3))
        t, _ = warpopt.theory.texture_coordinates(FRUSTUM, theta, warp, x, y, z)
        assert float(t.min()) == pytest.approx(0, abs=1e-12)
        assert float(t.max()) == pytest.approx(1, abs=1e-12)
        # apex at the eye: z_w of the point (0, 0, 0) is zero
        assert abs(s.near * a + s.depth(0, 0)) < mpf(10) ** -50


@pytest.mark.parametrize("degrees", [35, 60, 85])
def test_item_5_tsm_as_printed_does_not_map_the_focus_point_to_xi(degrees):
    """VN (16), theta >= phi: tan(phi) / tan(theta) is printed upside down, and a mu has slipped into the numerator."""
    theta, kappa, xi = degrees * DEGREE, mpf("0.5"), mpf("0.8")
    s = scene_at(theta)
    ratio = s.tan_phi * s.cos / s.sin
    n, f = s.near, s.far

    def printed(r, stray):
        top = (f - n) * kappa * (1 - xi) + n * (1 - xi) * r * stray
        return top / ((f - n) * (xi - kappa) + (f * xi - n * (1 - xi)) * r) * s.mu

    focus = n + (f - n) * kappa
    right = printed(ratio, 1)
    assert abs(s.texture(right, 0, 0, focus)[1] - xi) < mpf(10) ** -40
    for wrong in (printed(1 / ratio, s.mu), printed(1 / ratio, 1), printed(ratio, s.mu)):
        assert abs(s.texture(wrong, 0, 0, focus)[1] - xi) > 1e-3
    assert float(warpopt.rules.tsm(FRUSTUM, theta).lam) == pytest.approx(float(right), rel=1e-13)


def test_item_6_extrema_of_e_q_swap_below_n_a():
    """AT09 3.1 places E_q's extrema "regardless of lambda". Below lambda = n a they are at the other two corners."""
    for degrees in (45, 60, 85):
        s = scene_at(degrees * DEGREE)
        a = s.sin - s.tan_phi * s.cos
        corner = {
            (end, plane): (-plane * z * s.tan_phi, z)
            for end, z in (("near", s.near), ("far", s.far))
            for plane in (-1, 1)
        }
        for factor, largest, least in ((3, ("near", 1), ("far", -1)), (mpf(1) / 3, ("far", 1), ("near", -1))):
            errors = {name: s.e_q(factor * s.near * a, *at) for name, at in corner.items()}
            assert max(errors, key=errors.get) == largest  # 1: the lower plane, y < 0
            assert min(errors, key=errors.get) == least


def test_item_7_tsm_is_not_always_the_stronger_warp():
    """AT09 3.1: lambda_TSM < lambda_LiSPSM at 90 and 60 degrees. With VN's kappa = .5, xi = .8: 33 > 11, 20.3 > 12.7.

    True only for kappa below 2/7 at 90 and below about 0.378 at 60.
    """
    for degrees, tsm, lispsm, threshold in ((90, 33.0, 11.0, 2 / 7), (60, 20.3, 12.7, 0.378)):
        theta = degrees * DEGREE
        got = float(warpopt.rules.tsm(FRUSTUM, theta).lam)
        other = float(warpopt.rules.lispsm(FRUSTUM, theta).lam)
        assert got == pytest.approx(tsm, abs=0.05)
        assert other == pytest.approx(lispsm, abs=0.05)
        assert float(warpopt.rules.tsm(FRUSTUM, theta, kappa=threshold - 1e-3).lam) < other
        assert float(warpopt.rules.tsm(FRUSTUM, theta, kappa=threshold + 1e-3).lam) > other


def test_item_8_the_trapezoids_area_has_a_factor_two():
    """VN prints 4 (w1/w) h1 lambda^2 ... for the alternative TSM's area. The shoelace formula on VN's vertices: 2."""
    lam, h1, h2, w = mpf("0.7"), mpf("0.3"), mpf("0.25"), mpf("0.6")  # w = w1 / w
    vertices = [
        (sign * lam / (lam + h) * w, (lam + 1) * h / (lam + h))
        for h, signs in ((h2, (-1, 1)), (h2 + h1, (1, -1)))
        for sign in signs
    ]
    area = abs(sum(p[0] * q[1] - q[0] * p[1] for p, q in zip(vertices, vertices[1:] + vertices[:1], strict=True))) / 2
    shape = w * h1 * lam**2 * (lam + 1) * (lam + h1 / 2 + h2) / ((lam + h2) ** 2 * (lam + h1 + h2) ** 2)
    assert abs(area / shape - 2) < mpf(10) ** -50


def test_item_9_minimum_is_on_the_upper_plane_but_not_at_the_far_corner():
    """AT09 3.1 puts the minimum of every error at z = f, y = f tan(phi). For E_p and E_pxq it is at an inner z.

    E_p: z = clamp((lambda - d0) / a, n, f), E_pxq: twice that. The maxima are where AT09 says: on the lower plane.
    """
    for degrees, lam in ((60, 10.0), (45, 5.0), (80, 30.0)):
        theta = degrees * DEGREE
        s = scene_at(theta)
        a = s.sin - s.tan_phi * s.cos
        warp = warpopt.Warp.from_lam(lam, warpopt.FrustumView(FRUSTUM, theta))
        u, z = np.linspace(0, 1, 21)[:, None], np.linspace(NEAR, FAR, 4951)  # steps of 0.02
        for metric, factor in (("p", 1), ("pxq", 2)):
            grid = np.asarray(warpopt.theory.aliasing_error_uz(FRUSTUM, theta, warp, u, z, metric))
            row, column = np.unravel_index(grid.argmin(), grid.shape)
            expected = min(max(float(factor * (lam - s.d0) / a), NEAR), FAR)
            assert row == 0
            assert z[column] == pytest.approx(expected, abs=0.02)
            assert expected < 0.9 * FAR
            assert grid[0, -1] > 1.05 * grid.min()
            top_row, top_column = np.unravel_index(grid.argmax(), grid.shape)
            assert top_row == 20
            assert top_column in (0, 4950)


def test_item_10_warping_pays_at_theta_equal_phi_and_far_below():
    """AT09 3.2 sees no advantage over SSM for theta <= phi. At theta = phi SSM is 9.09 (E_p), 13.5 (E_pxq) times worse.

    E_p's no-warp zone ends at 0.334 degrees, E_pxq's at 11.3 degrees.
    """
    for metric, ratio, zone in (("p", 9.09, 0.334), ("pxq", 13.5, 11.3)):
        theta = np.array([PHI, zone * 0.998 * DEGREE, zone * 1.006 * DEGREE])
        best = warpopt.optimal_warp(warpopt.FrustumView(FRUSTUM, theta), warpopt.Objective(metric))
        ssm = warpopt.error_norm(
            warpopt.FrustumView(FRUSTUM, theta), warpopt.rules.ssm(FRUSTUM, theta), warpopt.Objective(metric)
        )
        assert float(ssm[0] / best.value[0]) == pytest.approx(ratio, rel=4e-3)
        assert best.warp.no_warp.tolist() == [False, True, False]
        # (the ratios to the three figures given) and by the oracle's search, without the package
        alpha, beta = {"p": (1, 0), "pxq": (1, 1)}[metric]
        s = scene_at(PHI)
        exact = twin.search(s, lambda lam, s=s, a=alpha, b=beta: s.supremum(a, b, lam))[2]
        unwarped = s.no_warp_error(alpha, beta, s.near)
        assert float(unwarped / exact) == pytest.approx(ratio, rel=4e-3)
