"""The tests under other processors, libraries and habits than those of this machine.

    python tests/matrix.py [--short] [NAME ...]

Each setting is one run of pytest: with environment variables that make the core, OpenBLAS and
NumPy behave as on an older processor, with options of pytest, or with other versions of Python and
of the packages, in an environment of their own under build/matrix. Settings run side by side; a
table follows, and each run's output stays in build/matrix. ``make matrix`` runs them all, about an
hour on two cores; ``--short`` one or two older processors as a whole, some minutes; a NAME those
whose names contain it.
"""

from __future__ import annotations

import argparse
import locale
import os
import platform
import re
import shlex
import shutil
import subprocess
import sys
import time
import tomllib
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from graspforce import _core

ROOT = Path(__file__).parents[1]
BUILD = ROOT / "build" / "matrix"
# Everything where the numbers of this machine's processor are not what is tested is left out.
WITHOUT_NUMBERS = (
    "allegro", "bench", "c", "campaign", "cli", "compare", "cpp", "datasets*", "docs", "figures",
    "files", "imports", "instructions", "readme", "report", "sim_*", "terminal", "typed",
    "viewer*", "warp", "wheels",
)  # fmt: skip
# Pinocchio needs NumPy 2, and nothing else does: no Python is so old as to get it.
NO_PINOCCHIO = BUILD / "without_pinocchio.txt"
NUMERIC = tuple(f"--ignore-glob=*/test_{name}.py" for name in WITHOUT_NUMBERS)


@dataclass(frozen=True)
class Setting:
    """One run of pytest.

    Attributes:
        name: what the table calls it.
        variables: of the environment.
        options: of pytest.
        python: the interpreter of an environment of its own; None runs in this one.
        versions: options of ``uv pip compile`` that choose the packages of that environment.
    """

    name: str
    variables: dict[str, str] = field(default_factory=dict)
    options: tuple[str, ...] = ()
    python: str | None = None
    versions: tuple[str, ...] = ()

    @property
    def folder(self) -> Path:
        return BUILD / re.sub(r"[^\w.]+", "-", self.name)


# ---- the settings ------------------------------------------------------------------------------


def short_settings() -> list[Setting]:
    """The oldest processor, and the one before this if it takes another core; on all cores."""
    older = list(processors())
    of_core = {each.variables["GRASPFORCE_CORE"]: each for each in (*older[1:][-1:], *older[:1])}
    processes = str(max(1, (os.cpu_count() or 1) // max(1, len(of_core))))
    options = (*NUMERIC, "-n", processes, "--dist", "loadfile")
    return [
        replace(each, variables=each.variables | {"OPENBLAS_NUM_THREADS": "1"}, options=options)
        for each in of_core.values()
    ]


def processors() -> Iterator[Setting]:
    """Processors as a whole: each with the core, the kernels and the NumPy that it would choose."""
    sets, simd = _core.instruction_sets(), numpy_features()
    if platform.machine() not in ("x86_64", "AMD64"):
        return
    plain = {"GRASPFORCE_CORE": "baseline", "NPY_DISABLE_CPU_FEATURES": " ".join(simd)}
    yield Setting("processor of SSE3", plain | {"OPENBLAS_CORETYPE": "Prescott"}, NUMERIC)
    if "avx2" in sets:
        yield Setting("processor of AVX", plain | {"OPENBLAS_CORETYPE": "Sandybridge"}, NUMERIC)
    if "avx512" in sets:
        wide = " ".join(name for name in simd if name.startswith(("AVX512", "X86_V4")))
        variables = {"GRASPFORCE_CORE": "avx2", "OPENBLAS_CORETYPE": "Haswell"}
        yield Setting("processor of AVX2", variables | {"NPY_DISABLE_CPU_FEATURES": wide}, NUMERIC)


def settings() -> Iterator[Setting]:
    """Every setting that this machine can run."""
    yield from processors()
    sets = ("baseline", *_core.instruction_sets())
    for core in sets:
        yield Setting(f"core {core}", {"GRASPFORCE_CORE": core}, NUMERIC)
    if platform.machine() in ("x86_64", "AMD64"):
        needed = {"Prescott": "baseline", "Sandybridge": "avx2", "Haswell": "avx2", "Zen": "avx2",
                  "SkylakeX": "avx512"}  # fmt: skip
        for kernel, least in needed.items():
            if least in sets:
                yield Setting(f"OpenBLAS {kernel}", {"OPENBLAS_CORETYPE": kernel}, NUMERIC)
    if features := numpy_features():
        variables = {"NPY_DISABLE_CPU_FEATURES": " ".join(features)}
        yield Setting(f"NumPy without {' '.join(features)}", variables, NUMERIC)
    seed = int(time.time()) % 100_000
    order = ("--random-order", "--random-order-bucket=global", f"--random-order-seed={seed}")
    yield Setting(f"random order {seed}", options=order)
    yield Setting("two processes", options=("-n", "2"))
    yield Setting("locale C without UTF-8", {"LC_ALL": "C", "PYTHONUTF8": "0"})
    if comma := comma_locale():
        yield Setting(f"locale {comma}", {"LC_ALL": comma})
    found = pythons()
    locked = ("-c", str(ROOT / "requirements.lock"))
    for version, path in found.items():
        if version != sys.version_info[:2]:
            name = "Python {}.{}, locked versions".format(*version)
            yield Setting(name, python=path, versions=locked)
    lowest = ("--resolution", "lowest-direct")
    oldest, latest = min(found), max(found)
    words = "Python {}.{}, ".format(*oldest)
    yield Setting(f"{words}lower bounds", python=found[oldest], versions=lowest)
    name = f"{words}lower bounds without Pinocchio"
    yield Setting(name, python=found[oldest], versions=(*lowest, "--override", str(NO_PINOCCHIO)))
    yield Setting("Python {}.{}, newest versions".format(*latest), python=found[latest])


def numpy_features() -> list[str]:
    """The instruction sets beyond its baseline that NumPy found, each with its own name for it."""
    return list(np.show_config(mode="dicts")["SIMD Extensions"].get("found", []))


def comma_locale() -> str | None:
    """A locale of this machine whose decimal point is a comma."""
    names = subprocess.run(["locale", "-a"], capture_output=True, text=True).stdout.split()
    try:
        for name in names:
            locale.setlocale(locale.LC_NUMERIC, name)
            if locale.localeconv()["decimal_point"] == ",":
                return name
    finally:
        locale.setlocale(locale.LC_NUMERIC, "C")
    return None


def pythons() -> dict[tuple[int, int], str]:
    """The Pythons of this machine that the package is for: on PATH, or pyenv's."""
    pyenv = Path(os.environ.get("PYENV_ROOT", Path.home() / ".pyenv")) / "versions"
    found = {}
    for minor in range(11, 20):
        paths = [shutil.which(f"python3.{minor}"), *pyenv.glob(f"3.{minor}.*/bin/python")]
        for path in filter(None, paths):
            # pyenv puts names on PATH that run only where the version is the chosen one.
            if subprocess.run([path, "-c", ""], capture_output=True).returncode == 0:
                found[3, minor] = str(path)
                break
    return found


# ---- running them ------------------------------------------------------------------------------


@dataclass(frozen=True)
class Result:
    """What the table shows of a run; ``seen`` is the processor that the tests found themselves on.

    The counts are None where the run broke down before pytest could count.
    """

    name: str
    counts: dict[str, int] | None
    seconds: float
    seen: str
    failures: tuple[str, ...]

    @property
    def green(self) -> bool:
        return self.counts is not None and self.counts["passed"] > 0 and not self.failures


def run(setting: Setting) -> Result:
    """Run pytest under a setting, in an environment of its own where it asks for one."""
    began = time.monotonic()
    log = BUILD / f"{setting.folder.name}.log"  # a suffix would take the place of .11
    with log.open("w", encoding="utf-8") as out:

        def call(*command: object, **variables: str) -> int:
            words = [str(word) for word in command]
            print("$", shlex.join(words), file=out, flush=True)
            return subprocess.run(
                words, cwd=ROOT, env=os.environ | variables, stdout=out, stderr=out, check=False
            ).returncode

        python = Path(sys.executable)
        broken = False
        if setting.python:
            python = setting.folder / "bin" / "python"
            broken = any(call(*command) for command in installing(setting, python))
        if not broken:
            call(python, "-m", "pytest", "-p", "no:cacheprovider", *setting.options,
                 **setting.variables)  # fmt: skip
    text = log.read_text(encoding="utf-8", errors="replace")
    ending = re.findall(r"^=+ (.*\d+ (?:passed|failed|error).*) in [\d.]+s.* =+$", text, re.M)
    words = re.findall(r"(\d+) (passed|failed|skipped|error)", ending[-1]) if ending else []
    counts = {"passed": 0, "failed": 0, "skipped": 0, "error": 0}
    counts |= {word: int(count) for count, word in words}
    failures = tuple(re.findall(r"^(?:FAILED|ERROR) .*", text, re.M))
    seen = re.search(r"^processor: (.*)", text, re.M)
    if setting.python and ending and not failures:
        shutil.rmtree(setting.folder)
    return Result(
        setting.name, counts if ending else None, time.monotonic() - began,
        seen[1] if seen else "", failures,
    )  # fmt: skip


def installing(setting: Setting, python: Path) -> Iterator[tuple[object, ...]]:
    """The commands that make an environment; the versions are those that pyproject.toml allows."""
    uv = (sys.executable, "-m", "uv", "--quiet", "--no-python-downloads")
    build, packages = setting.folder / "build.txt", setting.folder / "packages.txt"
    yield *uv, "venv", "--clear", "--python", setting.python, setting.folder
    wanted = setting.folder / "build.in"
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    wanted.write_text("\n".join(project["build-system"]["requires"]), encoding="utf-8")
    choose = (*uv, "pip", "compile", "--python", python, *setting.versions)
    yield *choose, wanted, "-o", build
    yield *choose, "--extra", "test", ROOT / "pyproject.toml", "-o", packages
    install = (*uv, "pip", "install", "--python", python)
    yield *install, "-r", packages
    yield *install, "--no-deps", "--reinstall", "--no-cache", "--build-constraints", build, ROOT


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("names", nargs="*", metavar="NAME")
    parser.add_argument("--short", action="store_true")
    given = parser.parse_args()
    BUILD.mkdir(parents=True, exist_ok=True)
    NO_PINOCCHIO.write_text("pin; python_version < '3'\n", encoding="utf-8")
    chosen = [
        setting
        for setting in (short_settings() if given.short else settings())
        if not given.names or any(name in setting.name for name in given.names)
    ]
    with ThreadPoolExecutor(os.cpu_count()) as pool:
        results = []
        for result in pool.map(run, chosen):
            print(row(result), flush=True)
            results.append(result)
    for result in results:
        for line in result.failures:
            print(f"{result.name}: {line}")
    return 0 if all(result.green for result in results) else 1


def row(result: Result) -> str:
    """A line of the table."""
    if result.counts is None:
        numbers = f"broke down: see {BUILD.relative_to(ROOT)}"
    else:
        numbers = "{passed:5} passed {failed:3} failed {error:3} errors {skipped:3} skipped".format(
            **result.counts
        )
    return f"{result.name:44} {numbers} {result.seconds:5.0f} s  {result.seen}"


if __name__ == "__main__":
    sys.exit(main())
