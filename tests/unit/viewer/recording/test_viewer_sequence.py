"""Running numbers: gaps are counted, old samples refused."""

from viewer.recording.recording import Sequence


def test_nothing_missing():
    sequence = Sequence()
    assert all(sequence.take(seq) for seq in range(5))
    assert sequence.complete
    assert (sequence.received, sequence.lost) == (5, 0)


def test_a_gap_is_counted_once():
    sequence = Sequence()
    sequence.take(0)
    sequence.take(3)
    sequence.take(4)
    assert (sequence.received, sequence.lost) == (3, 2)
    assert not sequence.complete


def test_the_first_samples_may_be_missing():
    sequence = Sequence()
    sequence.take(2)
    assert sequence.lost == 2


def test_an_old_sample_is_refused():
    sequence = Sequence()
    sequence.take(0)
    sequence.take(1)
    assert not sequence.take(1)
    assert (sequence.received, sequence.lost) == (2, 0)


def test_several_samples_in_one_message():
    sequence = Sequence()
    assert sequence.take(0, count=5)
    assert sequence.take(5, count=2)
    assert not sequence.take(6)
    assert sequence.take(9)
    assert (sequence.received, sequence.lost) == (8, 2)
