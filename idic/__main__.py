"""``python -m idic``: the same as the command ``idic``."""

from idic.cli import main

if __name__ == "__main__":
    main()
