"""Value analysis by Frama-C of the hand-written C: state machine, store, and the link."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace

from esea_gen.device import Device
from esea_gen.emit.build import format_hash
from esea_gen.emit.dialect import render_dialect
from esea_gen.emit.formats import FORMATS
from esea_gen.emit.render import Renderer
from esea_gen.files import template_folder
from esea_gen.targets import firmware_folder
from esea_gen.verify.proof import EvaResult, analysed

CONTRACTS = {
    "static uint32_t crc_over(": """
    assigns \\result \\from crc, ((char const *)from)[0 .. count - 1];""",
    "static uint32_t crc_in_flash(": """
    requires inside: at + SET_AT + head->bytes + 4 <= flash->area_bytes;
    assigns \\result \\from *head;""",
    "static bool look(": """
    requires there: area < 2 && slot < flash->area_bytes / SLOT_BYTES;
    assigns \\result, *head \\from area, slot;
    ensures read: \\initialized(head);
    ensures truth: \\result == 0 || \\result == 1;""",
    "static bool blank(": """
    requires there: area < 2 && slot < flash->area_bytes / SLOT_BYTES;
    assigns \\result \\from area, slot;
    ensures truth: \\result == 0 || \\result == 1;""",
    "MAVLINK_HELPER uint16_t mavlink_finalize_message_buffer(": """
    assigns \\result, *msg, *status \\from *msg, *status, length;""",
    "static void mavlink_sha256_calc(": """
    assigns m->u, m->counter[0 .. 7] \\from *m;""",
}


@dataclass(frozen=True)
class AnalysedPart:
    """One analysis: its driver and sources, what it takes by contract, how finely it looks."""

    driver: str
    sources: tuple[str, ...] = ()
    defines: tuple[str, ...] = ()
    taken: tuple[str, ...] = ()
    options: Mapping[str, str] = field(default_factory=dict)


PARTS = {
    "machine": AnalysedPart("eva_machine.c", ("machine.c",)),
    "store": AnalysedPart(
        "eva_store.c", taken=("crc_over", "look", "blank"), options={"-eva-precision": "1"}
    ),
    "store, a slot": AnalysedPart(
        "eva_store.c",
        defines=("-DESEA_EVA_SLOT",),
        taken=("crc_in_flash",),
        options={"-eva-precision": "2", "-eva-domains": "gauges", "-eva-min-loop-unroll": "80"},
    ),
    "store, a sum": AnalysedPart(
        "eva_store.c",
        # Small sets: every length that fits two slots.
        defines=(
            *("-DESEA_EVA_SUM", "-DESEA_STORE_PARAMETERS=4u", "-DESEA_STORE_ENCODERS=2u"),
            *("-DESEA_STORE_LIVES=1u", "-DESEA_LIFE_CLASSES=2u", "-DESEA_LIFE_POINTS=2u"),
        ),
        taken=("crc_over",),
        options={"-eva-precision": "1", "-eva-slevel": "30", "-eva-min-loop-unroll": "10"},
    ),
    "parser": AnalysedPart(
        "eva_parser.c",
        defines=("-DESEA_EVA_FRAME",),
        options={"-eva-precision": "2", "-eva-slevel": "100"},
    ),
    "parser, the reader": AnalysedPart(
        "eva_parser.c",
        defines=("-DESEA_EVA_READER",),
        options={"-eva-precision": "1", "-eva-slevel": "1000"},
    ),
    "parser, a signature": AnalysedPart(
        "eva_parser.c",
        defines=("-DESEA_EVA_SIGNATURE",),
        taken=("mavlink_sha256_calc",),
        options={"-eva-precision": "1", "-eva-slevel": "60", "-eva-min-loop-unroll": "20"},
    ),
    "link": AnalysedPart(
        "eva_link.c",
        taken=("mavlink_finalize_message_buffer",),
        options={"-eva-precision": "2", "-eva-slevel": "30", "-eva-split-return": "full"},
    ),
    "parser, a sum": AnalysedPart("eva_parser.c", defines=("-DESEA_EVA_SUM",)),
}
# The store again with the largest program units, which pad each part of a slot; above, units of 4.
PARTS |= {
    f"{name}, units of 32": replace(of, defines=(*of.defines, "-DESEA_EVA_UNIT=32u"))
    for name, of in PARTS.items()
    if of.driver == "eva_store.c"
}


def _with_contracts(text: str) -> str:
    for before, contract in CONTRACTS.items():
        whole = before if before.startswith("MAVLINK_HELPER") else f"\n{before}"
        # The definition, which opens a body; a prototype is left alone.
        found = re.search(re.escape(whole) + r"[^;{]*\{", text)
        if found:
            at = found.start() + len(whole) - len(before)
            text = f"{text[:at]}/*@{contract} */\n{text[at:]}"
    return text


def _sources(device: Device) -> dict[str, str]:
    """Firmware, dialect and the device's own headers, as they lie beside each other."""
    renderer = Renderer(
        device.system, FORMATS["f32"], format_hash(device, "f32"), "-", device.title
    )
    files = renderer.files() | dict(render_dialect(device).files)
    for folder in ("app", "port"):
        for path in (firmware_folder() / folder).glob("*.[ch]"):
            files[path.name] = path.read_text(encoding="utf-8")
    for path in (template_folder() / "proof").glob("*.c"):
        files[path.name] = path.read_text(encoding="utf-8")
    return {n: _with_contracts(t) for n, t in files.items()}


def prove_firmware(
    device: Device, part: str, change: Callable[[str, str], str] | None = None
) -> EvaResult:
    """Analyse a part of the hand-written C, one of ``PARTS``."""
    of = PARTS[part]
    files = _sources(device)
    link = [
        f"'-DESEA_{name}=\"esea_{device.name}_link.{suffix}\"'"
        for name, suffix in (("LINK_HEADER", "h"), ("BINDING", "c"))
    ]
    options = [("-warn-special-float", "none"), *of.options.items()]
    if of.taken:
        options.append(("-eva-use-spec", ",".join(of.taken)))
    alarms, unproven, reached = analysed(
        files,
        (of.driver, *of.sources),
        (*of.defines, *link),
        [word for option in options for word in option],
        change,
        folders=("mavlink",),
    )
    lines = files[of.driver].splitlines()
    assumed = tuple(s.strip() for s in lines if "/* assumed" in s)
    return EvaResult(device.name, part, alarms, unproven, assumed, *reached)


def prove_drive(
    device: Device, real: str, free: bool = False, change: Callable[[str, str], str] | None = None
) -> EvaResult:
    """Analyse a whole device: its tasks, latches and conversions, with all its Blocks."""
    renderer = Renderer(device.system, FORMATS[real], format_hash(device, real), "-", device.title)
    files = renderer.files()
    # The marks of a run are plain accesses here: one thread.
    own = f"{renderer.prefix}.c"
    files[own] = f"#define ESEA_FENCE() ((void)0)\n{files[own]}"
    # The compiler's own, which the analysis has neither body nor words for.
    real_h = f"{renderer.prefix}_real.h"
    files[real_h] = f"#define __builtin_fabsf(x) ((x) < 0.0f ? -(x) : (x))\n{files[real_h]}"
    sources = sorted(n for n in files if n.endswith(".c") and n != "main.c")
    units = f"{renderer.prefix}_units.h" in files
    checked = [i for i, b in device.system.blocks.items() if b.name == "limits"]
    tasks = [t.name for t in device.system.tasks]
    driver = renderer.render(
        "proof/eva_drive.c.j2", free=free, units=units, checked=checked, tasks=tasks
    )
    # Floats may be NaN and infinite: that is no undefined behaviour.
    options = ("-warn-special-float", "none")
    alarms, unproven, reached = analysed(
        files | {"eva.c": driver},
        ["eva.c", *sources],
        ("-DESEA_Q31_PORTABLE_CLZ",),
        options,
        change,
    )
    trusted = () if free else (i for i, b in device.system.blocks.items() if i not in checked)
    assumed = [
        f"coeffs.{i}.{p.name}: as prepare leaves it"
        for i in trusted
        for p in device.system.blocks[i].coefficients
    ]
    return EvaResult(device.name, real, alarms, unproven, tuple(assumed), *reached)
