"""Names that become identifiers of the emitted C, and those that C, C++ or Arduino has taken."""

from __future__ import annotations

import re

_FORM = re.compile(r"[A-Za-z][A-Za-z0-9_]*")
# Headers define too many macros in capitals to list: NAN, EOF, Arduino's PI, B0, DEC.
_CAPITALS = re.compile(r"[A-Z][A-Z0-9_]+")


def _words(text: str) -> frozenset[str]:
    return frozenset(text.split())


# C89 to C23, C++98 to C++23 with the alternative tokens, and macros in place of a name.
KEYWORDS = _words("""
    alignas alignof and and_eq asm auto bitand bitor bool break case catch char char16_t
    char32_t char8_t class co_await co_return co_yield compl complex concept const const_cast
    consteval constexpr constinit continue decltype default delete do double dynamic_cast else
    enum explicit export extern false float for fortran friend goto if imaginary import inline
    int long module mutable namespace new noexcept noreturn not not_eq nullptr operator or
    or_eq private protected public register reinterpret_cast requires restrict return short
    signed sizeof static static_assert static_cast struct switch template this thread_local
    throw true try typedef typeid typename typeof typeof_unqual union unsigned using virtual
    void volatile wchar_t while xor xor_eq errno linux unix
""")
# Macros of the standard headers, of Arduino.h and of Windows' headers, and Arduino's types.
_MACROS = _words("""
    abs analogInPinToBit analogPinToChannel assert bit bitClear bitRead bitSet bitToggle
    bitWrite boolean byte cbi cli clockCyclesPerMicrosecond clockCyclesToMicroseconds
    constrain degrees digitalPinToBitMask digitalPinToInterrupt digitalPinToPCICR
    digitalPinToPCICRbit digitalPinToPCMSK digitalPinToPCMSKbit digitalPinToPort
    digitalPinToTimer F far fpclassify highByte I interface interrupts isfinite isgreater
    isgreaterequal isinf isless islessequal islessgreater isnan isnormal isunordered
    kill_dependency lowByte math_errhandling max microsecondsToClockCycles min near
    noInterrupts offsetof pascal portInputRegister portModeRegister portOutputRegister radians
    round sbi sei setjmp signbit sq stderr stdin stdout va_arg va_copy va_end va_start word
""")


def fault_of(name: str) -> str:
    """Reason why a name is not possible in the emitted C; empty if it is."""
    if not _FORM.fullmatch(name):
        return "is not a C identifier that begins with a letter"
    if "__" in name:
        return "has two underscores in a row, which C++ reserves"
    if name in KEYWORDS:
        return "is a keyword or a reserved word of C or C++"
    if name in _MACROS:
        return "is a macro or a type of C's or Arduino's headers"
    if _CAPITALS.fullmatch(name):
        return "is all capitals, as the macros of C and Arduino are"
    return ""


def check_flags(port: str, names: list[str]) -> None:
    """Reject names of a status word's bits that the dialect cannot have, or that occur twice."""
    if len({n for n in names if re.fullmatch("[A-Z][A-Z0-9_]*", n)}) < len(names):
        raise ValueError(f"port {port}: flags {names} are not all different names in capitals")


def check_name(kind: str, name: str) -> None:
    """Reject a name that is not possible in the emitted C."""
    fault = fault_of(name)
    if not fault:
        return
    better = re.sub(r"_+", "_", re.sub(r"\W", "_", name, flags=re.ASCII)).strip("_")
    if not better[:1].isalpha():
        better = f"x{better}"
    if better.isupper():
        better = better.lower()
    if fault_of(better):
        better += "_value"
    raise ValueError(f"{kind} name {name!r} {fault}; use {better!r}, for example")
