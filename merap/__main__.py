"""`python -m merap` is `merap`."""

from merap.cli.main import main

main()
