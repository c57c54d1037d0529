"""Project rules: packaging, extras, light imports, a core without numba, no official statements."""

import gzip
import importlib
import inspect
import json
import pkgutil
import re
import shutil
import subprocess
import sys
import tarfile
import tomllib
from contextlib import suppress
from enum import Enum
from importlib.metadata import PackageNotFoundError
from pathlib import Path
from unittest.mock import Mock

import pytest

import lilgym_mp
from lilgym_mp import cli
from lilgym_mp.corpus import extras
from tests.command_line import python
from tests.scripts import ROOT, load_script, needs

PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())
SETUPTOOLS = PROJECT["tool"]["setuptools"]
EXTRAS = PROJECT["project"]["optional-dependencies"]
HEAVY = ("torch", "shapely", "pettingzoo", "stable_baselines3", "sb3_contrib", "transformers", "ray", "numba", "PIL")
PACKAGE_NODES, TEST_NODES = 384_070, 189_950  # most syntax nodes; lower them as code goes
PAGE_AND_DATA_LINES = 2_130 + 1_774  # most lines of JavaScript, CSS and HTML, and of TOML in data
LONG_STATEMENT = 5  # words; shorter statements may occur by coincidence
WITHOUT_NUMBA = """
import sys
for name in ("numba", "lilgym_mp.envs.fast"):
    sys.modules[name] = None  # importing it fails
"""
PLAY = """
import gymnasium, lilgym_mp
for configuration in ("TowerFlipIt", "ScatterFlipIt"):
    env = gymnasium.make(f"lilgym_mp/{configuration}-v0", split="dev")
    env.reset(seed=0)
    for episode in range(12):
        env.reset(options=dict(task=env.unwrapped.tasks.ids[0]))
        env.step(int(env.unwrapped.action_masks().nonzero()[0][-1]))
        goal = env.unwrapped.goal_reached()
        _, reward, terminated, *_ = env.step(0)
        assert terminated and reward == (1 if goal else -1)
"""
PARTS = (
    "envs.workers.WorkerVectorEnv",
    "envs.proposer_verifier.partners.SCRIPTED",
    "programs.canonical",
    "scene.render.canvas",
    "corpus.generator.writer",
    "learning.common.agents",
    "contrib.rlvr.checked_scenes",
    "wrappers.replies",
)
FRESH = f"""
import json, operator, sys
from importlib.util import find_spec
import lilgym_mp

found = dict(loaded=[*sys.modules], type=type(lilgym_mp).__name__, generated=[])
found["beside"] = [name for name in ("lilgym_mp", "tests", "examples") if find_spec("lilgym_mp." + name)]
program = lilgym_mp.programs.Program("exist(all_items)")
for _ in range(4):
    assert not program(lilgym_mp.scene.Scene.of((), (), ()))
    found["generated"].append("lilgym_mp.envs.fast.code_generation" in sys.modules)
found["parts"] = len([operator.attrgetter(part)(lilgym_mp) for part in {PARTS}])
print(json.dumps(found))
"""


def _passes(*arguments, cwd=ROOT):
    """What Python, which must succeed, prints."""
    done = python(*arguments, cwd=cwd)
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


def _package_directories():
    """Every directory that contains modules of the package, by import name."""
    outside = {name: ROOT / place for name, place in SETUPTOOLS["package-dir"].items()}
    tops = {"lilgym_mp": ROOT / "lilgym_mp", **outside}
    return {
        ".".join((name, *directory.relative_to(top).parts)): directory
        for name, top in tops.items()
        for directory in {path.parent for path in top.rglob("*.py")}
    }


def test_packaging__every_directory_with_modules_is_listed():
    unlisted = _package_directories().keys() - set(SETUPTOOLS["packages"])
    assert not unlisted, f"add to tool.setuptools.packages in pyproject.toml: {sorted(unlisted)}"


@pytest.mark.long
def test_packaging__every_module_and_data_file_is_shipped(installed_form):
    missing = [
        str(path.relative_to(ROOT))
        for name, directory in _package_directories().items()
        for path in directory.iterdir()
        if path.is_file() and not path.name.startswith(".")
        if not (installed_form / name.replace(".", "/") / path.name).exists()
    ]
    assert not missing, f"add to tool.setuptools.package-data in pyproject.toml: {missing}"


@pytest.mark.long
def test_packaging__a_source_distribution_has_the_package_its_tests_and_documents(tmp_path):
    needs("setuptools")
    program = "from setuptools import setup; setup()"
    _passes("-c", program, "-q", "egg_info", "-e", tmp_path, "sdist", "-d", tmp_path)
    (packed,) = tmp_path.glob("*.tar.gz")
    with tarfile.open(packed) as archive:
        names = {name.partition("/")[2] for name in archive.getnames()}
    documents = {"tests/conftest.py", "docs/index.md", "examples/demo.py", "integrations/trl/lilgym_trl.py"}
    assert documents <= names
    assert {"wrappers/__init__.py", "data/builtin.jsonl.gz", "lilgym_mp/py.typed", "README.md"} <= names


@pytest.mark.parametrize("layout", ["checkout", pytest.param("installed", marks=pytest.mark.long)])
def test_packaging__wrappers_and_data_are_imported_from_the_package(layout, request):
    place = ROOT if layout == "checkout" else request.getfixturevalue("installed_form")
    program = """if True:
        import sys
        sys.path.insert(0, sys.argv[1])
        import lilgym_mp.wrappers, lilgym_mp.data
        print(lilgym_mp.wrappers.__file__, lilgym_mp.data.__file__, sep="\\n")
    """
    paths = _passes("-c", program, place, cwd=place).splitlines()
    assert [path for path in paths if not Path(path).is_relative_to(place)] == []


def test_packaging__a_checkout_that_is_not_installed_says_how_to_install_it(tmp_path):
    shutil.copytree(ROOT / "lilgym_mp", tmp_path / "lilgym_mp", ignore=shutil.ignore_patterns("wrappers", "data"))
    done = python("-c", "import lilgym_mp", cwd=tmp_path)
    assert done.returncode == 1
    message = done.stderr.splitlines()[-1]
    assert message.startswith("ImportError")
    assert str(tmp_path) in message
    assert "pip install -e ." in message


@pytest.fixture(scope="module")
def fresh():
    """What a new process finds that imports the package."""
    return json.loads(_passes("-c", FRESH))


def test_packaging__nothing_beside_the_package_is_imported_from_it(fresh):
    assert fresh["beside"] == []
    assert fresh["type"] == "module"


def test_import__loads_nothing_heavy_or_seldom_used(fresh):
    assert not {*HEAVY, "lilgym_mp.corpus.generator", "lilgym_mp.corpus.spelling"} & {*fresh["loaded"]}


def test_program__has_code_generated_only_once_it_is_evaluated_often(fresh):
    assert fresh["generated"] == [False, False, True, True]


def test_parts__are_imported_on_first_use(fresh):
    assert fresh["parts"] == len(PARTS)


def test_import__shows_what_users_use():
    shown = set(dir(lilgym_mp))
    assert {"action_masks", "load_agent", "envs", "wrappers", "sb3"} <= shown
    assert not {"Path", "TYPE_CHECKING", "annotations"} & shown
    assert [name for name in shown if getattr(lilgym_mp, name) is None] == []


def test_core__plays_without_numba_and_without_generated_code():
    done = python("-c", WITHOUT_NUMBA + PLAY, cwd=ROOT)
    assert done.returncode == 0, done.stderr
    assert done.stderr.count("RuntimeWarning: programs are evaluated slowly") == 1


@pytest.mark.long
def test_core__plays_without_docstrings():
    _passes("-OO", "-c", PLAY)


@pytest.mark.parametrize(
    ("use", "limit"),
    [
        ("scatter", 38_300),
        pytest.param("ppo", 93_300, marks=pytest.mark.long),
        pytest.param("train ppo", 99_300, marks=pytest.mark.long),
    ],
)
def test_package__loads_little_code_for_a_use(use, limit):
    sizes = load_script("print_closures")
    assert sizes.nodes(sizes.closure(use)) <= limit


@pytest.mark.long
def test_code__stays_within_its_budgets():
    sizes = load_script("print_closures")
    assert sizes.nodes(sizes.python_files("lilgym_mp", "wrappers")) <= PACKAGE_NODES
    assert sizes.nodes(sizes.python_files("tests")) <= TEST_NODES
    assert sizes.page_lines() + sizes.data_lines() <= PAGE_AND_DATA_LINES


@pytest.mark.parametrize("extra", ["sb3", "report", "human", "pettingzoo"])
def test_install__names_the_packages_of_the_extra(extra, monkeypatch):
    built = [f'{package}; extra == "{name}"' for name, packages in EXTRAS.items() for package in packages]
    monkeypatch.setattr(extras, "requires", lambda name: ["numpy>=2.0", *built])
    expected = {re.split(r"[<>=]", package)[0] for package in EXTRAS[extra]}
    assert set(re.findall(r'"([A-Za-z0-9_-]+(?:\[[a-z0-9,]+\])?)[^"]*"', extras.install(extra))) == expected
    assert extras.install(extra).endswith(f"(the extra {extra})")


def test_load_agent__without_torch_names_the_extra(monkeypatch):
    monkeypatch.setitem(sys.modules, "lilgym_mp.learning.common.agents", None)
    monkeypatch.delattr("lilgym_mp.learning.common.agents", raising=False)
    with pytest.raises(ModuleNotFoundError, match=r"load_agent needs .*: pip install .*\(the extra train\)"):
        lilgym_mp.load_agent("parse-and-plan")


def test_install__of_a_checkout_that_is_not_installed(monkeypatch):
    monkeypatch.setattr(extras, "requires", Mock(side_effect=PackageNotFoundError))
    assert extras.install("report") == 'pip install ".[report]" (the extra report)'


def test_modules__are_imported_by_name_in_one_place():
    sources = {path.relative_to(ROOT).as_posix(): path for path in (ROOT / "lilgym_mp").rglob("*.py")}
    found = {name for name, path in sources.items() if "import_module(" in path.read_text()}
    assert found == {"lilgym_mp/submodules.py"}


def _public_definitions(owner, module):
    """The classes, functions, methods and properties that a module or class defines, by qualified name."""
    for name, member in vars(owner).items():
        found = inspect.unwrap(getattr(member, "fget", None) or getattr(member, "__func__", member))
        if not name.startswith("_") and getattr(found, "__module__", None) == module:
            if inspect.isclass(found) or inspect.isfunction(found):
                yield f"{module}.{found.__qualname__}", getattr(owner, name)
            if inspect.isclass(found):
                yield from _public_definitions(found, module)


@pytest.mark.filterwarnings("ignore")
def test_code__documents_every_public_definition():
    definitions = []
    for name, directory in _package_directories().items():
        for path in {*directory.glob("*.py")} - {directory / "__main__.py"}:
            module = f"{name}.{path.stem}".removesuffix(".__init__")
            with suppress(ImportError):  # an extra that is not installed
                definitions += _public_definitions(importlib.import_module(module), module)
    protocols = [found for _, found in definitions if getattr(found, "_is_protocol", False)]
    inherited = {name for protocol in protocols for name, member in vars(protocol).items() if inspect.getdoc(member)}
    undocumented = {name for name, found in definitions if not inspect.getdoc(found) and "<locals>" not in name}
    assert [name for name in undocumented if name.rpartition(".")[2] not in inherited] == []


API_NAMES = [
    name
    for page in sorted((ROOT / "docs/api").glob("*.md"))
    for name in re.findall("^::: (.+)", page.read_text(), re.M)
]


def _documented_methods(found):
    """The functions of the public methods and properties that a class defines and documents itself."""
    for name, member in vars(found).items():
        function = inspect.unwrap(getattr(member, "fget", None) or getattr(member, "__func__", member))
        if inspect.isfunction(function) and function.__doc__ and not name.startswith("_"):
            yield function


@pytest.mark.parametrize("name", API_NAMES)
def test_docs__list_arguments_results_and_errors_in_sections(name):
    try:
        found = pkgutil.resolve_name(name)
    except ModuleNotFoundError as missing:
        pytest.skip(f"{missing.name} is not installed")
    if inspect.isfunction(found):
        assert "Returns:" in inspect.getdoc(found) or inspect.signature(found).return_annotation == "None"
        documented = [found]
    else:
        documented = _documented_methods(found) if inspect.isclass(found) else []
    if inspect.isclass(found) and not issubclass(found, Enum) and not inspect.isabstract(found):
        inherits = found.__init__ is object.__init__
        text = inspect.getdoc(found) + ("" if inherits else f"\n{inspect.getdoc(found.__init__)}")
        if not inherits and not issubclass(found, Exception):
            assert re.search("^(Args|Attributes):", text, re.M) or getattr(found, "_is_protocol", False)
        assert not re.search(r"\bRaises [A-Z]", text)
    for function in documented:
        text = inspect.getdoc(function)
        assert "Args:" in text or not set(inspect.signature(function).parameters) - {"self", "cls"}, function
        assert not re.search(r"\bRaises [A-Z]", text), function


def test_extras__named_in_code_exist():
    sources = [path for place in ("lilgym_mp", "wrappers") for path in (ROOT / place).rglob("*.py")]
    named = {extra for path in sources for extra in re.findall(r"""\binstall\(["'](\w+)["']\)""", path.read_text())}
    assert {"sb3", "human"} <= named
    assert named | set(cli.EXTRAS.values()) <= set(EXTRAS)


def _words(text):
    return tuple(re.findall(r"[a-z0-9']+", text.lower()))


def _project_files():
    command = ["git", "ls-files", "--cached", "--others", "--exclude-standard"]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    if done.returncode:
        pytest.skip("not a git checkout, so the project's files cannot be listed")
    return [path for name in done.stdout.splitlines() if (path := ROOT / name).is_file()]


def _phrases(path):
    """The text between quotes, line ends and similar separators, split into words; none too short."""
    content = path.read_bytes()
    text = (gzip.decompress(content) if path.suffix == ".gz" else content).decode(errors="ignore")
    least = 2 * LONG_STATEMENT - 1  # letters and blanks
    return (_words(phrase) for phrase in re.split(r'["`\n.:;|]', text) if len(phrase) >= least)


def test_repository__contains_no_official_statement(official_data):
    sentences = re.compile(r'"sentence": *"((?:[^"\\]|\\.)*)"')
    texts = (path.read_text() for path in official_data.glob("*.json"))
    official = {_words(sentence) for text in texts for sentence in sentences.findall(text)}
    assert official, f"no statement found in {official_data}"
    long = {words for words in official if len(words) >= LONG_STATEMENT}
    found = {path.name: words for path in _project_files() for words in long.intersection(_phrases(path))}
    assert not found


@pytest.mark.long
def test_editable_install__lets_type_checkers_find_the_wrappers(tmp_path):
    needs("setuptools", "pyright")  # of the extra `lint`
    for name in ("lilgym_mp", "wrappers", "data", "scripts"):
        shutil.copytree(ROOT / name, tmp_path / name, symlinks=True)
    for name in ("pyproject.toml", "README.md", "LICENSE"):
        shutil.copy(ROOT / name, tmp_path)
    program = "import sys; sys.path.insert(0, 'scripts'); import build_backend; build_backend.build_editable('.')"
    _passes("-c", program, cwd=tmp_path)
    (tree,) = (tmp_path / "build").glob("__editable__.*")
    shutil.copy(ROOT / "wrappers" / "__init__.py", tmp_path / "wrappers" / "added.py")
    user = tmp_path / "user"
    user.mkdir()
    (user / "script.py").write_text("from lilgym_mp.wrappers.added import stop_forcing_v0\nimport lilgym_mp.data\n")
    (user / "pyrightconfig.json").write_text(json.dumps({"extraPaths": [str(tree)]}))
    _passes("-m", "pyright", "--project", str(user), cwd=user)
