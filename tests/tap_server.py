"""A TAP service on 127.0.0.1 that does what a test tells it to: answer, fail, cut off, go away."""

import re
import threading
import urllib.parse
from contextlib import contextmanager
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer

VOTABLE = (
    '<?xml version="1.0"?><VOTABLE version="1.3" xmlns="http://www.ivoa.net/xml/VOTable/v1.3"><RESOURCE type="results">'
    '<INFO name="QUERY_STATUS" value="{value}">{text}</INFO></RESOURCE></VOTABLE>'
)


def columns_of_ours(adql):
    """The answer to a question for the columns of a schema: those that our own queries ask for."""
    from vsh.io.archive import ASTROMETRY, RELEASES, of_table

    schema = re.search(r"'(\w+)\.%'", adql)[1]
    release = next(each for each in RELEASES.values() if each.schema == schema)
    rows = set()
    for astrometry in ASTROMETRY[: 2 if release.name == "DR4" else 1]:
        asked = of_table("t.t", release=release, astrometry=astrometry)
        places = {alias: table for table, alias in re.findall(r"JOIN ([\w.]+) AS (\w)", asked)}
        rows |= {f"{places[alias]},{name}" for alias, name in re.findall(r"\b([gs])\.(\w+)", asked)}
    return "\n".join(["table_name,column_name", *sorted(rows)])


class Service:
    """What the server answers.

    Attributes
    ----------
    table : bytes
        The result.
    phases : list of str
        Of the job, one for each time it is asked; the last stays.
    send : int or None
        So many bytes of the result are sent before the connection is cut.
    refuse : str or None
        What is said of a query that is refused at once.
    error : str
        What is said of a job that failed.
    asked : list of (method, path, form)
    """

    def __init__(self, table):
        self.table, self.phases, self.send, self.refuse, self.error = table, ["COMPLETED"], None, None, "no such column"
        self.asked, self.jobs, self.status = [], 0, 200

    def submitted(self):
        return [form for method, path, form in self.asked if method == "POST" and path.endswith("/async")]


def form_of(body, kind):
    """The fields of a form, whose files stay bytes."""
    if not kind.startswith("multipart/form-data"):
        return dict(urllib.parse.parse_qsl(body.decode()))
    mark = kind.partition("boundary=")[2].encode()
    form = {}
    for part in body.split(b"--" + mark)[1:-1]:
        head, _, value = part.partition(b"\r\n\r\n")
        name = re.search(rb' name="([^"]+)"', head)[1].decode()
        form[name] = value.removesuffix(b"\r\n") if b"filename" in head else value.removesuffix(b"\r\n").decode()
    return form


class Handler(BaseHTTPRequestHandler):
    def log_message(self, *_):
        pass

    def answer(self, body, status=200, **headers):
        body = body if isinstance(body, bytes) else body.encode()
        self.send_response(status)
        for name, value in headers.items():
            self.send_header(name, value)
        self.send_header("Content-Length", str(len(body)))
        self.end_headers()
        self.wfile.write(body if self.server.service.send is None else body[: self.server.service.send])

    def do_POST(self):
        service, path = self.server.service, self.path
        length = int(self.headers.get("Content-Length") or 0)
        form = form_of(self.rfile.read(length), self.headers.get("Content-Type") or "")
        service.asked.append(("POST", path, form))
        if path.endswith("/sync"):
            return self.answer(columns_of_ours(form["QUERY"]))
        if service.refuse:
            return self.answer(VOTABLE.format(value="ERROR", text=service.refuse), 400)
        service.jobs += 1
        return self.answer("", 303, Location=f"http://{self.headers['Host']}/tap/async/{service.jobs}")

    def do_GET(self):
        service, path = self.server.service, self.path
        service.asked.append(("GET", path, {}))
        job = re.fullmatch(r"/tap/async/(\d+)(/.*)?", path)
        if not job or int(job[1]) > service.jobs:
            return self.answer(VOTABLE.format(value="ERROR", text="no such job"), 404)
        if job[2] == "/phase":
            return self.answer(service.phases.pop(0) if len(service.phases) > 1 else service.phases[0])
        if job[2] == "/error":
            return self.answer(VOTABLE.format(value="ERROR", text=service.error))
        if job[2] == "/results/result":
            return self.answer(service.table, service.status)
        return self.answer("<job/>")


@contextmanager
def serving(table):
    """The address of a service and what steers it."""
    server = ThreadingHTTPServer(("127.0.0.1", 0), Handler)
    server.service = Service(table)
    thread = threading.Thread(target=server.serve_forever, daemon=True)
    thread.start()
    try:
        yield f"http://127.0.0.1:{server.server_port}/tap", server.service
    finally:
        server.shutdown()
        server.server_close()
