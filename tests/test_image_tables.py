"""What is read off an image: symbol tables, sizes, listings and call graphs, all made up."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace

import pytest

from esea_gen.emit.formats import FORMATS
from esea_gen.errors import UserError
from esea_gen.language.system import Task
from esea_gen.targets import find_board
from esea_gen.verify import firmware, preempt
from esea_gen.verify.stack import CallGraph, deepest_stack, stack_by_priority


@pytest.fixture
def says(monkeypatch):
    """Have every program of the compiler's say a text; its commands."""
    asked: list[list[str]] = []

    def told(text: str) -> list[list[str]]:
        def run(command, **_):
            asked.append([str(c) for c in command])
            return SimpleNamespace(stdout=text, stderr="", returncode=0)

        for module in (firmware, preempt):
            monkeypatch.setattr(module, "find_compiler", lambda name, *_: name)
            monkeypatch.setattr(module.subprocess, "run", run)
        return asked

    return told


# -- symbols ---------------------------------------------------------------------------------------

NM = """\
/tmp/x/esea_a.o: esea_a_step T 0 40
/tmp/x/esea_a.o: esea_b_step U
/tmp/x/esea_a.o: __aeabi_dmul U
/tmp/x/esea_b.o: esea_b_step T 0 8
/tmp/x/esea_b.o: memcpy U
/tmp/x/esea_b.o: __aeabi_idivmod U
/tmp/x/esea_b.o: maybe w
/tmp/lib: c.a[odd: name.o]: own t 10 4
"""


def test_symbols_by_file_name_and_kind(says):
    asked = says(NM)
    found = firmware.symbols([Path("/tmp/x/esea_a.o"), Path("/tmp/x/esea_b.o")])
    assert found[:2] == [("esea_a.o", "esea_a_step", "T"), ("esea_a.o", "esea_b_step", "U")]
    assert found[6:] == [("esea_b.o", "maybe", "w"), ("lib: c.a[odd: name.o]", "own", "t")]
    assert asked[0][1:] == ["-A", "-P", "/tmp/x/esea_a.o", "/tmp/x/esea_b.o"]
    assert asked[0][0].endswith("nm")


def test_what_nobody_defines_and_control_code_must_not_ask_for(says):
    says(NM)
    assert firmware.double_arithmetic([Path("a.o")]) == [
        "esea_a.o: __aeabi_dmul",
        "esea_b.o: maybe",
    ]


@pytest.mark.parametrize(
    ("name", "allowed"),
    [
        *((f"mem{what}", True) for what in ("cpy", "move", "set")),
        *((f"__aeabi_{n}", True) for n in ("memcpy4", "memclr", "idiv", "uidiv", "uidivmod")),
        *((f"__aeabi_{n}", True) for n in ("ldivmod", "uldivmod", "lmul", "llsl", "llsr", "lasr")),
        *((n, True) for n in ("__asan_report_load4", "__ubsan_handle_add_overflow")),
        *((n, False) for n in ("memcmp", "__aeabi_dadd", "__aeabi_f2d", "__aeabi_fadd", "sinf")),
        *((n, False) for n in ("malloc", "xmemcpy", "memcpyx", "__aeabi_idivx")),
    ],
)
def test_what_the_compilers_own_library_may_do(says, name, allowed):
    says(f"a.o: {name} U\n")
    assert firmware.double_arithmetic([Path("a.o")]) == ([] if allowed else [f"a.o: {name}"])


def test_helpers_of_double_arithmetic_each_once_in_order(says):
    names = ["__muldf3", "__aeabi_dadd", "main", "__aeabi_f2d", "__aeabi_dadd", "__aeabi_cdcmple"]
    says("".join(f"a.elf: {n} T 0 8\n" for n in [*names, "__aeabi_fadd", "x__adddf3", "f2d"]))
    wanted = ["__aeabi_cdcmple", "__aeabi_dadd", "__aeabi_f2d", "__muldf3"]
    assert firmware.double_helpers(Path("a.elf")) == wanted


def test_sizes_of_the_sections_that_are_loaded(says):
    asked = says(
        "a.elf  :\nsection  size  addr\n.text  1200  134217728\n.data  36  536870912\n"
        ".bss 500 536870948\nTotal 1736\nnotes 12 0\n.only 7\n.odd 1 2 3\n"
    )
    assert firmware._sections(Path("a.elf"), "size") == {".text": 1200, ".data": 36, ".bss": 500}
    assert asked == [["size", "-A", "a.elf"]]


def test_the_hash_in_a_header():
    assert firmware._hash_in('#define A 1\n#define ESEA_X_CONTENT_HASH "0a1b2c"\n') == "0a1b2c"
    assert firmware._hash_in('#define ESEA_X_OTHER_HASH "0a1b2c"\n') == ""


def test_addresses_without_the_bit_that_says_thumb(says):
    says("step T 8000101 20\nhelper t 8000203 4\nport B 20000005 4\nlost U\nown d 20000011 2\n")
    assert preempt.addresses(SimpleNamespace(elf="a.elf")) == {
        **{"step": 0x8000100, "helper": 0x8000202, "port": 0x20000005, "own": 0x20000011},
    }


LISTING = """
a.elf:     file format elf32-littlearm

08000100 <first>:
 8000100:\tpush\t{r4, lr}
 8000102:\tvadd.f32\ts0, s0, s1
 8000106:\t.word\t0x20000000
0800010a <second>:
 800010a:\tbx\tlr
0800010c <third.part>:
 800010c:\tnop
"""


def test_instructions_of_some_functions_and_no_data(says):
    says(LISTING)
    image = SimpleNamespace(elf="a.elf")
    assert preempt.instructions_of(image, ["first"]) == [0x8000100, 0x8000102]
    assert preempt.instructions_of(image, ["third.part", "second"]) == [0x800010A, 0x800010C]
    assert preempt.instructions_of(image, ["none"]) == []


def test_members_of_the_ports_struct_are_words(monkeypatch, tmp_path):
    (tmp_path / "port").mkdir()
    (tmp_path / "port" / "port.h").write_text(
        "typedef struct { int other; } early_t;\n"
        "typedef struct {\n    /* a; comment */\n    uint32_t (*now)(void); /* of it; */\n"
        "    void (*put)(const uint8_t *data, size_t n);\n    uint32_t base_ticks;\n"
        "    uint32_t last;\n} esea_port_t;\nstruct { int later; };\n"
    )
    monkeypatch.setattr(preempt, "firmware_folder", lambda: tmp_path)
    places = {n: preempt._port_place(n) for n in ("now", "put", "base_ticks", "last")}
    assert places == {"now": 0, "put": 4, "base_ticks": 8, "last": 12}


def test_the_slower_task_is_the_one_that_is():
    tasks = [SimpleNamespace(name=n, every=e) for n, e in (("sense", 1), ("control", 5))]
    device = SimpleNamespace(system=SimpleNamespace(tasks=tasks))
    assert preempt.slower_task(device).name == "control"


# -- building --------------------------------------------------------------------------------------


def test_an_object_is_kept_until_text_header_or_flags_change(monkeypatch, tmp_path):
    made: list[str] = []

    def compiled(command, folder, what):
        assert command[0].endswith("gcc")
        made.append(f"{what} {' '.join(map(str, command[1:]))}")
        target = Path(command[-1])
        target.write_text(f"object {(folder / what).read_text()}")
        if "-graph" in command:
            target.with_suffix(".ci").write_text(f"graph of {what}")

    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    monkeypatch.setattr(firmware, "_run", compiled)
    monkeypatch.setattr(firmware, "find_compiler", lambda name, *_: name)
    monkeypatch.setattr(firmware, "compiler_version", lambda gcc: "gcc 1")
    folder = tmp_path / "a"
    (folder / "in").mkdir(parents=True)
    (folder / "one.c").write_text("1")
    (folder / "in" / "two.c").write_text("2")
    (folder / "in" / "all.h").write_text("h")
    toolchain = find_board("netduinoplus2").processor.toolchain

    def build(*flags: str) -> int:
        made.clear()
        objects = firmware.compile_objects(folder, toolchain, flags, ["one.c", "in/two.c"])
        assert objects == [folder / "one.o", folder / "in" / "two.o"]
        texts = [(folder / n).read_text() for n in ("one.c", "in/two.c")]
        assert [o.read_text() for o in objects] == [f"object {t}" for t in texts]
        return len(made)

    assert build("-O2", "-graph") == 2
    assert made[1] == f"in/two.c -O2 -graph -c in/two.c -o {folder / 'in' / 'two.o'}"
    for path in folder.rglob("*.o"):
        path.unlink()
        path.with_suffix(".ci").unlink()
    assert build("-O2", "-graph") == 0
    assert (folder / "in" / "two.ci").read_text() == "graph of in/two.c"
    assert build("-O1", "-graph") == 2
    (folder / "one.c").write_text("3")
    assert build("-O1", "-graph") == 1
    (folder / "in" / "all.h").write_text("g")
    assert build("-O1", "-graph") == 2
    (folder / "in" / "all.h").rename(folder / "in" / "other.h")
    assert build("-O1", "-graph") == 2
    monkeypatch.setattr(firmware, "compiler_version", lambda gcc: "gcc 2")
    assert build("-O1", "-graph") == 2
    # The same text under another name is another object.
    (folder / "in" / "two.c").write_text("3")
    assert build("-O1", "-graph") == 1


def test_the_hand_written_code_is_told_of_the_device():
    def told(bits: float, gear: float | None, needs_Hz: float | None = None):
        quantity = SimpleNamespace
        actuator = None if gear is None else quantity(encoder_bits=quantity(value=gear))
        encoder = quantity(resolution_bits=quantity(value=bits))
        device = quantity(name="x", file=quantity(encoder=encoder, actuator=actuator))
        return firmware._defined(device, find_board("netduinoplus2"), needs_Hz)

    header, encoder, *clocks = told(14.0, None)
    assert (header, encoder) == ('-DESEA_LINK_HEADER="esea_x_link.h"', "-DESEA_ENCODER_BITS=14u")
    clock = ["-DESEA_CLOCK_HZ=168000000u", "-DESEA_RESET_HZ=16000000u"]
    assert clocks == [*clock, "-DESEA_NEEDS_HZ=168000000u"]
    assert told(12.0, 17.0, 17.2e6)[-2:] == ["-DESEA_NEEDS_HZ=17200000u", "-DESEA_GEAR_BITS=17u"]


def test_encoders_with_more_bits_than_the_drivers_read_are_refused():
    def device(**bits: float):
        told = {f"{k}.{v}": SimpleNamespace(value=b) for (k, v), b in zip(
            (("encoder", "resolution_bits"), ("actuator", "encoder_bits")), bits.values(),
            strict=False,
        )}  # fmt: skip
        return SimpleNamespace(origin="x.toml", quantities=told.items)

    board = find_board("netduinoplus2")
    firmware._can_be_read(device(a=14, b=24), board)
    firmware._can_be_read(device(a=15, b=25), find_board("mps2-an500"))
    firmware._can_be_read(device(), board)
    for more, said in (({"a": 15, "b": 24}, "resolution_bits = 15.*14 bits"),
                       ({"a": 14, "b": 25}, "encoder_bits = 25.*24 bits")):  # fmt: skip
        with pytest.raises(UserError, match=said) as error:
            firmware._can_be_read(device(**more), board)
        assert "--board mps2-an500" in str(error.value.fix)


def test_an_image_is_put_in_place_whole_and_may_be_run(tmp_path):
    built = tmp_path / "a.elf"
    built.write_bytes(b"\x7fELF")
    placed = firmware._place(built, tmp_path / "new" / "out")
    assert (placed.name, placed.read_bytes()) == ("a.elf", b"\x7fELF")
    assert placed.stat().st_mode & 0o777 == 0o755
    assert [p.name for p in placed.parent.iterdir()] == ["a.elf"]
    with pytest.raises(UserError, match="cannot be written"):
        firmware._place(built, built)


def built_image(monkeypatch, tmp_path, board: str, **changes):
    """An image whose compiler, linker and call graphs are made up; what they were asked."""
    asked: dict[str, list] = {"objects": [], "link": []}
    arm = find_board(board).processor.toolchain
    numbers = {
        "sections": {".text": 1000, ".data": 20, ".bss": 300, ".noinit": 64, ".stack": 4096},
        "helpers": [],
        "bounds": {"main": 1000, "tick": 3096},
        **changes,
    }

    def objects(folder, toolchain, flags, sources):
        asked["objects"].append(([str(f) for f in flags], list(sources)))
        return [folder / f"{n}.o" for n in sources]

    def linked(command, folder, what):
        asked["link"].append(([str(c) for c in command], what))
        command[-1].write_bytes(b"image")

    def bounds(graph, fast, slow, fpu):
        asked["bounds"] = [fast, slow, fpu]
        return numbers["bounds"]

    for name, made in {
        **{"compile_objects": objects, "_run": linked, "stack_by_priority": bounds},
        "double_helpers": lambda elf, toolchain: {toolchain: numbers["helpers"]}[arm],
        "double_arithmetic": lambda made, toolchain: {toolchain: numbers.get("foreign", [])}[arm],
        "_sections": lambda elf, size: numbers["sections"],
        "deepest_stack": lambda graphs, entry: len(entry),
        **{"find_compiler": lambda name, *_: name, "compiler_version": lambda gcc: f"{gcc} 1"},
        "render_dialect": lambda device: SimpleNamespace(files={"d.h": ""}),
    }.items():
        monkeypatch.setattr(firmware, name, made)
    quantity = SimpleNamespace
    tasks = [Task(n, (), every=e) for n, e in (("sense", 1), ("law", 5), ("fast", 1))]
    device = SimpleNamespace(
        **{"name": "x", "laws": changes.get("laws", ()), "origin": "x.toml"},
        system=quantity(tasks=tasks),
        quantities=lambda: {"encoder.resolution_bits": quantity(value=15)},
        file=quantity(encoder=quantity(resolution_bits=quantity(value=14)), actuator=None),
    )
    files = dict.fromkeys(("main.c", "esea_x_b.c", "esea_x_a.c", "esea_x_b.h"), "")
    files["esea_x.h"] = '#define ESEA_X_CONTENT_HASH "f00d"\n'
    return firmware.build_firmware(device, board, tmp_path, files), asked


def test_figures_of_an_image_and_what_is_compiled_into_it(monkeypatch, tmp_path):
    image, asked = built_image(monkeypatch, tmp_path, "netduinoplus2")
    told = image.to_dict()
    assert (told.pop("elf"), image.elf.read_bytes()) == ("esea_x_netduinoplus2.elf", b"image")
    assert told == {
        **{"board": "netduinoplus2", "real": "f32", "device": "x", "content_hash": "f00d"},
        **{"flash_bytes": 1020, "ram_bytes": 320, "noinit_bytes": 64, "stack_bytes": 4096},
        "step_stack_bytes": {"sense": 17, "law": 15, "fast": 16},
        "stack_bounds_bytes": {"main": 1000, "tick": 3096},
        "compiler": "arm-none-eabi-gcc 1",
    }
    assert asked["bounds"] == [["esea_x_sense_step", "esea_x_fast_step"], ["esea_x_law_step"], True]
    (flags, sources), (app_flags, app_sources) = asked["objects"]
    assert sources == ["f32/esea_x_a.c", "f32/esea_x_b.c"]
    assert "-fcallgraph-info=su" in flags
    assert "-fcallgraph-info=su" in app_flags
    assert {n.split("/")[0] for n in app_sources} == {"app", "drivers", "boards", "port"}
    assert app_sources.index("port/cortex_m.c") > app_sources.index("drivers/biss.c")
    header = FORMATS["f32"].link_header("esea_x")
    for flag in ("-DESEA_ENCODER_BITS=14u", f'-DESEA_LINK_HEADER="{header}"', "-Idialect",
                 '-DESEA_BOARD_NAME="netduinoplus2"', "-If32", "-Iapp"):  # fmt: skip
        assert flag in app_flags
    ((command, what),) = asked["link"]
    assert what == "the image"
    at = command.index("-T")
    assert command[at + 1 : at + 3] == ["boards/netduinoplus2/link.ld", "-o"]
    objects = [c for c in command if c.endswith(".o")]
    assert len(objects) == 2 + len(app_sources)


def test_an_image_without_what_a_processor_needs_has_no_such_figures(monkeypatch, tmp_path):
    image, asked = built_image(monkeypatch, tmp_path, "host", sections={".text": 7, ".data": 2})
    assert (image.flash_bytes, image.ram_bytes, image.noinit_bytes, image.stack_bytes) == (
        9,
        2,
        0,
        0,
    )
    assert (image.stack_bounds_bytes, "bounds" in asked) == ({}, False)
    assert "-T" not in asked["link"][0][0]
    app_flags, app_sources = asked["objects"][1]
    assert "-fcallgraph-info=su" not in app_flags
    assert not any(n.startswith("port/") for n in app_sources)
    image, _ = built_image(monkeypatch, tmp_path, "host", sections={".bss": 3}, foreign=["a: x"])
    assert (image.flash_bytes, image.ram_bytes) == (0, 3)


def test_an_image_that_may_overflow_or_counts_in_doubles_is_refused(monkeypatch, tmp_path):
    with pytest.raises(UserError, match=r"the stack may need 4097 bytes .* the image has 4096"):
        built_image(monkeypatch, tmp_path, "netduinoplus2", bounds={"main": 1, "tick": 4096})
    with pytest.raises(RuntimeError, match="double arithmetic: __adddf3, __muldf3"):
        built_image(monkeypatch, tmp_path, "mps2-an500", helpers=["__adddf3", "__muldf3"])
    with pytest.raises(RuntimeError, match=r"the control code is not f32 only: a\.o: sin, b\.o: y"):
        built_image(monkeypatch, tmp_path, "netduinoplus2", foreign=["a.o: sin", "b.o: y"])
    with pytest.raises(UserError, match="resolution_bits = 15"):
        built_image(monkeypatch, tmp_path, "netduinoplus2", laws=("smc",))
    assert not list(tmp_path.iterdir())
    # What is linked for this computer may hold doubles.
    built_image(monkeypatch, tmp_path, "host", helpers=["__adddf3"])


def test_a_compiler_that_refuses_is_quoted(tmp_path):
    firmware._run(["true"], tmp_path, "a.c")
    command = ["sh", "-c", "echo wrong here >&2; exit 3"]
    with pytest.raises(RuntimeError, match=r"a\.c does not build:\nwrong here"):
        firmware._run(command, tmp_path, "a.c")


# -- stacks ----------------------------------------------------------------------------------------


def node(name: str, used: str = "") -> str:
    label = f"{name}\\na.c:1:5" + (f"\\n{used}\\n0 dynamic objects" if used else "")
    return f'node: {{ title: "{name}" label: "{label}" }}\n'


def edge(caller: str, called: str) -> str:
    return f'edge: {{ sourcename: "{caller}" targetname: "{called}" label: "a.c:2:3" }}\n'


def graph_file(path: Path, own: dict[str, int], calls: list[tuple[str, str]]) -> Path:
    text = "".join(node(n, f"{b} bytes (static)") for n, b in own.items())
    path.write_text(text + "".join(edge(*c) for c in calls))
    return path


def test_the_deepest_path_counts_and_not_the_sum(tmp_path):
    own = {"top": 24, "mid": 16, "leaf": 104, "wide": 119}
    calls = [("top", "mid"), ("mid", "leaf"), ("top", "wide"), ("leaf", "memcpy")]
    one = graph_file(tmp_path / "a.ci", own, calls)
    (tmp_path / "b.ci").write_text(node("memcpy") + node("last", "8 bytes (static)"))
    graph = CallGraph.read([one, tmp_path / "b.ci"])
    assert graph.own == {**own, "last": 8}
    assert graph.calls["top"] == {"mid", "wide"}
    assert deepest_stack([one], "top") == 24 + 16 + 104
    assert deepest_stack([one], "wide") == 119
    assert (graph.deepest("memcpy"), graph.deepest("nobody")) == (0, 0)
    graph.own["wide"] = 121
    assert graph.deepest("top") == 24 + 121


@pytest.mark.parametrize("kind", ["dynamic", "dynamic,bounded"])
def test_a_stack_of_unknown_size_is_refused(tmp_path, kind):
    (tmp_path / "a.ci").write_text(node("f", f"16 bytes ({kind})"))
    with pytest.raises(ValueError, match="f uses a stack of unknown size"):
        CallGraph.read([tmp_path / "a.ci"])


def test_a_call_by_pointer_reaches_what_may_be_pointed_to():
    pointer = "__indirect_call"
    own = {"loop": 10, "a.c:port_send": 30, "x.c:hw_spi": 50, "x.c:hw_spi_late": 70, "step": 40}
    own |= {"esea_biss_read": 5, "drivers/escon.c:poll": 6, "app/store.c:put": 7, "hw_own": 1000}
    graph = CallGraph(own, {n: {pointer} for n in own if n not in ("step", "hw_own")})
    graph.calls["step"] = {"esea_biss_read"}
    with pytest.raises(ValueError, match="recursion: esea_biss_read -> __indirect_call -> x"):
        graph.deepest("esea_biss_read", ["esea_biss_read"])
    for name in ("x.c:hw_spi", "x.c:hw_spi_late", "a.c:port_send"):
        del graph.calls[name]
    assert graph.deepest("loop") == 10
    assert graph.deepest("loop", ["a.c:port_send", "step"]) == 10 + max(30, 40 + 5 + 70)
    # A driver calls the functions of the hardware and no other.
    for name in ("esea_biss_read", "drivers/escon.c:poll", "app/store.c:put"):
        assert graph.deepest(name, ["hw_own"]) == own[name] + 70
    graph.calls["x.c:hw_spi"] = {"loop"}
    assert graph.deepest("esea_biss_read", ["a.c:port_send"]) == 5 + 50 + 10 + 30
    with pytest.raises(ValueError, match="recursion"):
        graph.deepest("loop", ["step", "loop"])


@pytest.mark.parametrize(("fpu", "frame"), [(False, 36), (True, 108)])
def test_every_priority_with_its_frame_and_what_it_may_call(fpu, frame):
    pointer = "__indirect_call"
    own = {
        **{"esea_reset_handler": 1, "esea_slower_handler": 2, "esea_tick_handler": 4},
        **{"usart1_handler": 8, "esea_cortex_m_received": 16, "a.c:port_put": 32},
        **{"esea_board_wait": 48, "sense_step": 64, "law_step": 128},
    }
    calls = {n: {pointer} for n in ("esea_reset_handler", "esea_slower_handler")}
    calls |= {"esea_tick_handler": {pointer}, "usart1_handler": {"esea_cortex_m_received"}}
    calls["esea_cortex_m_received"] = {pointer}
    found = stack_by_priority(CallGraph(own, calls), ["sense_step"], ["law_step"], fpu)
    assert found == {
        **{"main": 1 + 128 + 64, "slower": 2 + 128 + 64 + frame, "tick": 4 + 64 + 64 + frame},
        "receive": 8 + 16 + 48 + 64 + frame,
    }
    own["a.c:port_put"] = 60
    found = stack_by_priority(CallGraph(own, calls), [], [], fpu)
    assert (found["main"], found["receive"]) == (1 + 60 + 64, 8 + 16 + 60 + 64 + frame)
    for name in ("esea_reset_handler", "usart1_handler"):
        less = {n: b for n, b in own.items() if n != name}
        with pytest.raises(ValueError, match=f"no call graph has {name}"):
            stack_by_priority(CallGraph(less, calls), [], [], fpu)
