"""`python -m torchradiometry` is the command line."""

from torchradiometry.cli import main

if __name__ == "__main__":
    main()
