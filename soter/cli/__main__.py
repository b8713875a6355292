"""`python -m soter.cli` is `soter`."""

from soter.cli.app import main

if __name__ == "__main__":
    main()
