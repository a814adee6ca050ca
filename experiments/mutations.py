"""Breaks the package at one place after another, and says which tests notice.

    PYTHONPATH=src python experiments/mutations.py                # all, some minutes of CPU time
    PYTHONPATH=src python experiments/mutations.py --only table   # of files whose path has the word

Each mutant is a copy of `src` in a temporary folder with one line changed, and the tests named beside it are run on
that copy until the first fails. A mutant that survives asks for a test, or has its reason in `EQUIVALENT`.
"""

import argparse
import os
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).resolve().parents[1]


class Mutation(NamedTuple):
    """One change of one file, and what should notice it: files of `tests/`, an expression for pytest's -k."""

    file: str
    old: str
    new: str
    tests: str
    chosen: str = ""


MUTATIONS = (
    Mutation("theory/light_frame.py", "return across / s, along / t, along / across",
             "return across / s, along / s, along / across", "shadow_matrix", "pixels_and_texels"),
    Mutation("theory/light_frame.py", "return columns / (right - left), rows / (top - bottom), t, s",
             "return rows / (right - left), columns / (top - bottom), t, s", "shadow_matrix", "pixels_and_texels"),
    Mutation("theory/light_frame.py", "parallel = sine_squared < jnp.finfo(l.dtype).eps",
             "parallel = sine_squared < 1e4 * jnp.finfo(l.dtype).eps", "shadow_matrix", "frozen or parallel"),
    Mutation("theory/light_frame.py", "jnp.where(l[2] < 0, jnp.pi, 0.0)", "jnp.where(l[2] > 0, jnp.pi, 0.0)",
             "scene_warp", "yz_plane"),
    Mutation("theory/light_space.py", "jnp.where(above, 0, -a)", "jnp.where(above, 0, a)", "aliasing"),
    Mutation("theory/light_space.py", "angle = jnp.where(mirrored, difference + rest,",
             "angle = jnp.where(mirrored, difference,", "aliasing"),
    Mutation("theory/light_space.py", "return jnp.log1p(self.depth_range)", "return jnp.log(self.far / self.near)",
             "lower_bound", "thin"),
    Mutation("theory/light_space.py", "range(7, 0, -1)]", "range(3, 0, -1)]", "aliasing"),
    Mutation("theory/light_space.py", "space.b + near_span * (1 - u), mu)", "space.b + near_span * u, mu)",
             "aliasing"),
    Mutation("theory/aliasing.py", "smaller((1 + space.depth_range) * near.blend(eta), far.blend(eta))",
             "far.blend(eta)", "aliasing"),
    Mutation("theory/aliasing.py", "jnp.sin(theta) - ky * jnp.cos(theta)", "jnp.sin(theta) + ky * jnp.cos(theta)",
             "aliasing"),
    Mutation("theory/aliasing.py", "(2 * half_width * blend)", "(half_width * blend)", "aliasing"),
    Mutation("theory/warp.py", "warp.mu * warp.eta + shift * warp.one_minus_eta",
             "warp.mu * warp.eta - shift * warp.one_minus_eta", "warp"),
    Mutation("theory/warp.py", "<= 16 * eps * jnp.abs(start) + 4 * eps * mu", "<= 0 * mu", "warp"),
    Mutation("theory/warp.py", "return -jnp.log(self.eta) / jnp.log1p", "return jnp.log(self.eta) / jnp.log1p",
             "rules engine_rules warp"),
    Mutation("theory/camera.py", "jnp.stack([x, y, one]) for x in (left, right) for y in (bottom, top)",
             "jnp.stack([x, y, one]) for x in (left, right) for y in (-top, top)", "receivers", "boundary"),
    Mutation("theory/light_frame.py", "jnp.ones_like(z) if self.is_orthographic else z", "z", "orthographic"),
    Mutation("receivers/footprint.py", "(sides.depth, sides.farthest, right, left)",
             "(sides.farthest, sides.farthest, right, left)", "receivers depth_buffer", "excess or cells"),
    Mutation("receivers/footprint.py", "jnp.where(largest < 0, largest, jnp.where(least > 0, least, 0))",
             "jnp.zeros_like(least)", "scene_warp", "brute_force"),
    Mutation("receivers/footprint.py", "flat = ~(end - start > 4 * jnp", "flat = ~(end - start > 0 * jnp",
             "receivers", "flat"),
    Mutation("receivers/moments.py", "[math.comb(M, j) * value for j, value in enumerate(sums)]",
             "[value for j, value in enumerate(sums)]", "scene_warp", "brute_force"),
    Mutation("receivers/points.py", "return points, seen_from(camera, points)",
             "return points, jnp.ones(len(points), bool)", "receivers", "does_not_see"),
    Mutation("receivers/points.py", "slack = 64 * jnp", "slack = 0 * jnp", "receivers", "boundary"),
    Mutation("receivers/bins.py", "_FINEST = 1e-4", "_FINEST = 1e-1", "receivers", "bins_are"),
    Mutation("receivers/bins.py", "for side in (largest - axis, axis - least)",
             "for side in (axis - least, largest - axis)", "receivers", "exact or boundary or buffer"),
    Mutation("receivers/bodies/convex_body.py", "else 1 - objective.volume_exponent", "else -objective.volume_exponent",
             "receivers", "exact or holds"),
    Mutation("solve/scene.py", "values = every.unwarped.at[0].set(every.value[0])", "values = every.value",
             "steady_axes"),
    Mutation("receivers/bodies/whole_frustum.py", "jnp.where(least > 0, n * least, f * least)", "n * least",
             "shadow_matrix", "texture or round_trip"),
    Mutation("receivers/depth_histogram.py", "counts = self.counts * jnp.diff(edges) / jnp.diff(whole)",
             "counts = self.counts", "receivers", "histogram"),
    Mutation("receivers/polytope.py", "tolerance = 64 * eps * reach", "tolerance = 0 * eps * reach", "receivers",
             "without_thickness"),
    Mutation("receivers/bodies/frustum_moments.py", "jnp.where(x < 1, jnp.expm1(growth * L)",
             "jnp.where(x < 0, jnp.expm1(growth * L)", "optimum", "thin"),
    Mutation("receivers/bodies/frustum_moments.py", "ratio = 1 / ((1 + x) * sigma)",
             "ratio = 1 / ((1 + 2 * x) * sigma)", "optimum", "l2"),
    Mutation("solve/power_mean.py", "helps = rise > 4 * len(top[0])", "helps = rise > 0 * len(top[0])",
             "optimum", "flat"),
    Mutation("solve/power_mean.py", "at_kink = under & (below <= 0)", "at_kink = under & (below < -1e300)", "optimum",
             "l2"),
    Mutation("solve/sign_change.py", "mostly_b = b >= geometric", "mostly_b = b >= 0", "closed_form", "quadratics"),
    Mutation("solve/sign_change.py", "falling = c1 <= 0", "falling = c1 <= 1e300", "closed_form"),
    Mutation("solve/pieces.py", "Outcome.kink, Outcome.tie), Outcome.stationary)",
             "Outcome.tie, Outcome.tie), Outcome.stationary)",
             "scene_warp", "yz_plane"),
    Mutation("solve/pieces.py", "met = met & (slopes[0] <= 0) & (slopes[2] >= 0)",
             "met = met & (slopes[0] <= 0)", "scene_warp receivers", "brute_force or yz or excess"),
    Mutation("solve/pieces.py", "curvatures[1] > eps**0.5)", "curvatures[1] > 1e300)", "means", "differences"),
    Mutation("solve/scene.py", "value / jnp.where(least > 0, least, 1) - 1", "0 * value", "receivers depth_buffer",
             "excess or cells or pixels"),
    Mutation("bound/frustum.py", "return (space.b + space.a_minus) * L", "return (space.b - space.a_minus) * L",
             "lower_bound", "raw_geometry"),
    Mutation("bound/frustum.py", "middle = space.b * (log_length * decay((Q * root - 1) * log_length))",
             "middle = space.b * (log_length * decay(Q * root * log_length))", "lower_bound", "l_p or raw_geometry"),
    Mutation("bound/frustum_map.py", "first = tuple(a_minus * v for v in at_far)",
             "first = tuple(b * v for v in at_far)", "lower_bound", "map_s_limit"),
    Mutation("render/map_depth.py", "jnp.where(some & (before < own), before, own)", "own", "map_depth"),
    Mutation("render/map_depth.py", "some & (nearest.height < 0)", "some & (nearest.height < -1e30)", "map_depth"),
    Mutation("render/casters.py", "jnp.where(across > 0, high / width, low / width)", "high / width", "map_depth"),
    Mutation("render/shadow_matrix.py", "jnp.ones_like(mu), 1 - 2 * pad_s, jnp", "jnp.ones_like(mu), 1 - pad_s, jnp",
             "shadow_matrix"),
    Mutation("render/map_depth.py", "jnp.where(self.there | ~some, (self.end", "jnp.where(True, (self.end", "map_depth"),
    Mutation("solve/closed_form.py", "shrunk * share * space.a_plus", "share * space.a_plus", "ends"),
    Mutation("render/shadow_matrix.py", "y = -1 if clip_space.y_down else 1", "y = 1", "shadow_matrix"),
    Mutation("table/build/verify.py", "for _ in range(_ROUNDS):", "for _ in range(0):", "table", "spike"),
    Mutation("table/build/verify.py", "np.maximum(in_precision(np.float64, points), in_precision(np.float32, rounded))",
             "in_precision(np.float64, points)", "table", "promise or steep"),
    Mutation("table/lookup.py", "share = high * (between", "share = low * (between", "table", "far_near"),
    Mutation("table/build/heights.py", "for rising in (other - one, one - other)",
             "for rising in (other - one, other - one)", "table", "slope"),
    Mutation("table/build/tolerance_band.py", "upper = jnp.where(open_end, jnp.inf,",
             "upper = jnp.where(open_end, 1.0,", "table", "tolerance_band_ends"),
    Mutation("table/build/slope.py", "_ALLOWED = 1.1", "_ALLOWED = 1.4", "table", "slope"),
    Mutation("table/build/polyline.py", "least = np.maximum.accumulate(", "least = np.asarray(", "table", "fewest"),
    Mutation("theory/texel.py", "return larger(e_p * jnp.sqrt(1 + sigma * sigma), e_q)", "return larger(e_p, e_q)",
             "means", "brute or parabola"),
    Mutation("theory/texel.py", "ends / 4 + (middle * middle) / (4 * safe) +", "ends / 4 +", "means", "offset"),
    Mutation("theory/texel.py", "small = t < 0.05", "small = t < 0.9", "means", "offset"),
    Mutation("theory/texel.py", "highest = 1 - 4 * jnp.finfo(ends.dtype).eps", "highest = 1", "means", "offset"),
    Mutation("receivers/weighted/cells.py", "/ _positive(weight.sum())", "/ 1", "means", "brute"),
    Mutation("receivers/weighted/cells.py", "finer = Sides(first, last,", "finer = Sides(last, last,", "means",
             "holds_every"),
    Mutation("receivers/weighted/cells.py", "* (1 - 2.0**-23) - _OFFSET", "- _OFFSET", "means", "in_its_bin"),
    Mutation("receivers/weighted/cells.py", "both - first * lateral - inner * delta",
             "both - first * delta - inner * lateral", "means", "cells"),
    Mutation("receivers/weighted/cells.py", "across = (x - axis) *", "across = x *", "means", "holds_every"),
    Mutation("receivers/weighted/weights.py", "counted = seen if self.lit is None else seen & self.lit",
             "counted = seen", "means", "weights_by_depth"),
    Mutation("receivers/weighted/weights.py", "jnp.where(none, jnp.where(instead, z, 0), weights)", "weights", "means",
             "without_any"),
    Mutation("receivers/weighted/weights.py", "jnp.where(counted.any(), counted, seen)", "seen", "means", "fallback"),
    Mutation("solve/means/sample_norm.py", "((1 - eta) * self.pixel_ratio)", "(1 - eta)", "means", "square"),
    Mutation("solve/means/sample_norm.py", "bend = bend - self.across *", "bend = bend - 0.5 * self.across *", "means",
             "bends_down"),
    Mutation("solve/means/sample_norm.py", "(rise * before).sum()",
             "(rise * part.depth.one_minus_delta).sum()", "means",
             "plateau"),
    Mutation("solve/means/sample_norm.py", "concave = -lean_rise *", "concave = 0 * lean_rise *",
             "edge_directions", "curve"),
    Mutation("solve/means/cell_bounds.py", "jnp.stack([1 - u - v + uv, v - uv])",
             "jnp.stack([1 - u - v + uv, u - uv])", "means", "cells"),
    Mutation("solve/means/cell_bounds.py", "* (falling + rest)).sum()", "* (0 * falling + rest)).sum()",
             "means", "centroid"),
    Mutation("solve/means/cell_bounds.py", "most = larger(most, norm.mean(eta))", "most = most",
             "means", "centroid"),
    Mutation("theory/texel.py", "most / 4 + least * least / (12", "most / 4 + least * least / (13",
             "edge_directions", "offset"),
    Mutation("theory/light_frame.py", "return jnp.stack([along / height, across / length])",
             "return jnp.stack([across / length, along / height])", "edge_directions", "screen_axes"),
    Mutation("receivers/weighted/cells.py", "jnp.where((along < 0) ^ (across < 0), -beside, beside)", "beside",
             "edge_directions", "brute"),
    Mutation("receivers/weighted/cells.py", "for each in there])\n    chosen = jnp.argmax(counts <= room)",
             "for each in there])\n    chosen = len(lists) - 1", "means", "noise"),
    Mutation("receivers/weighted/cells.py", "number - before[chosen] - 1, room)", "number - 1, room)", "parallel",
             "compacted"),
    Mutation("receivers/weighted/cells.py", "cells[first + which]", "cells[which]", "parallel", "compacted"),
    Mutation("solve/means/weak_convexity.py", "(order == best) | (order == best - 1)", "order == best", "parallel",
             "bracket"),
    Mutation("solve/means/weak_convexity.py", "(ratio - 1) / _PARTS", "(ratio - 1) / (2 * _PARTS)", "parallel",
             "bracket"),
    Mutation("theory/light_frame.py", "deep * fixed[0] - right * fixed[2]", "deep * fixed[0]", "shadow_matrix",
             "parallel"),
    Mutation("render/edge_weights.py", "right * right - up * up, 2 * right * up", "right * right - up * up, right * up",
             "edge_directions", "normals"),
    Mutation("solve/means/weak_convexity.py", "TOLERANCE = 1e-6", "TOLERANCE = 1e-4", "means", "brute"),
    Mutation("solve/means/weak_convexity.py", "jnp.minimum(at(meeting), ", "(", "means", "bound or minima"),
    Mutation("solve/means/weak_convexity.py", "falling = left.slope - (left.bend +",
             "falling = left.slope - 0 * (left.bend +", "means", "between_nodes"),
    Mutation("solve/means/weak_convexity.py", "jnp.where(i > 0, nodes[i - 1], 0)", "nodes[i]", "means",
             "brute or differences"),
    Mutation("solve/means/weak_convexity.py", "nodes[jnp.minimum(i + 1, room - 1)]", "nodes[i]", "means",
             "brute or differences"),
    Mutation("solve/means/cell_bounds.py", "most = corner_mean(norm, eta)", "most = norm.touch(eta).value", "means",
             "centroid"),
    Mutation("solve/means/cell_bounds.py", "near.bounds.min() - covariance_loss(norm, low, high)", "near.bounds.min()",
             "means", "centroid"),
    Mutation("solve/means/sample_optimum.py", "least_sum, 0) ** (1 / norm.order)", "least_sum, 0)", "means", "brute"),
    Mutation("receivers/depth_histogram.py", "_DEGREE_WITH_KINKS = 22", "_DEGREE_WITH_KINKS = 0", "means", "histogram"),
    Mutation("receivers/depth_histogram.py", "[:, None] * w * weights * share", "[:, None] * w * share", "means",
             "histogram"),
    Mutation("receivers/depth_histogram.py", "objective, own_sides=True)", "objective)", "means", "histogram"),
    Mutation("render/edge_weights.py", "(one != other) & both[0] & both[1]", "(one != other)", "edge_weights",
             "background"),
    Mutation("render/edge_weights.py", "in ((1, 0), (0, 1)):\n            pad =", "in ((1, 0),):\n            pad =",
             "edge_weights", "both_sides"),
    Mutation("render/edge_weights.py", "before = at[..., 2] >= last_camera.near", "before = at[..., 2] == at[..., 2]",
             "edge_weights", "behind"),
    Mutation("render/edge_weights.py", "turn = -turn if rendered", "turn = turn if rendered", "edge_weights",
             "shadows"),
    Mutation("render/edge_weights.py", "reached = faces & (", "reached = (", "edge_weights", "shadows"),
    Mutation("render/edge_weights.py", "(depth - bias <= stored)", "(depth <= stored)", "edge_weights", "shadows"),
    Mutation("render/edge_weights.py", "bias = _widest(jnp.where(seen & faces, bias, 0))", "bias = bias",
             "edge_weights", "shadows"),
    Mutation("render/edge_weights.py", "jnp.abs(by_t) * dt + _QUANTA", "jnp.abs(by_t) * dt", "edge_weights", "acne"),
    Mutation("render/edge_weights.py", "_UNKNOWN = 0.02", "_UNKNOWN = 0.0", "edge_weights", "without_a_neighbour"),
    Mutation("render/edge_weights.py", "(before, smooth_before) = towards(1), towards(-1)",
             "(before, smooth_before) = towards(1), towards(1)", "edge_weights", "shadows"),
    Mutation("render/edge_weights.py", "row = (top - at[..., 1] / z)",
             "row = (at[..., 1] / z - bottom)", "edge_weights", "carried"),
    Mutation("theory/light_frame.py", "z_axis = cosine * self.z_axis + sine * self.x_axis",
             "z_axis = cosine * self.z_axis - sine * self.x_axis", "directions", "area or level"),
    Mutation("theory/direction.py", "unit) ** -2", "unit) ** -1", "best_direction", "gradient_and"),
    Mutation("theory/ground.py", "/ safe_steepness", "", "directions", "level"),
    Mutation("receivers/footprint.py", "jnp.where(least > 0, least, jnp.where(most < 0, most, 0))", "least",
             "directions", "many_axes"),
    Mutation("receivers/footprint.py", "return self.m1 + (x - self.m0", "return (x - self.m0", "directions", "shear"),
    Mutation("receivers/free_fit.py", "chord = jnp.where(there, upper - lower, 0)",
             "chord = jnp.where(there, upper - least, 0)", "directions", "linear_program or storage_has"),
    Mutation("receivers/profiles/nearness.py", "(-1.0 if light[2] > 0 else 1.0)", "(1.0 if light[2] > 0 else -1.0)",
             "directions", "bodies"),
    Mutation("receivers/profiles/nearness.py", "(area - finer)[occupied]", "(area + 0 * finer)[occupied]", "directions",
             "points_stand"),
    Mutation("receivers/sketch.py", "(size * up).sum(0)", "(size * up * up).sum(0)", "best_direction", "sums_of"),
    Mutation("bound/frustum.py", "2 * (space.b + space.a_minus) + 4 * space.slope", "2 * space.b + 4 * space.slope",
             "directions", "bodies"),
    Mutation("solve/footprint_optimum.py", "if self.summed or len(self.terms) == 1:", "if len(self.terms) == 1:",
             "directions", "storage_has"),
    Mutation("solve/scene.py", "kept.value > view.turn_only_if * turned.value", "kept.value > turned.value",
             "best_direction", "gains_enough"),
    Mutation("solve/directions.py", "jnp.where(slope < 0, middle, low), jnp.where(slope < 0, high, middle)",
             "jnp.where(slope < 0, low, middle), jnp.where(slope < 0, middle, high)", "best_direction", "max_with"),
    Mutation("compare/over_scene.py", "footprint = footprint_of(seen.receivers, seen.camera, ahead, objective)",
             "pass", "best_direction", "rules_are"),
    Mutation("stable/pencil.py", "(square.t[0] + square.t[1] - 1) / 2", "(square.t[0] + square.t[1]) / 2", "stable"),
    Mutation("stable/pencil.py", "(length * largest)", "largest", "stable"),
    Mutation("stable/pencil.py", "self.one_minus_eta * length / before", "self.one_minus_eta / before", "stable"),
    Mutation("stable/pencil.py", "kept < low, forward, jnp.where(kept > high, backward, kept)",
             "kept < low, backward, jnp.where(kept > high, forward, kept)", "stable", "free_texels"),
    Mutation("stable/pencil.py", "high = jnp.minimum(jnp.floor(least - padding + slack), limit)",
             "high = jnp.floor(least - padding + slack)", "stable export_window"),
    Mutation("stable/pencil.py", "jnp.broadcast_to(x, (2, len(x)))", "x.reshape(2, -1).repeat(2, 1)", "stable",
             "texels_stay"),
    Mutation("stable/pencil.py", "return row - (row[:3] @ light) / (plane[:3] @ light) * plane",
             "return row - (row[:3] @ light) * plane", "stable", "anchor"),
    Mutation("stable/pencil.py", "first = jnp.minimum(first, above)", "pass", "stable", "casters"),
    Mutation("stable/loss.py", "e_q = frame.density_q * blend / (placed.across * z)",
             "e_q = frame.density_q / (placed.across * z)", "stable", "loss_is"),
    Mutation("stable/loss.py", "longer = jnp.log(end) * 2 +", "longer = jnp.log(end) +", "stable", "loss_is"),
    Mutation("stable/steps.py", "must = (reason != Reason.FITS) & ~empty", "must = reason != Reason.FITS", "stable"),
    Mutation("stable/steps.py", "due & (fit.loss > window.tolerance) & jnp.asarray(may_refit)",
             "due & (fit.loss > window.tolerance)", "stable", "refit"),
    Mutation("stable/steps.py", "pencil = state.pencil.cropped(square).about(eye)", "pencil = state.pencil.about(eye)",
             "stable", "single_precision"),
    Mutation("stable/steps.py", "(moved > window.jump * pencil.size, Reason.JUMP)", "(moved < 0, Reason.JUMP)",
             "stable", "refit"),
    Mutation("stable/steps.py", "pencil.along - shares[1] * blend", "pencil.along - shares[0] * blend", "stable"),
    Mutation("export/splits.py", "float piece = (whole - (count - 1.0f) * band) / count;",
             "float piece = whole / count;", "export_splits"),
    Mutation("export/splits.py", "found = log(sum) * (x / rest);", "found = log(sum);", "export_splits", "count"),
    Mutation("export/splits.py", "&& count == floor(count)", "&& count == count", "export_splits", "no_cascades"),
    Mutation("cascades/splits.py", "z.at[..., 1:-1].add(near[..., None] * (1 - z[..., 1:-1] / far[..., None]))", "z",
             "cascades", "engines_split_where"),
    Mutation("app/cascades/run.py", "(i, k): under_light(view, k)", "(i, k): under_light(view, 0)", "cascades_command",
             "path"),
    Mutation("app/cascades/screen.py", "made = np.where(number == k,", "made = np.where(number >= 0,",
             "cascades_command", "screen"),
    Mutation("app/cascades/numbers.py", "np.maximum(made[1:-1] * (1 - asked.overlap), made[0])", "made[:-2]",
             "cascades_command", "frustum"),
    Mutation("cascades/splits.py", "stays = (jnp.abs(off) < 1)", "stays = (jnp.abs(off) < 0.5)", "cascades", "steps"),
    Mutation("cascades/over_frustum.py", "(warps.start * scale, warps.mu * scale)", "(warps.start, warps.mu * scale)",
             "cascades", "one_solve"),
    Mutation("cascades/over_scene.py", "given = first | (numbers == count - 1)", "given = first", "cascades",
             "exhaustive"),
    Mutation("cascades/over_scene.py", "jnp.where(below, at, state.farthest)", "at", "cascades", "exhaustive"),
    Mutation("render/sphere_fit.py", "middle = jnp.minimum((far + near) * (1 + growth) / 2, far)", "middle = far",
             "sphere_fit"),
    Mutation("render/sphere_fit.py", "jnp.floor((centre - radius) / texel) * texel", "centre - radius", "sphere_fit",
             "moving"),
    Mutation("render/sphere_fit.py", "texel = 2 * radius / (texels - 1)", "texel = 2 * radius / texels", "sphere_fit"),
    Mutation("frames/cascaded_map.py", "np.searchsorted(np.array(self.ends)[there], depth)", "0 * depth.astype(int)",
             "frame_cascades", "reads"),
    Mutation("frames/cascade_fits.py", "round(side / np.sqrt(count))", "side", "frame_cascades", "library_s_plan"),
    Mutation("frames/methods.py", "_, part = view.receivers.between(view.camera, start, end)", "part = view.receivers",
             "frame_cascades"),
    Mutation("export/window.py", "low + floor(ahead * (high - low) + 0.5f)", "low", "export_window"),
    Mutation("scene_files/poses/gltf_animation.py", "span * (t**3 - t**2) * values[i + 1, 0]",
             "(t**3 - t**2) * values[i + 1, 0]", "stable_commands", "animation"),
    Mutation("export/ground.py", "float room = half_last * (eta - first / last);", "float room = 0.0f;",
             "export_ground", "library"),
    Mutation("theory/light_space.py", "over(share * space.a_minus + near_span * u, mu)",
             "(share * space.a_minus + near_span * u) / mu", "ends", "edge_of_the_view"),
    Mutation("solve/closed_form.py", "over(larger(top, 0), bottom)", "larger(top, 0) / bottom", "ends",
             "edge_of_the_view"),
    Mutation("receivers/bodies/convex_body.py", "valid.any() & (jnp.log(", "~valid.any() & (jnp.log(",
             "ends", "right_or_say"),
    Mutation("receivers/bodies/convex_body.py", "along = depths if flat_view else jnp.log(depths)",
             "along = jnp.log(depths)", "orthographic", "means_over_bodies"),
    Mutation("receivers/sketch.py", "slope.at[:, 2].set(z) for", "slope * z[:, None] for", "orthographic",
             "rectangles"),
    Mutation("receivers/sketch.py", "points[:, :2] / size[:, None]", "points[:, :2] / z[:, None]", "orthographic",
             "rectangles"),
    Mutation("receivers/sketch.py", "own * power(unit / size, exponent)", "share * power(unit / z, exponent)",
             "orthographic", "keep_the_sums"),
    Mutation("receivers/profiles/hulls.py", "np.ones(len(vertices)) if frame.is_orthographic else vertices[:, 2]",
             "vertices[:, 2]", "orthographic", "better_than_none"),
    Mutation("receivers/profiles/slices.py", "(0.0, 0.0) if frame.is_orthographic else (order + exponent, exponent)",
             "(order + exponent, exponent)", "orthographic", "hoelder"),
    Mutation("receivers/profiles/slices.py", "size = unit if frame.is_orthographic else 1", "size = 1", "orthographic",
             "hoelder"),
    Mutation("receivers/profiles/nearness.py", "areas.sum() / 2 if parallel", "areas.sum() if parallel", "orthographic",
             "better_than_none"),
    Mutation("receivers/receivers.py", "(float(camera.window[3] - camera.window[2]) if camera.is_orthographic else 1)",
             "1", "orthographic", "hoelder"),
    Mutation("solve/scene.py", "best_known = frame.is_orthographic and objective.supremum",
             "best_known = frame.is_orthographic", "orthographic", "means_are"),
    Mutation("compare/over_scene.py", "not parallel or rule is KNOWN", "True or rule is KNOWN", "orthographic",
             "no_eye"),
    Mutation("frames/shadow_map.py", "if camera.is_orthographic:", "if False:", "orthographic_frames", "step"),
    Mutation("scene_files/scene_camera.py", "return eye[..., :2] if self.is_orthographic else", "return",
             "orthographic_frames", "again"),
    Mutation("scene_files/scene_camera.py", "(flat, ahead + 0 * flat) if self.is_orthographic else", "",
             "orthographic_frames", "truth"),
    Mutation("solve/scene.py", "& ~(warped | own)", "& (chosen != 0)", "steady_axes"),
    Mutation("app/scene/solve.py", "seen = seen.along(one.solution) if view.searched else seen", "pass", "steady_axes"),
    Mutation("app/scene/solve.py", 'if needed and self.row["matrix"] is None else None', "if False else None",
             "scene_casters", "without_a_matrix"),
    Mutation("app/common/record.py", "str(value) if isinstance(value, float) and not math.isfinite(value) else value",
             "value", "scene_casters", "without_ends"),
    Mutation("app/common/settings.py", "near * LARGEST_RATIO < value < math.inf", "False", "cli"),
    Mutation("render/casters.py", "there & small, there & ~small", "there & small, there & False", "map_depth",
             "far_as"),
    Mutation("render/hull.py", "return ConvexHull(centred).simplices", "return ConvexHull(centred).simplices[:-4]",
             "map_depth", "hull"),
    Mutation("render/hull.py", "[along.argmin(), along.argmax(), along.argmax()]", "[0, 0, 0]", "map_depth", "hull"),
    Mutation("render/hull.py", "around[0], *pair", "around[0], *pair[:1], pair[0]", "map_depth", "hull"),
    Mutation("theory/warp.py", "warp.defined & before, warp.promised)", "warp.defined & before)", "table", "promise"),
    Mutation("export/closed_form.py", "{ c = sqrt(z_near) / sqrt(z_far); }", "{ c = sqrt(ratio); }", "export",
             "closed_forms"),
    Mutation("export/closed_form.py", "    if (z_far <= $LARGEST) {\n", "    if (z_far <= $NO_WARP) {\n", "export",
             "closed_forms"),
    Mutation("cascades/chain.py", "np.stack(np.triu_indices(count), 1)", "np.stack(np.triu_indices(count, 2), 1)",
             "cascades", "exhaustive or means"),
    Mutation("cascades/chain.py", "best[..., :, None] + weights[k] * table", "best[..., :, None] + table",
             "cascades_ends", "coarser"),
    Mutation("cascades/chain.py", "np.linspace(-1, 1, _FINER)", "np.linspace(0, 1, _FINER)", "cascades", "means"),
    Mutation("cascades/over_scene.py", "np.where(at <= at[0], 0, weight)", "weight",
             "cascades", "exhaustive"),
    Mutation("cascades/over_frustum.py", "jnp.where(target > least, high, 0)", "high", "cascades", "shares"),
    Mutation("cascades/over_frustum.py", "target = level[..., None] + log_scale", "target = level[..., None]",
             "cascades", "shares"),
    Mutation("receivers/sketch.py", "sums, mass = self.sums, self.sums.mass.sum()",
             "sums, mass = self.sums, self.sums.weight.sum()", "cascades_ends", "many_pixels"),
    Mutation("cascades/plan.py", "jnp.where(ends > own, jnp.maximum(starts, first), own)",
             "jnp.maximum(starts, first)", "cascades_ends", "no_length"),
    Mutation("cascades/plan.py", "jnp.where(one, finest, splits[1:] > splits[:-1])", "splits[1:] > splits[:-1]",
             "cascades_ends", "one_depth"),
    Mutation("cascades/over_scene.py", "place = 0.5 if apart else", "place = 0.5 if True else", "cascades_ends",
             "bands"),
    Mutation("cascades/over_frustum.py", "jnp.maximum(ends[-1] + band, 0)", "(ends[-1] + band)", "cascades_ends",
             "unequal"),
    Mutation("cascades/chain.py", "jnp.where(jnp.isnan(costs), jnp.inf, costs)", "costs", "cascades_ends", "beyond"),
    Mutation("app/cascades/numbers.py", "self.price * np.arange(1, len(values) + 1)", "0", "cascades_command", "price"),
    Mutation("app/compare/splits.py", "under_light(view, k)", "under_light(view, 0)", "compare_splits"),
    Mutation("app/splits/plans.py", "camera.near < near * (1 - 1e-9) or", "False and", "compare_splits"),
    Mutation("app/splits/plans.py", "for warp in both)", "for _ in both for warp in (True,))", "compare_splits"),
)  # fmt: skip

EQUIVALENT = {
    ("receivers/polytope.py", "tolerance = 0 * eps * reach"): (
        "a corner ends several edges, and rounding spares one of them in every pose tried (squares, lines, points)"
    ),
    ("render/map_depth.py", "jnp.where(True, (end"): (
        "a group without receivers is at delta = 0 with the least l . c, and a receiver at delta = 0 has no less"
    ),
    ("solve/pieces.py", "met = met & (slopes[0] <= 0)"): (
        "the root finder ends where the slope turns positive, so that the piece above rises"
    ),
}
"""(file, new text) of mutants that nothing can notice, and why."""


def mutated(mutation: Mutation, folder: Path) -> None:
    """A copy of the sources with the change, which must be in the file exactly once."""
    shutil.copytree(ROOT / "src", folder, ignore=shutil.ignore_patterns("__pycache__"))
    path = folder / "warpopt" / mutation.file
    text = path.read_text(encoding="utf-8")
    if text.count(mutation.old) != 1:
        raise SystemExit(f"{mutation.file}: got {text.count(mutation.old)} of {mutation.old!r}, expected one")
    path.write_text(text.replace(mutation.old, mutation.new), encoding="utf-8")


def noticed(mutation: Mutation, cache: Path) -> tuple[bool, str]:
    """Whether a test fails on the mutant, and which."""
    with tempfile.TemporaryDirectory() as temporary:
        source = Path(temporary) / "src"
        mutated(mutation, source)
        files = [f"tests/test_{name}.py" for name in mutation.tests.split()]
        command = [sys.executable, "-m", "pytest", "-x", "-q", "-p", "no:cacheprovider", *files]
        command += ["-k", mutation.chosen] if mutation.chosen else []
        environment = {**os.environ, "PYTHONPATH": str(source), "PYTHONDONTWRITEBYTECODE": "1", "WARPOPT_LANE": "all"}
        # What the mutant does not touch is compiled once for all of them.
        environment |= {"JAX_COMPILATION_CACHE_DIR": str(cache), "JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS": "0.05"}
        done = subprocess.run(command, cwd=ROOT, env=environment, capture_output=True, text=True)
    if done.returncode == 5:
        raise SystemExit(f"{mutation.file}: got no test in {mutation.tests!r} for {mutation.chosen!r}, expected some")
    if done.returncode not in (0, 1):
        return True, f"pytest ended with {done.returncode}: {done.stdout.strip().splitlines()[-1:]}"
    failed = [line for line in done.stdout.splitlines() if line.startswith(("FAILED", "ERROR"))]
    name = failed[0].split("::", 1)[1].split(" - ")[0] if failed else ""
    return done.returncode == 1, name


def main(arguments: list[str] | None = None) -> int:
    """The table; the exit status is the number of survivors without a reason."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--only", default="", help="mutate files whose path has this")
    parser.add_argument("--first", type=int, default=0, help="begin with the mutation of this number")
    options = parser.parse_args(arguments)
    survivors = 0
    with tempfile.TemporaryDirectory() as cache:
        for number, mutation in enumerate(MUTATIONS):
            if options.only not in mutation.file or number < options.first:
                continue
            start = time.perf_counter()
            killed, by = noticed(mutation, Path(cache))
            reason = EQUIVALENT.get((mutation.file, mutation.new))
            survivors += not killed and reason is None
            verdict = f"killed by {by}" if killed else f"survived: {reason or 'no test notices'}"
            took = time.perf_counter() - start
            print(
                f"{number:2} {mutation.file}: {mutation.old} -> {mutation.new}\n   {verdict} ({took:.0f} s)", flush=True
            )
    return survivors


if __name__ == "__main__":
    raise SystemExit(main())
