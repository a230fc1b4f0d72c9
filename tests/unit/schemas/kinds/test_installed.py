"""Distributions are found as ``importlib.metadata`` finds them."""

import importlib.metadata
import sys

from foreign_distributions import install

from schemas.kinds.installed import metadata_folders, normalized, version_of
from schemas.kinds.registry import installed_plugins


def test_every_distribution_has_its_version():
    folders = metadata_folders()
    assert folders is not None
    seen = {normalized(each.metadata["Name"]) for each in importlib.metadata.distributions()}
    assert set(folders) == seen
    for name in seen:
        assert version_of(name) == importlib.metadata.version(name), name
    assert version_of("no-such-distribution") == ""


def test_the_first_on_the_import_path_counts(tmp_path, monkeypatch):
    for folder, version in (("one", "1.0"), ("two", "2.0")):
        (tmp_path / folder).mkdir()
        install(tmp_path / folder, "Some.Plug_in", version, "[drivetwin.kpis]\nk = no:K\n")
        monkeypatch.syspath_prepend(tmp_path / folder)
    assert version_of("some_plug.in") == importlib.metadata.version("some-plug-in") == "2.0"
    assert installed_plugins()["Some.Plug_in"] == "2.0"


def test_other_finders_of_distributions_are_asked(tmp_path, monkeypatch):
    """An import hook may bring distributions that lie in no folder of the import path."""
    install(tmp_path, "hooked", "3.0", "[drivetwin.kpis]\nk = no:K\n")

    class Hook:
        @staticmethod
        def find_spec(*_):
            return None

        @staticmethod
        def find_distributions(context):
            place = importlib.metadata.DistributionFinder.Context(
                name=context.name, path=[str(tmp_path)]
            )
            return importlib.metadata.MetadataPathFinder.find_distributions(place)

    assert version_of("hooked") == ""
    monkeypatch.setattr(sys, "meta_path", [*sys.meta_path, Hook])
    assert version_of("hooked") == "3.0"
    assert installed_plugins()["hooked"] == "3.0"
