"""A service that is bound beyond its own machine, as a program, a page and the command line meet it."""

import json
import os
import stat
import subprocess
import sys
from pathlib import Path

import httpx

from bench_service.client import BenchClient

BENCH = "workers = 1\n[bench.sim]\nsimulate = { seed = 3 }\n"


def test_only_who_has_the_token_gets_in(tmp_path: Path) -> None:
    config, data = tmp_path / "bench.toml", tmp_path / "data"
    config.write_text(f"data_dir = '{data}'\n{BENCH}")
    command = [sys.executable, "-m", "bench_service.cli"]
    arguments = ["serve", "--json", "--config", str(config), "--host", "0.0.0.0", "--port", "0"]  # noqa: S104
    environment = {name: value for name, value in os.environ.items() if name not in ("BENCH_DATA_DIR", "BENCH_TOKEN")}
    process = subprocess.Popen([*command, *arguments], stdout=subprocess.PIPE, text=True, env=environment)
    try:
        assert process.stdout is not None
        told = json.loads(process.stdout.readline())
        url, token = told["address"], told["login"].partition("token=")[2]
        for address in ("/", "/healthz", "/api/v1/benches", "/static/main.js"):
            assert httpx.get(url + address).status_code == 401
        assert httpx.post(f"{url}/api/v1/benches/sim/stop").status_code == 401
        with BenchClient(url, token=token) as client:
            assert [bench["name"] for bench in client.benches()] == ["sim"]
        with httpx.Client(base_url=url, follow_redirects=True) as page:
            assert page.get(f"/login?token={token}").status_code == 200
            assert page.get("/api/v1/benches").status_code == 200
        # Its owner's own commands find the token where it is kept.
        stopped = subprocess.run([*command, "stop", "--config", str(config)], env=environment, capture_output=True)
        assert stopped.returncode == 0, stopped.stderr
        profile = tmp_path / "profile.csv"
        profile.write_text("time_s,current_A\n0,0\n5,0\n")
        out = ["--bench", "sim", "--out", str(tmp_path / "r.csv"), "--initial-soc", "0.5"]
        run = [*command, "run", str(profile), "--config", str(config), *out]
        played = subprocess.run(run, env=environment, capture_output=True)
        assert played.returncode == 0, played.stderr
        # Nobody else reads what it stores.
        modes = {stat.S_IMODE(path.stat().st_mode) for path in data.rglob("*") if path.is_file()}
        assert modes == {0o600} and stat.S_IMODE(data.stat().st_mode) == 0o700
    finally:
        process.terminate()
        process.communicate(timeout=60)
