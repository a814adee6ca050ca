"""The figures: the files are what they claim, the lines are the sweep's, and odd runs are drawn too."""

import dataclasses
import xml.etree.ElementTree

import jax
import matplotlib
import numpy as np
import pytest

from warpopt.app.common import figure_style
from warpopt.app.frusta.problem import View
from warpopt.app.frusta.solve import OptimumCurves, RuleCurves, Sweep
from warpopt.app.sweep import figures
from warpopt.app.sweep.curve_figures import drawn_views, exits, no_warp_spans
from warpopt.app.sweep.figures import (
    error_distribution_figure,
    focus_region_figure,
    lambda_figure,
    ratio_figure,
    write_figures,
)
from warpopt.app.sweep.frustum_figures import distributions, focus_region, fraction_text
from warpopt.objective import Objective
from warpopt.rules.registry import PUBLISHED

jax.config.update("jax_enable_x64", True)

PAPER = View(1.0, 100.0, 30.0)
STEMS = ["lambda", "error_distribution", "ratio", "focus_region"]


def synthetic_sweep(views=(PAPER,), context=(), theta_deg=None, metrics=("p", "q"), norms=("inf", "l2"), seed=0):
    """A sweep of the right shapes with random contents, some of it infinite or undefined."""
    rng = np.random.default_rng(seed)
    theta_deg = np.linspace(0, 90, 31) if theta_deg is None else np.asarray(theta_deg, float)
    shape = len(views) + len(context), theta_deg.size

    def curves():
        lam = np.where(theta_deg < rng.uniform(0, 30), np.inf, 10 ** rng.uniform(-3, 1, shape))
        return 1 / (1 + 1 / lam), lam, lam

    rules = {name: RuleCurves(*curves(), rng.uniform(size=shape) > 0.1) for name in PUBLISHED}
    rules["ssm"] = RuleCurves(np.ones(shape), np.full(shape, np.inf), np.full(shape, np.inf), np.full(shape, True))
    optima = tuple(
        OptimumCurves(
            *curves(),
            Objective(metric, norm),
            np.ones(shape),
            np.zeros(shape, int),
            np.zeros(shape),
            {name: 10 ** rng.uniform(0, 2, shape) for name in PUBLISHED},
            np.full(shape, np.nan),
        )
        for metric in metrics
        for norm in norms
    )
    return Sweep(tuple(views), tuple(context), theta_deg, rules, optima)


def render(figure):
    """Draw it all; warnings are errors."""
    with figure_style.shared_style():
        figure.canvas.draw()


def lines_of(axes):
    return {line.get_label(): np.asarray(line.get_ydata(), float) for line in axes.lines if line.get_label()[0] != "_"}


def panels_of(figure):
    """The axes that hold curves, in drawing order."""
    return [axes for axes in figure.axes if any(line.get_label().startswith("rule") for line in axes.lines)]


def finite_or_nan(values):
    return np.where(np.isfinite(values), values, np.nan)


@pytest.fixture(scope="module")
def written(tmp_path_factory, paper_errors):
    sweep = synthetic_sweep(metrics=("p",), norms=("inf",))
    folders = [tmp_path_factory.mktemp(name) for name in ("first", "second")]
    told = []
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(figures, "distributions", lambda view: paper_errors)  # coarser, compiled once
        captions = [write_figures(sweep, folder, told.append) for folder in folders]
    return folders, captions, told


@pytest.fixture(scope="module")
def paper_errors():
    return distributions(PAPER, samples=16)


def test_every_figure_is_written_with_a_caption(written):
    folders, captions, told = written
    assert [stem for stem, _ in captions[0]] == STEMS
    assert sorted(told) == sorted(STEMS * 2)
    assert {path.name for path in folders[0].iterdir()} == {
        f"{stem}.{kind}" for stem in STEMS for kind in ("png", "svg")
    }
    for _, caption in captions[0]:
        assert caption.endswith(".")
        assert "  " not in caption
        assert "$" not in caption


@pytest.mark.parametrize("stem", STEMS)
def test_files_are_valid_and_self_contained(written, stem):
    folder = written[0][0]
    png = (folder / f"{stem}.png").read_bytes()
    assert png[:8] == b"\x89PNG\r\n\x1a\n"
    assert png[-8:-4] == b"IEND"
    assert 800 < int.from_bytes(png[16:20]) < 2400
    root = xml.etree.ElementTree.parse(folder / f"{stem}.svg").getroot()
    assert root.tag == "{http://www.w3.org/2000/svg}svg"
    # text is outlines, so that no font is needed, and pictures are inside the file
    assert root.find(".//{http://www.w3.org/2000/svg}text") is None
    for image in root.iterfind(".//{http://www.w3.org/2000/svg}image"):
        assert image.get("{http://www.w3.org/1999/xlink}href").startswith("data:image/png;base64,")


@pytest.mark.parametrize("stem", STEMS)
@pytest.mark.parametrize("kind", ["png", "svg"])
def test_files_are_the_same_bytes_again(written, stem, kind):
    first, second = ((folder / f"{stem}.{kind}").read_bytes() for folder in written[0])
    assert first == second


def test_settings_of_the_process_are_left_alone(written):
    assert matplotlib.rcParams["svg.hashsalt"] is None
    assert matplotlib.rcParams["font.size"] == 10.0


def test_lambda_lines_are_the_sweep():
    sweep = synthetic_sweep(context=(View(1.0, 10.0, 30.0), View(1.0, 50.0, 20.0)))
    views = drawn_views(sweep)
    assert [sweep.all_views[view].far for view in views] == [10.0, 100.0]
    panels = panels_of(lambda_figure(sweep))
    assert len(panels) == len(views)
    for view, axes in zip(views, panels, strict=True):
        assert axes.get_yscale() == "log"
        assert list(axes.get_xticks()) == list(range(0, 91, 15))
        drawn = lines_of(axes)
        for name, rule in sweep.rules.items():
            expected = finite_or_nan(np.where(rule.defined[view], rule.lam_over_mu[view], np.nan))
            np.testing.assert_array_equal(drawn[f"rule {name}"], expected)
        for optimum in sweep.optima:
            label = f"optimum {optimum.metric} {optimum.norm}"
            np.testing.assert_array_equal(drawn[label], finite_or_nan(optimum.lam_over_mu[view]))


def test_ratio_lines_are_the_first_view_of_the_sweep():
    sweep = synthetic_sweep(views=(PAPER, View(1.0, 7.0, 30.0)), metrics=("p", "q", "pxq"))
    panels = panels_of(ratio_figure(sweep))
    assert len(panels) == 6
    for optimum, axes in zip(sweep.optima, panels, strict=True):
        drawn = lines_of(axes)
        for name, ratios in optimum.ratios.items():
            np.testing.assert_array_equal(
                drawn[f"rule {name}"], np.where(sweep.rules[name].defined[0], ratios[0], np.nan)
            )


def test_unsorted_directions_are_drawn_in_order():
    sweep = synthetic_sweep(theta_deg=[90, 60, 30, 0])
    (axes,) = panels_of(lambda_figure(sweep))
    drawn = lines_of(axes)["optimum p inf"]
    np.testing.assert_array_equal(drawn, finite_or_nan(sweep.optima[0].lam_over_mu[0][::-1]))


def test_no_warp_spans_reach_half_way_to_the_neighbours():
    theta = np.array([0.0, 10.0, 20.0, 30.0])
    flat = np.array([np.inf, np.inf, 1.0, np.inf])
    assert no_warp_spans(theta, flat, 90.0) == [(0.0, 15.0), (25.0, 5.5)]
    assert no_warp_spans(theta, np.ones(4), 90.0) == []
    assert no_warp_spans(np.array([45.0]), np.array([np.inf]), 90.0) == [(44.5, 1.0)]
    assert exits(theta, flat) == [(20.0, 1.0)]


def test_near_identical_fields_of_view_and_ratios_are_not_repeated():
    sweep = synthetic_sweep(views=(PAPER, View(2.0, 200.0, 30.0)), context=(View(1.0, 100.0, 45.0),))
    assert drawn_views(sweep) == [0]


def test_error_distributions_are_those_of_the_theory(paper_errors):
    """Ratios of the largest errors, SSM, LiSPSM and TSM over the optimum, from the table of the derivation."""
    largest = paper_errors.errors.max(axis=(3, 4, 5))
    over = largest / largest[:, 3:]
    np.testing.assert_allclose(over[0, :3].T, [[10, 1, 2.5], [9.55, 1.04, 1.52], [9.09, 1.79, 1.08]], rtol=5e-3)
    np.testing.assert_allclose(over[2, :3, 0], [464, 4.64, 29.0], rtol=2e-3)
    np.testing.assert_allclose(over[2, 0, 2], 13.5, rtol=3e-3)
    assert np.all(over >= 1 - 1e-12)


def test_error_distribution_shows_the_errors(paper_errors):
    figure = error_distribution_figure(PAPER, paper_errors)
    render(figure)
    canvas, bar = figure.axes
    texts = [text.get_text() for text in canvas.texts]
    assert sum(text.startswith("max ") for text in texts) == 36
    assert "max 34,295" in texts
    assert len(canvas.images) == 72
    assert [text.get_text() for text in bar.get_xticklabels()][:4] == ["5⁻²", "5⁻¹", "5⁰", "5¹"]


def test_focus_region_is_that_of_the_note():
    """VN section 3: lambda = mu/3, and the first quarter of light space takes the first 4/7 of the map."""
    region = focus_region()
    assert region.lam_over_mu == pytest.approx(1 / 3, abs=1e-3)
    assert region.focus[0, 0, 1] == pytest.approx(1 / 4, abs=1e-3)
    assert region.distant_share == pytest.approx(4 / 7, abs=1e-3)
    assert region.focus_areas[0] > 3 * region.focus_areas[1]
    assert (fraction_text(region.distant_share), fraction_text(0.0), fraction_text(0.923)) == ("4/7", "0", "0.92")
    render(focus_region_figure(data=region))


def test_focus_region_without_a_warp():
    region = focus_region(0.5, 0.4)
    assert np.isinf(region.lam_over_mu)
    np.testing.assert_allclose(region.focus[0], region.focus[1], atol=1e-12)
    render(focus_region_figure(data=region))


def undefined(sweep):
    rules = {n: dataclasses.replace(r, defined=np.zeros_like(r.defined)) for n, r in sweep.rules.items()}
    return dataclasses.replace(sweep, rules=rules)


def never_warped(sweep):
    gone = {"lam_over_mu": np.full_like(sweep.optima[0].lam, np.inf), "lam": np.full_like(sweep.optima[0].lam, np.inf)}
    rules = {name: dataclasses.replace(rule, **gone) for name, rule in sweep.rules.items()}
    ones = {name: np.ones_like(gone["lam"]) for name in sweep.rules}
    optima = tuple(dataclasses.replace(optimum, ratios=ones, **gone) for optimum in sweep.optima)
    return dataclasses.replace(sweep, rules=rules, optima=optima)


def failed(sweep):
    nan = np.full_like(sweep.optima[0].lam, np.nan)
    ratios = {name: nan for name in sweep.rules}
    return dataclasses.replace(
        sweep, optima=tuple(dataclasses.replace(o, lam_over_mu=nan, ratios=ratios) for o in sweep.optima)
    )


@pytest.mark.parametrize(
    "sweep",
    [
        synthetic_sweep(theta_deg=[60.0], metrics=("q",), norms=("3.0",)),
        synthetic_sweep(theta_deg=[0.0], metrics=("p",), norms=("1.5", "l1")),
        synthetic_sweep(views=tuple(View(1.0, 10.0 * k, 30.0) for k in range(1, 11)), metrics=("p",)),
        synthetic_sweep(metrics=("p",), norms=("inf", "l2", "l1", "3.0", "7.5", "1.25")),
        synthetic_sweep(theta_deg=np.linspace(0, 180, 19), views=(View(0.1, 1e6, 75.0),)),
        undefined(synthetic_sweep(metrics=("p",))),
        undefined(never_warped(synthetic_sweep(metrics=("p",)))),
        never_warped(synthetic_sweep(theta_deg=[45.0])),
        failed(synthetic_sweep(metrics=("p",))),
    ],
    ids=["one", "orders", "views", "norms", "mirrored", "undefined", "empty", "never", "failed"],
)
def test_odd_runs_are_drawn(sweep):
    lambdas, ratios = lambda_figure(sweep), ratio_figure(sweep)
    render(lambdas)
    render(ratios)
    assert 1 <= len(panels_of(lambdas)) <= 6
    assert 1 <= len(panels_of(ratios)) <= 12


def test_a_single_direction_is_marked():
    sweep = synthetic_sweep(theta_deg=[60.0])
    (axes,) = panels_of(lambda_figure(sweep))
    assert [line.get_markevery() for line in axes.lines if line.get_label() == "optimum p inf"] == [[0]]


@pytest.mark.parametrize("view", [View(1.0, 1.5, 5.0), View(0.01, 1e5, 80.0)])
def test_odd_frusta_are_drawn(view):
    render(error_distribution_figure(view, distributions(view, samples=8)))


def test_failed_errors_are_drawn(paper_errors):
    render(error_distribution_figure(PAPER, dataclasses.replace(paper_errors, errors=paper_errors.errors * np.nan)))


def test_captions_say_what_is_left_out():
    many = synthetic_sweep(
        views=tuple(View(1.0, 10.0 * k, 30.0) for k in range(1, 11)), norms=("inf", "l2", "l1", "3.0", "4.0")
    )
    assert (
        "4 more views with other f/n or φ are not shown. 1 more norm of the run is not shown."
        in figures._lambda_caption(many)
    )
    assert "9 more views of the run are not shown." in figures._ratio_caption(many)
    few = synthetic_sweep(norms=("inf",))
    assert "not shown" not in figures._lambda_caption(few) + figures._ratio_caption(few)
