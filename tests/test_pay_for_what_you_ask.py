"""What a scene does not ask for is not imported, not generated, not evaluated."""

from __future__ import annotations

import importlib.util
import json
import subprocess
import sys

import pytest

PROBE = """
import json, sys
from contimpact.segments.kernels import Kernels
from contimpact.orbits import problem
counts = {}
def counted(owner, name):
    function = getattr(owner, name)
    def wrapper(*given, **named):
        counts[name] = counts.get(name, 0) + 1
        return function(*given, **named)
    setattr(owner, name, wrapper)
counted(problem.OrbitProblem, "evaluate")
counted(problem.OrbitProblem, "second_along")
counted(problem, "interior_touches")
given = json.loads(sys.argv[1])
from contimpact.results.scene import read_scene
scene = read_scene(given)
from contimpact.diagrams.explore import follow
diagram = follow(scene)
kernels = diagram.statistics["kernels"]
print(json.dumps({
    "modules": sorted(sys.modules), "loaded": sorted(kernels["loaded"]),
    "generated": kernels["generated"], "counts": counts, "points": diagram.statistics["counts"],
}))
"""

ALWAYS = {"setup", "harmonics", "flight_B_T", "flight_T_B", "motion_B", "motion_T"}
FOR = {
    "grazing": {"flight_B_B"}  # from an impact to a touch at the same wall
}
"""The kernels that events need beyond those of a branch."""

HEAVY = (
    "sympy",
    "mpmath",
    "matplotlib",
    "pandas",
    "scipy",
    "llvmlite",
    "hypothesis",
    "flint",
    "heyoka",
)
OWN_HEAVY = (
    "accuracy",
    "certificates",
    "page",
    "plots",
    "simulation",
    "diagrams.curve_problem",
    "diagrams.curves",
    "diagrams.map_lines",
    "diagrams.arrangement",
    "diagrams.areas",
    "diagrams.map_explorer",
    "diagrams.scene_simulation",
    "segments.machine_code",
    "diagrams.chain_backend",
    "diagrams.orbit_program",
    "orbits.cyclic_chain",
    "segments.checking",
    "models.equations",
    "models.symbolic",
    "results.formats",
    "segments.balls",
    "segments.codegen",
    "systems.oscillator",
)
"""Parts of the package that following an orbit of the impact pair has no use for."""

OF_RESULTS = ("results.catalogue", "cli", "results.diagram_reading")
"""Parts that only the command needs."""

RECORDS = (
    "results.branch",
    "results.diagram",
    "results.diagram_reading",
    "results.curve",
    "results.catalogue",
    "results.result_folder",
    "results.quantities",
    "results.formats",
)
"""What holds results; reading a scene needs none of it."""

RARE = (
    "asyncio",
    "difflib",
    "email",
    "http",
    "importlib.metadata",
    "multiprocessing",
    "numpy.fft",
    "numpy.f2py",
    "numpy.ma",
    "numpy.polynomial",
    "numpy.testing",
    "subprocess",
    "unittest",
)
"""What the standard library and NumPy have for rare cases, unless NumPy itself imports it."""


def scene(events, switch=(), **follow):
    """1:1 is stable at the start; where no orbit that is asked for attracts, some are simulated."""
    return {
        "name": "frugal",
        "model": {
            "system": "impact-pair",
            "parameters": {"beta": "pi/6", "r": 0.3, "A": 5.0, "s": 0.39},
        },
        "follow": {
            "parameter": "s",
            "range": [0.3, 0.4],
            "orbits": ["1:1"],
            "switch": list(switch),
            **follow,
        },
        "detect": {"events": list(events)},
    }


def own(*names):
    return [f"contimpact.{name}" for name in names]


def among(modules, packages):
    """The modules that are one of the packages or in it."""
    return [m for m in modules if any(m == p or m.startswith(f"{p}.") for p in packages)]


def imported(code, *arguments):
    """The modules that a fresh interpreter has imported when it has run some code."""
    code += "\nimport json, sys\nprint(json.dumps(sorted(sys.modules)))"
    done = subprocess.run(
        [sys.executable, "-c", code, *arguments], capture_output=True, text=True, check=True
    )
    return json.loads(done.stdout.splitlines()[-1])


def run(given):
    done = subprocess.run(
        [sys.executable, "-c", PROBE, json.dumps(given)], capture_output=True, text=True, check=True
    )
    return json.loads(done.stdout)


@pytest.fixture(scope="module")
def measured():
    """Scenes run with a warm cache: one that asks for everything has been run before."""
    known = {}
    run(scene(("V", "T", "G", "FB", "PD", "BP"), ("G",), depth=1))

    def measure(*given, **named):
        key = json.dumps([given, named], sort_keys=True)
        if key not in known:
            known[key] = run(scene(*given, **named))
        return known[key]

    return measure


def test_what_is_not_to_be_imported_exists():
    """The test of the tests: a part that has moved would be missed nowhere."""
    for module in own(*OWN_HEAVY, *OF_RESULTS):
        assert importlib.util.find_spec(module) is not None


def test_the_package_imports_nothing():
    modules = imported("import contimpact")
    assert among(modules, ("contimpact",)) == ["contimpact"]
    assert among(modules, (*HEAVY, "numpy")) == []


@pytest.fixture(scope="module")
def of_numpy():
    return set(imported("import numpy, numpy.random"))


TOML = """
name = "frugal"
model = { system = "impact-pair", parameters = { beta = "pi/6", r = 0.3, A = 5.0, s = 0.389 } }
follow = { parameter = "s", range = [0.3885, 0.3895], orbits = ["1:1"] }
numerics = { step = 0.1, max_step = 0.1 }
plot = { formats = [] }
"""
SIMULATED = """
simulate = { values = 3, branches = true, portraits = [0.389], basins = [0.389], grid = 2 }
energy = { m = 0.004 }
"""
"""Tables that only ``contimpact simulate`` acts on; the others validate them."""

CURVES = """
curves = { parameter = "r", range = [0.2, 0.5], kinds = ["PD", "G"] }
"""


@pytest.mark.parametrize("tables", ["", SIMULATED, CURVES])
def test_reading_a_scene_loads_no_numerics(tables, tmp_path):
    (tmp_path / "scene.toml").write_text(TOML + tables, encoding="utf-8")
    code = "import sys\nfrom contimpact.results.scene import load_scene\nload_scene(sys.argv[1])"
    modules = imported(code, str(tmp_path / "scene.toml"))
    assert among(modules, (*HEAVY, "numpy")) == []
    assert among(modules, own("arrays", "simulation", "orbits", "segments", *RECORDS)) == []


COMMANDS = {
    "check": ["check", "{scene}"],
    "run": ["run", "{scene}", "-o", "{folder}", "-q"],
    "help": ["--help"],
}


@pytest.mark.parametrize("tables", ["", SIMULATED])
@pytest.mark.parametrize("name", COMMANDS)
@pytest.mark.quick(1)
def test_a_command_imports_what_it_needs(name, tables, tmp_path, of_numpy):
    """With a warm cache, as after the first run; what a scene says of simulations costs nothing."""
    (tmp_path / "scene.toml").write_text(TOML + tables, encoding="utf-8")
    places = {"scene": tmp_path / "scene.toml", "folder": tmp_path / "out"}
    arguments = [text.format(**places) for text in COMMANDS[name]]
    code = (
        "import sys\nfrom contimpact.cli import main\n"
        "try: main(sys.argv[1:])\nexcept SystemExit: pass"
    )
    imported(code, *arguments)
    modules = imported(code, *arguments)
    assert among(modules, HEAVY) == []
    assert among(modules, own(*OWN_HEAVY)) == []
    assert among(set(modules) - of_numpy, RARE) == []
    if name == "help":
        assert among(modules, ("numpy",)) == []
    if name == "check":
        assert among(modules, own("results.catalogue", "results.diagram_reading")) == []


SCENES = {
    "nothing": ((), ()),
    "requested velocity": (("V",), ()),
    "grazing": (("G",), ()),
    "fold and doubling": (("FB", "PD"), ()),
    "branch points": (("BP",), ()),
}


@pytest.mark.parametrize("name", SCENES)
@pytest.mark.quick(1)
def test_no_heavy_module_is_imported(measured, name):
    modules = measured(*SCENES[name])["modules"]
    assert among(modules, HEAVY) == []
    assert among(modules, own(*OWN_HEAVY, *OF_RESULTS)) == []


@pytest.mark.parametrize("name", SCENES)
@pytest.mark.quick(1)
def test_no_kernel_but_those_asked_for(measured, name):
    found = measured(*SCENES[name])
    assert found["generated"] == []
    assert set(found["loaded"]) <= ALWAYS | FOR.get(name, set())
    assert {"setup", "flight_B_T", "flight_T_B"} <= set(found["loaded"])


@pytest.mark.parametrize("name", SCENES)
@pytest.mark.quick(1)
def test_second_derivatives_are_evaluated_for_events_alone(measured, name):
    found = measured(*SCENES[name])
    counts, derived = found["counts"], "contimpact.segments.derivatives" in found["modules"]
    scalar = name == "fold and doubling"  # whose scalar code does without `second_along`
    assert derived == (scalar or "second_along" in counts)
    if name not in ("fold and doubling", "branch points"):
        assert "second_along" not in counts
    else:  # a doubling: a few Newton iterations with one evaluation each
        assert counts.get("second_along", 0) < 40


def test_gaps_are_evaluated_once_for_each_row(measured):
    """A table tells whether each orbit is physical; no gap is looked at twice."""
    found = measured((), ())
    assert found["counts"]["interior_touches"] <= found["points"]["points"]


def test_a_kind_of_which_there_is_no_event_costs_no_evaluation(measured):
    plain, named = measured((), ()), measured(("V", "T"), ())
    assert named["counts"]["evaluate"] == plain["counts"]["evaluate"]


def test_switching_loads_the_longer_words_kernels_alone(measured):
    found = measured(("G",), ("G",), depth=1)
    assert {"flight_B_B"} <= set(found["loaded"])
    assert "flight_T_T" not in found["loaded"]
    assert not any(name.startswith("second") for name in found["loaded"])


def test_integrating_imports_no_sympy():
    """heyoka would, for a conversion of expressions that nobody asks for."""
    pytest.importorskip("heyoka")
    text = (
        "import sys; from contimpact.segments.integrated_flight import flown; "
        "assert abs(flown(': -x0', '', 1.0, 0.0, 1.0, 0.0)[1] + 0.8414709848078965) < 1e-15; "
        "assert 'heyoka' in sys.modules and 'sympy' not in sys.modules; import sympy; sympy.Symbol"
    )
    subprocess.run([sys.executable, "-c", text], check=True)


def test_multipliers_import_one_routine():
    """scipy.linalg imports much more; it has the same routine when it is imported later."""
    text = (
        "import sys; import numpy as np; "
        "from contimpact.orbits.status import pencil_multipliers; "
        "found = pencil_multipliers(np.diag([2.0, 3.0, 4.0]), -np.eye(3)); "
        "assert np.allclose(found, [4.0, 3.0, 2.0]); "
        "assert 'scipy.linalg' not in sys.modules and 'numpy.f2py' not in sys.modules; "
        "from scipy.linalg import eigvals; assert np.allclose(eigvals(np.eye(3)), 1.0)"
    )
    subprocess.run([sys.executable, "-c", text], check=True)


@pytest.mark.parametrize("laps", [1, 4])
def test_second_derivatives_are_of_the_unknowns_at_a_flights_ends(laps):
    """Along all unknowns in turn: five for each flight, whatever the others. They are not evaluated
    for a residual alone."""
    import numpy as np

    import contimpact as ci
    from contimpact.bifurcations.extended_system import Crossing
    from contimpact.models.guards import Word
    from contimpact.orbits.problem import OrbitProblem
    from contimpact.segments.kernels import Kernels

    model = ci.ImpactPair(beta=0.5, r=0.3, A=5.0, s=0.3)
    problem = OrbitProblem(model, Word("BT" * laps, laps), Kernels(model, "s"))
    times = np.linspace(0.1, 2.0 * laps, 2 * laps, endpoint=False)
    rows = np.column_stack([times, np.resize([-0.5, 0.6], 2 * laps)])
    here = problem.evaluate(np.append(rows.ravel(), 0.3))
    evaluated = problem.kernel_evaluations
    system = Crossing(problem)
    at = system.assemble(here, system.start(here))
    assert problem.kernel_evaluations == evaluated
    assert at.jacobian.shape == (2 * problem.n + 2,) * 2
    assert problem.kernel_evaluations == evaluated + 5 * 2 * laps
