"""`python -m bench_service.cli`, for when the script `bench-service` is not on the path."""

import sys

from bench_service.cli.main import main

if __name__ == "__main__":
    sys.exit(main())
