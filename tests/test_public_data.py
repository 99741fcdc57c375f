"""The recordings of benchmarks.public_data that are not there."""

from pathlib import Path

import pytest

from benchmarks import public_data
from fasbody.exceptions import InputFileError


def test_what_cannot_be_fetched_is_one_sentence(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A source that is no repository, as without a network; what is there already is not fetched."""
    monkeypatch.setattr(public_data, "SOURCES", {str(tmp_path / "none"): ()})
    with pytest.raises(InputFileError, match=r"none: cannot be fetched from .*none.* \(.+\); try again") as caught:
        public_data.fetch(tmp_path / "folder")
    assert "\n" not in str(caught.value)
    (tmp_path / "folder" / "none").mkdir(parents=True)
    public_data.fetch(tmp_path / "folder")
