"""A study in one page: flow of participants, sessions, deviations, adverse events, intact logs."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence, Set
from dataclasses import dataclass

from esea_gen.errors import UserError
from esea_gen.pages import environment
from esea_host.study.exchange import NOBODY, omissions
from esea_host.study.folder import StudyFolder
from esea_host.study.log import LoggedEvent
from esea_host.study.session import SessionState

HEADS = ("who", "session", "begun", "by", "trials done", "failed", "skipped", "note")
ACTS = ("allocate", "disclose", "unblind", "export", "repair", "delete", "takeover", "rehearsal")


@dataclass(frozen=True)
class StudyFlow:
    """Counts of people, in the order of a CONSORT diagram: lines of boxes."""

    simulated: bool
    before: tuple[str, ...]
    allocated: tuple[str, ...]
    arms: tuple[tuple[tuple[str, ...], ...], ...]

    def lines(self) -> list[str]:
        boxes = [self.before, self.allocated, *(box for arm in self.arms for box in arm)]
        return [*([NOBODY] if self.simulated else []), *("; ".join(box) for box in boxes)]


def flow_of(study: StudyFolder) -> StudyFlow:
    entries = study.trail(strict=False)
    enrolled = list(study.participants())
    lost = {
        word: {e.data["participant"] for e in entries if e.kind == kind}
        for kind, word in (("withdraw", "withdrew"), ("delete", "data deleted"))
    }
    found = study.allocations
    opened = [c for c in enrolled if found.group(c) is not None] if found.needs_list else enrolled
    idle = set(enrolled) - set(opened)
    before = [f"Enrolled: {len(enrolled)}"]
    before += _counted({f"{w}, without a group": codes & idle for w, codes in lost.items()})
    waiting = idle.difference(*lost.values())
    allocated = [f"Allocated: {len(opened)}", *_counted({"not yet": waiting})]
    if found.needs_list:
        allocated.append(f"places of the sealed list: {found.places()}")
    states = states_of(study)
    arms: list[tuple[tuple[str, ...], ...]] = []
    if study.protocol.file.groups and not study.blinded("operator"):
        for group, order in sorted(study.protocol.file.groups.items()):
            members = [c for c in opened if found.group(c) == group]
            title = f"Group {group}: {', then '.join(order)}"
            arms.append(_arm(study, title, members, states, lost))
    else:
        arms.append(_arm(study, "All participants", opened, states, lost))
    return StudyFlow(study.simulated, tuple(before), tuple(allocated), tuple(arms))


def _counted(found: Mapping[str, Set[str]]) -> list[str]:
    return [f"{what}: {len(codes)}" for what, codes in found.items() if codes]


def states_of(study: StudyFolder) -> dict[tuple[str, int], SessionState | UserError]:
    found: dict[tuple[str, int], SessionState | UserError] = {}
    for code, number, path in study.sessions(every=True):
        try:
            found[code, number] = study.read(code, number, path)
        except UserError as error:
            found[code, number] = error
    return found


def _arm(
    study: StudyFolder,
    title: str,
    members: Sequence[str],
    states: Mapping[tuple[str, int], SessionState | UserError],
    lost: Mapping[str, Set[str]],
) -> tuple[tuple[str, ...], ...]:
    boxes: list[tuple[str, ...]] = [(title, f"participants: {len(members)}")]
    for number, session in enumerate(study.protocol.file.session):
        begun = [states[c, number] for c in members if (c, number) in states]
        whole = [s for s in begun if isinstance(s, SessionState) and not s.remaining]
        told = f"begun: {len(begun)}, complete: {len(whole)}"
        boxes.append((f"Session {number + 1}, {session.name}", told))
    used = sum(bool(study.rows(c, strict=False)) for c in members)
    gone = _counted({what: codes & set(members) for what, codes in lost.items()})
    boxes.append((f"Data used: {used}", *gone))
    return tuple(boxes)


def _sessions(
    study: StudyFolder, states: Mapping[tuple[str, int], SessionState | UserError]
) -> list[tuple[str, ...]]:
    begun = {
        (e.data["participant"], e.data["session"]): e
        for e in reversed(study.trail(strict=False))
        if e.kind == "session_start"
    }
    rows: list[tuple[str, ...]] = []
    for (code, number), state in states.items():
        start = begun.get((code, number))
        head = (code, str(number + 1), _day(start), start.by if start else "")
        if isinstance(state, UserError):
            rows.append((*head, "", "", "", f"not readable: {state.what}"))
            continue
        count = Counter(state.states.values())
        done = f"{count['completed']} of {len(state.plan.trials)}"
        rows.append((*head, done, str(count["failed"]), str(count["skipped"]), state.ended))
    return rows


def _people(study: StudyFolder, entries: Sequence[LoggedEvent]) -> list[tuple[str, ...]]:
    consents = {e.data["participant"]: e.data for e in entries if e.kind == "consent"}
    keys, found = ("date", "form", "by"), study.allocations
    return [
        (code, found.stratum(code), *(str(consents.get(code, {}).get(k, "")) for k in keys))
        for code in study.participants()
    ]


def _day(entry: LoggedEvent | None) -> str:
    return entry.utc[:16].replace("T", " ") if entry is not None else ""


def study_page(study: StudyFolder) -> str:
    entries, states = study.trail(strict=False), states_of(study)

    def rows(kinds: Sequence[str], *keys: str) -> list[tuple[str, ...]]:
        return [
            (_day(e), e.by, *(str(e.data.get(k, "")) for k in keys))
            for e in entries
            if e.kind in kinds
        ]

    early = [
        (_day(e), e.by, e.data["participant"], f"session before its day: {e.data['early']}")
        for e in entries
        if e.kind == "session_start" and e.data.get("early")
    ]
    acts = [(_day(e), e.by, _act(e)) for e in entries if e.kind in ACTS]
    who = ("participant", "severity", "relation", "action", "text")
    return (
        environment()
        .get_template("page/study.html.j2")
        .render(
            title=study.protocol.file.title,
            protocol=study.protocol.file.name,
            simulated=study.simulated,
            until=_day(entries[-1]),
            groups_shown=not study.blinded("operator"),
            flow=flow_of(study),
            left_out=omissions(study),
            people=_people(study, entries),
            session_heads=HEADS,
            sessions=_sessions(study, states),
            adverse=rows(["adverse"], *who),
            deviations=sorted(rows(["deviation"], "participant", "text") + early),
            acts=acts,
            problems=study.problems(),
            hashes=study.content().items(),
        )
    )


def _act(entry: LoggedEvent) -> str:
    # Neither a group nor the code that opens it.
    hidden = ("group", "code", "sealed", "sha256", "file")
    shown = {k: v for k, v in entry.data.items() if k not in hidden}
    texts = {k: " ".join(map(str, v)) if isinstance(v, list) else str(v) for k, v in shown.items()}
    told = ", ".join(f"{k} {text}" for k, text in texts.items() if text)
    return f"{entry.kind}: {told}" if told else entry.kind
