"""Workers of a cluster as they are looked at: what is refused and said, without any of them."""

from __future__ import annotations

import logging
from types import SimpleNamespace

import pytest

from esea_gen.analysis import cluster
from esea_gen.errors import UserError

from .conftest import require_module

HERE = {"python": "3.11", "gcc": "12.2.0"}


def test_what_differs_is_named_with_what_stands_here():
    same = cluster._differences(HERE, HERE | {"more": "1"}, 1)
    assert same == ""
    assert cluster._differences(HERE, {"python": "3.12"}, 1) == (
        "python 3.12 (here 3.11), gcc None (here 12.2.0)"
    )
    assert cluster._differences(HERE, HERE, 4) == (
        "4 threads (1 is needed, a case has its process to itself)"
    )
    assert cluster._differences(HERE, HERE | {"gcc": "13"}, 0) == (
        "gcc 13 (here 12.2.0), 0 threads (1 is needed, a case has its process to itself)"
    )


@pytest.mark.parametrize(("count", "more"), [(1, ""), (3, ""), (4, "; and 1 more"), (6, "; and 3")])
def test_three_workers_are_named_and_the_others_counted(count, more):
    text = str(cluster._refused("tcp://x:1", {f"w{k}": f"old {k}" for k in range(count)}))
    told = "; ".join(f"w{k}: old {k}" for k in range(min(count, 3)))
    assert "The cluster at tcp://x:1 has workers that would not give this machine's num" in text
    assert f"{told}{more}" in text
    assert ("more" in text) == (count > 3)
    assert "--nthreads 1" in text


class Client:
    """Two workers that say what they are told to."""

    def __init__(self, said, threads=None):
        self.said, self.threads, self.asked = said, threads or {}, []

    def wait_for_workers(self, count, timeout):
        self.asked.append((count, timeout))
        if not self.said:
            raise TimeoutError

    def ncores(self):
        return self.threads

    def run(self, function, on_error):
        assert (function, on_error) == (cluster.machine, "return")
        return self.said


def test_every_worker_is_asked_what_it_is(monkeypatch):
    monkeypatch.setattr(cluster, "machine", lambda: HERE)
    good = Client({"a": HERE, "b": HERE}, {"a": 1})
    cluster._check(good, "tcp://x:1")
    assert good.asked == [(1, 5.0)]
    for client, words in (
        (Client({}), r"The scheduler at tcp://x:1 has no worker\. .* dask worker tcp://x:1 --nthr"),
        (Client({"a": HERE, "b": OSError("gone")}), r"b: cannot load this esea_gen \(gone\)\."),
        (Client({"a": HERE | {"gcc": "9"}, "b": HERE}), r"a: gcc 9 \(here 12\.2\.0\)\."),
        (Client({"a": HERE, "b": HERE}, {"a": 1, "b": 2}), "numbers. b: 2 threads"),
    ):
        with pytest.raises(UserError, match=words):
            cluster._check(client, "tcp://x:1")


def test_a_worker_does_a_case_only_where_it_is_fit(monkeypatch):
    require_module("distributed")
    import distributed

    worker = SimpleNamespace(address="tcp://w:2", state=SimpleNamespace(nthreads=1))
    monkeypatch.setattr(distributed, "get_worker", lambda: worker)
    monkeypatch.setattr(cluster, "machine", lambda: HERE)
    assert cluster._fit(lambda case: 2 * case, 21, HERE) == 42
    old = cluster._fit(lambda case: 2 * case, 21, HERE | {"gcc": "9"})
    assert old == ("tcp://w:2", "gcc 12.2.0 (here 9)")
    worker.state.nthreads = 2
    assert cluster._fit(lambda case: 2 * case, 21, HERE)[1].startswith("2 threads")


def test_a_connection_leaves_the_log_as_it_was(monkeypatch):
    require_module("distributed")
    import distributed

    log, seen = logging.getLogger("distributed.client"), []
    monkeypatch.setattr(log, "level", logging.INFO)

    class Connected:
        def __init__(self, address, **how):
            seen.append((address, how, log.level))

        def __enter__(self):
            return self

        def __exit__(self, *_):
            seen.append("closed")

    monkeypatch.setattr(distributed, "Client", Connected)
    monkeypatch.setattr(cluster, "_probe", lambda address: seen.append(("probe", address)))
    monkeypatch.setattr(cluster, "_check", lambda c, address: seen.append((type(c), address)))
    with cluster.connected("tcp://x:1") as found:
        assert isinstance(found, Connected)
        assert log.level == logging.CRITICAL
    how = {"timeout": 5.0, "set_as_default": False}
    assert seen == [
        *(("probe", "tcp://x:1"), ("tcp://x:1", how, logging.CRITICAL), (Connected, "tcp://x:1")),
        "closed",
    ]
    assert log.level == logging.INFO

    def refuse(c, address):
        raise UserError("no", "no")

    monkeypatch.setattr(cluster, "_check", refuse)
    with pytest.raises(UserError), cluster.connected("tcp://x:1"):
        pass
    assert log.level == logging.INFO


def test_without_the_package_its_installation_is_named(monkeypatch):
    monkeypatch.setitem(__import__("sys").modules, "distributed", None)
    with (
        pytest.raises(UserError, match=r"pip install 'esea-gen\[cluster\]'"),
        cluster.connected("tcp://x:1"),
    ):
        pass


def test_the_code_is_known_by_every_file_of_the_package_and_its_templates(monkeypatch, tmp_path):
    package, templates, digested = tmp_path / "esea_gen", tmp_path / "templates", []
    for name in (
        *("esea_gen/a.py", "esea_gen/analysis/cluster.py", "esea_gen/__pycache__/a.pyc"),
        *("esea_gen/_templates/t", "esea_gen/_firmware/f", "esea_gen/x/_templates/kept"),
        *("templates/_templates/kept", "templates/c.j2"),
    ):
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text(name[-1])
    monkeypatch.setattr(cluster, "__file__", str(package / "analysis" / "cluster.py"))
    monkeypatch.setattr(cluster, "template_folder", lambda: templates)
    monkeypatch.setattr(cluster, "files_digest", lambda found: digested.append(found) or "0" * 64)
    assert cluster.code_digest() == "0" * 64
    assert digested == [
        {
            **{"True/a.py": "79", "True/analysis/cluster.py": "79", "True/x/_templates/kept": "74"},
            **{"False/_templates/kept": "74", "False/c.j2": "32"},
        }
    ]


def test_a_machine_is_its_versions_its_code_its_compiler_and_its_library(monkeypatch):
    monkeypatch.setattr(cluster, "versions", lambda: {"python": "3"})
    monkeypatch.setattr(cluster, "code_digest", lambda: "0123456789abcdef")
    monkeypatch.setattr(cluster.platform, "libc_ver", lambda: ("glibc", "2.36"))
    monkeypatch.setattr(cluster.shutil, "which", lambda name: None)
    ask = cluster.machine.__wrapped__
    said = {"python": "3", "code of esea_gen": "0123456789ab", "gcc": "none", "libc": "glibc-2.36"}
    assert ask() == said
    monkeypatch.setattr(cluster.shutil, "which", lambda name: "/" if name == "gcc" else None)
    told = []

    def run(command, **how):
        told.append((command, how))
        return SimpleNamespace(stdout="12.2.0\n")

    monkeypatch.setattr(cluster.subprocess, "run", run)
    assert ask() == said | {"gcc": "12.2.0"}
    how = {"capture_output": True, "text": True, "check": True}
    assert told == [(["gcc", "-dumpfullversion"], how)]
