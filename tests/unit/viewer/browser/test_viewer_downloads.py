"""Large recordings on slow lines: they pass from the disk, so nothing of them lies in memory."""

import http.client
import threading
import tracemalloc
from contextlib import ExitStack

from unit.viewer.recorded_case import write
from waiting import PATIENCE_S, wait_for

from viewer.browser.front import DOWNLOADS_MAX, BrowserFront, ShownSite
from viewer.console.run_folder import find_runs
from viewer.console.site import ConsoleSite

RECORDING_BYTES = 300_000_000


def test_slow_downloads_take_no_memory_and_are_counted(tmp_path):
    write(tmp_path / "cases" / "c" / "attempt-1", case="c")
    with (tmp_path / "cases" / "c" / "attempt-1" / "recording.rrd").open("r+b") as file:
        file.truncate(RECORDING_BYTES)
    with ExitStack() as stack:
        server = stack.enter_context(
            BrowserFront(0, ShownSite({}, ConsoleSite(find_runs(tmp_path))))
        )
        threading.Thread(target=server.serve_forever, daemon=True).start()
        stack.callback(server.shutdown)

        def ask():
            address = ("127.0.0.1", server.server_address[1])
            connection = http.client.HTTPConnection(*address, timeout=PATIENCE_S)
            stack.callback(connection.close)
            connection.request("GET", "/recording/c.rrd")
            return connection, connection.getresponse()

        tracemalloc.start()
        slow = [ask() for _ in range(DOWNLOADS_MAX)]
        assert {answer.status for _, answer in slow} == {200}
        assert {answer.headers["Content-Length"] for _, answer in slow} == {str(RECORDING_BYTES)}
        assert {len(answer.read(1000)) for _, answer in slow} == {1000}
        assert ask()[1].status == 503, "one more waits for its turn"
        peak = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
        assert peak < RECORDING_BYTES / 10, "not one of them"
        slow[0][1].close()
        slow[0][0].close()
        wait_for(lambda: ask()[1].status == 200, "a turn after somebody left")
