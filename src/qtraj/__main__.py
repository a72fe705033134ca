"""`python -m qtraj`: the command line."""

from qtraj.cli.main import main

if __name__ == "__main__":
    main()
