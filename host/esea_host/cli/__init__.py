"""``esea-host``: the command line.  One file a group of commands; each registers itself."""

try:
    from esea_host.cli import (
        analyse,
        assess,
        board,
        bridge,
        commission,
        demo,
        interaction,
        life,
        live,
        logs,
        session,
        study,
        view,
        virtual,
        wrist,
    )
    from esea_host.cli.app import app, main
except ModuleNotFoundError as error:
    if not error.name or error.name.startswith("esea"):
        raise
    raise SystemExit(
        f"esea-host needs {error.name.partition('.')[0]}, which is not installed.\n"
        "Install it with: pip install 'esea-gen[host]'"
    ) from None

__all__ = [
    "analyse",
    "app",
    "assess",
    "board",
    "bridge",
    "commission",
    "demo",
    "interaction",
    "life",
    "live",
    "logs",
    "main",
    "session",
    "study",
    "view",
    "virtual",
    "wrist",
]
