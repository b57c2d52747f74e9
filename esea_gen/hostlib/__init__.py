"""Compile generated C and load it through cffi: the same files that ship."""

from esea_gen.hostlib.compiler import find_compiler
from esea_gen.hostlib.library import HostLibrary, compile_device
from esea_gen.hostlib.runner import CRunner

__all__ = ["CRunner", "HostLibrary", "compile_device", "find_compiler"]
