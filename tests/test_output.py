"""Files are written as a whole or not at all, and nothing but a file is ever replaced."""

from __future__ import annotations

import errno
import json
import os
import re
import signal
import socket
import stat
import subprocess
import sys
import threading
from pathlib import Path

import numpy as np
import pytest

import graspforce as gf
from graspforce import files, scenarios
from graspforce._util import atomic
from graspforce._util.atomic import atomic_write, check_writable, make_folder

OLD, NEW = "what was there\n", "what is written\n"


def write(path, text=NEW):
    with atomic_write(path) as temporary:
        temporary.write_text(text)


def mode(path):
    return stat.S_IMODE(os.stat(path).st_mode)


def names(folder):
    return sorted(os.listdir(folder))


@pytest.fixture
def umask():
    before = os.umask(0o022)
    yield os.umask
    os.umask(before)


@pytest.fixture(autouse=True)
def patience(monkeypatch):
    """No test waits that long, and none fails on a slow machine."""
    monkeypatch.setattr(atomic, "READER_TIMEOUT", 600)


# ---- regular files -----------------------------------------------------------------------------


@pytest.mark.parametrize(("mask", "expected"), [(0o022, 0o644), (0o077, 0o600), (0o007, 0o660)])
def test_output_a_new_file_has_the_mode_of_the_umask(tmp_path, umask, mask, expected):
    umask(mask)
    write(tmp_path / "new.txt")
    assert (tmp_path / "new.txt").read_text() == NEW
    assert mode(tmp_path / "new.txt") == expected
    assert names(tmp_path) == ["new.txt"]


@pytest.mark.parametrize("bits", [0o600, 0o640, 0o666, 0o755, 0o4755, 0o2775])
def test_output_a_replaced_file_keeps_its_mode(tmp_path, umask, bits):
    umask(0o077)
    path = tmp_path / "old.txt"
    path.write_text(OLD)
    path.chmod(bits)
    os.utime(path, (0, 0))
    write(path)
    assert path.read_text() == NEW
    assert mode(path) == bits
    assert path.stat().st_mtime > 0


def test_output_a_replaced_file_keeps_its_owner(tmp_path):
    path = tmp_path / "old.txt"
    path.write_text(OLD)
    try:
        os.chown(path, 12345, 23456)
    except PermissionError:
        pytest.skip("only root may give files away")
    path.chmod(0o4640)
    write(path)
    assert (path.stat().st_uid, path.stat().st_gid, mode(path)) == (12345, 23456, 0o4640)
    assert path.read_text() == NEW


def test_output_a_replaced_file_keeps_its_extended_attributes(tmp_path):
    path = tmp_path / "old.txt"
    path.write_text(OLD)
    try:
        os.setxattr(path, "user.origin", b"a grasp")
    except (AttributeError, OSError):
        pytest.skip("there are none here")
    write(path)
    assert os.getxattr(path, "user.origin") == b"a grasp"


def test_output_other_hard_links_keep_the_old_content(tmp_path):
    (tmp_path / "one.txt").write_text(OLD)
    os.link(tmp_path / "one.txt", tmp_path / "two.txt")
    write(tmp_path / "one.txt")
    assert (tmp_path / "one.txt").read_text() == NEW
    assert (tmp_path / "two.txt").read_text() == OLD


@pytest.mark.parametrize(
    "name",
    [
        b"n" * 250 + b".json", "ä".encode() * 125 + b".json", b"with\nnewline.json", b" .json",
        "λ 手 🤏.json".encode(), b"latin-1 \xe4.json", b"-v.json", b"$(x) %d 'q' [b].json",
    ],
)  # fmt: skip
def test_output_every_name_that_open_takes(tmp_path, monkeypatch, name):
    monkeypatch.chdir(tmp_path)
    for path in (tmp_path / os.fsdecode(name), os.fsdecode(name)):
        check_writable(path)
        write(path)
        assert names(tmp_path) == [os.fsdecode(name)]
        assert Path(path).read_text() == NEW


def test_output_a_name_that_is_too_long_is_refused(tmp_path):
    path = tmp_path / ("n" * 256)
    with pytest.raises(gf.InvalidInputError, match="cannot write it: File name too long"):
        check_writable(path)
    with pytest.raises(OSError, match="File name too long"):
        write(path)


def test_output_the_temporary_name_is_unforeseeable_and_its_folder_private(tmp_path):
    (tmp_path / "a.txt").write_text(OLD)
    with atomic_write(tmp_path / "a.txt") as one, atomic_write(tmp_path / "a.txt") as other:
        assert one.parent != other.parent
        assert mode(one.parent) == 0o700
        assert one.parent.parent == tmp_path  # a rename within one file system
        one.write_text("1")
        other.write_text("2")
    assert (tmp_path / "a.txt").read_text() == "1"
    assert names(tmp_path) == ["a.txt"]


def test_output_threads_that_write_one_file(tmp_path):
    path = tmp_path / "one.json"
    failed = []

    def work():
        for _ in range(25):
            try:
                write(path, json.dumps(list(range(10_000))))
                assert len(json.loads(path.read_text())) == 10_000
            except Exception as error:
                failed.append(error)

    threads = [threading.Thread(target=work) for _ in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert failed == []
    assert names(tmp_path) == ["one.json"]


@pytest.mark.parametrize("raised", [ValueError, OSError, KeyboardInterrupt, SystemExit])
def test_output_a_block_that_fails_leaves_all_as_it_was(tmp_path, raised):
    (tmp_path / "old.txt").write_text(OLD)

    def fail(path):
        with atomic_write(path) as temporary:
            temporary.write_text("half of wh")
            raise raised

    for name in ("old.txt", "new.txt"):
        with pytest.raises(raised):
            fail(tmp_path / name)
    assert names(tmp_path) == ["old.txt"]
    assert (tmp_path / "old.txt").read_text() == OLD


def test_output_the_bytes_are_on_the_disk_before_they_have_the_name(tmp_path, monkeypatch):
    order = []
    fsync, replace = os.fsync, os.replace
    monkeypatch.setattr(os, "fsync", lambda fd: (order.append("fsync"), fsync(fd)))
    monkeypatch.setattr(os, "replace", lambda a, b: (order.append("replace"), replace(a, b)))
    write(tmp_path / "new.txt")
    assert order == ["fsync", "replace"]


def test_output_an_error_names_the_file_and_not_the_temporary_one(tmp_path):
    def full(*_):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    path = tmp_path / "old.txt"
    with (
        pytest.raises(OSError, match="cannot write it: No space left") as caught,
        atomic_write(path),
    ):
        full()
    assert caught.value.filename == str(path)
    assert caught.value.errno == errno.ENOSPC


# ---- links -------------------------------------------------------------------------------------


def test_output_a_link_stays_one_and_its_target_is_replaced(tmp_path):
    (tmp_path / "there").mkdir()
    (tmp_path / "there" / "real.dat").write_text(OLD)
    (tmp_path / "link.txt").symlink_to("there/real.dat")
    (tmp_path / "second.txt").symlink_to("link.txt")
    with atomic_write(tmp_path / "second.txt") as temporary:
        assert temporary.suffix == ".txt"  # the format is that of the name that was given
        temporary.write_text(NEW)
    assert (tmp_path / "second.txt").readlink() == Path("link.txt")
    assert (tmp_path / "link.txt").readlink() == Path("there/real.dat")
    assert (tmp_path / "there" / "real.dat").read_text() == NEW
    assert names(tmp_path / "there") == ["real.dat"]


def test_output_a_dangling_link_makes_its_target(tmp_path):
    (tmp_path / "link.txt").symlink_to("new.txt")
    check_writable(tmp_path / "link.txt")
    assert names(tmp_path) == ["link.txt"]
    write(tmp_path / "link.txt")
    assert (tmp_path / "link.txt").is_symlink()
    assert (tmp_path / "new.txt").read_text() == NEW


def test_output_a_link_into_nowhere_is_refused(tmp_path):
    (tmp_path / "link.txt").symlink_to("nowhere/new.txt")
    with pytest.raises(gf.InvalidInputError, match=r"the directory .*nowhere does not exist"):
        check_writable(tmp_path / "link.txt")


def test_output_a_loop_of_links_is_refused(tmp_path):
    (tmp_path / "a.txt").symlink_to("b.txt")
    (tmp_path / "b.txt").symlink_to("a.txt")
    with pytest.raises(gf.InvalidInputError, match=r"a\.txt: cannot write it: .*symbolic links"):
        check_writable(tmp_path / "a.txt")
    with pytest.raises(OSError, match="symbolic links"):
        write(tmp_path / "a.txt")
    assert names(tmp_path) == ["a.txt", "b.txt"]


# ---- what is no regular file -------------------------------------------------------------------


def listen(fifo):
    """Read the pipe in a thread; the function that is returned waits for what came."""
    came = []
    thread = threading.Thread(target=lambda: came.append(fifo.read_text()), daemon=True)
    thread.start()

    def heard():
        thread.join(timeout=60)
        return came[0]

    return heard


def test_output_a_pipe_gets_the_content_and_stays_a_pipe(tmp_path):
    fifo, link = tmp_path / "fifo.txt", tmp_path / "link.txt"
    os.mkfifo(fifo)
    link.symlink_to(fifo.name)
    for path in (fifo, link):
        check_writable(path)
        heard = listen(fifo)
        write(path, 10_000 * NEW)
        assert heard() == 10_000 * NEW
        assert fifo.is_fifo()
    assert names(tmp_path) == ["fifo.txt", "link.txt"]


def test_output_a_pipe_waits_for_a_reader_that_is_about_to_come(tmp_path, monkeypatch):
    fifo = tmp_path / "fifo.txt"
    os.mkfifo(fifo)
    hearers = []
    sleep = atomic.time.sleep

    def start_reading(seconds):
        hearers.append(hearers[0] if hearers else listen(fifo))
        sleep(seconds)

    monkeypatch.setattr(atomic.time, "sleep", start_reading)
    write(fifo)
    assert hearers[0]() == NEW


def test_output_a_pipe_that_nobody_reads_is_refused(tmp_path, monkeypatch):
    monkeypatch.setattr(atomic, "READER_TIMEOUT", 0)
    os.mkfifo(tmp_path / "fifo.txt")
    with pytest.raises(OSError, match="cannot write it: no process reads this pipe"):
        write(tmp_path / "fifo.txt")
    assert (tmp_path / "fifo.txt").is_fifo()


def test_output_a_reader_that_goes_away_is_an_error_of_that_pipe(tmp_path):
    fifo = tmp_path / "fifo.txt"
    os.mkfifo(fifo)
    thread = threading.Thread(target=lambda: open(fifo, "rb").close(), daemon=True)
    thread.start()
    with pytest.raises(BrokenPipeError) as caught:
        write(fifo, 10**6 * NEW)
    assert caught.value.filename == str(fifo)


def test_output_a_terminal_is_written_to(tmp_path):
    reader, writer = os.openpty()
    try:
        device = Path(os.ttyname(writer))
        (tmp_path / "link.txt").symlink_to(device)
        for path in (device, tmp_path / "link.txt"):
            check_writable(path)
            write(path)
            assert os.read(reader, 1000).decode().replace("\r", "") == NEW
            assert device.is_char_device()
    finally:
        os.close(reader)
        os.close(writer)


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="Linux has it")
def test_output_a_device_that_is_full_is_an_error(tmp_path):
    (tmp_path / "full.txt").symlink_to("/dev/full")
    with pytest.raises(OSError, match="cannot write it: No space left") as caught:
        write(tmp_path / "full.txt")
    assert caught.value.filename == str(tmp_path / "full.txt")
    assert (tmp_path / "full.txt").is_symlink()
    assert Path("/dev/full").is_char_device()


@pytest.mark.skipif(not Path("/dev/fd/0").exists(), reason="no /dev/fd")
def test_output_a_file_that_is_open_here_is_written_to_where_it_stands(tmp_path):
    """To replace it would cut off whoever holds it open, such as the shell that redirected."""
    log = tmp_path / "log.txt"
    with log.open("w") as file:
        file.write("before\n")
        file.flush()
        (tmp_path / "link.txt").symlink_to(f"/dev/fd/{file.fileno()}")
        for path in (tmp_path / "link.txt", f"/dev/fd/{file.fileno()}"):
            check_writable(path)
            write(path)
        file.write("after\n")
    assert log.read_text() == f"before\n{NEW}{NEW}after\n"
    with pytest.raises(OSError, match="cannot write it"):
        write(tmp_path / "link.txt")  # which now leads nowhere


@pytest.mark.skipif(not Path("/dev/fd/0").exists(), reason="no /dev/fd")
def test_output_an_unnamed_pipe_is_written_to():
    reader, writer = os.pipe()
    try:
        write(f"/dev/fd/{writer}")
        assert os.read(reader, 1000).decode() == NEW
    finally:
        os.close(reader)
        os.close(writer)


def test_output_folders_and_sockets_are_refused(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)  # the path of a socket must be short
    (tmp_path / "folder.txt").mkdir()
    with socket.socket(socket.AF_UNIX) as made:
        made.bind("socket.txt")
        for path, what in (("folder.txt", "a directory"), ("socket.txt", "a socket")):
            Path("link.txt").symlink_to(path)
            for each in (path, "link.txt"):
                for act in (check_writable, write):
                    with pytest.raises(gf.InvalidInputError, match=f"{each}: got {what}, expected"):
                        act(each)
            Path("link.txt").unlink()
    assert names(tmp_path) == ["folder.txt", "socket.txt"]
    assert names(tmp_path / "folder.txt") == []


def test_output_a_block_device_is_refused(tmp_path):
    path = tmp_path / "disk.txt"
    try:
        os.mknod(path, stat.S_IFBLK | 0o666, os.makedev(7, 99))
    except PermissionError:
        pytest.skip("only root may make one")
    with pytest.raises(gf.InvalidInputError, match="got a block device, expected a file"):
        write(path)
    assert path.is_block_device()


# ---- places that cannot be written to ----------------------------------------------------------


def test_output_a_folder_that_is_not_there_or_none(tmp_path):
    (tmp_path / "file").write_text(OLD)
    with pytest.raises(gf.InvalidInputError, match=r"the directory .*no does not exist"):
        check_writable(tmp_path / "no" / "new.txt")
    with pytest.raises(gf.InvalidInputError, match="cannot write it: Not a directory"):
        check_writable(tmp_path / "file" / "new.txt")
    for folder in ("no", "file"):
        with pytest.raises(OSError, match=r"new\.txt"):
            write(tmp_path / folder / "new.txt")
    assert names(tmp_path) == ["file"]


def test_output_a_read_only_folder_is_refused_before_and_after_the_work(ordinary_user):
    old = ordinary_user / "old.txt"
    old.write_text(OLD)
    ordinary_user.chmod(0o500)
    for name in ("new.txt", "old.txt"):
        path = ordinary_user / name
        reason = f"cannot write it: no file can be made in {ordinary_user} (Permission denied)"
        with pytest.raises(gf.InvalidInputError, match=re.escape(reason)):
            check_writable(path)
        with pytest.raises(PermissionError, match=re.escape(reason)) as caught:
            write(path)
        assert caught.value.filename == str(path)
    with pytest.raises(gf.InvalidInputError, match=r"out: got .* write into \(Permission denied\)"):
        make_folder(ordinary_user, "out")
    with pytest.raises(gf.InvalidInputError, match=r"out: got .* write into \(Permission denied\)"):
        make_folder(ordinary_user / "below" / "it", "out")
    assert names(ordinary_user) == ["old.txt"]
    assert old.read_text() == OLD


def test_output_a_write_protected_file_is_not_replaced(ordinary_user):
    path = ordinary_user / "old.txt"
    path.write_text(OLD)
    path.chmod(0o400)
    with pytest.raises(gf.InvalidInputError, match="cannot write it: Permission denied"):
        check_writable(path)
    with pytest.raises(PermissionError):
        write(path)
    assert path.read_text() == OLD


@pytest.fixture
def of_another_user(request):
    """A file of root's that anybody may write to, in a folder of an ordinary user."""
    if os.geteuid() != 0:
        pytest.skip("only root may give files away")
    folder = request.getfixturevalue("ordinary_user")
    os.setresuid(0, 0, 0)
    path = folder / "old.txt"
    path.write_text(OLD)
    path.chmod(0o4666)
    return path, lambda: os.setresuid(65534, 65534, 0)


def test_output_a_file_of_another_user_is_replaced_where_that_is_permitted(of_another_user):
    path, switch = of_another_user
    switch()
    write(path)
    assert path.read_text() == NEW
    assert mode(path) == 0o666  # its set-user-ID would now lend another identity
    assert names(path.parent) == ["old.txt"]


def test_output_a_sticky_folder_protects_files_of_others(of_another_user):
    path, switch = of_another_user
    os.chown(path.parent, 0, 0)
    path.parent.chmod(0o1777)
    switch()
    with pytest.raises(PermissionError) as caught:
        write(path)
    assert caught.value.filename == str(path)
    assert path.read_text() == OLD
    assert names(path.parent) == ["old.txt"]


def test_output_a_folder_for_results(tmp_path):
    (tmp_path / "file").write_text(OLD)
    (tmp_path / "link").symlink_to("made")
    assert make_folder(tmp_path / "a" / "b", "out") == tmp_path / "a" / "b"
    assert make_folder(tmp_path / "a", "out") == tmp_path / "a"
    assert names(tmp_path / "a" / "b") == []
    for bad in ("file", "file/below", "link"):
        with pytest.raises(gf.InvalidInputError, match=r"out: got .*, expected a folder"):
            make_folder(tmp_path / bad, "out")
    assert (tmp_path / "file").read_text() == OLD


def process(code, *arguments, **options):
    """Run Python code in a process of its own."""
    return subprocess.Popen(
        [sys.executable, "-c", code, *map(str, arguments)],
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, encoding="utf-8", **options,
    )  # fmt: skip


def test_output_a_current_directory_that_is_gone(tmp_path):
    gone = tmp_path / "gone"
    gone.mkdir()
    code = (
        "import os, sys; from graspforce._util.atomic import *\n"
        "os.chdir(sys.argv[1]); os.rmdir(sys.argv[1])\n"
        "check_writable(sys.argv[2])\n"
        "with atomic_write(sys.argv[2]) as path: path.write_text('new')\n"
        "for act in (check_writable, lambda path: atomic_write(path).__enter__()):\n"
        "    try: act('here.txt')\n"
        "    except (OSError, InvalidInputError) as error: print(error)\n"
    )
    out, err = process(code, gone, tmp_path / "there.txt").communicate()
    assert err == ""
    assert out.count("cannot write it") == 2
    assert (tmp_path / "there.txt").read_text() == "new"


@pytest.mark.parametrize("name", ["SIGTERM", "SIGHUP", "SIGINT"])
def test_output_a_signal_ends_a_command_without_a_trace(tmp_path, name):
    (tmp_path / "old.txt").write_text(OLD)
    # A shell starts what runs in its background with SIGINT ignored; the tests may run there.
    usual = "default_int_handler" if name == "SIGINT" else "SIG_DFL"
    code = (
        "import signal, sys, time\n"
        f"signal.signal(signal.{name}, signal.{usual})\n"
        "from graspforce._util.atomic import atomic_write\n"
        "from graspforce.cli.process import as_command\n"
        "with as_command(), atomic_write(sys.argv[1]) as path:\n"
        "    path.write_text('half of wh'); print('writing', flush=True); time.sleep(60)\n"
    )
    running = process(code, tmp_path / "old.txt")
    assert running.stdout.readline() == "writing\n"
    assert len(names(tmp_path)) == 2
    running.send_signal(getattr(signal, name))
    running.communicate(timeout=60)
    assert running.returncode in (128 + getattr(signal, name), -getattr(signal, name))
    assert names(tmp_path) == ["old.txt"]
    assert (tmp_path / "old.txt").read_text() == OLD


def test_output_a_signal_that_is_ignored_stays_so():
    code = (
        "import signal; signal.signal(signal.SIGHUP, signal.SIG_IGN)\n"
        "from graspforce.cli.process import as_command\n"
        "with as_command(): signal.raise_signal(signal.SIGHUP); print('went on')\n"
    )
    assert process(code).communicate()[0] == "went on\n"


# ---- everything that is written ----------------------------------------------------------------

GRASP = gf.ForceProblem(np.eye(3), [1, 0, 0], gf.PCWF(0.5), c_max=20)
WRITERS = {
    "results.json": lambda path: files.write(path, [("a", gf.solve(GRASP))]),
    "results.csv": lambda path: files.write(path, [("a", gf.solve(GRASP))]),
    "results.npz": lambda path: files.write(path, [("a", gf.solve(GRASP))]),
    "ticks.csv": lambda path: short_log().write_csv(path),
}


def short_log():
    return scenarios.run(scenarios.get("static", duration=0.02))


@pytest.mark.parametrize("name", WRITERS)
def test_output_every_writer_writes_to_pipes_and_replaces_files_as_a_whole(
    tmp_path, name, monkeypatch
):
    act = WRITERS[name]
    act(tmp_path / name)
    content = (tmp_path / name).read_bytes()
    os.mkfifo(tmp_path / f"fifo-{name}")
    came = []
    reading = threading.Thread(
        target=lambda: came.append((tmp_path / f"fifo-{name}").read_bytes()), daemon=True
    )
    reading.start()
    act(tmp_path / f"fifo-{name}")
    reading.join(timeout=60)
    assert len(came[0]) == len(content)
    if not name.endswith("npz"):  # which holds the time
        assert came[0] == content

    def full(*_):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(os, "replace", full)
    with pytest.raises(OSError, match="No space left"):
        act(tmp_path / name)
    assert (tmp_path / name).read_bytes() == content
    assert names(tmp_path) == [f"fifo-{name}", name]


@pytest.mark.parametrize("ending", [".json", ".csv", ".npz"])
def test_output_a_full_disk_leaves_the_old_file(tmp_path, ending):
    """A limit on the size of files stands in for the disk."""
    path = tmp_path / f"out{ending}"
    path.write_text(OLD)
    code = (
        "import resource, sys; import graspforce as gf; from graspforce import files\n"
        "grasps = files.read(sys.argv[2])\n"
        "results = 50 * [(name, gf.solve(problem)) for name, problem in grasps]\n"
        "resource.setrlimit(resource.RLIMIT_FSIZE, (1000, 1000))\n"
        "try: files.write(sys.argv[1], results)\n"
        "except OSError as error: print(error.filename, error.strerror)\n"
    )
    several = Path(__file__).parents[1] / "examples" / "several_grasps.json"
    out, err = process(code, path, several).communicate()
    assert out == f"{path} cannot write it: File too large\n"
    assert err == ""
    assert path.read_text() == OLD
    assert names(tmp_path) == [path.name]
