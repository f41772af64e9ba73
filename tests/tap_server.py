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


JOB = (
    '<?xml version="1.0"?><uws:job xmlns:uws="http://www.ivoa.net/xml/UWS/v1.0" version="1.1" '
    'xmlns:xlink="http://www.w3.org/1999/xlink"><uws:jobId>{number}</uws:jobId><uws:ownerId/><uws:phase>{phase}'
    "</uws:phase><uws:executionDuration>0</uws:executionDuration><uws:parameters/><uws:results><uws:result "
    'id="result" xlink:href="{address}/results/result"/></uws:results>{error}</uws:job>'
)
ERROR = '<uws:errorSummary type="fatal" hasDetail="true"><uws:message>{error}</uws:message></uws:errorSummary>'


def columns_of_ours(adql):
    """The answer to a question for the tables or columns of a schema: those that our own queries ask for."""
    from vsh.io.archive import ASTROMETRY, NEIGHBOURS, RELEASES, of_table

    schema = re.search(r"'(\w+)\.", adql)[1]
    release = next(each for each in RELEASES.values() if each.schema == schema)
    rows = set()
    queries = [NEIGHBOURS] if release.name == "DR4" else []
    for astrometry in ASTROMETRY[: 2 if release.name == "DR4" else 1]:
        queries.append(of_table("t.t", release=release, astrometry=astrometry))
    for asked in queries:
        places = {alias: table for table, alias in re.findall(r"JOIN ([\w.]+) AS (\w)", asked)}
        rows |= {f"{places[alias]},{name}" for alias, name in re.findall(r"\b([gsn])\.(\w+)", asked)}
    if "TAP_SCHEMA.tables" in adql:
        return "\n".join(["table_name", *sorted({row.partition(",")[0] for row in rows})])
    named = set(re.findall(r"'(\w+\.\w+)'", adql))
    return "\n".join(["table_name,column_name", *sorted(row for row in rows if row.partition(",")[0] in named)])


class Service:
    """What the server answers.

    Attributes
    ----------
    table : bytes or function
        The result, or what makes it of the query of the job.
    needs_run : bool
        A job waits until it is told to run (UWS 1.1: PHASE=RUN in the first form is optional).
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
        self.asked, self.jobs, self.status, self.needs_run, self.started = [], 0, 200, False, set()

    def submitted(self):
        return [form for method, path, form in self.asked if method == "POST" and path.endswith("/async")]

    def phase(self, job, goes_on=True):
        """The phase of a job, which goes on with every question for it."""
        if self.needs_run and job not in self.started:
            return "PENDING"
        return self.phases.pop(0) if goes_on and len(self.phases) > 1 else self.phases[0]


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
        if job := re.fullmatch(r"/tap/async/(\d+)/phase", path):
            service.started.add(job[1])
            return self.answer("", 303, Location=f"http://{self.headers['Host']}/tap/async/{job[1]}")
        if path.endswith("/sync"):
            return self.answer(columns_of_ours(form["QUERY"]))
        if service.refuse:
            return self.answer(VOTABLE.format(value="ERROR", text=service.refuse), 400)
        service.jobs += 1
        return self.answer("", 303, Location=f"http://{self.headers['Host']}/tap/async/{service.jobs}")

    def do_GET(self):
        service, path = self.server.service, self.path.partition("?")[0]  # ?WAIT= of UWS 1.1 is not obeyed
        service.asked.append(("GET", path, {}))
        job = re.fullmatch(r"/tap/async/(\d+)(/.*)?", path)
        if not job or int(job[1]) > service.jobs:
            return self.answer(VOTABLE.format(value="ERROR", text="no such job"), 404)
        if job[2] == "/phase":
            return self.answer(service.phase(job[1]))
        if job[2] == "/error":
            return self.answer(VOTABLE.format(value="ERROR", text=service.error))
        if job[2] == "/results/result":
            table = service.table
            return self.answer(
                table(service.submitted()[int(job[1]) - 1]["QUERY"]) if callable(table) else table, service.status
            )
        phase = service.phase(job[1], goes_on=False)
        error = ERROR.format(error=service.error) if phase == "ERROR" else ""
        address = f"http://{self.headers['Host']}/tap/async/{job[1]}"
        document = JOB.format(number=job[1], phase=phase, address=address, error=error)
        return self.answer(document, **{"Content-Type": "text/xml"})


@contextmanager
def running(handler):
    """A server on this machine whose requests a handler answers, and its address."""
    server = ThreadingHTTPServer(("127.0.0.1", 0), handler)
    threading.Thread(target=server.serve_forever, daemon=True).start()
    try:
        yield server, f"http://127.0.0.1:{server.server_port}"
    finally:
        server.shutdown()
        server.server_close()


@contextmanager
def serving(table):
    """The address of a service and what steers it."""
    with running(Handler) as (server, address):
        server.service = Service(table)
        yield f"{address}/tap", server.service


@contextmanager
def posting(reply):
    """The address of a server that gives `reply(path, form)`, a (status, body), and what it was asked."""
    asked = []

    class Posted(BaseHTTPRequestHandler):
        def log_message(self, *_):
            pass

        def do_POST(self):
            text = self.rfile.read(int(self.headers.get("Content-Length") or 0)).decode()
            form = dict(urllib.parse.parse_qsl(text))
            asked.append((self.path, form))
            status, body = reply(self.path, form)
            self.send_response(status)
            self.send_header("Content-Length", str(len(body)))
            self.end_headers()
            self.wfile.write(body)

    with running(Posted) as (_, address):
        yield address, asked
