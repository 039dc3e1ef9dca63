"""`python -m pumps_cli` is `pumps`."""

from pumps_cli.app import main

if __name__ == "__main__":
    main()
