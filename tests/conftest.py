"""The tests run in float64; the library itself never decides that.

Compiling is most of their time: they take the command line's settings for it. Commands and experiments that tests start
read what others of them have compiled; the tests themselves keep nothing, as hardly two workers compile the same.

WARPOPT_LANE=default-xla takes XLA's own settings, which are a Python user's; =single leaves float64 off; =types checks
every call's shapes and types against the signatures (the application's settings check themselves). Each runs the tests
that are named in `LANES` alone. =thorough runs what is marked so, which takes seconds to compile and repeats, for
another objective, kind or script, what a cheaper test claims; without a lane that is left out. =all runs both.
"""

import atexit
import functools
import gc
import os
import shutil
import tempfile
from pathlib import Path

import pytest

if "JAX_COMPILATION_CACHE_DIR" not in os.environ:  # workers have their parent's
    _cache = tempfile.mkdtemp(prefix="warpopt-tests-")
    atexit.register(shutil.rmtree, _cache, ignore_errors=True)
    os.environ |= {
        "JAX_COMPILATION_CACHE_DIR": _cache,
        "JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS": "0.2",  # writing what is compiled faster costs more than it saves
        "JAX_PERSISTENT_CACHE_MIN_ENTRY_SIZE_BYTES": "-1",
    }
os.environ.setdefault("TF_CPP_MIN_LOG_LEVEL", "3")  # jaxlib 0.10.1 warns at each program that it reads
os.environ.setdefault("JAX_TRACEBACK_IN_LOCATIONS_LIMIT", "0")  # of each operation's origin, which nothing here reads
os.environ.setdefault("JAX_TRACEBACK_FILTERING", "off")  # for every expected error it looks at each frame's file

LANE = os.environ.get("WARPOPT_LANE", "")
# Their files of tests; without a lane, all but the one that is theirs.
LANES = {
    "": (),
    "thorough": (),
    "all": (),
    "default-xla": ("test_lanes.py", "test_canaries.py"),
    "single": ("test_lanes.py",),
    "types": ("test_lanes.py", "test_aliasing.py", "test_closed_form.py", "test_compare_scene.py"),
}
if LANE not in LANES:
    raise pytest.UsageError(f"WARPOPT_LANE: got {LANE!r}, expected one of {list(LANES)}")
if LANE == "types":
    from jaxtyping import install_import_hook

    _parts = [path for path in (Path(__file__).parents[1] / "src/warpopt").iterdir() if path.name != "app"]
    install_import_hook([f"warpopt.{path.stem}" for path in _parts], "type_checker.checked")

from warpopt.app.common.call_stack import with_room_for_calls
from warpopt.app.common.jax_settings import prepare_jax

if LANE != "default-xla":
    prepare_jax()
    # XLA would make two or three kernels of each sum or minimum over more than 32 numbers, which takes a fifth of the
    # time of compiling here. The lane with XLA's own settings has them.
    if "disable_hlo_passes" not in os.environ["XLA_FLAGS"]:
        os.environ["XLA_FLAGS"] += " --xla_disable_hlo_passes=tree_reduction_rewriter"

import jax

jax.config.update("jax_enable_x64", LANE != "single")
jax.config.update("jax_enable_compilation_cache", False)
if LANE != "default-xla":
    # JAX makes a context of MLIR for each program, and registers hundreds of operations in it: a quarter of the time of
    # a small one, of which there are thousands. They can share one. It has no public name: a JAX without it makes many.
    from jax._src.interpreters import mlir

    if hasattr(mlir, "make_ir_context"):
        mlir.make_ir_context = functools.cache(mlir.make_ir_context)
# What JAX compiles is kept for the whole session: looking through all of it for garbage again and again took a sixth
# of the time.
gc.collect()
gc.freeze()
gc.disable()


def memory_maps(path: str) -> int:
    """The number of lines, or the number that is written, in a file of Linux's /proc; 0 elsewhere."""
    try:
        text = Path(path).read_text()
    except OSError:
        return 0
    return int(text) if text.strip().isdigit() else text.count("\n")


@pytest.fixture(autouse=True, scope="module")
def _room_for_programs():
    """Forget what is compiled where four fifths of the process's memory maps are taken.

    A program holds some of them; all of the tests' in one process, 90,000, and XLA's compiler crashes at Linux's
    default of 65,530. One file takes 8,000 at most. With two workers, of up to 47,000 maps, nothing is forgotten: that
    takes five seconds, and what is used again is compiled again.
    """
    yield
    if 5 * memory_maps("/proc/self/maps") > 4 * memory_maps("/proc/sys/vm/max_map_count") > 0:
        jax.clear_caches()


@pytest.hookimpl(tryfirst=True)
def pytest_unconfigure(config):
    """Look for garbage once, where pytest would five times.

    Not in xdist's workers, whose warnings nobody would see at this point: they leave at once. JAX would free each of
    their programs, which takes five seconds.
    """
    if hasattr(config, "workerinput"):
        os._exit(0)
    gc.unfreeze()
    gc.collect()
    gc.freeze()


def pytest_report_header():
    """What the numbers of this run stand for."""
    return f"lane: {LANE or 'float64, XLA without optimisation'}"


def pytest_ignore_collect(collection_path):
    """A lane's own files alone; the others are not even read: some make float64 as they are."""
    if not collection_path.name.startswith("test_"):
        return None
    own = LANES[LANE]
    ignored = collection_path.name not in own if own else collection_path.name == "test_lanes.py"
    return ignored or None  # False would overrule other hooks


def pytest_collection_modifyitems(config, items):
    """Where types are checked, without what gives wrong ones on purpose; what is thorough in its own lane.

    Each test has the room for calls that the command line has.
    """
    for item in items:
        item.setup, item.runtest = with_room_for_calls(item.setup), with_room_for_calls(item.runtest)
    if LANE == "types":
        others = [item for item in items if item.get_closest_marker("wrong_types")]
    elif LANE in ("", "thorough"):
        others = [item for item in items if is_thorough(item) != (LANE == "thorough")]
    else:
        return
    config.hook.pytest_deselected(items=others)
    left_out = set(others)
    items[:] = [item for item in items if item not in left_out]


def is_thorough(item) -> bool:
    """Whether a test is marked so, or this case of it is among those that its mark names."""
    mark = item.get_closest_marker("thorough")
    return mark is not None and (not mark.args or item.callspec.id in mark.args)


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_make_scheduler(config, log):
    """With -n, whole files to a worker unless --dist says otherwise: what one test compiles, the next one has.

    In their own order, at whose end are the many short ones of src: both workers finish at about the same time.
    """
    from xdist.scheduler import LoadFileScheduling

    config.option.loadscopereorder = False
    return LoadFileScheduling(config, log) if config.getoption("dist") == "load" else None
