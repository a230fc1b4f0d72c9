"""``twin bench drive`` runs real stacks, and says what it could not measure."""

import json

from autodrive_environments import missing_today


def test_the_drive_plane_is_faster_than_the_bridge(marked):
    """Both run; how fast they are is the machine's business, which of them is faster is not."""
    done = marked.run("twin", "bench", "drive", "--ticks", "10", "--output", "json")
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout)
    assert found["shared_ticks_per_s"] > 0
    assert found["payload_ticks_per_s"] > 0
    if missing_today():
        assert found["bridge_ticks_per_s"] is None
        assert found["ratio"] is None
    else:
        assert found["ratio"] > 1
