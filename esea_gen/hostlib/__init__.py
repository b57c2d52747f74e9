"""Compile generated C and load it through cffi: the same files that ship."""

from esea_gen.hostlib.compiler import find_compiler
from esea_gen.hostlib.library import CRunner, HostLibrary, compile_device

__all__ = ["CRunner", "HostLibrary", "compile_device", "find_compiler"]
