"""Checks ``#PBS`` lines against the reference: qsub(1B), pbs_resources(7B) of OpenPBS 20-23.

No real PBS is at hand to refuse a bad script, and PBS itself silently ignores some mistakes (a
directive after the first command), so this is strict: what it does not know is a mistake. Site
resources are allowed inside chunks only, as ``name=value``.
"""

from __future__ import annotations

import re
from collections.abc import Callable

_WALLTIME = re.compile(r"([0-9]{1,5}:)?[0-9]{1,2}:[0-9]{2}|[0-9]+")
_NAME = re.compile(r"[A-Za-z0-9][\x21-\x7e]{0,235}")
_RESOURCE = re.compile(r"[A-Za-z][A-Za-z0-9_-]*")
_COUNT = re.compile(r"[1-9][0-9]*")
_SIZE = re.compile(r"[1-9][0-9]*([kmgtp]?[bw])?", re.IGNORECASE)
_COUNTED = ("ncpus", "ngpus", "mpiprocs", "ompthreads", "nchunk", "naccelerators")
_SIZED = ("mem", "vmem", "pmem", "pvmem", "file")
_ARRANGEMENTS = ("free", "pack", "scatter", "vscatter")
_SHARINGS = ("excl", "shared", "exclhost")
_DEPEND = re.compile(
    r"((after|afterok|afternotok|afterany|before|beforeok|beforenotok|beforeany)(:[0-9]+[\w.\[\]-]*)+"
    r"|on:[1-9][0-9]*)(,.+)?"
)
_OLD = ("nodes", "neednodes")
_JOB_WIDE = (*_SIZED, "ncpus", "walltime", "min_walltime", "max_walltime", "cput", "pcput", "nice")


def lint(text: str) -> list[str]:
    """Mistakes of a job script, each one line that begins with ``line N:``; empty: none found."""
    mistakes: list[str] = []
    first_lines: dict[str, int] = {}
    command = 0
    for number, line in enumerate(text.splitlines(), 1):
        if not line.startswith("#PBS"):
            if re.match(r"\s+#PBS|#\s+PBS\s+-|#pbs\s+-", line):
                mistakes.append(
                    f"line {number}: a directive begins with '#PBS' in column 1: {line}"
                )
            if line.strip() and not line.startswith("#") and not command:
                command = number
            continue
        line_mistakes = _directive(line)
        if command:
            line_mistakes.append(f"PBS stops reading at the first command, which is line {command}")
        line_mistakes += _twice(line, first_lines, number)
        mistakes += [f"line {number}: {mistake}" for mistake in line_mistakes]
    if not text.startswith("#!/"):
        mistakes.insert(0, "line 1: no '#!/bin/bash'; PBS would use the login shell")
    if "-l walltime" not in first_lines:
        mistakes.append("no '#PBS -l walltime=HH:MM:SS'; the site's default may be minutes")
    if "-l select" not in first_lines:
        mistakes.append("no '#PBS -l select=...'; the job would get one CPU")
    return mistakes


def _directive(line: str) -> list[str]:
    if not re.match(r"#PBS [^ ]", line):
        return ["expected '#PBS', one space, and an option"]
    if line != line.rstrip():
        return ["ends with white space"]
    option, _, value = line[len("#PBS ") :].partition(" ")
    if option in _FLAGS:
        return [f"{option} takes no value, given {value!r}"] if value else []
    if option in _NOT_IN_SCRIPTS:
        return [f"{option} works on the command line of qsub only"]
    check = _OPTIONS.get(option)
    if check is None:
        known = " ".join(sorted([*_OPTIONS, *_FLAGS]))
        if option[:2] in _OPTIONS and len(option) > 2:
            return [f"write a space after {option[:2]}"]
        return [f"unknown option {option}; known: {known}"]
    if not value or value.startswith(" "):
        return [f"{option} needs a value after one space"]
    return check(value)


def _resources(value: str) -> list[str]:
    if " " in value:
        return [f"white space in the resources {value!r}"]
    name, equals, rest = value.partition("=")
    if not equals or not rest:
        return [f"expected name=value, given {value!r}"]
    if name == "select":
        return _select(rest)
    if name == "place":
        return _place(rest)
    mistakes = []
    for part in value.split(","):
        name, equals, rest = part.partition("=")
        if name in ("select", "place"):
            mistakes.append(f"{name} stands in a '-l' line of its own")
        elif name in _OLD:
            mistakes.append(f"{name}= is the old syntax; use select=N:ncpus=..:mpiprocs=..")
        elif name not in _JOB_WIDE:
            mistakes.append(f"{name} belongs into a chunk of select=, it is no job-wide resource")
        else:
            mistakes += _value(name, rest)
    return mistakes


def _select(value: str) -> list[str]:
    if "," in value:
        return ["a comma in select=; chunks are joined by '+', other resources have their own line"]
    mistakes = []
    for chunk in value.split("+"):
        parts = chunk.split(":")
        if _COUNT.fullmatch(parts[0]):
            parts = parts[1:]
        elif "=" not in parts[0]:
            mistakes.append(f"chunk {chunk!r}: begins with {parts[0]!r}, expected a number from 1")
            continue
        if not parts:
            mistakes.append(f"chunk {chunk!r}: asks for nothing, give ncpus= at least")
        names = [part.partition("=")[0] for part in parts]
        for name in sorted({name for name in names if names.count(name) > 1}):
            mistakes.append(f"chunk {chunk!r}: {name} appears twice")
        for part in parts:
            name, equals, rest = part.partition("=")
            if not equals or not rest or not _RESOURCE.fullmatch(name):
                mistakes.append(f"chunk {chunk!r}: expected name=value, given {part!r}")
            elif name in ("walltime", "cput", "place", "nodes"):
                mistakes.append(
                    f"chunk {chunk!r}: {name} is job-wide, give it in its own '-l' line"
                )
            else:
                mistakes += [f"chunk {chunk!r}: {mistake}" for mistake in _value(name, rest)]
    return mistakes


def _place(value: str) -> list[str]:
    mistakes = []
    kinds: list[str] = []
    for part in value.split(":"):
        kind = (
            "arrangement"
            if part in _ARRANGEMENTS
            else "sharing"
            if part in _SHARINGS
            else "grouping"
            if re.fullmatch(r"group=[A-Za-z][\w-]*", part)
            else ""
        )
        if not kind:
            allowed = ", ".join((*_ARRANGEMENTS, *_SHARINGS))
            mistakes.append(f"place={part}: allowed are {allowed} and group=RESOURCE")
        elif kind in kinds:
            mistakes.append(f"place={value}: two of the kind '{kind}'")
        kinds.append(kind)
    return mistakes


def _value(name: str, value: str) -> list[str]:
    kinds: list[tuple[bool, re.Pattern[str], str]] = [
        (name.endswith(("walltime", "cput")), _WALLTIME, "HH:MM:SS"),
        (name in _COUNTED, _COUNT, "a whole number from 1"),
        (name in _SIZED, _SIZE, "a size, e.g. 16gb"),
    ]
    for applies, pattern, words in kinds:
        if applies and not pattern.fullmatch(value):
            return [f"{name}={value}: expected {words}"]
    if name.endswith("walltime") and any(int(n) > 59 for n in value.split(":")[1:]):
        return [f"{name}={value}: expected HH:MM:SS"]
    return []


def _attributes(value: str) -> list[str]:
    name, equals, rest = value.partition("=")
    if not equals or not rest:
        return [f"expected attribute=value, given {value!r}"]
    known: dict[str, str] = {
        "group_list": r"[\w@.,-]+",
        "umask": r"[0-7]{1,4}",
        "run_count": r"[0-9]+",
        "sandbox": r"PRIVATE|HOME",
        "block": r"true",
        "stagein": r".+@.+:.+",
        "stageout": r".+@.+:.+",
    }
    if name == "depend":
        return [] if _DEPEND.fullmatch(rest) else [f"depend={rest}: expected e.g. afterany:12"]
    if name not in known:
        return [f"unknown attribute {name}; known: depend {' '.join(known)}"]
    return [] if re.fullmatch(known[name], rest) else [f"{name}={rest}: not allowed"]


def _like(pattern: str, words: str) -> Callable[[str], list[str]]:
    compiled = re.compile(pattern)
    return lambda value: [] if compiled.fullmatch(value) else [f"given {value!r}, expected {words}"]


def _twice(line: str, first_lines: dict[str, int], number: int) -> list[str]:
    """The later of two lines wins silently; resources with different names may repeat ``-l``."""
    option, _, value = line[len("#PBS ") :].partition(" ")
    names = [part.partition("=")[0] for part in value.split(",")]
    if option in ("-l", "-W"):
        keys = [f"{option} {name}" for name in (names if option == "-l" else names[:1])]
        if value.startswith(("select=", "place=")):
            keys = keys[:1]
    else:
        keys = [option]
    mistakes = [
        f"{key} again, first in line {first_lines[key]}" for key in keys if key in first_lines
    ]
    for key in keys:
        first_lines.setdefault(key, number)
    return mistakes


_FLAGS = ("-V", "-h", "-X")
_NOT_IN_SCRIPTS = ("-C", "-z", "-I", "-f", "-G")
_PATH = _like(r"[^\s:]+(:[^\s:]+)?", "[host:]path without white space")
_OPTIONS: dict[str, Callable[[str], list[str]]] = {
    "-a": _like(r"([0-9]{2}){2,6}(\.[0-5][0-9])?", "[[[[CC]YY]MM]DD]hhmm[.SS]"),
    "-A": _like(r"\S+", "a name without white space"),
    "-c": _like(r"[nscwu]|[cw]=[1-9][0-9]*", "n, s, c, w, c=MINUTES or w=MINUTES"),
    "-e": _PATH,
    "-j": _like(r"oe|eo|n", "oe, eo or n"),
    "-J": _like(r"[0-9]+-[0-9]+(:[1-9][0-9]*)?(%[1-9][0-9]*)?", "FIRST-LAST[:STEP][%AT_ONCE]"),
    "-k": _like(r"n|d?[oe]{1,2}", "n, or any of d, o and e"),
    "-l": _resources,
    "-m": _like(r"n|j?(?=[abe])a?b?e?", "n, or any of a, b and e"),
    "-M": _like(r"[\w.@,+-]+", "addresses with commas"),
    "-N": _like(_NAME.pattern, "a letter or digit, then printable characters, 236 in all"),
    "-o": _PATH,
    "-p": _like(r"-?([0-9]{1,3}|10[01][0-9]|102[0-3])|-1024", "-1024 to 1023"),
    "-P": _like(r'[^\s/\[\]";:|<>+,?*]+', "a project's name"),
    "-q": _like(r"[A-Za-z0-9_.-]+(@[\w.-]+)?|@[\w.-]+", "queue, queue@server or @server"),
    "-r": _like(r"[yn]", "y or n"),
    "-R": _like(r"o|e|oe|eo", "o, e or both"),
    "-S": _like(r"/[^\s,]+(,/[^\s,]+)*", "the absolute path of a shell"),
    "-u": _like(r"[\w@.,-]+", "user names"),
    "-v": _like(r"\S+", "names or name=value with commas, without white space"),
    "-W": _attributes,
}
