"""The live wall: which cases are shown, where, in which colour."""

import numpy as np
from view_messages import thumbnail

from twin.view.samples import jpeg
from viewer.live import mosaic
from viewer.live.hub import ViewerHub
from viewer.live.overview import TILES_MAX, Overview, _color
from viewer.live.renewal import Renewal
from viewer.recording import naming
from viewer.recording.scenery import BLUE, GREEN, RED

RED_PICTURE = np.full((36, 64, 3), (250, 10, 10), np.uint8)


def test_tiles_do_not_overlap_and_fit():
    for count in (0, 1, 2, 5, 16, 17, 64):
        used = np.zeros((mosaic.HEIGHT_PX, mosaic.WIDTH_PX), int)
        grid = mosaic.Grid(count)
        for x, y, w, h in grid.boxes_px():
            assert x + w <= mosaic.WIDTH_PX
            assert y + h + grid.label_px <= mosaic.HEIGHT_PX
            used[y : y + h, x : x + w] += 1
        assert used.max(initial=0) <= 1
        width, height = grid.tile_px
        assert used.sum() == count * width * height
        assert width >= mosaic.TILE_WIDTH_PX


def test_pictures_arrive_in_their_tiles_with_their_colours():
    picture = mosaic.decoded(jpeg(RED_PICTURE))
    tiles = [mosaic.MosaicTile(None, "a", BLUE), mosaic.MosaicTile(picture, "b", GREEN, ended=True)]
    wall = mosaic.compose(tiles)
    x, y = mosaic.Grid(2).corner_px(1)
    width, height = mosaic.Grid(2).tile_px
    middle = wall[y + height // 2, x + width // 2]
    assert middle[2] > 200, "BGR"
    assert middle[0] < 60
    assert tuple(wall[y + height + 2, x + width - 2]) == GREEN[::-1], "its verdict below"
    x, y = mosaic.Grid(2).corner_px(0)
    assert (wall[y : y + height, x : x + width] == mosaic.BACKGROUND).all()
    strip = wall[y + height : y + height + mosaic.Grid(2).label_px - 4, x : x + width]
    assert (strip != mosaic.BACKGROUND).any(), "its name, on no colour as it runs"
    assert (strip[:, -2] == mosaic.BACKGROUND).all()


def test_the_wall_never_changes_its_size():
    overview = Overview()
    sizes = set()
    for index in range(5):
        overview.take(thumbnail(f"c{index}"), jpeg(RED_PICTURE))
        image = dict(overview.logged())[naming.MOSAIC]
        data = image.blob.as_arrow_array().to_pylist()[0]
        sizes.add(mosaic.decoded(bytes(data)).shape)
    assert sizes == {(mosaic.HEIGHT_PX, mosaic.WIDTH_PX, 3)}


def test_a_damaged_picture_is_none():
    assert mosaic.decoded(b"nonsense") is None
    assert mosaic.decoded(b"") is None


def test_ended_cases_make_room_first():
    overview = Overview()
    picture = jpeg(RED_PICTURE)
    for index in range(TILES_MAX):
        overview.take(thumbnail(f"c{index}"), picture)
    overview.take(thumbnail("c5", outcome="verdict", verdict="pass"), picture)
    overview.take(thumbnail("new"), picture)
    assert len(overview.tiles) == TILES_MAX
    assert ("demo", "c5") not in overview.tiles
    overview.take(thumbnail("newer"), picture)
    assert ("demo", "c0") not in overview.tiles, "without ended ones the oldest goes"
    assert overview.verdicts == {("demo", "c5"): "pass"}


def test_the_table_tells_running_and_ended():
    overview = Overview()
    picture = jpeg(RED_PICTURE)
    overview.take(thumbnail("a", outcome="verdict", verdict="collision"), picture)
    overview.take(thumbnail("b", aeb=True), picture)
    table = overview.table()
    assert table.startswith("**1 running**, 1 collision")
    assert table.index("| b | AEB") < table.index("| a | collision")
    assert [path for path, _ in overview.logged()] == [naming.MOSAIC, naming.TILES, naming.CASES]


VERDICT = {"outcome": "verdict", "verdict": "pass", "passed": True}


def shown(overview, case="a"):
    """Token, and what is said of the case."""
    tile = overview.tiles["demo", case].thumbnail
    return tile.token, tile.verdict or tile.outcome or "running"


def test_late_thumbnails_of_other_attempts_do_not_take_a_verdict_back():
    overview = Overview()
    assert overview.take(thumbnail("a", token=8), b"")
    assert not overview.take(thumbnail("a", token=7), b"")
    assert overview.take(thumbnail("a", token=8, **VERDICT), b"")
    for late in (thumbnail("a", token=8), thumbnail("a", token=7)):
        assert not overview.take(late, b"")
    assert shown(overview) == (8, "pass")
    assert overview.take(thumbnail("a", token=9), b"")
    assert shown(overview) == (9, "running"), "another attempt"
    assert overview.verdicts == {}


def test_what_the_conductor_says_of_the_end_counts():
    overview = Overview()
    case = {"campaign": "demo", "case": "a"}
    overview.take(thumbnail("a", token=7), b"")
    assert overview.event({"fact": "attempt_ended", **case, "token": 7, "reason": "crash"})
    assert shown(overview) == (7, "crash")
    assert overview.verdicts == {}, "it waits for another attempt"
    overview.take(thumbnail("a", token=7), b"")
    assert shown(overview) == (7, "crash")
    overview.take(thumbnail("a", token=8), b"")
    assert not overview.event({"fact": "attempt_ended", **case, "token": 7, "reason": "lost"})
    assert shown(overview) == (8, "running")
    assert overview.event({"fact": "case_ended", **case, "outcome": "unresolved", "reason": "r"})
    assert shown(overview) == (8, "unresolved")
    overview.take(thumbnail("a", token=9), b"")
    assert shown(overview) == (9, "running"), "it was retried"
    result = {**case, "token": 8, **VERDICT}
    assert overview.event({"fact": "committed", "result": result})
    overview.take(thumbnail("a", token=10), b"")
    assert shown(overview) == (10, "pass"), "nothing runs after that"
    assert overview.verdicts == {("demo", "a"): "pass"}
    overview.forget("demo")
    overview.take(thumbnail("a", token=1), b"")
    assert shown(overview) == (1, "running"), "the campaign was begun anew"
    assert not overview.event({"fact": "leased", **case})


def test_a_campaign_that_was_begun_anew_is_noticed():
    renewal = Renewal()

    def status(**changes):
        epoch, row = changes.pop("epoch", 2), {"out": "/runs/a", "attempts": 5, **changes}
        return {"epoch": epoch, "campaigns": {"demo": row}}

    for changes in ({}, {"attempts": 6}, {"attempts": 6, "epoch": 3}):
        assert renewal.status(status(**changes)) == []
    for changes in ({"attempts": 0, "epoch": 3}, {"epoch": 1}, {"epoch": 1, "out": "/runs/b"}):
        assert renewal.status(status(**changes)) == ["demo"]


def test_colours():
    assert _color(thumbnail()) == BLUE
    assert _color(thumbnail(outcome="verdict", verdict="pass")) == GREEN
    assert _color(thumbnail(outcome="verdict", verdict="collision")) == RED


class StuckStream:
    """A recording stream whose viewer is frozen: nothing can be flushed."""

    def __init__(self):
        self.stuck = True
        self.logged = 0

    def flush(self, timeout_sec):
        if self.stuck:
            raise RuntimeError("timeout")

    def set_time(self, *_, **__):
        pass

    def log(self, *_):
        self.logged += 1


def test_nothing_is_logged_while_a_viewer_is_stuck():
    overview = Overview()
    overview.take(thumbnail("a"), jpeg(RED_PICTURE))
    hub = ViewerHub(StuckStream(), "rerun+http://127.0.0.1:1/proxy")
    assert not hub.open()
    assert not hub.open()
    assert (hub.logged, hub.skipped, hub._stream.logged) == (0, 2, 0)
    hub._stream.stuck = False
    assert hub.open()
    hub.show(overview, 3.0)
    assert (hub.logged, hub._stream.logged) == (1, 3)
