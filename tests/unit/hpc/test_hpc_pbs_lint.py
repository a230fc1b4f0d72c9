"""The linter refuses every kind of mistake in ``#PBS`` lines, and nothing that is right."""

import pytest

from hpc.pbs.lint import lint

GOOD = """\
#!/bin/bash
#PBS -N night
#PBS -l walltime=72:00:00
#PBS -l select=2:ncpus=4:ngpus=1:mpiprocs=1:mem=16gb+1:ncpus=8:model=milan
#PBS -l place=scatter:excl
"""


def test_good():
    assert lint(GOOD + "echo\n") == []


@pytest.mark.parametrize(
    "line",
    [
        "#PBS -q gpu@head",
        "#PBS -A proj-1",
        "#PBS -P proj_1",
        "#PBS -W group_list=robots",
        "#PBS -W depend=afterany:12.head:13.head",
        "#PBS -W umask=022",
        "#PBS -j oe",
        "#PBS -k doe",
        "#PBS -o /logs/night.log",
        "#PBS -r y",
        "#PBS -m abe",
        "#PBS -M me@example.org",
        "#PBS -J 0-255%8",
        "#PBS -p -1024",
        "#PBS -S /bin/bash",
        "#PBS -v A=1,B",
        "#PBS -V",
        "#PBS -a 2359",
        "#PBS -c n",
        "#PBS -l mem=4gb",
    ],
)
def test_good_lines(line):
    assert lint(f"{GOOD}{line}\n") == []


@pytest.mark.parametrize(
    ("line", "said"),
    [
        ("#PBS -lmem=4gb", "write a space after -l"),
        ("#PBS  -j oe", "one space"),
        ("#PBS\t-j oe", "one space"),
        ("#PBS -j oe ", "white space"),
        ("# PBS -j oe", "column 1"),
        (" #PBS -j oe", "column 1"),
        ("#pbs -j oe", "column 1"),
        ("#PBS -j both", "oe, eo or n"),
        ("#PBS -j", "needs a value"),
        ("#PBS -Q gpu", "unknown option -Q"),
        ("#PBS --queue gpu", "unknown option --queue"),
        ("#PBS -I", "command line of qsub only"),
        ("#PBS -V yes", "takes no value"),
        ("#PBS -q a b", "queue"),
        ("#PBS -A two words", "white space"),
        ("#PBS -P a:b", "project"),
        ("#PBS -r yes", "y or n"),
        ("#PBS -k oen", "d, o and e"),
        ("#PBS -m always", "a, b and e"),
        ("#PBS -p 1024", "-1024 to 1023"),
        ("#PBS -J 5", "FIRST-LAST"),
        ("#PBS -a 9", "hhmm"),
        ("#PBS -S bash", "absolute path"),
        ("#PBS -o my log", "path"),
        ("#PBS -v A = 1", "without white space"),
        ("#PBS -N again", "-N again, first in line 2"),
        ("#PBS -l walltime=1:00:00", "-l walltime again"),
        ("#PBS -l nodes=2:ppn=4", "old syntax"),
        ("#PBS -l ngpus=2", "chunk"),
        ("#PBS -l mem=lots", "a size"),
        ("#PBS -l mem = 4gb", "white space"),
        ("#PBS -l mem", "name=value"),
        ("#PBS -l mem=4gb,select=1:ncpus=1", "line of its own"),
        ("#PBS -W depend=after", "afterany"),
        ("#PBS -W umask=9", "not allowed"),
        ("#PBS -W colour=red", "unknown attribute"),
        ("#PBS -W block", "attribute=value"),
    ],
)
def test_bad_lines(line, said):
    mistakes = lint(f"{GOOD}{line}\n")
    assert any(said in mistake for mistake in mistakes), mistakes
    assert all(mistake.startswith("line 6:") for mistake in mistakes)


@pytest.mark.parametrize(
    ("resources", "said"),
    [
        ("select=2:ncpus=1,walltime=1:00:00", "a comma in select="),
        ("select=0:ncpus=1", "expected a number from 1"),
        ("select=two:ncpus=1", "expected a number from 1"),
        ("select=2", "asks for nothing"),
        ("select=2:ncpus", "name=value"),
        ("select=2:ncpus=0", "a whole number from 1"),
        ("select=2:ncpus=four", "a whole number from 1"),
        ("select=2:ncpus=1:ngpus=0", "a whole number from 1"),
        ("select=2:ncpus=1:mem=4GiB", "a size"),
        ("select=2:ncpus=1:ncpus=2", "appears twice"),
        ("select=2:ncpus=1:walltime=1:00:00", "job-wide"),
        ("select=2:ncpus=1+", "number from 1"),
    ],
)
def test_bad_chunks(resources, said):
    text = GOOD.replace(
        "select=2:ncpus=4:ngpus=1:mpiprocs=1:mem=16gb+1:ncpus=8:model=milan", resources
    )
    assert any(said in mistake for mistake in lint(text)), lint(text)


@pytest.mark.parametrize(
    ("place", "said"),
    [("everywhere", "allowed are"), ("free:pack", "two of the kind"), (":excl", "allowed are")],
)
def test_bad_places(place, said):
    assert any(said in m for m in lint(GOOD.replace("scatter:excl", place)))


@pytest.mark.parametrize("walltime", ["1:60:00", "1:00", "1h", "100:00:0"])
def test_walltimes(walltime):
    found = lint(GOOD.replace("72:00:00", walltime))
    assert bool(found) == (walltime != "1:00"), "MM:SS is allowed"


def test_after_the_first_command_nothing_counts():
    (mistake,) = lint(GOOD + "cd /work\n#PBS -q gpu\n")
    assert "first command, which is line 6" in mistake


def test_what_every_script_needs():
    said = lint("#PBS -N night\necho\n")
    assert [mistake.split(";")[0] for mistake in said] == [
        "line 1: no '#!/bin/bash'",
        "no '#PBS -l walltime=HH:MM:SS'",
        "no '#PBS -l select=...'",
    ]
