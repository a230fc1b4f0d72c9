"""A page of the console without a browser: follows its events over real HTTP, and asks for data."""

import http.client
import json
import socket
import threading
from urllib.parse import urlsplit

from processes import PATIENCE_S


class ConsolePage:
    """What a page knows: the table as the events have made it, and the last event's id."""

    def __init__(self, url, run):
        address, _, token = url.partition("#steer=")
        self.host = urlsplit(address).netloc
        self.token, self.run = token, run
        self.last_id = ""
        self.table, self.log, self.hellos, self.gone = {}, [], [], []
        self.pictures = 0
        self._lock = threading.Lock()
        self._line = None

    def follow(self):
        """Open the stream; from where the page was, if it was somewhere."""
        line = http.client.HTTPConnection(self.host, timeout=PATIENCE_S)
        headers = {"Last-Event-ID": self.last_id} if self.last_id else {}
        line.request("GET", "/data/events", headers=headers)
        self._line = line.sock  # the connection itself forgets it
        answer = line.getresponse()
        assert answer.status == 200
        threading.Thread(target=self._read, args=(answer,), daemon=True).start()

    def cut(self):
        """The network is gone: the line ends without a word."""
        self._line.shutdown(socket.SHUT_RDWR)

    def data(self, path, **headers):
        """Data of an address."""
        status, data = self.request("GET", f"/data/{path}", None, headers)
        assert status == 200, data
        return json.loads(data)

    def act(self, name, **body):
        """Status and answer of an act."""
        headers = {
            "Origin": f"http://{self.host}",
            "Content-Type": "application/json",
            "X-Steer-Token": self.token,
        }
        status, data = self.request("POST", f"/act/{name}", json.dumps(body), headers)
        return status, json.loads(data)

    def request(self, method, path, body, headers):
        """Status and content of any request."""
        line = http.client.HTTPConnection(self.host, timeout=PATIENCE_S)
        line.request(method, path, body, headers)
        answer = line.getresponse()
        data = answer.read()
        line.close()
        return answer.status, data

    def verdicts(self):
        """Verdict by case, as this page knows it."""
        with self._lock:
            if not self.table:
                return {}
            columns = self.table["columns"]
            return dict(zip(self.table["cases"], columns["verdict"], strict=True))

    def _read(self, answer):
        kind = ""
        try:
            while text := answer.readline():
                name, _, value = text.strip().partition(b": ")
                if name == b"id":
                    self.last_id = value.decode()
                elif name == b"event":
                    kind = value.decode()
                elif name == b"data":
                    self._take(kind, json.loads(value))
        except (OSError, ValueError, http.client.HTTPException):
            return  # cut

    def _take(self, kind, data):
        if kind == "hello":
            self.hellos.append(data)
            if data["resync"] or not self.table:
                self._ask()
        elif kind == "table" and data["run"] == self.run:
            if data.get("reset"):
                self._ask()
                return
            with self._lock:
                self.table["cases"] += data["cases"]
                for index, cells in data["rows"].items():
                    for column, value in cells.items():
                        values = self.table["columns"].setdefault(column, [])
                        values += [None] * (len(self.table["cases"]) - len(values))
                        values[int(index)] = value
        elif kind == "log":
            self.log.append(data["text"])
        elif kind == "picture":
            self.pictures += len(data["pictures"])
        elif kind == "gone":
            self.gone.append(data)

    def _ask(self):
        runs = [row["id"] for row in self.data("runs.json")["runs"]]
        if self.run in runs:
            table = self.data(f"runs/{self.run}/table.json")
            with self._lock:
                self.table = table
