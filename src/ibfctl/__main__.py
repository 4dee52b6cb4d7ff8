"""`python -m ibfctl` is `ibfctl`."""

from ibfctl.cli.main import main

main()
