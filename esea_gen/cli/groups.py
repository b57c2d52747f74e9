"""Command groups that import a command only when it runs, not for help.

Completion and help must answer at once, and the imports of the commands take seconds.
"""

from __future__ import annotations

import ast
import os
import re
from collections import defaultdict
from collections.abc import Callable, Iterator, Mapping
from functools import cache, partial
from importlib import import_module
from itertools import permutations
from pathlib import Path
from types import SimpleNamespace
from typing import Any, ClassVar, get_args, get_type_hints

import typer
from typer.core import TyperGroup

from esea_gen.errors import UserError
from esea_gen.typed import refuse_unplain_number


class WholeSentences(TyperGroup):
    """Group whose help shows the complete first sentence of each command."""

    def format_commands(self, ctx: Any, formatter: Any) -> None:
        """Nothing ends in three dots."""
        with formatter.section("Commands"):
            helps = ((n, self.commands[n]) for n in self.list_commands(ctx))
            formatter.write_dl([(n, c.get_short_help_str(limit=200)) for n, c in helps])


class GroupedCommands(TyperGroup):
    """Commands by group, from the files of a package."""

    package: ClassVar[str]  # dotted name; its app.py has the application, app
    groups: ClassVar[Mapping[str, Mapping[str, str]]]

    @property
    def commands(self) -> Any:
        return _Commands(self.package, self._homes())

    @commands.setter
    def commands(self, _: Any) -> None:
        return

    def _homes(self) -> dict[str, str]:
        return {name: home for group in self.groups.values() for name, home in group.items()}

    def list_commands(self, ctx: Any) -> list[str]:
        return list(self._homes())

    def format_commands(self, ctx: Any, formatter: Any) -> None:
        """Each group under its title, the first sentence of each command whole."""
        for title, group in self.groups.items():
            with formatter.section(title):
                formatter.write_dl([(name, self._sentence(name)) for name in group])

    def _sentence(self, name: str) -> str:
        # From the text of its file; help that is made elsewhere needs the command itself.
        folder = Path(str(import_module(self.package).__file__)).parent
        text = (folder / f"{self._homes()[name].split()[0]}.py").read_text(encoding="utf-8")
        words = _written_helps(text).get(name, "")
        if not words:
            return str(self.commands[name].get_short_help_str(limit=200))
        return " ".join(words.split("\n\n")[0].split()).partition(". ")[0].rstrip(".") + "."


class _Commands(Mapping[str, Any]):
    # What is typed is loaded, and nothing else.

    def __init__(self, package: str, homes: Mapping[str, str]) -> None:
        self._package, self._homes = package, homes

    def __getitem__(self, name: str) -> Any:
        return _command(self._package, name, self._homes[name])

    def __iter__(self) -> Iterator[str]:
        return iter(self._homes)

    def __len__(self) -> int:
        return len(self._homes)


@cache
def _command(package: str, name: str, homes: str) -> Any:
    for home in homes.split():
        import_module(f"{package}.{home}")
    known = registered(package)
    alone = typer.Typer(add_completion=False, rich_markup_mode=None)
    alone.callback()(lambda: None)
    for c in known.registered_commands:
        if (c.name or getattr(c.callback, "__name__", "")) == name:
            alone.registered_commands.append(c)
    alone.registered_groups += [g for g in known.registered_groups if g.name == name]
    group: Any = typer.main.get_command(alone)
    return _with_checks(group.commands[name])


_REGISTERED: defaultdict[str, typer.Typer] = defaultdict(typer.Typer)


def registered(package: str) -> typer.Typer:
    """Take commands from the application, of which typer builds at each run all that it has."""
    app, taken = import_module(f"{package}.app").app, _REGISTERED[package]
    for kind in ("registered_commands", "registered_groups"):
        getattr(taken, kind).extend(getattr(app, kind))
        getattr(app, kind).clear()
    return taken


# typer takes 1_0 for ten, full-width digits and inf.
def _with_checks(command: Any) -> Any:
    hints = get_type_hints(command.callback) if command.callback else {}
    for param in command.params:
        hint = hints.get(param.name)
        kinds = {hint, *get_args(hint), *(x for a in get_args(hint) for x in get_args(a))}
        if kinds & {int, float}:
            param.process_value = partial(_checked, param, int in kinds, param.process_value)
    command.invoke = partial(_apart, command, command.invoke)
    for below in getattr(command, "commands", {}).values():
        _with_checks(below)
    return command


# How results begin: in a folder that is read, only pages, tables, pictures may be written again.
RESULTS = rb'<!DOC|{\n  "schema|table,part|name,seed|controller,name|<\?xml|\x89PNG|%PDF|SQLite|PK'


def _apart(command: Any, then: Callable[..., Any], ctx: Any) -> Any:
    # No result takes the place of a file that another word of the command names, or has in it.
    named: list[tuple[Any, Path, Any, bool]] = []
    for param in command.params:
        given, writes = ctx.params.get(param.name), hasattr(param.callback, "writes")
        for x in given if isinstance(given, list | tuple) else [given]:
            for w in [x, *re.split("[:,?]", x)] if isinstance(x, str) else [x]:
                if isinstance(w, Path) or (isinstance(w, str) and os.path.isfile(w)):
                    named.append((w, Path(os.path.realpath(w)), param, writes))
    for (x, path, param, writes), (_, other, source, also) in permutations(named, 2):
        inside = writes and other in path.parents and not also and path.is_file()
        lost = inside and not re.match(RESULTS, path.read_bytes())
        beside = command.name == "identify" and path.is_dir()  # replaces no file but its own
        if source is not param and (lost or (writes and path == other and not beside)):
            said = ("is named twice", "is read")[lost] + f": {source.opts[0]} and {param.opts[0]}"
            raise UserError(f"{x} {said}.", "Give another file to write.")
    return then(ctx)


def _checked(param: Any, whole: bool, then: Callable[..., Any], ctx: Any, value: Any) -> Any:
    name = param.opts[0] if param.param_type_name == "option" else param.name.upper()
    for text in value if isinstance(value, list | tuple) else [value]:
        if isinstance(text, str) and not ctx.resilient_parsing:
            refuse_unplain_number(name, text, whole)
    return then(ctx, value)


def _written_helps(text: str) -> dict[str, str]:
    """Help by command, as a file's text has it: docstrings under ``@app.command``, ``help=``."""
    found, typers = {}, {}
    for node in ast.parse(text).body:
        match node:
            case ast.FunctionDef(name=own):
                for by in node.decorator_list:
                    if isinstance(by, ast.Call) and ast.unparse(by.func) == "app.command":
                        found[_text(by, "name") or own] = ast.get_docstring(node) or ""
            case ast.Assign(targets=[ast.Name(own)], value=ast.Call() as made):
                typers[own] = _text(made, "help")
            case ast.Expr(ast.Call(ast.Attribute(attr="add_typer"), [added]) as call):
                made_here = isinstance(added, ast.Call)
                helps = _text(added, "help") if made_here else typers[ast.unparse(added)]
                found[_text(call, "name")] = helps
    return found


def _text(call: Any, keyword: str) -> str:
    # Of an f-string the part before what is put in.
    for given in (*call.args, *(k.value for k in call.keywords if k.arg == keyword)):
        first = given.values[0] if isinstance(given, ast.JoinedStr) else given
        if isinstance(first, ast.Constant):
            return str(first.value)
    return ""


def take_values_as_typed() -> None:
    """Leave the values of a word that is being completed unchecked."""
    # typer checks values by pydantic, whose import takes half the time of a press of the tab key.
    # A typer that does without it has no such name: then nothing is changed.
    from typer import core

    if hasattr(core, "build_runtime_param"):
        unchecked = SimpleNamespace(coerce=lambda value, **_: value)
        vars(core)["build_runtime_param"] = lambda _: unchecked
