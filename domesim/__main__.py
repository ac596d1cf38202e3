"""``domesim``, and ``python -m domesim``."""

import sys


def main() -> None:
    """Run the command. Ctrl-C while it still loads is no traceback either."""
    try:
        from domesim.cli import run  # noqa: PLC0415
        from domesim.strips import keep_freed_memory  # noqa: PLC0415
    except KeyboardInterrupt:
        print("domesim: interrupted", file=sys.stderr)
        sys.exit(130)
    keep_freed_memory()
    run()


if __name__ == "__main__":
    main()
