"""A real Dask scheduler and real workers: same numbers, a worker killed, everything refused."""

from __future__ import annotations

import contextlib
import json
import os
import re
import shutil
import signal
import socket
import subprocess
import sys
import time
from pathlib import Path

import pytest

from esea_gen.analysis.campaign import Workers, run_cases
from esea_gen.analysis.cluster import code_digest
from tests.analysis.test_campaign import CONFIG, PATHS, killed_and_resumed, until
from tests.campaign_cases import compiled, draw, noted, seeded
from tests.conftest import ROOT, require_module
from tests.typed import typed

pytestmark = pytest.mark.ci


class Dask:
    """A real scheduler and real workers on this machine, each worker with a home of its own."""

    def __init__(self, folder: Path) -> None:
        self.folder, self.processes = folder, []
        require_module("distributed")
        where = folder / "scheduler.json"
        self.start("scheduler", "--host", "127.0.0.1", "--port", "0", "--scheduler-file", where)
        until(where.exists)
        self.address = until(lambda: json.loads(where.read_text() or "{}").get("address"))

    def start(self, kind, *arguments, **environment):
        home = self.folder / f"home-{len(self.processes)}"
        home.mkdir()
        quiet = {"HOME": str(home), "XDG_CACHE_HOME": str(home / "cache"), "PYTHONPATH": PATHS}
        quiet |= {"DASK_DISTRIBUTED__WORKER__PROFILE__ENABLED": "False"}
        with (home / "log").open("w") as log:
            process = subprocess.Popen(
                [sys.executable, "-m", "dask", kind, "--no-dashboard", *map(str, arguments)],
                cwd=home,
                env=os.environ | quiet | environment,
                stdout=log,
                stderr=subprocess.STDOUT,
                start_new_session=True,
            )
        self.processes.append(process)
        return process

    def worker(self, *arguments, nanny=False, **environment):
        before = len(self.workers())
        chosen = ("--nthreads", 1, *(() if nanny else ("--no-nanny",)), *arguments)
        process = self.start("worker", self.address, *chosen, **environment)
        until(lambda: len(self.workers()) > before)
        return process

    def workers(self) -> dict[str, int]:
        """Threads by address."""
        from distributed import Client

        with Client(self.address, set_as_default=False) as client:
            return dict(client.ncores())

    def end(self, process) -> None:
        """Whatever it has started, too."""
        with contextlib.suppress(ProcessLookupError):
            os.killpg(process.pid, signal.SIGKILL)
        process.wait()

    def homes(self, name: str) -> list[Path]:
        return sorted(self.folder.glob(f"home-*/{name}"))

    def close(self) -> None:
        for process in reversed(self.processes):
            self.end(process)

    def filled(self) -> Dask:
        """With two workers: one of this checkout, one of a copy of it elsewhere."""
        copy = self.folder / "copy"
        if not copy.exists():
            copied(copy)
        for paths in (PATHS, str(copy))[len(self.workers()) :]:
            self.worker(PYTHONPATH=paths)
        return self


def copied(folder: Path) -> None:
    # With what Python has compiled of it: a file of the same size and time is the same.
    for name in ("esea_gen", "templates", "tests/campaign_cases.py", "tests/__init__.py"):
        if (ROOT / name).is_dir():
            shutil.copytree(ROOT / name, folder / name)
        else:
            (folder / name).parent.mkdir(exist_ok=True)
            shutil.copyfile(ROOT / name, folder / name)


@pytest.fixture(scope="module")
def cluster(tmp_path_factory):
    made = Dask(tmp_path_factory.mktemp("dask"))
    try:
        yield made
    finally:
        made.close()


@pytest.fixture
def dask(cluster):
    return cluster.filled()


@pytest.fixture
def empty(tmp_path_factory):
    """A scheduler that nobody works for."""
    made = Dask(tmp_path_factory.mktemp("empty"))
    try:
        yield made
    finally:
        made.close()


def test_a_cluster_gives_the_same_bits(dask, tmp_path):
    cases, there = seeded(60, root=1, gain=2.0), Workers(cluster=dask.address)
    one = run_cases(draw, cases, configuration=CONFIG)
    far = run_cases(draw, cases, configuration=CONFIG, workers=there, folder=tmp_path)
    assert far.to_dict() == one.to_dict()
    assert {r.failure for r in far.failures} == {"RuntimeError: tripped at 2.0", "odd is inf"}
    # Cases may be written where they are needed: nothing of this test's text is on the workers.
    local = run_cases(lambda seed: {"x": seed % 7 / 3}, seeded(3), configuration=CONFIG)
    remote = run_cases(
        lambda seed: {"x": seed % 7 / 3}, seeded(3), configuration=CONFIG, workers=there
    )
    assert remote.to_dict() == local.to_dict()


def test_workers_compile_the_c_in_a_home_of_their_own(dask):
    there = Workers(cluster=dask.address)
    far = run_cases(compiled, seeded(6), configuration=CONFIG, workers=there)
    assert far.to_dict() == run_cases(compiled, seeded(6), configuration=CONFIG).to_dict()
    assert not far.failures
    assert len({p.parent for p in dask.homes("cache/esea-gen/*.so")}) == 2


def test_a_killed_campaign_goes_on_on_a_cluster(dask, tmp_path):
    killed_and_resumed(tmp_path, cluster=dask.address)


def refused(*arguments):
    """What a person reads, and after how long."""
    begun = time.monotonic()
    done = typed(*arguments)
    assert (done.returncode, done.stdout) == (2, ""), done.stderr
    assert done.stderr.startswith("esea-gen: ")
    assert "\n\n" not in done.stderr.strip()
    return " ".join(done.stderr.split()), time.monotonic() - begun


@pytest.mark.parametrize("name", ["simulate tuning", "passivity", "tune"])
def test_a_wrong_address_is_told_before_anything_is_computed(name):
    text, took_s = refused(*name.split(), "--cluster", "nowhere")
    assert "No Dask scheduler at 'nowhere'" in text
    assert "missing port number" in text
    assert "tcp://10.0.0.5:8786" in text
    assert took_s < 15


def test_nobody_or_somebody_else_answers(dask):
    with socket.create_server(("127.0.0.1", 0)) as other:
        silent = f"127.0.0.1:{other.getsockname()[1]}"
        text, took_s = refused("tune", "--cluster", silent)
        assert f"No Dask scheduler at '{silent}' (no answer within 5 s)" in text
        assert took_s < 15
    text, took_s = refused("tune", "--cluster", silent)
    assert f"No Dask scheduler at '{silent}'" in text
    assert took_s < 15
    text, _ = refused("tune", "--cluster", next(iter(dask.workers())))
    assert "a worker answers there" in text


def test_dask_is_not_installed(monkeypatch):
    monkeypatch.setitem(sys.modules, "distributed", None)
    text, _ = refused("tune", "--cluster", "127.0.0.1:8786")
    assert 'pip install "esea-gen[cluster]"' in text


def test_workers_that_would_give_other_numbers_are_refused(empty, tmp_path):
    def refusal():
        text, took_s = refused("tune", "--cluster", empty.address)
        assert took_s < 60
        return text

    assert "has no worker" in (text := refusal())
    assert f"dask worker {empty.address} --nthreads 1" in text
    changed, old = tmp_path / "changed", tmp_path / "old"
    copied(changed)
    with (changed / "esea_gen" / "twin" / "people.py").open("a") as source:
        source.write("# changed\n")
    (old / "esea_gen").mkdir(parents=True)
    (old / "esea_gen" / "__init__.py").touch()
    empty.worker(PYTHONPATH=str(changed))
    empty.worker(PYTHONPATH=str(old))
    empty.worker("--nthreads", 2)
    mine = code_digest()[:12]
    assert re.search(rf"code of esea_gen [0-9a-f]{{12}} \(here {mine}\)", text := refusal())
    assert "cannot load this esea_gen" in text
    assert "No module named 'esea_gen.analysis'" in text
    assert "2 threads (1 is needed" in text
    assert "Start every worker from the same installation" in text


def test_a_worker_is_killed_in_the_middle(dask, tmp_path):
    victim, folder = dask.processes[-1], tmp_path / "begun"
    folder.mkdir()
    cases = [{"seed": k, "folder": str(folder), "wait_s": 0.1} for k in range(24)]
    seen = []

    def progress(done, total, failed):
        seen.append((done, total, failed))
        if done >= 4 and victim.poll() is None:
            victim.kill()
            victim.wait()

    there = Workers(cluster=dask.address)
    result = run_cases(noted, cases, configuration=CONFIG, workers=there, progress=progress)
    assert victim.returncode == -signal.SIGKILL
    ran = [p.name.split("-") for p in folder.iterdir()]
    assert str(victim.pid) in {pid for _, pid, _ in ran}
    assert len(ran) > 24  # what it was running ran again
    assert seen == [(n, 24, 0) for n in range(25)]
    assert result.to_dict() == run_cases(noted, cases, configuration=CONFIG).to_dict()
