"""Many simulated participants do a study, on as many processes as there are."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from contextlib import closing
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from joblib import Parallel, delayed

from esea_gen.analysis.cluster import connected, run_on
from esea_gen.errors import UserError
from esea_gen.trust import allow
from esea_host.study.allocation import strata_of
from esea_host.study.folder import StudyFolder
from esea_host.study.log import read_log
from esea_host.study.plan import generator
from esea_host.study.protocol import Protocol
from esea_host.study.source import InputSource, SimulatedSource

# From the participant's number to what gives the source of each session, told the days between.
Sources = Callable[[int], Callable[[int, float], InputSource]]


def code_of(index: int) -> str:
    return f"V{index + 1:03d}"


@dataclass(frozen=True)
class EveryTask:
    seed: int

    def __call__(self, index: int) -> Callable[[int, float], InputSource]:
        def source(number: int, _: float) -> InputSource:
            return SimulatedSource(int(generator(self.seed, 5, index, number).integers(2**31)))

        return source


def run_everybody(
    folder: Path,
    protocol: Protocol,
    participants: int,
    sources: Sources,
    jobs: int = 1,
    cluster: str | None = None,
    say: Callable[[str], None] | None = None,
) -> list[str]:
    folder = folder.resolve()
    study = StudyFolder.create(folder, protocol, simulated=True, durable=False)
    codes = [code_of(k) for k in range(participants)]
    strata = strata_of(protocol.file)
    for k, stratum in enumerate(strata):
        study.enrol(codes[k :: len(strata)], consent=True, strata=[stratum])
    trusted = [c.sha256 for c in study.protocol.code]
    work, cases = partial(_everything, folder, sources, trusted), enumerate(codes)
    if cluster is None:
        done = Parallel(n_jobs=jobs, return_as="generator_unordered")(map(delayed(work), cases))
        found = _told(done, participants, say)
    else:
        with connected(cluster) as client:
            found = _told(run_on(client, cluster, work, cases), participants, say)
    if len(found) < participants:
        raise UserError(
            f"Workers of {cluster} died: {participants - len(found)} participants are missing.",
            "Run it again in a new folder.",
        )
    ends = [
        {"participant": code, "session": number, "head": read_log(path).entries[-1].hash}
        for code, number, path in study.sessions()
    ]
    study.record_all(("session_end", end) for end in ends)
    return sorted(filter(None, found))


def _told(done: Iterable[str], participants: int, say: Callable[[str], None] | None) -> list[str]:
    found = []
    for reason in done:
        found.append(reason)
        if say:
            say(f"{len(found)} of {participants} simulated participants")
    return found


def _everything(
    folder: Path, sources: Sources, trusted: Sequence[str], case: tuple[int, str]
) -> str:
    index, code = case
    allow(trusted)  # on a worker, as where the study was begun
    # All sessions of one participant; the first that ends early is the last one.
    study = StudyFolder.open(folder, durable=False)
    source = sources(index)
    for number, plan in enumerate(study.protocol.file.session):
        with closing(source(number, plan.after_days)) as inputs:
            session = study.session(code, number, inputs)
            reason = session.run()
            session.close()
        if reason:
            return f"{code}, session {number + 1}: {reason}"
    return ""
