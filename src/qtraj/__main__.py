"""Run the command line as `python -m qtraj`."""

from qtraj.cli.main import main

if __name__ == "__main__":
    main()
