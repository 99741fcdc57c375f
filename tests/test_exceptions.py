"""Errors travel from a worker process as the sentence that they are."""

import pickle
from pathlib import Path

import pytest

from fasbody import exceptions
from fasbody.exceptions import FasError, InputFileError, MissingPackageError, SettingError


@pytest.mark.parametrize(
    "error",
    [
        InputFileError(Path("a.csv"), "is empty", "give numbers", 3),
        MissingPackageError("h5py", "formats"),
        SettingError("no"),
    ],
)
def test_an_error_comes_back_from_another_process(error: FasError) -> None:
    again = pickle.loads(pickle.dumps(error))
    assert type(again) is type(error) and str(again) == str(error)


def test_every_error_is_one_that_commands_print() -> None:
    kinds = [kind for kind in vars(exceptions).values() if isinstance(kind, type) and issubclass(kind, Exception)]
    assert len(kinds) > 8
    assert all(issubclass(kind, FasError | exceptions.Stopped) for kind in kinds)
