"""A System's C, compiled and loaded, and the numpy types of its structs."""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import Any

import numpy as np

from esea_gen.emit.render import Renderer
from esea_gen.hostlib.codec import Field
from esea_gen.hostlib.compiler import compile_sources, declared
from esea_gen.language.block import Block
from esea_gen.language.ports import Port
from esea_gen.language.system import External, System


class LoadedC:
    """A System's generated C, compiled for the host."""

    def __init__(self, system: System, renderer: Renderer, flags: Sequence[str] = ()) -> None:
        self.system = system
        self.real = renderer.fmt.name
        self.prefix = renderer.prefix
        self.naming = renderer.naming
        self.files = renderer.files()
        driver = renderer.render("hostlib/driver.c.j2")
        files = {n: t for n, t in self.files.items() if not n.startswith("reference/")}
        link = ("-lm",) if renderer.fmt.needs_libm else ()
        self.path = compile_sources(files | {"driver.c": driver}, flags, link)
        # The driver's loops are declared by their own text: bodies are cut at the first brace.
        prototypes = re.sub(r"\)\s*\n\{.*?\n\}", ");", driver, flags=re.DOTALL)
        self.ffi = declared(self.files[f"{self.prefix}.h"] + prototypes)
        self.lib: Any = self.ffi.dlopen(str(self.path))
        self._dtypes: dict[str, np.dtype[Any]] = {}
        self._init = renderer.init_name

    def block_field(self, block: Block, group: str, port: Port) -> Field:
        """A field of a Block's own struct: ``in``, ``out`` or ``state``."""
        return Field(port.name, port, self.naming.fraction(block, group, port.name))

    def external_field(self, external: External) -> Field:
        """A field of a task's struct."""
        return Field(external.name, external.port, self.naming.external_fraction(external))

    def function(self, name: str) -> Any:
        """A function of the C by the name that its header gives it."""
        return getattr(self.lib, self._init if name == f"{self.prefix}_init" else name)

    def dtype(self, c_type: str) -> np.dtype[Any]:
        if c_type not in self._dtypes:
            self._dtypes[c_type] = self._convert(self.ffi.typeof(c_type))
        return self._dtypes[c_type]

    def _convert(self, ctype: Any) -> np.dtype[Any]:
        primitive = {"double": "f8", "float": "f4", "uint32_t": "u4", "int32_t": "i4"}
        if ctype.kind == "primitive":
            return np.dtype(primitive[ctype.cname])
        if ctype.kind == "array":
            return np.dtype((self._convert(ctype.item), (ctype.length,)))
        fields = ctype.fields
        return np.dtype(
            {
                "names": [n for n, _ in fields],
                "formats": [self._convert(f.type) for _, f in fields],
                "offsets": [f.offset for _, f in fields],
                "itemsize": self.ffi.sizeof(ctype),
            }
        )
