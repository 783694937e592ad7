"""The engine ray, on a cluster of two nodes on this machine: the same bytes as the local engine."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
import warnings

import numpy as np
import pytest

from graspforce.scenarios.random import grasps

pa = pytest.importorskip("pyarrow")
pq = pytest.importorskip("pyarrow.parquet")
gd = pytest.importorskip("graspforce.datasets")
pytest.importorskip("ray", reason="the extra ray is not installed")

# What Ray and its packages warn of is no matter of ours.
pytestmark = pytest.mark.filterwarnings("ignore")

OPTIONS = {"rows_per_part": 50, "tau_lo": -0.5, "tau_hi": 0.5}
COUNT = 1500


@pytest.fixture(scope="module")
def cluster():
    """The address of a cluster of two nodes, and its processes."""
    os.environ |= {"RAY_USAGE_STATS_ENABLED": "0", "RAY_AUTH_MODE": "disabled"}
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        from ray.cluster_utils import Cluster

        node = {"num_cpus": 1, "object_store_memory": 80 * 2**20}
        made = Cluster(initialize_head=True, head_node_args=node | {"include_dashboard": False})
        made.add_node(**node)
        yield made
        made.shutdown()


@pytest.fixture(scope="module")
def source(tmp_path_factory):
    problems = grasps(COUNT // 5)
    columns = {
        name: [np.asarray(getattr(each, name)).tolist() for each in problems] * 5
        for name in ("W", "f", "J", "mu", "alpha")
    }
    columns["mu"][77] = [-1.0] * 4
    path = tmp_path_factory.mktemp("source") / "grasps.parquet"
    pq.write_table(pa.table(columns), path, row_group_size=200)
    return path


@pytest.fixture(scope="module")
def whole(source, tmp_path_factory):
    """What the local engine makes of it."""
    target = tmp_path_factory.mktemp("local") / "out"
    gd.solve_dataset(source, target, **OPTIONS)
    return content(target)


def content(target):
    return {
        str(path.relative_to(target)): path.read_bytes()
        for path in sorted(target.rglob("*"))
        if path.is_file()
    }


def workers(cluster):
    """The processes of the cluster that do parts."""
    import psutil

    found = []
    for node in cluster.list_all_nodes():
        for info in node.all_processes.get("raylet", []):
            found += psutil.Process(info.process.pid).children(recursive=True)
    return [each for each in found if "_RayWorker" in " ".join(each.cmdline())]


def test_two_nodes_write_the_bytes_of_the_local_engine(cluster, source, whole, tmp_path):
    seen = []
    summary = gd.solve_dataset(
        source, tmp_path / "out", "ray", ray_address=cluster.address, **OPTIONS,
        progress=lambda counts, total: seen.append(counts.rows),
    )  # fmt: skip
    assert content(tmp_path / "out") == whole
    assert (summary.counts.rows, summary.counts.rejected) == (COUNT, 1)
    assert seen == sorted(seen)
    assert seen[-1] == COUNT


def test_workers_that_die_are_replaced(cluster, source, whole, tmp_path):
    killed = []

    def progress(counts, total):
        if counts.rows and not killed:
            for each in workers(cluster):
                each.kill()
                killed.append(each.pid)

    gd.solve_dataset(
        source, tmp_path / "out", "ray", ray_address=cluster.address, progress=progress, **OPTIONS
    )
    assert killed
    assert content(tmp_path / "out") == whole


def test_a_killed_driver_is_gone_on_with_by_either_engine(cluster, source, whole, tmp_path):
    command = [
        sys.executable, "-m", "graspforce", "batch", str(source), str(tmp_path / "out"),
        "--engine", "ray", "--ray-address", cluster.address, "--rows-per-part", "50",
        "--set", "tau_lo=-0.5", "--set", "tau_hi=0.5",
    ]  # fmt: skip
    process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    until = time.monotonic() + 120
    while process.poll() is None and time.monotonic() < until:
        if len(list((tmp_path / "out").glob("part-*"))) >= 3:
            break
        time.sleep(0.01)
    process.send_signal(signal.SIGKILL)
    process.wait()
    summary = gd.solve_dataset(source, tmp_path / "out", **OPTIONS)
    assert summary.resumed >= 3
    assert content(tmp_path / "out") == whole


def test_an_unreadable_file_is_told_of(cluster, source, tmp_path):
    data = bytearray(source.read_bytes())
    place = pq.read_metadata(source).row_group(3).column(0).data_page_offset
    data[place : place + 40] = b"\xff" * 40
    (tmp_path / "bad.parquet").write_bytes(data)
    with pytest.raises(gd.UnfinishedError, match=r"bad\.parquet: cannot read rows"):
        gd.solve_dataset(
            tmp_path / "bad.parquet",
            tmp_path / "out",
            "ray",
            ray_address=cluster.address,
            **OPTIONS,
        )
    assert (tmp_path / "out" / "part-000000.parquet").is_file()
