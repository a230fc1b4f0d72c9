"""Samples for the recorder, gathered: exact limits, and nothing is lost on the way."""

from view_messages import camera, state

from schemas.wire.codec import FREE_BYTES_MAX, decode
from schemas.wire.view import RecorderBatch, RecorderSample
from twin.view.batch import AGE_MAX_S, BYTES_MAX, SAMPLE_BYTES, SampleBatch


def test_the_oldest_sample_decides_how_long_all_wait():
    batch = SampleBatch()
    assert batch.left_s(1e9) is None, "nothing to be sent"
    batch.add(RecorderSample(state=state(1)), 100.0)
    batch.add(RecorderSample(state=state(2)), 100.0 + AGE_MAX_S / 2)
    assert batch.left_s(100.0 + AGE_MAX_S / 2) == AGE_MAX_S / 2
    assert batch.left_s(100.0 + AGE_MAX_S) == 0.0
    assert batch.left_s(200.0) == 0.0
    sent = decode(batch.take(), RecorderBatch).samples
    assert [sample.state.seq for sample in sent] == [1, 2]
    assert batch.left_s(200.0) is None
    batch.add(RecorderSample(state=state(3)), 200.0)
    assert batch.left_s(200.0) == AGE_MAX_S, "those that were sent count no more"


def test_large_pictures_do_not_wait():
    batch = SampleBatch()
    jpeg = b"x" * (BYTES_MAX - SAMPLE_BYTES - 1)
    batch.add(RecorderSample(camera=camera(1, 0), jpeg=jpeg), 0.0)
    assert batch.left_s(0.0) == AGE_MAX_S
    batch.add(RecorderSample(state=state(2)), 0.0)
    assert batch.left_s(0.0) == 0.0
    data = batch.take()
    assert len(data) < FREE_BYTES_MAX, "decoded without being counted first"
    assert decode(data, RecorderBatch).samples[0].jpeg == jpeg


def test_after_a_large_batch_small_samples_wait_again():
    batch = SampleBatch()
    batch.add(RecorderSample(camera=camera(1, 0), jpeg=b"x" * BYTES_MAX), 0.0)
    assert batch.left_s(0.0) == 0.0
    batch.take()
    batch.add(RecorderSample(state=state(2)), 5.0)
    assert batch.left_s(5.0) == AGE_MAX_S
