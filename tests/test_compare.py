"""Rules beside the optimum: numbers against the library's own and a high-precision twin, users' rules, the command."""

import csv
import dataclasses
import json
import math
import re
import subprocess
import sys
from pathlib import Path

import jax.numpy as jnp
import numpy as np
import pytest
from scene_cases import strict
from twin import Scene, mp

import warpopt
from warpopt.app import cli
from warpopt.app.compare import figures, run
from warpopt.app.compare.own_rules import own_rules
from warpopt.app.compare.report import intervals_text
from warpopt.app.compare.settings import CompareConfig, RuleName, RulesConfig, read_compare_config
from warpopt.app.compare.solve import Compared
from warpopt.compare import rule_set
from warpopt.compare.peaks import first_largest, peaks
from warpopt.compare.regions import regions
from warpopt.compare.rule_set import KNOWN
from warpopt.rules.registry import rule_title

EPS = np.finfo(float).eps
CONFIGS = Path(__file__).parents[1] / "configs"
PHI = math.radians(30.0)
FRUSTUM = warpopt.ViewFrustum(1.0, 100.0, PHI)
THETA = np.deg2rad([0.0, 5.0, 12.0, 30.0, 45.0, 60.0, 90.0])
VIEW = warpopt.FrustumView(FRUSTUM, THETA)
CONFIG = """
[view]
near = 1.0
far = 100.0
half_fov_deg = 30.0
[light]
theta_deg = [0.0, 5.0, 12.0, 30.0, 45.0, 60.0, 90.0]
[rules]
own = { tenth = "rules_beside_the_config:tenth" }
[objective]
metrics = ["p", "pxq"]
[output]
directory = "out"
"""
OWN = """
import numpy as np
import warpopt

def tenth(frustum, theta):
    return warpopt.Warp.from_eta(np.full(theta.shape, 0.1), warpopt.FrustumView(frustum, theta))

def raises(frustum, theta):
    raise ZeroDivisionError("empty body")

def number(frustum, theta):
    return 11.0

def long(frustum, theta):
    return warpopt.Warp.from_eta(np.full(3, 0.1), warpopt.theory.Extent(0.0, 1.0))

def negative(frustum, theta):
    return warpopt.Warp(theta - 1, 2 - theta, theta, theta, np.array(True))

constant = 3
"""


def tenth(frustum, theta):
    """eta = 1/10 by NumPy and an if: nothing that JAX could trace."""
    assert float(theta[0]) >= 0
    return warpopt.Warp.from_eta(np.full(theta.shape, 0.1), warpopt.FrustumView(frustum, theta))


def invoke(*arguments: str) -> int:
    with pytest.raises(SystemExit) as exit_:
        cli.main(["compare", *arguments])
    return exit_.value.code


@pytest.fixture(scope="module")
def comparison():
    return warpopt.compare_rules(VIEW, KNOWN | {"tenth": tenth})


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    """One run with every rule and a user's; compiled as `comparison` is."""
    folder = tmp_path_factory.mktemp("compare")
    (folder / "config.toml").write_text(CONFIG)
    (folder / "rules_beside_the_config.py").write_text(OWN)
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        assert invoke("config.toml") == 0
    return folder


@pytest.fixture
def folder(written, monkeypatch):
    monkeypatch.chdir(written)
    return written


def test_values_are_those_of_the_library(comparison):
    """Other shapes are compiled otherwise: 4 eps each for the optimum and the norm."""
    solution = warpopt.optimal_warp(VIEW)
    np.testing.assert_allclose(comparison.solution.value, solution.value, rtol=8 * EPS)
    np.testing.assert_allclose(comparison.bound, warpopt.lower_bound(VIEW), rtol=8 * EPS)
    for name in ("tsm", "filament", "osg_lispsm_corrected"):
        i, warp = comparison.names.index(name), KNOWN[name](FRUSTUM, THETA)
        np.testing.assert_array_equal(comparison.defined[i], warp.defined)
        expected = np.where(warp.defined, warpopt.error_norm(VIEW, warp), np.nan)
        np.testing.assert_allclose(comparison.values[i], expected, rtol=16 * EPS)
        np.testing.assert_allclose(comparison.ratio[i], expected / solution.value, rtol=16 * EPS)
        np.testing.assert_allclose(comparison.over_bound[i], expected / comparison.bound, rtol=16 * EPS)
    assert not comparison.defined[comparison.names.index("osg_lispsm_corrected")].all()
    assert (np.nan_to_num(comparison.ratio, nan=1) >= 1 - 8 * EPS).all()
    np.testing.assert_allclose(comparison.unwarped, comparison.values[comparison.names.index("ssm")], rtol=4 * EPS)


def twin_end(rule, low, high):
    """Where a rule's largest E_p is that of no warp, by bisection on raw geometry in 60 digits."""

    def excess(degrees):
        scene = Scene(1.0, 100.0, PHI, math.radians(degrees))
        bare = max(scene.no_warp_error(1, 0, z) for _, _, z in scene.corners)
        return scene.supremum(1, 0, rule(scene)) - bare

    below = excess(low) > 0
    for _ in range(45):
        middle = (low + high) / 2
        low, high = (middle, high) if (excess(middle) > 0) == below else (low, middle)
    return (low + high) / 2


def test_ends_of_regions_are_bisected(comparison):
    """LiSPSM, worse than no warp for E_p below 7.1 degrees: the twin's root, which no grid point is near.

    The criterion's 1e3 eps moves the end by 1e3 eps over the ratio's relative slope there, about 0.2 a radian.
    """
    (interval,) = comparison.regions["worse"]["lispsm"]
    end = twin_end(lambda scene: (1 + mp.sqrt(100)) / scene.sin, 5.0, 12.0)
    assert np.rad2deg(interval[1]) == pytest.approx(end, rel=1e-10)
    assert interval[0] < 1e-6  # no warp at theta = 0 itself, where its lambda is inf
    # The closed form: the near end of the lower plane rules, and (1 - d) eta + d = sqrt(eta) has the root (d/(1-d))^2.
    space = warpopt.theory.LightSpace(FRUSTUM, jnp.asarray(interval[1]))
    near, _ = space.edge(1.0)
    eta = warpopt.rules.lispsm(FRUSTUM, interval[1]).eta
    assert float(eta) == pytest.approx(float(near.delta / near.one_minus_delta) ** 2, rel=1e-10)


def test_where_rules_are_undefined_or_give_no_warp(comparison):
    undefined, no_warp = comparison.regions["undefined"], comparison.regions["no_warp"]
    # PSM needs theta > phi; the twin of that is arithmetic
    ((start, end),) = undefined["psm"]
    assert start == 0
    assert end == pytest.approx(PHI, rel=1e-12)
    ((start, end),) = undefined["tsm_alternative"]
    assert (start, end) == (pytest.approx(PHI, rel=1e-12), math.pi / 2)
    # VN section 3: no warp while (1 - z_k/f) tan(theta) <= tan(phi)/3, z_k = 50.5
    ((start, end),) = no_warp["tsm_alternative"]
    assert math.tan(end) == pytest.approx(math.tan(PHI) / 3 / (1 - 0.505), rel=1e-12)
    assert no_warp["ssm"] == ((0.0, math.pi / 2),)
    # X-Ray's cutoff |cos| >= 0.99
    assert no_warp["tsm_xray"][0][1] == pytest.approx(math.acos(0.99), rel=1e-12)
    assert comparison.regions["worse"]["ssm"] == ()
    assert comparison.regions["undefined"]["ssm"] == ()


def test_worst_mean_and_ranking(comparison):
    i = comparison.names.index("lispsm")
    ratio = comparison.ratio[i]
    worst = comparison.worst("lispsm")
    assert worst.ratio == pytest.approx(ratio.max(), rel=1e-9)  # a kink, which is one of the directions
    assert worst.ratio == pytest.approx(1.79, abs=0.005)
    assert worst.nearest == ratio.argmax()
    assert worst.theta == pytest.approx(PHI, rel=1e-9)
    mean = np.trapezoid(ratio, THETA) / (THETA[-1] - THETA[0])
    assert comparison.mean("lispsm") == pytest.approx(mean, rel=8 * EPS)
    ranking = comparison.ranking()
    assert "psm" not in ranking
    assert [comparison.mean(name) for name in ranking] == sorted(map(comparison.mean, ranking))
    nowhere = dataclasses.replace(comparison, values=np.full_like(comparison.values, np.nan))
    assert np.isnan(nowhere.mean("lispsm"))
    assert nowhere.worst("lispsm").nearest == -1


def test_the_worst_is_found_between_the_directions(comparison):
    """Seven directions, none near; what is there is `error_norm` over the optimum, and no denser sweep has more."""
    for name in ("tsm_alternative", "veloren", "lispsm_paper"):
        worst = comparison.worst(name)
        theta = np.r_[worst.theta, np.linspace(THETA[2], THETA[4], 99)]
        warp = KNOWN[name](FRUSTUM, theta)
        ratio = (
            warpopt.error_norm(warpopt.FrustumView(FRUSTUM, theta), warp)
            / warpopt.optimal_warp(warpopt.FrustumView(FRUSTUM, theta)).value
        )
        ratio = np.where(warp.defined, ratio, 0)
        assert worst.ratio == pytest.approx(ratio[0], rel=64 * EPS)
        assert worst.ratio >= ratio.max() * (1 - 64 * EPS)
        assert worst.ratio > 1.005 * np.nanmax(comparison.ratio[comparison.names.index(name)])
        assert comparison.theta[worst.nearest] == pytest.approx(PHI)


def test_what_has_no_bound_is_infinite_with_its_place(comparison):
    """lambda vanishes there: PSM's n a at phi, minimum_norm's f a + 10 sin(theta) at 110 tan(theta) = 100 tan(phi)."""
    places = {"psm": PHI, "minimum_norm": math.atan(100 * math.tan(PHI) / 110)}
    for name, place in places.items():
        for over in ("optimum", "bound"):
            ratio, theta, _ = comparison.worst(name, over)
            assert ratio == math.inf
            assert theta == pytest.approx(place, rel=1e-9)
        assert np.isnan(comparison.mean(name))
    bounded = [name for name in comparison.names if np.isfinite(comparison.worst(name).ratio)]
    assert set(comparison.names) - set(bounded) == {*places, "osg_lispsm_corrected"}
    assert all(np.isfinite(comparison.worst(name, "bound").ratio) for name in bounded)


def test_how_much_worse_than_no_warp(comparison):
    """LiSPSM by 1.47 % at 4.15 degrees, between two directions given: a dense sweep has no more."""
    worst = comparison.worst("lispsm", "no_warp")
    theta = np.r_[worst.theta, np.deg2rad(np.linspace(0.1, 7.0, 100))]
    ratio = warpopt.error_norm(warpopt.FrustumView(FRUSTUM, theta), warpopt.rules.lispsm(FRUSTUM, theta))
    ratio = ratio / warpopt.error_norm(warpopt.FrustumView(FRUSTUM, theta), warpopt.rules.ssm(FRUSTUM, theta))
    assert worst.ratio == pytest.approx(float(ratio[0]), rel=64 * EPS)
    assert 1.0146 < worst.ratio < 1.0148
    assert worst.ratio >= float(ratio.max()) * (1 - 64 * EPS)
    assert comparison.worst("ssm", "no_warp").ratio == pytest.approx(1, rel=8 * EPS)


def test_what_is_undefined_between_the_directions_is_not_ranked():
    """Four directions see neither gap of the corrected rule; its pole towards the first one is found all the same."""
    found = warpopt.compare_rules(
        warpopt.FrustumView(FRUSTUM, np.deg2rad([0.0, 30.0, 60.0, 90.0])), ["ssm", "osg_lispsm_corrected"]
    )
    assert found.defined.all()
    assert np.isinf(found.worst("osg_lispsm_corrected").ratio)
    assert not found.complete("osg_lispsm_corrected")
    assert found.ranking() == ["ssm"]
    assert found.order() == ["ssm", "osg_lispsm_corrected"]


def test_of_places_that_are_alike_to_rounding_the_first_is_named():
    theta = np.array([0.0, 1.0, 2.0, 3.0])
    noise = np.array([[1.0, 1 + 4 * EPS, 1.0, 0.5]])
    assert peaks(theta, noise, lambda t: np.interp(t, theta, noise[0])[None])[0][1] == 0
    assert first_largest(np.array([np.nan, 1.0, 1 + 4 * EPS])) == 1


def test_peaks_of_known_functions():
    """A kink, a jump, a smooth peak, poles of order 1 and 1/2 far from the grid's largest; nothing, a constant."""
    theta = np.array([0.0, 1.0, 2.0, 3.0])

    def at(t):
        with np.errstate(divide="ignore", invalid="ignore"):
            poles = [np.where(t > 1.3, (t - 1.3) ** -order / 100 + t, np.nan) for order in (1.0, 0.5)]
        kink, jump = 5 - np.abs(t - 1.7), np.where(t < 1.7, t, 0.5)
        return np.stack([kink, jump, 9 - (t - 2.2) ** 2, *poles, np.full_like(t, np.nan), np.ones_like(t)])

    kink, jump, smooth, *poles, nothing, constant = peaks(theta, at(theta), at)
    assert kink == pytest.approx((5, 1.7), rel=1e-9)
    assert jump == pytest.approx((1.7, 1.7), rel=1e-9)
    assert smooth == (pytest.approx(9, rel=1e-11), pytest.approx(2.2, rel=1e-5))
    assert poles == [(math.inf, pytest.approx(1.3, rel=1e-9))] * 2
    assert np.isnan(nothing).all()
    assert constant == (1, 0)
    assert peaks(theta[:1], at(theta[:1]), at)[2] == (9 - 2.2**2, 0)


def test_a_users_rule_is_a_rule(comparison):
    np.testing.assert_array_equal(comparison.eta[comparison.names.index("tenth")], 0.1)
    i, j = (comparison.names.index(name) for name in ("tenth", "lispsm"))
    # at pi/2 LiSPSM's eta is sqrt(n/f) = 1/10
    assert comparison.values[i, -1] == pytest.approx(comparison.values[j, -1], rel=8 * EPS)


def test_a_rule_of_one_angle_is_called_for_each():
    """`math` and an `if`, which no array passes; the shipped examples, one of each kind, from their module."""
    own = own_rules(RulesConfig(own={"half": "my_rules:half_way", "overhead": "my_rules:overhead"}), CONFIGS)
    eta, defined = rule_set.warps_of(own, VIEW)
    assert np.all(defined)
    np.testing.assert_allclose(eta[0] ** 2, warpopt.rules.lispsm(FRUSTUM, THETA).eta, rtol=4 * EPS)
    mu = np.asarray(warpopt.theory.LightSpace(FRUSTUM, jnp.asarray(THETA)).mu)
    np.testing.assert_allclose(eta[1], np.where(THETA < math.radians(10), 1, 11 / (11 + mu)), rtol=8 * EPS)


def test_rules_come_as_names_callables_or_a_dict():
    def names(rules):
        return tuple(rule_set.rule_set(rules))

    assert names(None) == (*warpopt.rules.PUBLISHED, *warpopt.rules.ENGINES)
    assert names("tsm") == ("tsm",)
    assert names(tenth) == ("tenth",)
    assert names(["tsm", tenth]) == ("tsm", "tenth")
    assert names({"mine": tenth, "theirs": "tsm"}) == ("mine", "theirs")


@pytest.mark.wrong_types
@pytest.mark.parametrize(
    ("rules", "words"),
    [
        (["lispsn"], "got 'lispsn', expected a callable or one of ssm, psm"),
        ([3], "got 3, expected a name or a callable"),
        ([], "got none"),
        ([tenth, tenth], "got 'tenth' twice"),
        (lambda f, t: 11.0, "got float from it, expected a warpopt.Warp"),
        (lambda f, t: math.sin("x"), r"it raised TypeError: .* called with theta of shape \(\)"),
        (lambda f, t: 1 / 0, "it raised ZeroDivisionError: division by zero"),
        (
            lambda f, t: warpopt.Warp.from_eta(np.full(3, 0.1), warpopt.theory.Extent(0.0, 1.0)),
            r"shape \(3,\) from it, expected theta's \(7,\)",
        ),
        (lambda f, t: warpopt.Warp(t, 1 - t, t, t, np.array(True)), "got eta = 0 from it at theta = 0 degrees"),
    ],
)
def test_bad_rules_are_refused_in_words(rules, words):
    with pytest.raises(ValueError, match=words):
        warpopt.compare_rules(VIEW, rules)


@pytest.mark.parametrize("theta", [[], [0.5, 0.2], [0.2, 0.2], [[0.1, 0.2]], [-0.1, 0.2]])
def test_bad_directions_are_refused(theta):
    with pytest.raises(ValueError, match="theta: got"):
        warpopt.compare_rules(warpopt.FrustumView(FRUSTUM, theta), "ssm")


def test_regions_of_a_known_function():
    theta = np.array([0.0, 1.0, 2.0, 3.0])

    def holds(t):
        return np.stack([(t > 0.3) & (t < 2.7), t < -1, t > -1, t < 0.25])

    found = regions(theta, holds(theta), holds)
    assert found[0] == (pytest.approx((0.3, 2.7), rel=1e-12),)
    assert found[1:3] == [(), ((0.0, 3.0),)]
    assert found[3] == (pytest.approx((0.0, 0.25), rel=1e-11),)
    assert intervals_text(((0.0, 1e-12), (0.1, 0.2))) == "at 0 deg, 5.73 to 11.46 deg"


def test_the_table_and_the_record_say_what_the_library_says(written, comparison):
    out = written / "out"
    assert strict(out / "run.json")["files"] == sorted(p.name for p in out.iterdir())
    with (out / "compare.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == 2 * len(comparison.names) * len(THETA)
    mine = [r for r in rows if r["metric"] == "p"]
    for i, name in enumerate(comparison.names):
        ratios = [float(r["over_optimum"] or "nan") for r in mine if r["rule"] == name]
        np.testing.assert_array_equal(ratios, comparison.ratio[i])
    assert all(r["over_limit"] == r["limit"] == "" for r in rows if r["metric"] == "pxq")  # no limit is known
    told = strict(out / "compare.json")["objectives"]
    assert [o["metric"] for o in told] == ["p", "pxq"]
    assert told[0]["ranking"] == comparison.ranking()
    assert told[0]["limit"] == comparison.bound.tolist()
    assert told[1]["limit"] is None
    assert [o["no_limit_because"] for o in told] == [None, "No lower bound is known for a product of E_p and E_q."]
    lispsm = told[0]["rules"]["lispsm"]
    assert lispsm["regions_deg"]["worse"] == [list(np.rad2deg(comparison.regions["worse"]["lispsm"][0]))]
    assert lispsm["mean_over_optimum"] == comparison.mean("lispsm")
    assert told[0]["rules"]["psm"]["over_optimum"][0] is None
    peak, psm = lispsm["worst_over_limit"], told[0]["rules"]["psm"]["worst_over_optimum"]
    assert (peak["ratio"], math.radians(peak["theta_deg"])) == pytest.approx(comparison.worst("lispsm", "bound")[:2])
    assert (psm["ratio"], psm["unbounded"], psm["theta_deg"]) == (None, True, pytest.approx(30.0, rel=1e-9))
    assert told[1]["rules"]["lispsm"]["worst_over_limit"] is None
    with (out / "ranking.csv").open() as file:
        ranked = [row for row in csv.DictReader(file) if row["metric"] == "p"]
    assert [row["rule"] for row in ranked] == comparison.order()
    assert [row["place"] for row in ranked] == [str(k) for k in range(1, 15)] + [""] * 4
    for row in ranked:
        worst = comparison.worst(row["rule"], "bound")
        assert float(row["worst_over_limit"]) == worst.ratio
        assert float(row["at_theta_deg_over_limit"]) == np.rad2deg(worst.theta)


def test_the_report_ranks_in_words(written, comparison):
    text = (written / "out/report.md").read_text()
    assert "- LiSPSM is worse than no warp for 0 to 7.133 deg by up to 1.5 %.\n" in text
    assert "- OGRE is worse than no warp for 0 to 16.48 deg, 40.91 to 78.09 deg by a factor of up to 2.07.\n" in text
    psm = "PSM is worse than no warp for 30 to 90 deg, yields no lambda > 0 for 0 to 30 deg"
    assert f"{psm} and is unbounded towards 30 deg." in text
    assert "| 2.99 | 29.58 deg |" in text  # Veloren's, between two directions
    assert "| - | unbounded | 30 deg | unbounded | 30 deg |" in text
    assert "The optimum's error is 1.96 to 17.8 times the limit." in text
    assert "No lower bound is known for a product of E_p and E_q." in text
    assert f"**{rule_title(comparison.ranking()[0])}** is best on average: " in text
    assert f"| 1 | {rule_title(comparison.ranking()[0])} | " in text
    assert text.index("![map](map.png)") < text.index("![curves](curves.png)")
    bullets = re.findall(r"^- (.*?) (?:is worse|yields)", text.split("## E_pxq")[0], re.M)
    order = [rule_title(name) for name in comparison.order()]
    assert bullets == sorted(bullets, key=order.index)
    assert len(bullets) > 8


def test_every_rule_has_a_name_in_the_configuration_and_for_people():
    assert list(RuleName.__args__) == list(KNOWN)
    assert rule_title("tenth") == "tenth"


def test_figures_are_drawn_and_written(written, comparison):
    out = written / "out"
    assert (out / "map.png").read_bytes()[:8] == b"\x89PNG\r\n\x1a\n"
    assert (out / "curves.png").read_bytes()[:8] == b"\x89PNG\r\n\x1a\n"
    every = figures.curves_figure([Compared(warpopt.Objective(), None, comparison)]).axes[0]
    shown = {text.get_text() for text in every.texts}
    assert {"tenth", "no warp", rule_title(comparison.ranking()[0])} <= shown
    thin = [line for line in every.lines if line.get_linewidth() < 1 and line.get_label().startswith("rule ")]
    assert len(thin) == len(comparison.names) - 3
    names = ("tsm_alternative", "tenth")
    rows = [comparison.names.index(name) for name in names]
    fewer = {field: getattr(comparison, field)[rows] for field in ("eta", "defined", "values")}
    few = dataclasses.replace(comparison, names=names, **fewer)
    figure = figures.curves_figure([Compared(warpopt.Objective(), None, few)])
    drawn = {line.get_label(): line.get_ydata() for line in figure.axes[0].lines}
    np.testing.assert_array_equal(drawn["rule tenth"], few.ratio[1])
    (strip,) = figure.axes[1].lines
    np.testing.assert_array_equal(strip.get_ydata(), few.solution.value / few.bound)
    figure.canvas.draw()
    texts = [text.get_text() for text in figure.axes[0].texts]
    assert {"tenth", "TSM alternative"} <= set(texts)


@pytest.mark.wrong_types
@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--rules.own.mine", "nowhere_at_all:f"], "rules.own.mine: got module 'nowhere_at_all', which is neither"),
        (["--rules.own.mine", "rules_beside_the_config:none"], "got 'none', which module 'rules_beside_the_config'"),
        (["--rules.own.mine", "rules_beside_the_config:constant"], "of type int; expected a callable"),
        (["--rules.own.mine", "rules_beside_the_config:raises"], "rule mine: it raised ZeroDivisionError: empty body"),
        (["--rules.own.mine", "rules_beside_the_config:number"], "rule mine: got float from it"),
        (["--rules.own.mine", "rules_beside_the_config:long"], "rule mine: got a warp of shape (3,)"),
        (["--rules.own.mine", "rules_beside_the_config:negative"], "rule mine: got eta = -1"),
        (["--rules.own.mine", "no colon"], "rules.own.mine: got 'no colon', expected module:function"),
        (["--rules.own.tsm", "rules_beside_the_config:tenth"], "rules.own: got 'tsm', expected a name that no rule"),
        (["--rules.names", "lispsn"], "rules.names.0: got 'lispsn', expected 'ssm'"),
        (["--rules.names", "[]", "--rules.own", "{}"], "rules.names: got none"),
        (["--light.theta_deg", "[30, 20]"], "light.theta_deg: got [30, 20], expected increasing"),
        (["--light.theta_deg", "{start = 9, stop = 3, count = 4}"], "expected increasing"),
        (["--view.far", "0.5"], "view.far: got 0.5"),
        (["--receivers.box.lower", "3"], "got [view] with [receivers], expected a view frustum"),
        (["--output.directory", "rules_beside_the_config.py"], "which is a file"),
    ],
)
def test_bad_input_exits_with_two_and_leaves_the_result_as_it_was(folder, capsys, arguments, words):
    before = {p.name: p.stat().st_mtime_ns for p in (folder / "out").iterdir()}
    assert invoke("config.toml", "--objective.metrics", "p", *arguments) == 2
    message = capsys.readouterr().err
    assert words in message
    assert "Traceback" not in message
    assert {p.name: p.stat().st_mtime_ns for p in (folder / "out").iterdir()} == before
    assert not [p.name for p in folder.iterdir() if p.name.startswith(".")]


def test_a_failed_write_keeps_the_earlier_result(folder, monkeypatch, capsys):
    before = {p.name: p.stat().st_mtime_ns for p in (folder / "out").iterdir()}

    def broken(*_):
        raise OSError("disk full")

    monkeypatch.setattr(run, "write_compare_table", broken)
    few = ("--objective.metrics", "p", "--rules.own", "{}", "--rules.names", "lispsm", "--output.figures", "false")
    assert invoke("config.toml", *few) == 1
    assert "disk full" in capsys.readouterr().err
    assert {p.name: p.stat().st_mtime_ns for p in (folder / "out").iterdir()} == before


def test_a_failed_solve_is_told_and_exits_with_one(folder, capsys):
    """f/n = 1e15 is beyond what the moments reach; one direction, one rule, which is not defined there."""
    arguments = ["--view.far", "1e15", "--objective.metrics", "p", "--objective.norms", "l2", "--rules.own", "{}"]
    arguments += ["--rules.names", "tsm_alternative", "--light.theta_deg", "60", "--output.directory", "failed"]
    assert invoke("config.toml", *arguments) == 1
    assert "1 problem(s) failed" in capsys.readouterr().out
    (told,) = strict(folder / "failed/compare.json")["objectives"]
    assert told["optimum"] == {"eta": [None], "value": [None], "outcome": ["not_finite"]}
    report = (folder / "failed/report.md").read_text()
    assert "could not be found" in report
    assert "TSM alternative yields no lambda > 0 at 60 deg." in report


def test_a_missing_module_is_refused_before_jax_is_loaded(written):
    code = (
        "import sys, warpopt.app.cli as cli\n"
        "try:\n    cli.main(sys.argv[1:])\nexcept SystemExit as e:\n    print('code', e.code)\n"
        "print('jax' in sys.modules)\n"
    )
    arguments = ["compare", str(written / "config.toml"), "--rules.own.mine", "nowhere_at_all:f"]
    result = subprocess.run([sys.executable, "-c", code, *arguments], capture_output=True, text=True, check=True)
    assert result.stdout.splitlines()[-2:] == ["code 2", "False"]


def test_schema_and_overrides(capsys):
    with pytest.raises(SystemExit):
        cli.main(["schema", "--of", "compare"])
    schema = json.loads(capsys.readouterr().out)
    assert [kind["$ref"].rpartition("/")[2] for kind in schema["anyOf"]] == ["CompareConfig", "SceneCompareConfig"]
    config = read_compare_config(CONFIGS / "compare.toml", ["--view.far", "500", "--rules.own.mine", "a.b:c"])
    assert isinstance(config, CompareConfig)
    assert (config.view.far, config.rules.own) == (500.0, {"mine": "a.b:c"})


def test_a_rule_that_is_undefined_everywhere_has_no_numbers():
    """Killed: NumPy's message about nothing to concatenate."""
    view = warpopt.FrustumView(FRUSTUM, np.array([0.5, 0.9, 1.2]))

    def nowhere(frustum, theta):
        return warpopt.Warp.from_range_ratio(0 * theta, warpopt.FrustumView(frustum, theta), theta < 0)

    comparison = warpopt.compare_rules(view, {"nowhere": nowhere})
    assert not comparison.defined.any()
    assert np.isnan(comparison.worst("nowhere").ratio)
