"""Takes what a bench-service tells of its runs, and makes an entry of each in the electronic notebook eLabFTW.

Needs Python alone. Addresses and secrets come from the environment:

    BENCH_URL=http://127.0.0.1:8000
    BENCH_SECRET='the one of bench.toml'
    ELAB_URL=https://elab.example
    ELAB_KEY='a key of the notebook'

and the port on which it listens from the command line: python receiver.py 8099
"""

import hashlib
import hmac
import html
import json
import os
import sys
import urllib.request
import uuid
from http.server import BaseHTTPRequestHandler, HTTPServer


def is_genuine(secret, body, signature):
    """Whether the service that knows the secret has signed this very body."""
    wanted = "sha256=" + hmac.new(secret.encode(), body, hashlib.sha256).hexdigest()
    return hmac.compare_digest(wanted, signature or "")


def entry_of(told):
    """Title and text of the entry for a run."""
    run, cell = told["run"], told["cell"]
    title = f"{run['label'] or run['name'] or run['id'][:8]}: {run['state']}"
    rows = {
        "cell": "not named" if cell is None else f"{cell['id']} {cell['label'] or ''}",
        "bench": run["bench"],
        "operator": run["operator"],
        "started": run["started_utc"],
        "ended": run["ended_utc"],
        "why": run["reason"],
        "samples": run["n_samples"],
        "SHA-256 of the samples": run["sha256"],
        "page": told["links"]["page"],
    }
    lines = [f"<tr><th>{name}</th><td>{html.escape(str(value))}</td></tr>" for name, value in rows.items() if value]
    return title, f"<table>{''.join(lines)}</table>"


def ask(url, key, method, data=None, kind="application/json"):
    """Send one request to the notebook; gives its answer."""
    headers = {"Authorization": key, "Content-Type": kind}
    return urllib.request.urlopen(urllib.request.Request(url, data, headers, method=method), timeout=60)


def add_entry(told, bench_url, elab_url, elab_key):
    """Make an entry with the run's bundle attached; gives the entry's address."""
    title, text = entry_of(told)
    made = ask(f"{elab_url}/api/v2/experiments", elab_key, "POST", b"{}").headers["Location"]
    address = f"{elab_url}/api/v2/experiments/{made.rstrip('/').rsplit('/', 1)[1]}"
    ask(address, elab_key, "PATCH", json.dumps({"title": title, "body": text}).encode())
    if told["run"]["n_samples"]:
        # Always from the bench that one knows, not from an address that somebody has sent.
        run_id = told["run"]["id"]
        bundle = f"{bench_url}/api/v1/runs/{run_id}/export?format=ro-crate"
        content = urllib.request.urlopen(bundle, timeout=300).read()
        border = uuid.uuid4().hex
        head = f'--{border}\r\nContent-Disposition: form-data; name="file"; filename="{run_id}.crate.zip"\r\n'
        form = f"{head}Content-Type: application/zip\r\n\r\n".encode() + content + f"\r\n--{border}--\r\n".encode()
        ask(f"{address}/uploads", elab_key, "POST", form, f"multipart/form-data; boundary={border}")
    return address


class Receiver(BaseHTTPRequestHandler):
    """Answers the service: 204 taken, 401 not signed, 502 the notebook did not take it (the service tries again)."""

    def do_POST(self):
        """Take one message."""
        body = self.rfile.read(int(self.headers.get("Content-Length", 0)))
        status = 204
        if not is_genuine(os.environ["BENCH_SECRET"], body, self.headers.get("X-Bench-Signature")):
            status = 401
        else:
            try:
                add_entry(json.loads(body), os.environ["BENCH_URL"], os.environ["ELAB_URL"], os.environ["ELAB_KEY"])
            except OSError as error:
                print(f"not entered: {error}", file=sys.stderr)
                status = 502
        self.send_response(status)
        self.end_headers()


if __name__ == "__main__":
    HTTPServer(("127.0.0.1", int(sys.argv[1])), Receiver).serve_forever()
