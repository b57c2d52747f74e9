"""``python -m esea_host.bench``: figures of link and recording."""

from esea_host.bench.link import main

main()
